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
Declaration of parameters: one place for type, unit, default, range and description.

A configuration is a frozen dataclass derived from `Config` whose fields are made by `parameter`.
The YAML file, the ROS nodes, `ctc` and the README's tables are all served from these fields. What
functions check of their arguments beyond types is at the end.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import copy
import dataclasses
from functools import cached_property
import importlib
import inspect
import math
import re
from typing import Any, ClassVar, TypeVar
import warnings

from ctc_chattering.errors import CtcError, near, ParameterError, refused_as
import numpy as np
import numpy.typing as npt

C = TypeVar('C', bound='Config')

#: Least magnitude of a number that must not be 0, and largest of any that is not infinite: what is
#: beyond is no gain, time, torque or length, and its products leave the range of floats.
LEAST, LARGEST = 1e-9, 1e9
#: What a class of the user's is called: ``package.module:Name``.
OWN_CLASS = re.compile(r'[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*')
#: Kinds of annotations that are no kind themselves, and shapes that they imply.
_KINDS = {'tuple[float, ...]': 'float[]', 'tuple[str, ...]': 'str[]'}
_SHAPES = {'tuple[float, ...]': 'n'}
_TYPE_NAMES = {
    'bool': 'a boolean', 'int': 'an integer', 'float': 'a number', 'str': 'a string',
    'float[]': 'a list of numbers', 'str[]': 'a list of strings'}
#: How a scalar of each kind is made, and of what; a boolean is no number.
_SCALARS: dict[str, tuple[Any, Any]] = {
    'bool': (bool, bool), 'int': (int, (int, np.integer)),
    'float': (float, (int, float, np.integer, np.floating)), 'str': (str, str)}


