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
Limits of the torque and of its rate, and the anti-windup of the filter (3).

The saturation error, what the limits take from the torque, acts in the closed loop (8) like a
perturbation: over one period it changes v by -b h M⁻¹ times itself. Added to ξ with the opposite
sign, it leaves v as it would be without limits.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from ctc_chattering.numerics.compilable import record, solve, some
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class Limiter(NamedTuple):
    """Limits of the torque, made by `limiter`; arrays of shape (n,)."""

    #: Largest torque, and largest change of it in a period [N·m]; inf for unlimited.
    effort: Array
    change: Array
    #: Whether there are limits, 1.0 or 0.0; b h of the filter [s], 0.0 for no anti-windup.
    limited: float
    anti_windup: float
    #: n zeros.
    zero: Array

    def limit(self, unsaturated: Array, held: Array) -> Array:
        """Return the torque to send after the torque `held`, shape (n,) [N·m]."""
        if self.limited == 0.0:
            return unsaturated
        near = np.minimum(np.maximum(unsaturated, held - self.change), held + self.change)
        return np.minimum(np.maximum(near, -self.effort), self.effort)

    def correction(self, mass: Array, lost: Array) -> Array:
        """Return the anti-windup correction of ξ and v for a torque lost, (n,) [rad/s]."""
        if self.anti_windup == 0.0 or not some(lost):
            return self.zero
        return self.anti_windup * solve(mass, lost)


def limiter(effort: Array, change: Array, anti_windup: float) -> Limiter:
    """Return limits; arguments as the first fields of `Limiter` but `limited`."""
    limited = min(effort.min(), change.min()) < inf
    return Limiter(effort, change, float(limited), anti_windup, np.zeros_like(effort))
