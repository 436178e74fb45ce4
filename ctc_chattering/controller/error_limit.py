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
Whether the position error is within its limit.

A law that observes the perturbation removes an error, whatever the robot started with. Where the
error of a joint i grows all the same, the loop is lost: by drives that are slower or later than
told, or a perturbation beyond Ka. In the sample k, of samples j since the torques began::

    g_i(k) = |e_i(k)| - min |e_i(j)| <= 1 rad                                             (TR1)

So a start far from the reference is allowed, and its overshoot. The price: a reference that jumps
by more counts as a loss, and an error that stays within 1 rad does not.
"""

from __future__ import annotations

from math import inf

from ctc_chattering.numerics.linear_algebra import Vector

#: Largest growth of an error of (TR1) [rad].
LARGEST_GROWTH = 1.0


def joint_beyond(e: Vector, limit: Vector) -> int | None:
    """
    Return the first joint whose error is beyond its limit; None if all are within.

    Parameters
    ----------
    e : sequence of float, shape (n,)
        Position error [rad]; NaN is beyond any limit.
    limit : sequence of float, shape (n,)
        Largest magnitude allowed [rad].

    """
    for i, (x, most) in enumerate(zip(e, limit)):
        if not -most <= x <= most:
            return i
    return None


class ErrorGrowth:
    """Remembers the least error of each joint, for n joints; see (TR1)."""

    def __init__(self, n: int) -> None:
        self._least = [inf] * n

    def restart(self) -> None:
        """Forget the errors so far."""
        self._least = [inf] * len(self._least)

    def largest(self, e: Vector) -> tuple[float, int]:
        """Return the largest g_i [rad] with the error e, shape (n,) [rad], and the joint i."""
        size = [abs(x) for x in e]
        self._least = least = [min(a, b) for a, b in zip(size, self._least)]
        return max((a - b, i) for i, (a, b) in enumerate(zip(size, least)))
