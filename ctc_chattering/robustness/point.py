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

"""A run of a map by its number, or by values of axes, law and repeat."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite, nan
from typing import Any

from ctc_chattering.errors import near, ParameterError, UsageError
from ctc_chattering.robustness.quantity import Axis
from ctc_chattering.robustness.runs import Runs
from ctc_chattering.robustness.spec import LawSettings, MapSpec

_LAW, _REPEAT = 'law', 'repeat'


def find_run(runs: Runs, text: str) -> int:
    """
    Return the number of the run that a text names.

    Parameters
    ----------
    runs : Runs
        Of the map.
    text : str
        A number, or ``name=value,...`` of the axes, law and repeat; the value of an axis that is
        nearest is taken. What has one value only may be left out.

    Raises
    ------
    UsageError
        If it names no run, or more than one.

    """
    try:
        if text.strip().isdecimal():
            return _among('run', int(text), len(runs))
        return runs.number(*_place(runs.spec, dict(_pair(word) for word in text.split(','))))
    except ParameterError as error:
        raise UsageError(f'--explain {text}: {error}') from None


def _place(spec: MapSpec, given: Mapping[str, str]) -> tuple[tuple[int, ...], int, int]:
    """Return the indices of the axes, of the law, and of the repeat."""
    choices: dict[str, Sequence[Any]] = {
        **{axis.name: axis.values for axis in spec.axes},
        _LAW: [x.name for x in spec.variants], _REPEAT: range(spec.repeats.repeats)}
    for name in given:
        if name not in choices:
            raise ParameterError(name, given[name], 'a run number, or '
                                 f'{", ".join(choices)}{near(name, choices)}')
    for name, values in choices.items():
        if len(values) > 1 and name not in given:
            shown = values if len(values) < 20 else [values[0], '...', values[-1]]
            words = ', '.join(x if isinstance(x, str) else f'{x:g}' for x in shown)
            raise ParameterError(name, '', f'one of {words}: there is more than one')
    repeat = _number(_REPEAT, given.get(_REPEAT, '0'))
    return (tuple(_nearest(axis, given[axis.name]) if axis.name in given else 0
                  for axis in spec.axes), _law(spec.variants, given[_LAW]) if _LAW in given else 0,
            _among(_REPEAT, repeat, spec.repeats.repeats))


def _pair(word: str) -> tuple[str, str]:
    name, equals, value = (x.strip() for x in word.partition('='))
    if not (name and equals and value):
        raise ParameterError('POINT', word, 'a run number, or name=value,...')
    return name, value


def _number(name: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = nan
    if not isfinite(number):
        raise ParameterError(name, text, 'a number')
    return number


def _among(name: str, number: float, count: int) -> int:
    """Return `number` as an index below `count`."""
    if number != number // 1 or not 0 <= number < count:
        raise ParameterError(name, number, f'0 to {count - 1}')
    return int(number)


def _nearest(axis: Axis, text: str) -> int:
    """Return the index of the value of an axis that is nearest to a number."""
    x = _number(axis.name, text)
    first, *others = sorted(range(len(axis.values)), key=lambda k: abs(axis.values[k] - x))
    if others and abs(axis.values[others[0]] - x) == abs(axis.values[first] - x):
        raise ParameterError(axis.name, text, 'a number nearest to one of '
                             + ', '.join(f'{axis.values[k]:g}' for k in (first, others[0])))
    return first


def _law(variants: Sequence[LawSettings], text: str) -> int:
    """Return the index of the variant with this name, or of the only one under this law."""
    found = [i for i, x in enumerate(variants) if x.name == text] or [
        i for i, x in enumerate(variants) if x.law == text]
    if len(found) != 1:
        names = [x.name for x in variants]
        raise ParameterError(_LAW, text, ' | '.join(names) + near(text, names))
    return found[0]
