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
Records of an identification: numbers with intervals, and findings.

All steps from the recording to the gains return these. They hold data only: `sentences` puts
findings into words.
"""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from enum import auto, Enum, IntEnum
from typing import Any

from ctc_chattering.errors import CtcError
from ctc_chattering.number_format import format_interval

#: Half an interval below this part of its number is rounding.
ROUNDING = 1e-9


class Gap(Enum):
    """Reason why there is no number."""

    HARDLY_MOVES = 'the joint hardly moves'
    NOT_SLOW = 'the joint does not move slowly enough'
    NOT_SHOWN = 'the motion does not show it'
    NOT_FELT = 'a sensor behind the gear does not feel it'
    AT_BOUND = 'at its bound'
    IN_COULOMB = 'it may be in Coulomb friction'
    NO_STEP = 'no step shows'
    NO_VELOCITIES = 'no velocities in the bag'
    OTHER_VELOCITY = 'the velocity is none of the position'
    FILTERED = ('the velocity differs from the change of the position, but not as noise of single '
                'samples does: it is filtered')
    NO_COMMANDS = 'no commanded torque in the bag'
    SLOW_COMMANDS = 'no command changes fast enough, or delay and lag are not identified'
    FOLLOWS_COMMANDS = 'the drive follows commands that change so fast'


@dataclasses.dataclass(frozen=True)
class Estimate:
    """
    Estimate of one quantity.

    Attributes
    ----------
    value : float or None
        None without a number.
    half : float
        Half the interval of 95 %, or 0 without an interval.
    unit : str
        As in ``N*m``.
    gap : Gap or None
        Why there is no number.
    absent : bool
        Whether the data would show the quantity, and do not.
    at_least, at_most : float or None
        Bound in the place of a number.
    shown_above : float or None
        Velocity above which an absent quantity would show [rad/s].

    """

    value: float | None
    half: float = 0.0
    unit: str = ''
    gap: Gap | None = None
    absent: bool = False
    at_least: float | None = None
    at_most: float | None = None
    shown_above: float | None = None

    @classmethod
    def unknown(cls, gap: Gap) -> Estimate:
        """Return the estimate of a quantity that does not show."""
        return cls(None, gap=gap)

    @classmethod
    def none(cls, **fields: Any) -> Estimate:
        """Return the estimate of a quantity that is absent, or small."""
        return cls(None, absent=True, **fields)

    def __str__(self) -> str:
        """Return value, interval and unit, or the words in their place."""
        if self.value is not None:
            half = self.half if self.half > ROUNDING * abs(self.value) else 0.0
            return format_interval(self.value, half, self.unit)
        if self.at_least is not None:
            return f'at least {self.at_least:.3g} {self.unit}'.strip()
        if self.at_most is not None:
            return f'at most {self.at_most:.2g} {self.unit}'.strip()
        return 'none' if self.absent else f'not known: {self.explanation}'

    @property
    def explanation(self) -> str:
        """Words for the lack of a number, empty without them."""
        if self.shown_above is not None:
            return f'of velocities above {self.shown_above:g} rad/s'
        return self.gap.value if self.gap else ''

    @property
    def cell(self) -> str:
        """Return number, bound, `none`, or `-`, without the unit."""
        if self.value is None and self.at_least is None and not self.absent:
            return '-'
        return str(dataclasses.replace(self, unit=''))

    def number(self) -> float:
        """
        Return the value, 0 if the quantity is absent.

        Raise `CtcError` if it is not known.
        """
        if self.value is None and not self.absent:
            raise CtcError(str(self))
        return self.value or 0.0

    def as_mapping(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        if self.value is not None:
            interval = [self.value - self.half, self.value + self.half]
            return {'value': self.value, **({'interval_95': interval} if self.half else {})}
        has_bound = self.absent or self.at_least is not None
        words = [str(self), self.explanation if has_bound else '']
        return {'value': None, 'reason': ': '.join(filter(None, words))}


#: Index of a joint in a finding about all joints.
ALL_JOINTS = -1


class Severity(IntEnum):
    """Effect of a finding on the numbers of a joint."""

    NOTE = 0
    CARE = 1
    REFUSED = 2

    @property
    def label(self) -> str:
        """Verdict on a joint whose worst finding has this severity."""
        return ('usable', 'usable with care', 'not usable')[self]


class Reason(Enum):
    """
    Observation behind a finding.

    `sentences.MESSAGES` has the words of each.
    """

    RECORDING = auto()
    PAYLOAD = auto()
    ASSUMED_ROTORS = auto()
    DROPPED = auto()
    STAMPS = auto()
    TURNS_COUNTED = auto()
    REPETITIONS = auto()
    VELOCITY = auto()
    TOOL = auto()
    UNITS = auto()
    SIGN = auto()
    URDF_CONSTANT = auto()
    OTHERS_CONSTANT = auto()
    NO_CONSTANT = auto()
    CORRECTED = auto()
    ROTOR = auto()
    MOUNT = auto()
    NOT_EXCITED = auto()
    NOT_PREDICTED = auto()
    UNEXPLAINED = auto()
    UNCERTAIN = auto()
    COUPLED = auto()
    OUTLIERS = auto()
    BREAK_AWAY = auto()
    SEVERAL_DELAYS = auto()
    FAR_DELAYS = auto()
    UNBOUNDED_LAG = auto()
    LONG_LAG = auto()
    KA_CUT = auto()
    SLOW_DRIVE = auto()
    NO_RATE = auto()
    NO_GAINS = auto()


@dataclasses.dataclass(frozen=True)
class Finding:
    """
    Observation that makes numbers doubtful, or is worth a note.

    Attributes
    ----------
    reason : Reason
        The observation.
    severity : Severity
        Its effect on the joint.
    joint : int
        Index of the joint, or `ALL_JOINTS`.
    values : mapping of str to number or text
        Values of the observation, by the names that its words have for them.

    """

    reason: Reason
    severity: Severity
    joint: int = ALL_JOINTS
    values: Mapping[str, Any] = dataclasses.field(default_factory=dict)