@dataclasses.dataclass(frozen=True)
class Parameter:
    """
    What is known of one parameter besides its value.

    Attributes
    ----------
    name : str
        As in the YAML file, for example ``disturbance.amplitude``.
    kind : {'bool', 'int', 'float', 'str', 'float[]', 'str[]'}
        Its type.
    default : object
        A scalar for a ``float[]`` stands for that value on every joint; numbers for each are
        those of as many joints, and 0 is the default of others.
    description, unit : str
        For `ros2 param describe` and the README.
    minimum, maximum : float
        Range of the value, or of each element; numbers are within ±`LARGEST` in any case, and
        `LEAST` is the minimum of what must not be 0.
    infinite : bool
        Whether infinity is a value.
    choices : tuple of str
        The only strings allowed; empty for any.
    own : bool
        Whether a class of the user's is allowed besides, itself or as ``package.module:Name``.
    shape : {'', 'n', 'nn'}
        For lists: any number of elements; one per joint; n or n·n (a symmetric positive definite
        matrix, row by row).
    read_only : bool
        Whether it is fixed once the node runs.
    laws : tuple of str
        The control laws that take it; empty for all, and for what has no law.
    usual : (float, float)
        From where to where a slider goes.

    """

    name: str
    kind: str
    default: Any
    description: str
    unit: str = ''
    minimum: float = -math.inf
    maximum: float = math.inf
    infinite: bool = False
    choices: tuple[str, ...] = ()
    own: bool = False
    shape: str = ''
    read_only: bool = False
    laws: tuple[str, ...] = ()
    usual: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def field(self) -> str:
        """Name in the dataclass: ``lambda`` is a keyword, and a dot is no identifier."""
        return 'lambda_' if self.name == 'lambda' else self.name.replace('.', '_')

    @property
    def meaning(self) -> str:
        """Return the description, and the laws that take it."""
        return self.description + (f' Law {", ".join(self.laws)}.' if self.laws else '')

    @property
    def allowed(self) -> str:
        """Return what is allowed, in words."""
        if self.choices:
            return ' | '.join((*(x or "''" for x in self.choices),
                               *['package.module:Name'] * self.own))
        text = _TYPE_NAMES[self.kind]
        if self.kind in ('float', 'float[]', 'int'):
            low, high = self.bounds
            text = text.replace('number', 'finite number') if not self.infinite else text
            text += f' >= {low:g} and <= {high:g}{", or inf" if self.infinite else ""}'
        if self.shape == 'nn':
            text += ', one for all, one per joint or n*n row by row, symmetric positive definite'
        elif self.shape == 'n':
            text += ', one for all or one per joint'
        return text

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest finite value."""
        most = 2 ** 62 if self.kind == 'int' else LARGEST
        return max(self.minimum, -most), min(self.maximum, most)

    def default_for(self, n: int) -> Any:
        """Return the default for `n` joints."""
        if self.kind != 'float[]' or (isinstance(self.default, tuple) and n == len(self.default)):
            return self.default
        return (0.0 if isinstance(self.default, tuple) else float(self.default),) * n

    def coerce(self, value: object, n: int = 0) -> Any:
        """
        Return `value` as this parameter's Python type, integers as floats where floats are due.

        Parameters
        ----------
        value : object
            Of any type.
        n : int
            Number of joints, each of which one number is for, in a list or not; 0 if it is not
            known, and a number for all is no value.

        Raises
        ------
        ParameterError
            If the type does not fit.

        """
        if not self.kind.endswith('[]'):
            return self._scalar(value, value)
        each = self.kind == 'float[]' and self.shape in ('n', 'nn') and n > 0
        if isinstance(value, (list, tuple, array)) or (
                isinstance(value, np.ndarray) and value.ndim == 1):
            items = tuple(self._scalar(item, value) for item in value)
            return items * n if each and len(items) == 1 else items
        if each:
            return (self._scalar(value, value),) * n
        raise ParameterError(self.name, value, self.allowed)

    def _scalar(self, item: object, whole: object) -> Any:
        if self.own and isinstance(item, type):
            return f'{item.__module__}:{item.__qualname__}'
        make, accepted = _SCALARS[self.kind.removesuffix('[]')]
        if isinstance(item, accepted) and (make is bool or not isinstance(item, bool)):
            with suppress(OverflowError):
                return make(item)
        hint = ''
        if isinstance(item, str) and make in (int, float):
            number = yaml_number(item)
            if number and (make is float or number.lstrip('+-').isdecimal()):
                hint = f'; write {number}: {item!r} is text to YAML'
        raise ParameterError(self.name, whole, self.allowed + hint)

    def checked(self, value: object, n: int = 0) -> Any:
        """Return `value` as `coerce` does; raise `ParameterError` as that and `check` do."""
        coerced = self.coerce(value, n)
        self.check(coerced, n)
        return coerced

    def check(self, value: Any, n: int) -> None:
        """Raise `ParameterError` unless `value` is allowed for a robot of `n` joints."""
        items = value if isinstance(value, tuple) else (value,)
        sizes = {'n': (n,), 'nn': (n, n * n)}.get(self.shape, (len(items),))
        if len(items) not in sizes:
            raise ParameterError(
                self.name, value, f'{self.allowed} (n = {n}, got {len(items)} values)')
        fits = True
        if self.choices:
            fits = all(item in self.choices or (
                self.own and OWN_CLASS.fullmatch(item)) for item in items)
        elif self.kind in ('float', 'float[]', 'int'):
            full = self.shape == 'nn' and len(items) != n
            low, high = self.bounds
            fits = all((-high if full else low) <= item <= high
                       or (self.infinite and item == math.inf) for item in items) and (
                not full or _positive_definite(matrix(items, n)))
        if not fits:
            raise ParameterError(self.name, value, self.allowed + near(value, self.choices))


#: A number as people write it: mantissa, and sign and digits of the exponent.
_NUMBER = re.compile(r'([-+]?(?:\d+\.?\d*|\.\d+))(?:[eE]([-+]?)(\d+))?')


def yaml_number(text: str) -> str:
    """
    Return how the number in a text is written so that YAML reads a number; empty for no number.

    To YAML, and to `ros2 param set`, 1e-9 is text and 1.0e-9 a number.
    """
    if text.strip().lstrip('+-.').lower() in ('inf', 'infinity'):
        return '-.inf' if text.strip().startswith('-') else '.inf'
    match = _NUMBER.fullmatch(text.strip())
    if match is None:
        return ''
    mantissa, sign, exponent = match.groups()
    if exponent is None:
        return mantissa
    return f'{mantissa}{"" if "." in mantissa else ".0"}e{sign or "+"}{exponent}'


def _positive_definite(a: npt.NDArray[np.float64]) -> bool:
    return np.allclose(a, a.T, rtol=1e-12, atol=0.0) and bool(np.linalg.eigvalsh(a).min() > 0.0)


def matrix(values: tuple[float, ...], n: int) -> npt.NDArray[np.float64]:
    """Return `values` as `n` rows: n of them are a diagonal, n·n stand row by row."""
    return np.reshape(values, (n, n)) if len(values) == n * n else np.diag(values)


def parameter(default: Any, description: str, unit: str = '', **more: Any) -> Any:
    """
    Return a dataclass field that declares one parameter.

    Parameters
    ----------
    default, description, unit
        As in `Parameter`.
    **more
        Others of `Parameter`. Where they are left out, the name is that of the field, the kind
        that of its annotation, a number at least 0, infinity a value if it is the default, and a
        list of numbers has one per joint.

    """
    return dataclasses.field(default=None, metadata={
        'default': default, 'description': description, 'unit': unit, 'minimum': 0.0,
        'infinite': default == math.inf, **more})


@dataclasses.dataclass(frozen=True)
class Config:
    """
    Base of the configurations: fields left out take their defaults, all are checked.

    `joint_names`, where there is such a parameter, comes first: it gives the number of joints.

    Raises
    ------
    ParameterError
        On construction, for the first value that is not allowed.

    """

    _declared: ClassVar[dict[str, Parameter]] = {}

    def __init_subclass__(cls) -> None:
        """Collect the declarations, inherited ones first, and describe them in the docstring."""
        specs = [spec for base in cls.__bases__[::-1] for spec in vars(base)['_declared'].values()]
        for name, field in vars(cls).items():
            if isinstance(field, dataclasses.Field):
                kind = cls.__annotations__[name]
                specs.append(Parameter(**{
                    'name': name, 'kind': _KINDS.get(kind, kind), 'shape': _SHAPES.get(kind, ''),
                    **field.metadata}))
        cls._declared = {spec.name: spec for spec in specs}
        cls.__doc__ = '\n'.join((
            inspect.cleandoc(cls.__doc__ or ''), '', 'Parameters', '----------', *(
                f'{spec.field} : {spec.kind}\n    {spec.meaning}' for spec in specs)))

    def __post_init__(self) -> None:
        """Fill in defaults, coerce types and check every value."""
        n = 0
        for spec in self.parameters().values():
            value = getattr(self, spec.field)
            value = spec.checked(spec.default_for(n) if value is None else value, n)
            object.__setattr__(self, spec.field, value)
            if spec.name == 'joint_names':
                check_joint_names(value)
                n = len(value)
        self.validate()

    def validate(self) -> None:
        """Check what concerns several parameters at once; a subclass overrides this."""

    @classmethod
    def parameters(cls) -> dict[str, Parameter]:
        """Return the declared parameters by name, in order."""
        return cls._declared

    @classmethod
    def from_mapping(cls: type[C], values: Mapping[str, object]) -> C:
        """
        Build the configuration from parameter names and values.

        Raises
        ------
        ParameterError
            For an unknown name or a value that is not allowed.

        """
        return cls(**{spec.field: value for spec, value in cls._known(values)})

    @classmethod
    def _known(cls, values: Mapping[str, object]) -> Iterator[tuple[Parameter, object]]:
        """Yield parameters with their values; raise `ParameterError` for an unknown name."""
        known = cls.parameters()
        for name, value in values.items():
            if name not in known:
                raise ParameterError(name, value, f'one of {", ".join(known)}{near(name, known)}')
            if value is None:
                raise ParameterError(name, value, known[name].allowed)
            yield known[name], value

    @classmethod
    def received(cls: type[C], values: Mapping[str, object],
                 instead: Mapping[str, object] | None = None) -> C:
        """
        Build the configuration from values of a bag or of another process: they name no code.

        Parameters
        ----------
        values : mapping
            Parameter names and values.
        instead : mapping, optional
            What the user gives in the place of a class that the values name, by parameter.

        Raises
        ------
        ParameterError
            As `from_mapping` raises it.
        CtcError
            For the name of a class in whose place nothing is given.

        """
        used, given = dict(values), instead or {}
        for name, spec in cls.parameters().items():
            value = values.get(name)
            if spec.own and isinstance(value, str) and value not in spec.choices:
                if name not in given:
                    raise CtcError(
                        f'{name}: {value[:80]!r} is not used, because what was recorded or '
                        f'received names no code; for your own give --{name} '
                        f"package.module:Name, in Python {name}='package.module:Name'")
                used[name] = given[name]
        return cls.from_mapping(used)

    def as_mapping(self) -> dict[str, Any]:
        """Return every parameter's value by name."""
        return {name: getattr(self, spec.field) for name, spec in self.parameters().items()}

    def changed(self: C, values: Mapping[str, object]) -> C:
        """Return a copy with some parameters changed, checked like a new one."""
        if 'joint_names' in values:  # The number of joints concerns all others.
            return self.from_mapping({**self.as_mapping(), **values})
        made, n = copy(self), len(getattr(self, 'joint_names', ()))
        for spec, value in self._known(values):
            object.__setattr__(made, spec.field, spec.checked(value, n))
        made.validate()
        return made


