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

"""A number with its interval, or the reason why there is none."""

from __future__ import annotations

import dataclasses
from enum import Enum, IntEnum
from math import inf
from typing import Any, NamedTuple

from ctc_chattering.analysis.tables import with_interval
from ctc_chattering.errors import CtcError

#: The reason where the data would show a quantity, and do not; and where they would, beyond a
#: bound that follows.
NONE, NONE_ABOVE = 'none shows', 'none above '

#: Half an interval, as a part of a number, that is rounding.
_ROUNDING = 1e-9


@dataclasses.dataclass(frozen=True)
class Estimate:
    """
    What was identified of one quantity.

    Attributes
    ----------
    value : float or None
        None where it is not identifiable.
    half : float
        Half the interval of 95 %; 0 where none is given.
    unit : str
        As in ``N*m``.
    reason : str
        Why there is no value.

    """

    value: float | None
    half: float = 0.0
    unit: str = ''
    reason: str = ''

    @classmethod
    def none(cls, reason: str) -> Estimate:
        """Return what is not identifiable."""
        return cls(None, reason=reason)

    @property
    def shows_none(self) -> bool:
        """Whether the data show that there is none, at least beyond a bound."""
        return self.value is None and self.reason.startswith((NONE, NONE_ABOVE))

    def __str__(self) -> str:
        """Return value, interval and unit, or the reason."""
        if self.value is None:
            return self.reason if self.shows_none else f'not identifiable: {self.reason}'
        # Less than rounding is no interval.
        half = self.half if self.half > _ROUNDING * abs(self.value) else 0.0
        return with_interval(self.value, half, self.unit)

    def number(self) -> float:
        """Return the value, 0 if the data show that there is none; raise `CtcError` without."""
        if self.value is None and not self.shows_none:
            raise CtcError(f'not identifiable: {self.reason}')
        return self.value or 0.0

    def as_mapping(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        if self.value is None:
            return {'value': None, 'reason': self.reason}
        return {'value': self.value, 'interval_95': [self.value - self.half,
                                                     self.value + self.half]} if self.half else {
            'value': self.value}


#: In place of a joint: all of them.
ALL_JOINTS = -1


class Severity(IntEnum):
    """What follows for a joint."""

    NOTE = 0
    CARE = 1
    REFUSED = 2


class Kind(Enum):
    """
    What a finding measures, with the size above which care is due, and that of a refusal.

    This is the one table that decides; steps of the identification only say how large something
    is. What has no size has 1.
    """

    #: Worth knowing; makes numbers doubtful; leaves no number.
    NOTE, DOUBT, NO_NUMBER = (inf, inf), (0.0, inf), (0.5, 0.5)
    #: Part by which friction may be off with what is not explained.
    FRICTION_OFF = (0.02, 0.3)
    #: Half an interval of Coulomb friction, as a part of it; where the model has errors without a
    #: cause, which the interval contains.
    COULOMB_INTERVAL, COULOMB_IN_DOUBT = (0.2, inf), (0.2, inf)
    #: Half the difference of both directions as a part of Coulomb friction; under a load of one
    #: sign, and otherwise.
    ONE_SIDED, UNEVEN = (0.05, inf), (0.5, inf)
    #: What a joint at rest needs beyond what it shows while it slides, as a part of that.
    BREAK_AWAY = (0.1, inf)
    #: Friction below 0 in halves of its interval; friction as a part of the load.
    NEGATIVE_FRICTION, LOAD = (0.0, 1.0), (0.5, 0.5)
    #: By which part velocities differ from changes of positions.
    VELOCITY_RATIO = (0.1, 0.1)
    #: Samples between the shortest and the longest delay; lag of a drive, and the least one where
    #: the longest that is looked for fits, too [s].
    DELAYS, LAG, LONGEST_LAG = (2.5, inf), (0.008, inf), (-1.0, 0.0)
    #: Half an interval of a torque scale.
    SCALE_INTERVAL = (0.05, inf)
    #: Part of a joint's torque that no body can have; inertia over the model's, or one over that.
    IMPOSSIBLE_BODY, INERTIA = (0.01, 0.05), (2.0, 2.0)
    #: A joint whose friction another motion would show: with some of it, and with none.
    MOTION, NO_MOTION = (0.5, inf), (0.0, 0.0)

    def __new__(cls, *_: float) -> Kind:
        # Two with the same sizes would be one.
        found = object.__new__(cls)
        found._value_ = len(cls.__members__)
        return found

    def __init__(self, care: float, refused: float) -> None:
        self.care, self.refused = care, refused


#: Kinds that another motion of the joint would settle.
SETTLED = (Kind.MOTION, Kind.NO_MOTION, Kind.COULOMB_INTERVAL, Kind.SCALE_INTERVAL,
           Kind.BREAK_AWAY)


class Finding(NamedTuple):
    """
    Something that makes the numbers of a joint doubtful.

    Attributes
    ----------
    kind : Kind
        What it measures.
    joint : int
        Index of the joint; `ALL_JOINTS` for all.
    reason : str
        What was noticed, with its numbers, and the physical cause that it points to.
    cure : str
        What to record, or which option to give; empty for nothing.
    size : float
        As `Kind` has it.

    """

    kind: Kind
    joint: int
    reason: str
    cure: str = ''
    size: float = 1.0

    @property
    def severity(self) -> Severity:
        """Return what follows for the joint."""
        return Severity(int(self.size > self.kind.care) + int(self.size > self.kind.refused))

    @property
    def text(self) -> str:
        """Return the reason with the cure."""
        return f'{self.reason}; {self.cure}' if self.cure else self.reason
