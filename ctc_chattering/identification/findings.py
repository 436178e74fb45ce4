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
"""A number with its interval, or what is known in its place; and reasons for doubt."""

from __future__ import annotations

import dataclasses
from enum import Enum, IntEnum
from typing import Any, NamedTuple

from ctc_chattering.errors import CtcError
from ctc_chattering.number_format import format_interval

#: Half an interval, as a part of a number, that is rounding.
ROUNDING = 1e-9


@dataclasses.dataclass(frozen=True)
class Estimate:
    """
    Estimate of one quantity.

    Attributes
    ----------
    value : float or None
        None without a number.
    half : float
        Half the interval of 95 %; 0 without an interval.
    unit : str
        As in ``N*m``.
    reason : str
        Why there is no number.
    absent : bool
        Whether the data would show the quantity, and do not.
    at_least, at_most : float or None
        Bound in the place of a number.

    """

    value: float | None
    half: float = 0.0
    unit: str = ''
    reason: str = ''
    absent: bool = False
    at_least: float | None = None
    at_most: float | None = None

    @classmethod
    def unknown(cls, reason: str) -> Estimate:
        """Return the estimate of a quantity that the data do not show."""
        return cls(None, reason=reason)

    @classmethod
    def none(cls, reason: str = '', at_most: float | None = None, unit: str = '') -> Estimate:
        """Return the estimate of a quantity that the data show to be absent, or small."""
        return cls(None, unit=unit, reason=reason, absent=True, at_most=at_most)

    def __str__(self) -> str:
        """Return value, interval and unit, or what is known in their place."""
        if self.value is not None:
            half = self.half if self.half > ROUNDING * abs(self.value) else 0.0
            return format_interval(self.value, half, self.unit)
        if self.at_least is not None:
            return f'at least {self.at_least:.3g} {self.unit}'.strip()
        if self.at_most is not None:
            return f'at most {self.at_most:.2g} {self.unit}'.strip()
        return 'none' if self.absent else f'not known: {self.reason}'

    @property
    def cell(self) -> str:
        """Text for a table, without the unit: number, bound, `none`, or `-`."""
        known = self.value is not None or self.absent or self.at_least is not None
        return str(dataclasses.replace(self, unit='')) if known else '-'

    def number(self) -> float:
        """Return the value, 0 if the quantity is absent; raise `CtcError` if it is not known."""
        if self.value is None and not self.absent:
            raise CtcError(str(self))
        return self.value or 0.0

    def as_mapping(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        if self.value is None:
            return {'value': None, 'reason': str(self) + f': {self.reason}' * bool(
                self.reason and (self.absent or self.at_least is not None))}
        interval = [self.value - self.half, self.value + self.half]
        return {'value': self.value, **({'interval_95': interval} if self.half else {})}


#: In place of a joint: all of them.
ALL_JOINTS = -1


class Severity(IntEnum):
    """Meaning of a finding for a joint."""

    NOTE = 0
    CARE = 1
    REFUSED = 2


class Reason(Enum):
    """Why numbers are doubtful, or are none."""

    NOTE = 'note'
    DROPPED = 'messages were dropped'
    STAMPS = 'stamps'
    UNITS = 'units'
    SIGN = 'sign of the torque'
    MOUNT = 'mounting of the base'
    SCALE = 'scale of the torque'
    VELOCITY = 'unit of the velocity'
    NOT_EXCITED = 'not excited'
    NOT_PREDICTED = 'not predicted'
    UNEXPLAINED = 'unexplained torque'
    UNCERTAIN = 'wide interval'
    COUPLED = 'coupled joints'
    OUTLIERS = 'outliers'
    BREAK_AWAY = 'friction at rest'
    DRIVE = 'drive'
    GAINS = 'gains'


#: Reasons that another motion of the joint would settle.
SETTLED_BY_MOTION = (Reason.NOT_EXCITED, Reason.UNCERTAIN, Reason.BREAK_AWAY)


class Finding(NamedTuple):
    """
    Something that makes the numbers of a joint doubtful.

    Attributes
    ----------
    reason : Reason
        What it is about.
    severity : Severity
        What it means for the joint.
    joint : int
        Index of the joint; `ALL_JOINTS` for all.
    text : str
        Observation with its numbers: sentences, the last one without its full stop.
    cure : str
        Motion to record, or option to give, likewise; empty for none.

    """

    reason: Reason
    severity: Severity
    joint: int
    text: str
    cure: str = ''

    @property
    def sentences(self) -> str:
        """Text and cure with their full stops."""
        return f'{self.text}. {self.cure}.' if self.cure else f'{self.text}.'


def note(text: str, joint: int = ALL_JOINTS) -> Finding:
    """Return a finding that is worth knowing and makes no number doubtful."""
    return Finding(Reason.NOTE, Severity.NOTE, joint, text)
