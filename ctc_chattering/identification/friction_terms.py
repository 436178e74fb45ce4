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
"""Terms of a joint's friction, as columns of the regression."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import NamedTuple

from ctc_chattering.identification.windows import STRIBECK_VELOCITIES, Windows
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class TermKind(Enum):
    """Meaning of a column of friction."""

    COULOMB = 'Coulomb'
    OFFSET = 'offset'
    VISCOUS = 'viscous'
    STRIBECK = 'Stribeck'
    LOAD = 'load'
    DEAD_BAND = 'dead band'
    COUPLED_COULOMB = 'Coulomb of another joint'
    COUPLED_VISCOUS = 'viscous of another joint'
    SCALE = 'scale of the torque'
    QUADRATIC = 'quadratic'


#: Terms that every joint in motion has.
ALWAYS = (TermKind.COULOMB, TermKind.VISCOUS, TermKind.OFFSET)
#: Terms with a coefficient that is not negative.
NOT_NEGATIVE = (TermKind.COULOMB, TermKind.VISCOUS, TermKind.LOAD, TermKind.DEAD_BAND)


class FrictionTerm(NamedTuple):
    """
    Column of friction of one joint, over its prior deviation.

    Attributes
    ----------
    kind : TermKind
        Its meaning.
    joint : int
        Index of the joint.
    size : float
        Deviation of the coefficient before any data, in its own unit.
    which : float
        Index of the velocity of Stribeck friction, also between two, or of the other joint.

    """

    kind: TermKind
    joint: int
    size: float
    which: float = 0

    @property
    def stribeck_velocity(self) -> float:
        """Velocity of Stribeck friction [rad/s]."""
        first, last = STRIBECK_VELOCITIES[0], STRIBECK_VELOCITIES[-1]
        return float(first * (last / first) ** (self.which / (len(STRIBECK_VELOCITIES) - 1)))

    def column(self, windows: Windows, drive_sign: Array) -> Array:
        """
        Return the torque for a coefficient of `size`, shape (J,) [N·m].

        Parameters
        ----------
        windows : Windows
            Of which it is the column.
        drive_sign : ndarray, shape (J, n)
            Sign of the torque of each drive, as a model predicts it.

        """
        joint, coupled = self.joint, int(self.which)
        values: Callable[[], Array] = {
            TermKind.COULOMB: lambda: windows.direction[:, joint],
            TermKind.OFFSET: lambda: np.ones(len(windows.t)),
            TermKind.VISCOUS: lambda: windows.velocity[:, joint],
            TermKind.QUADRATIC: lambda: (
                windows.velocity[:, joint] * np.abs(windows.velocity[:, joint])
            ),
            TermKind.STRIBECK: lambda: windows.stribeck_column(joint, self.which),
            TermKind.LOAD: lambda: windows.load[:, joint],
            TermKind.SCALE: lambda: windows.model_torque[:, joint],
            TermKind.DEAD_BAND: lambda: drive_sign[:, joint],
            TermKind.COUPLED_COULOMB: lambda: windows.direction[:, coupled],
            TermKind.COUPLED_VISCOUS: lambda: windows.velocity[:, coupled],
        }[self.kind]
        return np.asarray(self.size * values())
