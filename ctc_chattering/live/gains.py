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

"""Sliders of gains: what they show, and the values that follow from where one is released."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from typing import Any

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.parameters import Parameter, unit_text

#: The gains with a slider.
GAINS = ('kp', 'kv', 'lambda', 'ka')
#: Stands for all joints: their values keep their ratios, and the slider shows the largest.
ALL = -1


@dataclasses.dataclass(frozen=True)
class GainSlider:
    """
    A gain in force, as its slider shows it.

    Attributes
    ----------
    spec : Parameter
    values : tuple of float
        One for each joint, the diagonal of a matrix, or a single one.
    matrix : tuple of float
        All elements of a full matrix, row by row; else empty.
    off : str
        Why it has no effect; else empty.

    """

    spec: Parameter
    values: tuple[float, ...]
    matrix: tuple[float, ...] = ()
    off: str = ''

    @property
    def limits(self) -> tuple[float, float]:
        """Return where the slider begins and ends: its declared range and the values in force."""
        least, most = self.spec.usual
        known = [x for x in self.values if x > 0.0]
        return min(least, *known, most), max(most, *known, least)

    def shown(self) -> dict[str, Any]:
        """Return what the page has to know."""
        least, most = self.limits
        return {'name': self.spec.name, 'unit': unit_text(self.spec.unit),
                'about': self.spec.meaning, 'least': least, 'most': most,
                'values': self.values, 'each': len(self.values) > 1 and not self.matrix,
                'off': self.off}

    def changed(self, joint: Any, value: Any) -> list[float] | float | None:
        """
        Return the parameter's value once the one of a joint, or of `ALL`, is another.

        None for what no page of ours asks for.

        Raises
        ------
        ParameterError
            If the value is not allowed.

        """
        n = len(self.values)
        if (self.off or type(joint) is not int or not ALL <= joint < n
                or type(value) not in (int, float) or (self.matrix and joint != ALL)):
            return None
        (value,) = self.spec.coerce((value,)) if n > 1 or self.spec.shape else (
            self.spec.coerce(value),)
        if self.spec.kind == 'float':
            made: tuple[float, ...] | float = value
        elif joint == ALL:
            largest = max(self.values)
            made = tuple(value * (x / largest) if largest else value
                         for x in self.matrix or self.values)
        else:
            made = tuple(value if i == joint else x for i, x in enumerate(self.values))
        self.spec.check(made, n)
        return list(made) if isinstance(made, tuple) else made


def gains_of(parameters: Mapping[str, Any], names: Sequence[str]) -> list[GainSlider]:
    """Return the gains among a controller's parameters in force; what is no gain is left out."""
    law = parameters.get('law')
    found = []
    for name in GAINS:
        spec = ControllerConfig.parameters()[name]
        try:
            value = spec.coerce(parameters.get(name), len(names))
            spec.check(value, len(names))
        except CtcError:
            continue
        off = '' if not spec.laws or law in spec.laws or ':' in str(law) else (
            f'the law {law} does not take it')
        n = len(names)
        if spec.kind == 'float':
            found.append(GainSlider(spec, (value,), off=off))
        elif len(value) == n:
            found.append(GainSlider(spec, value, off=off))
        else:
            found.append(GainSlider(spec, value[::n + 1], value, off))
    return found
