# Copyright 2026 The ctc_chattering maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Types of the arguments of public functions and classes, checked where they are called.

A wrong one, or a call that has not the right arguments, raises a `CtcError` that names it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import functools
import inspect
from math import isfinite
from numbers import Integral, Real
from typing import Any, cast, TypeVar

from ctc_chattering.errors import CtcError, ParameterError
import numpy as np
import numpy.typing as npt

F = TypeVar('F', bound=Callable[..., Any])
_WORDS = {Real: 'a finite number', type(None): 'None', Sequence: 'a sequence',
          cast('type', Callable): 'a function'}


def checked(**kinds: Any) -> Callable[[F], F]:
    """
    Return a decorator of a function, or of a class and its `__init__`, that checks arguments.

    Parameters
    ----------
    **kinds : type or tuple of types
        By the argument's name; `Real` stands for finite numbers, `Sequence` for any but strings,
        `Callable` for functions.

    """
    def decorate(target: F) -> F:
        if inspect.isclass(target):
            setattr(target, '__init__', _checking(  # noqa: B010
                target.__init__, kinds, target.__name__))
            return target
        made: F = _checking(target, kinds, target.__name__)
        return made
    return decorate


def _checking(function: Any, kinds: dict[str, type | tuple[type, ...]], name: str) -> Any:
    signature = inspect.signature(function)

    @functools.wraps(function)
    def call(*args: Any, **more: Any) -> Any:
        try:
            given = signature.bind(*args, **more).arguments
        except TypeError as error:
            raise CtcError(f'{name}: {error}') from None
        for key, value in given.items():
            if key in kinds:
                check_type(key, value, kinds[key])
        return function(*args, **more)
    return call


def check_type(name: str, value: object, kind: type | tuple[type, ...]) -> None:
    """Raise `ParameterError` unless a value is of a type, or one of several; see `checked`."""
    kinds = kind if isinstance(kind, tuple) else (kind,)
    if not any(_is(value, x) for x in kinds):
        raise ParameterError(name, value, ' or '.join(
            _WORDS.get(x, f'of type {x.__name__}') for x in kinds))


def check_each(name: str, values: Sequence[object], kind: type | tuple[type, ...],
               least: int = 0) -> None:
    """Raise `ParameterError` unless all values are as `check_type` wants, and there are enough."""
    for i, value in enumerate(values):
        check_type(f'{name}[{i}]', value, kind)
    if len(values) < least:
        raise ParameterError(name, values, f'{"one" if least == 1 else least} or more')


def whole(name: str, value: Any, least: int | None = None, most: int = 2 ** 32 - 1) -> int:
    """Return a whole number as an `int`; raise `ParameterError` if it is none, or out of range."""
    if not isinstance(value, Integral) or isinstance(value, bool) or (
            least is not None and not least <= int(value) <= most):
        raise ParameterError(name, value, 'a whole number' + (
            '' if least is None else f' >= {least} and <= {most}'))
    return int(value)


def vector(name: str, values: Any, n: int) -> npt.NDArray[np.float64]:
    """Return `n` numbers as an array; raise `ParameterError` if they are something else."""
    try:
        found = np.array(values, float)
    except (TypeError, ValueError, OverflowError):
        found = np.empty(0)
    if found.shape != (n,):
        raise ParameterError(name, values, f'{n} numbers')
    return found


def _is(value: object, kind: type) -> bool:
    if kind is Real:
        return isinstance(value, Real) and not isinstance(value, bool) and _is_finite(value)
    if kind is Sequence and isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, kind) and not (kind is Sequence and isinstance(value, (str, bytes)))


def _is_finite(value: Any) -> bool:
    try:
        return isfinite(value)
    except OverflowError:  # A whole number that is no float.
        return False
