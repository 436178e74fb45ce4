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
The reference, and the way back to it.

The control loop adds the chunks of the reference as they come, and asks for the points of each
sample.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.trajectory.buffer import Point, Trajectory
from ctc_chattering.trajectory.path_clock import Stop
from ctc_chattering.trajectory.transitions import (
    braking,
    BRAKING_TIME,
    smooth_start,
    TimedMotion,
    Transition,
)
from ctc_chattering.trajectory.waypoints import Waypoints

#: Time in which a robot that moves is brought to rest to be held [s]. At the 1 rad/s at which
#: guiding begins to brake it goes on by 0.1 rad, the margin of a joint limit.
_HOLD_TIME_S = 0.2
#: Largest distance of a reference that takes over a robot that is held [rad or m].
_TAKEOVER_DISTANCE = 1e-3
#: Time between the waypoints of a stop before a limit [ns].
_STOP_STEP_NS = NANOSECONDS // 100
#: Factor from one duration of this stop that is tried to the next, and their number.
_STOP_FACTOR = 0.7
_STOP_TRIALS = 12
#: Shortest duration of this stop: a limit that is too near is passed rather than braked for [s].
_SHORTEST_STOP_S = 0.02
#: Time without a torque after which the robot may be far from the reference [ns].
PAUSE = NANOSECONDS // 10


class DesiredMotion(Trajectory):
    """
    The reference at the instants of a law.

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
    restart_duration : float
        As the parameter of this name: duration of a way back [s], or 0 for none.
    way_back : Transition or None
        The way back to the reference, or None where that is followed.
    holding : bool
        Whether the robot is held where it is until a reference rests there.

    """

    def __init__(self, grace: int, period: int, delay: int) -> None:
        super().__init__(grace)
        self.restart_duration = 0.0
        self._lags = [k * period for k in range(delay + 1)]
        self._period = period
        self.holding = False
        self.restart()

    def restart(self) -> None:
        """Forget when the robot was driven last: time begins again."""
        self._driven: int | None = None
        #: Motion to the rest at which the robot is held, None until its first sample.
        self._rest: Waypoints | None = None
        self.way_back: Transition | None = None

    def pass_over(self, t: int, driven: bool) -> None:
        """Forget points before `t` [ns], where torques may be `driven`."""
        self.forget(t)
        if not driven and self._driven is None:
            self._driven = t

    def resumes(self, t: int) -> bool:
        """Return whether `t` [ns] ends a pause of the torques."""
        return self._driven is not None and t - self._driven > PAUSE

    def hold(self, rest: Waypoints | None = None) -> None:
        """Hold the robot at the end of a motion, by default where it is at the next sample."""
        self.holding = True
        self.way_back = None
        self._rest = rest

    def stop_within(self, begin: int, is_allowed: Callable[[Vector], bool]) -> None:
        """
        Come to rest on the path, or the line by which it goes on, and hold.

        Parameters
        ----------
        begin : int
            Instant from which on the motion slows down [ns].
        is_allowed : callable
            Tells whether it may rest at a position, shape (n,) [rad].

        """
        path = self.way_back or cast('TimedMotion', self)
        # Half of the duration of a stop is time along the path.
        longest = 2.0 * seconds(max(self._times[-1] - begin, 0) + self.grace)
        for k in range(_STOP_TRIALS):
            duration = min(2.0 * BRAKING_TIME, longest) * _STOP_FACTOR ** k
            stop = Stop(path, begin, max(duration, _SHORTEST_STOP_S))
            if is_allowed(stop.at(stop.end)[0]):
                break
        times = [*range(begin, stop.end, max(self._period, _STOP_STEP_NS)), stop.end]
        self.hold(Waypoints(times, [stop.at(instant) for instant in times]))

    def _held_points(self, t: int, q: Vector, dq: Vector) -> list[Point] | None:
        """Return the points of the rest, or None once a reference rests there."""
        if self._rest is None or self.resumes(t):
            self._rest = braking(t, (q, dq, (0.0,) * len(q)), _HOLD_TIME_S)
        held = self._rest.at(t)
        reference = self.at(t)
        is_due = t >= self._rest.end and not self.overdue(t)
        if is_due and reference is not None and _rests_at(reference, held):
            self.holding = False
            self._rest = None
            return None
        return [self._rest.at(t + lag) for lag in self._lags]

    def _turns_beside(self, t: int) -> Point | None:
        return self.at(t) if self._rest is None else self._rest.at(t)

    def anchor_point(self, t: int) -> Point | None:
        """Return the point at `t` [ns] beside which turns are counted, if it is known."""
        way_back = self.way_back
        begins = self.resumes(t) and self.restart_duration > 0.0
        if way_back is None or begins or t >= way_back.end:
            return self.at(t)
        return way_back.at(t)

    def desired(self, t: int, q: Vector, dq: Vector, wait: bool) -> list[Point] | None:
        """
        Return the desired points at `t` and over the delay.

        Parameters
        ----------
        t : int
            Instant [ns], from which on the robot is driven if there is a reference for it.
        q, dq : sequence of float, shape (n,)
            Position [rad] and velocity [rad/s] of the robot.
        wait : bool
            Whether the reference must not be extrapolated.

        Returns
        -------
        list of (position, velocity, acceleration) or None
            Each of shape (n,) [rad, rad/s, rad/s²], or None if the reference is not known yet.

        Raises
        ------
        ParameterError
            If a way back begins that is not finite.

        """
        if self.holding:
            held = self._held_points(t, q, dq)
            self._driven = t
            if held is not None:
                return held
        points = [self.at(t + lag) for lag in self._lags]
        if points[0] is None:
            return None
        end = t + self._lags[-1]
        if wait and end > self._times[-1] and not self.ends_at_rest:
            return None
        if self.resumes(t) and self.restart_duration > 0.0:
            start = q, dq, (0.0,) * len(q)
            self.way_back = smooth_start(
                cast('TimedMotion', self), t, start, self.restart_duration)
        self._driven = t
        if self.way_back is not None:
            if t < self.way_back.end:
                return [self.way_back.at(t + lag) for lag in self._lags]
            self.way_back = None
        return points  # type: ignore[return-value]  # After the first one, none is unknown.


def _rests_at(point: Point, held: Point) -> bool:
    """Return whether a point of the reference rests where the robot is held."""
    q, dq, _ = point
    held_q, _, _ = held
    is_near = all(abs(x - y) <= _TAKEOVER_DISTANCE for x, y in zip(q, held_q))
    return is_near and not any(dq)
