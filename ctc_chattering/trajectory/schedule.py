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
Schedule of a motion that is published ahead of time, for the reference node.

The node hands over times, waypoints and parameters, and publishes the chunks. Time of the motion
is simulated time, or real time since the first state, by the clock of the stamps of the states.
Chunks cover the horizon on the control grid. What has been published until a quarter of the
horizon ahead stays as it is.

The plan knows path time only. A `PathClock` scales it, by the parameter `speed_scaling`.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

from ctc_chattering.errors import ParameterError, RejectedMessage
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.motion_plan import Followed, MotionPlan, Repetition
from ctc_chattering.trajectory.path_clock import PathClock, ScaledMotion
from ctc_chattering.trajectory.reference import RobotState
from ctc_chattering.trajectory.transitions import (
    BRAKING_TIME,
    fit_duration,
    TimedMotion,
    Transition,
)
from ctc_chattering.trajectory.waypoints import Route, Waypoints

#: Largest change between two states of the time from stamp to arrival [ns].
MAX_LEAD_CHANGE_NS = NANOSECONDS // 4
#: Largest distance of two positions that are the same but for interpolation [rad or m].
_SAME_POSITION = 1e-6
#: Number of chunks that cover the horizon.
CHUNKS_AHEAD = 4


class MotionSchedule:
    """
    Time of a motion, and the samples to publish next.

    Parameters
    ----------
    plan : MotionPlan
    period, horizon : int
        Control period, and time by which the motion is published ahead [ns].

    Attributes
    ----------
    chunk_size : int
        Number of samples in a chunk.
    now : int or None
        Present time of the motion [ns], None until it is known.
    simulated : bool
        Whether time is simulated.

    """

    def __init__(self, plan: MotionPlan, period: int, horizon: int) -> None:
        self._plan = plan
        self._period = period
        self._ahead = max(CHUNKS_AHEAD, horizon // period)
        self.chunk_size = self._ahead // CHUNKS_AHEAD
        self.now: int | None = None
        self.simulated = False
        #: Stamp at which the time of the motion is 0 [ns].
        self._start: int | None = None
        #: Stamps of the states minus the node's clock [ns].
        self._lead = 0
        #: Index of the sample to publish next.
        self._next = 0
        self._clock = self._start_clock()
        #: Instant from which the parameters of the plan are in force [ns].
        self._in_force = 0

    @property
    def running(self) -> bool:
        """Tell whether there is a motion with a known time."""
        return self.now is not None and self._plan.motion is not None

    @property
    def started(self) -> bool:
        """Tell whether the motion needs no further state of the robot."""
        return self._start is not None and self._plan.motion is not None

    def follow_clock(self, now: int) -> None:
        """
        Follow simulated time.

        Raises
        ------
        RejectedMessage
            If the motion follows real time.

        """
        if self._start is not None and not self.simulated:
            raise RejectedMessage('real_time', 'the motion follows real time since its start')
        if now == self.now:
            self.repeat()  # Time may stand still because the chunks were not received.
        self.simulated = True
        self._start = 0
        self._advance(now)

    def follow_states(self, stamp: int, clock: int) -> int | None:
        """
        Follow the stamps of the states, and return the motion's time [ns].

        Parameters
        ----------
        stamp, clock : int
            Stamp of the state, and the node's clock [ns].

        Returns
        -------
        int or None
            None for a stamp that is neither near the clock nor in step with the one before.

        """
        previous, lead = self._lead, stamp - clock
        if self._start is None:
            self._lead = lead
        if abs(lead - previous) >= MAX_LEAD_CHANGE_NS:
            return None
        if self._start is None:
            self._start = stamp
        return stamp - self._start

    def follow_real_time(self, clock: int) -> None:
        """Follow the node's clock [ns], unless time is simulated."""
        if self._start is not None and not self.simulated:
            self._advance(clock + self._lead - self._start)

    def _advance(self, now: int) -> None:
        """Set the motion's time [ns], and start again where it went back."""
        went_back = self.now is not None and now < self.now
        self.now = now
        if went_back:
            self.repeat()
            self._plan.restart()
            self._clock = self._start_clock()
            self._in_force = 0

    def _start_clock(self) -> PathClock:
        """Return the clock of a motion that begins."""
        return PathClock.steady(self._plan.config.speed_scaling)

    @property
    def path_time(self) -> int:
        """Present path time [ns]."""
        return self._clock.at(self.now or 0).instant

    @property
    def replacements(self) -> int:
        """Return the number of motions that have replaced another one."""
        return self._plan.replacements

    def path_time_of(self, stamp: int) -> int:
        """Return the path time at a stamp of the states [ns]."""
        return self._clock.at(stamp - (self._start or 0)).instant

    def time_until(self, s: int) -> float:
        """Return the time until path time `s` [s], inf while the motion stands."""
        instant = self._clock.instant_of(s)
        return inf if instant is None else max(seconds(instant - (self.now or 0)), 0.0)

    def repeat(self) -> None:
        """Publish again the chunks from now on."""
        if self.now is not None:
            self._next = self.now // self._period

    def begin(self, start: RobotState, t: int) -> None:
        """Begin the motion where the robot is at `t` [ns], as `MotionPlan.begin`."""
        self._plan.begin(start, self._clock.at(t).instant)
        self._in_force = 0

    def follow(self, route: Route, stamp: int) -> Followed:
        """
        Follow waypoints after what has been published.

        The end of what it returns is a path time.

        Parameters
        ----------
        route : Route
            With times since `stamp` [ns].
        stamp : int
            Stamp of the first instant [ns], 0 for as soon as possible.

        Raises
        ------
        RejectedMessage
            If the motion has not begun.
        CtcError
            If a waypoint is not allowed, or all are past.

        """
        if self.now is None or self._plan.motion is None:
            raise RejectedMessage('early', 'the motion has not begun')
        for i, t in enumerate(route.times):
            if t < 0:
                name = f'points[{i}].time_from_start'
                raise ParameterError(name, seconds(t), '0 s or more')
        begin = self._after_published(self.now)
        epoch = (self._start or 0) - self._lead
        start = self._clock.at(stamp - epoch if stamp else begin).instant
        times = [start + t for t in route.times]
        route = route._replace(times=times)
        path_begin, rate, _ = self._clock.at(begin)
        if not times and not rate:
            # The stop is over, so that nothing of it is left for a later speed.
            q, _, _ = self._published().at(path_begin)
            self.rest_at(q)
            return Followed(0, 0, path_begin)
        followed = self._plan.follow(route, self.path_time, path_begin, rate)
        if followed.waypoints and start >= path_begin:
            q, _, _ = self._plan.motion.at(start)
            self._plan.repetition = Repetition(route, start, q)
        self._next = begin // self._period
        return followed

    @property
    def at_rest(self) -> bool:
        """Tell whether the motion rests from now on."""
        return self.now is not None and self._plan.is_at_rest(self.path_time)

    def was_at(self, stamp: int, q: Vector) -> bool:
        """Tell whether the motion was at a position, shape (n,) [rad], at a stamp [ns]."""
        position, _, _ = self._published().at(self.path_time_of(stamp))
        return max(abs(x - y) for x, y in zip(position, q)) < _SAME_POSITION

    def rest_at(self, q: Vector) -> None:
        """
        Rest at a position after what has been published.

        The motion jumps there: only a robot that is held there already may be led by it.
        """
        zeros = (0.0,) * len(q)
        self._take(Waypoints([self._path_begin], [(q, zeros, zeros)]))

    def plan_home(self) -> Transition:
        """Return the way home from the rest at which the motion is, as `MotionPlan.way_home`."""
        return self._plan.way_home(self._path_begin)

    def go_home(self) -> Followed:
        """Follow the way home after what has been published."""
        path = self.plan_home()
        self._take(path)
        return Followed(1, 0, path.end)

    @property
    def _path_begin(self) -> int:
        """First path time that may still change [ns]."""
        return self._clock.at(self._after_published(self.now or 0)).instant

    def _take(self, motion: TimedMotion) -> None:
        """Follow another motion after what has been published."""
        self._plan.take(motion)
        self._next = self._after_published(self.now or 0) // self._period

    def update(self) -> int | None:
        """
        Take changed parameters, and return their first stamp in force [ns].

        It is None while they wait for the end of a transition.
        """
        assert self.now is not None
        begin = self._after_published(self.now)
        changed = self._plan.update(self.path_time, self._path_begin)
        rate = self._plan.config.speed_scaling
        slews = self._clock.rate != rate
        if slews and self.now >= self._clock.end:
            self._change_rate(begin, rate)
            changed, slews = True, False
        if changed:
            self._next = begin // self._period
            self._in_force = begin
        pending = slews or self._plan.change_pending
        return None if pending else (self._start or 0) + self._in_force

    def _change_rate(self, begin: int, rate: float) -> None:
        """Pass to another rate within the limits."""
        motion = self._plan.motion
        assert motion is not None

        def passage(duration: float) -> ScaledMotion:
            return ScaledMotion(motion, self._clock.slew(begin, rate, duration))

        duration = seconds(fit_duration(passage, BRAKING_TIME, self._plan.limits).end - begin)
        self._clock = self._clock.slew(begin, rate, duration)

    def chunks(self) -> Iterator[tuple[int, list[Point]]]:
        """Yield stamp and samples of each chunk up to the horizon."""
        assert self.now is not None and self._plan.motion is not None
        start = self._start or 0
        present = self.now // self._period
        while self._next < present + self._ahead:
            begin = max(self._next, present) * self._period
            end = begin + self.chunk_size * self._period
            if not self._is_final(begin, end):
                return
            motion = ScaledMotion(self._published(), self._clock)
            instants = range(begin, end, self._period)
            points = list(map(motion.at, instants))
            yield start + begin, points
            self._next = end // self._period

    def _published(self) -> TimedMotion:
        """Return the motion that is published, over path time."""
        assert self._plan.motion is not None
        return self._plan.motion

    def _is_final(self, _begin: int, _end: int) -> bool:
        """Return whether the samples between two instants [ns] may be published."""
        return True

    def desired(self, stamp: int) -> list[Point]:
        """Return the samples of a chunk, by its stamp [ns], without a correction."""
        assert self._plan.motion is not None
        motion = ScaledMotion(self._plan.motion, self._clock)
        begin = stamp - (self._start or 0)
        return [motion.at(begin + k * self._period) for k in range(self.chunk_size)]

    def _after_published(self, now: int) -> int:
        """Return the first instant [ns] that may still change."""
        present = now // self._period
        return (present + self.chunk_size) * self._period
