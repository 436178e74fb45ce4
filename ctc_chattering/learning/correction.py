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
The correction of a motion, as a motion.

`Learner` makes a `Correction` from the samples of a pass and passes into it by a `Transition`.
`CorrectedMotion` adds it to the desired motion.
"""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.learning.motion import RepeatedMotion
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import seconds
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.transitions import TimedMotion
import numpy as np


class ConstantCorrection:
    """
    A constant correction, such as 0 for an unknown motion.

    Parameters
    ----------
    q : sequence of float, shape (n,)
        Correction [rad].

    """

    def __init__(self, q: Sequence[float]) -> None:
        zeros = (0.0,) * len(q)
        self._point = q, zeros, zeros

    def at(self, t: int) -> Point:  # noqa: ARG002
        """Return the correction at any `t` [ns]."""
        return self._point


class Correction:
    """
    A cubic spline through the samples of a correction.

    Before and after a motion that is not periodic it keeps its first and its last value.

    Parameters
    ----------
    motion : RepeatedMotion
    rows : array, shape (N, n)
        Samples at equal intervals over one pass [rad].

    Attributes
    ----------
    rows
        The same.

    """

    def __init__(self, motion: RepeatedMotion, rows: Array) -> None:
        from scipy.interpolate import CubicSpline  # type: ignore[import-untyped]  # Takes time.
        self.rows = rows
        self._motion = motion
        last = rows[0] if motion.is_periodic else rows[-1]
        t = np.linspace(0.0, seconds(motion.duration), len(rows) + 1)
        spline = CubicSpline(
            t, np.vstack([rows, last]), bc_type='periodic' if motion.is_periodic else 'clamped')
        #: Coefficients of each interval, highest order first, shape (N, 4, n).
        self._coefficients = spline.c.swapaxes(0, 1)

    def at(self, t: int) -> Point:
        """Return the point at path time `t` [ns]."""
        motion = self._motion
        phase = motion.phase(t)
        # Several times as fast as the call of a spline, which is for many instants at once.
        k = min(phase * len(self.rows) // motion.duration, len(self.rows) - 1)
        s = seconds(phase) - k * seconds(motion.duration) / len(self.rows)
        joints = list(zip(*self._coefficients[k].tolist()))
        q = [((a * s + b) * s + c) * s + d for a, b, c, d in joints]
        if 0 < phase < motion.duration or motion.is_periodic:
            dq = [(3.0 * a * s + 2.0 * b) * s + c for a, b, c, _ in joints]
            return q, dq, [6.0 * a * s + 2.0 * b for a, b, _, _ in joints]
        zeros = [0.0] * len(q)
        return q, zeros, zeros


class CorrectedMotion:
    """
    A motion plus its correction.

    Parameters
    ----------
    motion, correction : TimedMotion

    """

    def __init__(self, motion: TimedMotion, correction: TimedMotion) -> None:
        self._motion = motion
        self._correction = correction

    def at(self, t: int) -> Point:
        """Return the point at path time `t` [ns]."""
        rows = zip(self._motion.at(t), self._correction.at(t))
        q, dq, ddq = ([x + r for x, r in zip(*row)] for row in rows)
        return q, dq, ddq
