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

"""The desired motion as a controller has it: the reference, and the way back to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.trajectory.buffer import Point, Trajectory
from ctc_chattering.trajectory.motions import smooth_start, TimedMotion, Transition

#: Time without a torque after which the robot may be far from the reference [ns].
PAUSE = NANOSECONDS // 10


class DesiredMotion:
    """
    Points of the reference at the instants that a law needs, led back to after a pause.

    After an outage of states, a restart of the robot's driver, or while the controller was
    disabled, the reference has moved on, and the error would be a step. The desired motion then
    begins where the robot is. Time is that of the stamps: in simulated time that stands still
    there is no pause.

    Parameters
    ----------
    grace : int
        How long the reference may be late [ns].
    period, delay : int
        Control period [ns], and number of samples that the law looks ahead.

    Attributes
    ----------
    way_back_since : int or None
        Instant at which the way back to the reference began [ns]; None where it is followed.

    """

    def __init__(self, grace: int, period: int, delay: int) -> None:
        self._trajectory = Trajectory(grace)
        self._lags = [k * period for k in range(delay + 1)]
        self.restart()

    def __len__(self) -> int:
        """Return the number of points held."""
        return len(self._trajectory)

    def restart(self) -> None:
        """Forget when the robot was driven last: time begins again."""
        self._driven: int | None = None
        self._way_back: Transition | None = None
        self.way_back_since: int | None = None

    def extend(self, times: Sequence[int], points: Sequence[Point], most: int | None = None
               ) -> None:
        """
        Add a chunk of the reference.

        Parameters
        ----------
        times : sequence of int
            Instants [ns], increasing.
        points : sequence of (position, velocity, acceleration)
            Each of shape (n,) [rad, rad/s, rad/s²].
        most : int, optional
            Number of points to keep, beside a longer chunk; by default all.

        """
        self._trajectory.extend(times, points)
        if most is not None:
            self._trajectory.limit(max(most, len(times)))

    def pass_over(self, t: int, driven: bool) -> None:
        """Forget what is past at `t` [ns]; `driven` is whether torques may be sent there."""
        self._trajectory.forget(t)
        if not driven and self._driven is None:
            self._driven = t

    def desired(self, t: int, q: Vector, dq: Vector, wait: bool, duration: float
                ) -> list[Point] | None:
        """
        Return what is desired at `t` [ns], and one point for each sample of delay.

        Parameters
        ----------
        t : int
            Instant [ns], from which on the robot is driven if there is a reference for it.
        q, dq : sequence of float, shape (n,)
            Position [rad] and velocity [rad/s] of the robot.
        wait : bool
            Whether the reference must not be extrapolated.
        duration : float
            Time that a way back takes [s]; 0 for none.

        Returns
        -------
        list of (position, velocity, acceleration) or None
            Each of shape (n,) [rad, rad/s, rad/s²]; None if the reference is not known yet.

        Raises
        ------
        ParameterError
            If a way back begins that is not finite.

        """
        reference, last = self._trajectory, t + self._lags[-1]
        if wait and (reference.end is None or last > reference.end) and not reference.ends_at_rest:
            return None
        points = [reference.at(t + lag) for lag in self._lags]
        if points[0] is None:
            return None
        if self._driven is not None and t - self._driven > PAUSE and duration > 0.0:
            self._way_back = smooth_start(
                cast('TimedMotion', reference), t, (q, dq, (0.0,) * len(q)), duration)
            self.way_back_since = t
        self._driven = t
        if self._way_back is not None:
            if t < self._way_back.end:
                return [self._way_back.at(t + lag) for lag in self._lags]
            self._way_back = self.way_back_since = None
        return cast('list[Point]', points)

    def late(self, t: int) -> bool:
        """Return whether a chunk that should go on at `t` [ns] has not come within the grace."""
        return self._trajectory.overdue(t)