def named_class(what: str, name: str, fits: Callable[[type], bool], wanted: str) -> Any:
    """
    Import the class ``package.module:Name``: the one place that runs code which a value names.

    A user has given the name: `Config.received` lets no other one in.

    Parameters
    ----------
    what, wanted : str
        For errors: what is named, and what it must be.
    name : str
        Of the class.
    fits : callable
        Whether a class is of the kind that is expected.

    Raises
    ------
    CtcError
        If there is none, or it is not of that kind; nothing of it has been called then.

    """
    module, _, attribute = name.partition(':')
    with refused_as(f'there is no {what} {name}'):
        found = getattr(importlib.import_module(module), attribute)
    if not (isinstance(found, type) and fits(found)):
        raise CtcError(f'the {what} {name} is no {wanted}')
    return found


def accept_old_name(kind: type, old: str, new: str) -> None:
    """Let a class of the user's have a method by its old name, with a warning."""
    if not hasattr(kind, new) and hasattr(kind, old):
        warnings.warn(f'{kind.__name__}.{old} is deprecated. Call it {new}.', FutureWarning,
                      stacklevel=3)
        setattr(kind, new, getattr(kind, old))


def unit_text(unit: str) -> str:
    """Return a declared unit as pages and tables have it: N·m for ``N*m``, s² for ``s^2``."""
    return unit.replace('*', '·').replace('^2', '²').replace('^3', '³')


def check_joint_names(names: tuple[str, ...]) -> None:
    """Raise `ParameterError` unless there are names, each of them once and none empty."""
    if not names or len(set(names)) != len(names) or not all(names):
        raise ParameterError('joint_names', names, 'one or more names, all different, none empty')


def check_some(name: str, values: Sequence[object]) -> None:
    """Raise `ParameterError` for an empty sequence."""
    if not values:
        raise ParameterError(name, values, 'one or more')


def whole(name: str, value: object, least: float = -math.inf) -> int:
    """Return a whole number as an `int`; raise `ParameterError` if it is none, or less."""
    return int(Parameter(name, 'int', None, '', minimum=least).checked(value))


def vector(name: str, values: Any, n: int) -> npt.NDArray[np.float64]:
    """Return `n` numbers as an array; raise `ParameterError` if they are something else."""
    try:
        found = np.array(values, float)
    except (TypeError, ValueError, OverflowError):
        found = np.empty(0)
    if found.shape != (n,):
        raise ParameterError(name, values, f'{n} numbers')
    return found
