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
Keep the running motion of a reference, and replace it smoothly.

Waypoints replace the motion, and so do changed parameters of its profile. The node `reference`
makes one `MotionPlan`, begins it and sets its parameters. `MotionSchedule` passes waypoints and
times on, and reads the points to publish.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import NamedTuple

from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import seconds
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.joint_limits import (
    check_limits,
    continuous_joints,
    describe_violations,
    JointLimits,
    limit_speed,
)
from ctc_chattering.trajectory.path_clock import Stop
from ctc_chattering.trajectory.reference import (
    make_motion,
    ReferenceConfig,
    RobotState,
    Sinusoid,
)
from ctc_chattering.trajectory.transitions import (
    BRAKING_TIME,
    fit_duration,
    sample_passage,
    smooth_start,
    TimedMotion,
    Transition,
)
from ctc_chattering.trajectory.waypoints import (
    check_names,
    PastWaypointsError,
    Route,
    Waypoints,
)

#: Default time to blend into waypoints that begin in the past [s].
_JOIN_TIME_S = 0.5
#: Default time to pass into a changed profile [s].
_CHANGE_TIME_S = 2.0
#: Speed limit while catching up with late waypoints, over their own top speed.
_CATCH_UP_SPEED_RATIO = 1.5
#: Speed that catching up may always have [rad/s or m/s].
_MIN_CATCH_UP_SPEED = 0.5
#: Largest speed of a joint on the way home [rad/s or m/s].
_HOME_SPEED = 0.5


class Followed(NamedTuple):
    """Outcome of waypoints that were accepted."""

    #: Number of waypoints.
    waypoints: int
    #: Number of waypoints that were already past.
    past: int
    #: Instant at which the motion comes to rest, for a stop as well [ns].
    end: int
    #: Continuous joints whose waypoints were shifted by whole turns.
    turned: tuple[str, ...] = ()


class Repetition(NamedTuple):
    """A motion that may come again."""

    #: Waypoints with path times [ns], None for the profile.
    route: Route | None
    #: Path time from which it counts [ns].
    begin: int
    #: Position from which waypoints that were sent begin [rad].
    start: Vector = ()


