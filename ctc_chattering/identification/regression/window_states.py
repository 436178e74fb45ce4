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

"""The motion in each window, on which a torque may depend that the regression lacks."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses

from ctc_chattering.analysis.recording import Stretch
from ctc_chattering.identification.regression.rows import columns, least_velocity, Rows, sliding
from ctc_chattering.identification.regression.weak_form import smooth, TestFunction
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Ways after a reversal in which a torque may build up [rad].
BUILD_UP = (3e-4, 1e-3, 3e-3, 1e-2)


@dataclasses.dataclass(frozen=True)
class WindowStates:
    """
    Motion of all windows of all stretches; J windows, n joints.

    Attributes
    ----------
    position : ndarray, shape (J, n)
        Mean position [rad].
    acceleration : ndarray, shape (J, n)
        Mean acceleration [rad/s²], by differences of positions and parts.
    build_up : ndarray, shape (J, n, len(BUILD_UP))
        Mean of sgn(dq) exp(-x / d) for these d, x the way since the direction changed.

    """

    position: Array
    acceleration: Array
    build_up: Array

    @property
    def way(self) -> Array:
        """Return the way since the direction changed, up to some 0.1 rad, shape (J, n) [rad]."""
        longest = BUILD_UP[-1]
        found: Array = -longest * np.log(np.clip(np.abs(self.build_up[:, :, -1]), 1e-5, 1.0))
        return found

    @classmethod
    def of(cls, parts: Sequence[Stretch], rows: Sequence[Rows], phi: TestFunction
           ) -> WindowStates:
        """Return the motion in the windows of stretches."""
        found = [cls._of(part, row, phi) for part, row in zip(parts, rows)]
        return cls(*(np.concatenate(x) for x in zip(*found)))

    @staticmethod
    def _of(part: Stretch, rows: Rows, phi: TestFunction) -> tuple[Array, Array, Array]:
        found = []
        # Joint by joint, for long series.
        for q, least in zip(columns(part.q), least_velocity(part.q, part.period)):
            bend = -phi.sums(np.gradient(q, part.period, axis=0), phi.slope, rows.centres)
            place, dq = (smooth(q, part.period, order) for order in range(2))
            position = phi.sums(place, phi.at, rows.centres)
            ways = way_since_reversal(place, sliding(dq, least, part.period))
            build_up = [phi.sums(np.sign(dq) * np.exp(-ways / d), phi.at, rows.centres)
                        for d in BUILD_UP]
            found.append((position, bend, np.stack(build_up, axis=2)))
        position, acceleration, turned = (np.concatenate(x, axis=1) for x in zip(*found))
        return position, acceleration, turned


def way_since_reversal(q: Array, slide: Array) -> Array:
    """
    Return how far each joint has come since its direction changed; inf before, shape (N, n) [rad].

    Parameters
    ----------
    q : ndarray, shape (N, n)
        Positions [rad].
    slide : ndarray, shape (N, n)
        Direction, 0 at rest; a rest between the same directions is no reversal.

    """
    found = np.empty_like(q)
    for i, (x, way) in enumerate(zip(q.T, slide.T)):
        moving = np.flatnonzero(way)
        turns = np.flatnonzero(np.diff(way[moving])) if len(moving) else moving
        # The last sample of one direction is where the next one begins.
        ends = moving[turns]
        counts = np.diff(np.concatenate(([0], ends + 1, [len(x)])))
        found[:, i] = np.abs(x - np.repeat(np.append(np.inf, x[ends]), counts))
    return found