class MotionPlan:
    """
    Motion that waypoints or changed parameters replace.

    Parameters
    ----------
    config : ReferenceConfig
        Parameters at the start.
    route : Route or None
        Waypoints in place of the profile.

    Attributes
    ----------
    config : ReferenceConfig
        Requested parameters, which the node replaces. `update` takes those of the profile.
    limits : list of JointLimits, length n, or None
        Limits of the robot, None if they are unknown.
    motion : TimedMotion or None
        Motion over path time. None before it has begun.
    replacements : int
        Number of motions that have replaced another one.
    repetition : Repetition or None
        The motion as one that may come again, None for one that leads elsewhere.

    """

    def __init__(self, config: ReferenceConfig, route: Route | None) -> None:
        self.config = config
        self._route = route
        self.limits: list[JointLimits] | None = None
        self.motion: TimedMotion | None = None
        self.replacements = 0
        self.repetition: Repetition | None = None
        #: Parameters of the profile that the motion has, or passes into.
        self._shape = _shape(config)

    def take(self, motion: TimedMotion | None, repetition: Repetition | None = None) -> None:
        """Follow another motion from now on, or none."""
        self.motion = motion
        self.repetition = repetition
        self.replacements += 1

    @property
    def from_state(self) -> bool:
        """Tell whether the motion begins at the robot's present state."""
        return self._route is not None or self.config.start_duration > 0.0

    @property
    def change_pending(self) -> bool:
        """Tell whether `update` has yet to take a changed profile."""
        return self._route is None and self._shape != _shape(self.config)

    def check(self, config: ReferenceConfig) -> None:
        """Raise `CtcError` if parameters would lead beyond the limits."""
        if not config.trajectory_file:
            make_motion(config.changed({'start_duration': 0.0}), limits=self.limits)

    def prepare(self) -> None:
        """Begin now if the robot's state does not matter."""
        if self.motion is None and not self.from_state:
            self.begin(None, 0)

    def begin(self, start: RobotState | None, t: int) -> None:
        """
        Begin the motion.

        Parameters
        ----------
        start : mapping or None
            Position [rad] and velocity [rad/s] by joint, as far as they are known.
        t : int
            Instant at which it begins [ns].

        Raises
        ------
        CtcError
            If it would lead beyond the limits.

        """
        motion = make_motion(self.config, self._route, start, t, self.limits)
        self.take(motion, Repetition(self._route, 0))
        self._shape = _shape(self.config)

    def restart(self) -> None:
        """Discard a motion that began at the robot, since time went back."""
        self.take(None if self.from_state else self.motion, self.repetition)

    def follow(self, route: Route, now: int, begin: int, rate: float = 1.0) -> Followed:
        """
        Follow waypoints, or stop without any.

        Waypoints before `begin` are skipped. The motion meets the next one in time, unless that
        takes more than 1.5 times their top speed, and more than 0.5 rad/s or m/s, or exceeds the
        limits. It then joins the motion of the waypoints later.

        Parameters
        ----------
        route : Route
            Waypoints, of which some may be past.
        now : int
            Present instant [ns].
        begin : int
            Instant from which the motion may be another one [ns].
        rate : float
            Speed of path time, at which a stop takes as long as at full speed.

        Raises
        ------
        CtcError
            If a waypoint is not allowed, or all are past.

        """
        present = self.motion
        assert present is not None
        if isinstance(present, Transition) and present.t0 == present.end == begin:
            present = present.origin  # A replacement that has not begun is itself replaced.
        if not len(route.points):
            return self._stop(route, present, begin, BRAKING_TIME * rate)
        state = present.at(begin)
        requested = route.ordered(self.config.joint_names)
        continuous = continuous_joints(self.config, self.limits)
        route = requested.by_the_short_way(continuous, (begin, state))
        last = route.times[-1]
        if last <= now:
            raise PastWaypointsError(
                f'all waypoints are past: the last one was due {seconds(now - last):.3f} s ago; '
                'are the clocks synchronised?')
        motion = Waypoints(route.times, route.points, (begin, state))
        if self.limits is not None:
            check_limits('the motion', self.limits, motion.extremes())
        past = bisect_right(route.times, begin)
        passage: Waypoints | Transition = motion
        if past:
            passage = self._join(route, past, motion, begin, state)
        self.take(Transition(present, passage, begin, 0.0))
        end = max(last, passage.end)
        return Followed(len(route.points), past, end, _turned_joints(requested, route))

    def _join(self, route: Route, past: int, motion: Waypoints, begin: int, state: Point
              ) -> Waypoints | Transition:
        """Return the way into waypoints that are partly past."""
        points = [*motion.extremes(), state]
        top_speed = max(abs(v) for _, dq, _ in points for v in dq)
        speed = max(_CATCH_UP_SPEED_RATIO * top_speed, _MIN_CATCH_UP_SPEED)
        limits = self._limits_up_to(speed)
        if past < len(route.points):
            direct = Waypoints(
                route.times[past:],
                route.points[past:],
                (begin, state))
            if not describe_violations(limits, direct.extremes()):
                return direct
        return fit_duration(
            lambda duration: smooth_start(motion, begin, state, duration),
            self.config.start_duration or _JOIN_TIME_S,
            limits)

    def _limits_up_to(self, speed: float) -> list[JointLimits]:
        """Return the limits of the robot, if any are known, with a lower speed [rad/s or m/s]."""
        limits = self.limits or list(map(JointLimits, self.config.joint_names))
        return limit_speed(limits, speed)

    def _stop(self, route: Route, present: TimedMotion, begin: int, shortest: float) -> Followed:
        """Bring a motion to rest on its path."""
        if route.names:
            check_names(route.names, self.config.joint_names)
        if isinstance(present, Stop):
            return Followed(0, 0, present.end)
        stop = fit_duration(
            lambda duration: Stop(present, begin, duration),
            shortest,
            self.limits)
        self.take(stop)
        return Followed(0, 0, stop.end)

    def is_at_rest(self, begin: int) -> bool:
        """Tell whether the motion rests from path time `begin` [ns] on."""
        motion = self.motion
        if isinstance(motion, Transition) and begin >= motion.end:
            motion = motion.target
        stands = isinstance(motion, (Stop, Waypoints)) and begin >= motion.end
        return stands or (isinstance(motion, Sinusoid) and not any(self._shape[1]))

    def way_home(self, begin: int) -> Transition:
        """
        Return the way from rest to where the configured motion begins.

        It is a straight line of the joints, within the limits and at most 0.5 rad/s or m/s.

        Parameters
        ----------
        begin : int
            Path time at which it begins [ns].

        Raises
        ------
        CtcError
            If no way keeps the limits.

        """
        assert self.motion is not None
        state = self.motion.at(begin)
        first = make_motion(self.config.changed({'start_duration': 0.0}), self._route)
        q, _, _ = first.at(0)
        zeros = (0.0,) * len(q)
        goal = Route(self.config.joint_names, [begin], [(q, zeros, zeros)])
        goal = goal.by_the_short_way(
            continuous_joints(self.config, self.limits), (begin, state))
        limits = self._limits_up_to(_HOME_SPEED)
        home = Waypoints(goal.times, goal.points)
        path = fit_duration(
            lambda duration: smooth_start(home, begin, state, duration),
            _CHANGE_TIME_S,
            limits)
        check_limits('the way home', limits, sample_passage(path))
        return path

    def update(self, now: int, begin: int) -> bool:
        """
        Pass into a changed profile, and return whether this call began it.

        A change during another transition waits for its end.

        Parameters
        ----------
        now : int
            Present instant [ns].
        begin : int
            Instant from which the motion may be another one [ns].

        """
        while isinstance(self.motion, Transition) and now >= self.motion.end:
            self.motion = self.motion.target
        present = self.motion
        if present is None or isinstance(present, Transition) or not self.change_pending:
            return False
        changed = make_motion(self.config.changed({'start_duration': 0.0}))
        passage = fit_duration(
            lambda duration: Transition(present, changed, begin, duration),
            self.config.start_duration or _CHANGE_TIME_S,
            self.limits)
        self.take(passage, Repetition(None, 0))
        self._shape = _shape(self.config)
        return True


def _turned_joints(requested: Route, route: Route) -> tuple[str, ...]:
    """Return the joints whose waypoints are at another turn than requested."""
    targets = zip(*(q for q, _, _ in requested.points))
    positions = zip(*(q for q, _, _ in route.points))
    joints = zip(route.names, targets, positions)
    return tuple(name for name, target, position in joints if target != position)


def _shape(config: ReferenceConfig) -> tuple[tuple[float, ...], ...]:
    """Return the parameters of the profile that may change."""
    return config.center, config.amplitude, config.frequency, config.phase
