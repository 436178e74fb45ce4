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

"""The motion that a reference follows, and what it passes into without a jump."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf

from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.joint_limits import check_limits, DescribedLimits
from ctc_chattering.trajectory.motions import (
    Route,
    smooth_start,
    TimedMotion,
    Transition,
    Waypoints,
)
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig, shortest

#: Without a start duration: time over which waypoints that begin in the past are joined, and over
#: which the motion passes into one with changed parameters [s].
_JOIN, _CHANGE = 0.5, 2.0


class MotionPlan:
    """
    A motion, which waypoints or changed parameters replace.

    Parameters
    ----------
    config : ReferenceConfig
        As at the start.
    route : Route or None
        Waypoints in place of the sinusoid.

    Attributes
    ----------
    config : ReferenceConfig
        In force; may be replaced.
    limits : DescribedLimits or None
        Of the robot, where they are known.
    motion : TimedMotion or None
        None before it has begun.
    in_force : int
        Instant from which on the parameters of the sinusoid are in force [ns].

    """

    def __init__(self, config: ReferenceConfig, route: Route | None) -> None:
        self.config, self._route = config, route
        self.limits: DescribedLimits | None = None
        self.motion: TimedMotion | None = None
        self.in_force = 0
        #: Parameters of the sinusoid that the motion has, or passes into.
        self._shape = _shape(config)

    @property
    def from_state(self) -> bool:
        """Whether the motion begins where the robot is."""
        return self._route is not None or self.config.start_duration > 0.0

    def check(self, config: ReferenceConfig) -> None:
        """Raise `CtcError` if parameters would lead beyond the limits."""
        if not config.trajectory_file:
            make_motion(config.changed({'start_duration': 0.0}), limits=self.limits)

    def prepare(self) -> None:
        """Make the motion if it does not depend on the robot's state."""
        if self.motion is None and not self.from_state:
            self.begin(None, 0)

    def begin(self, start: Mapping[str, tuple[float, float]] | None, t: int) -> None:
        """
        Begin the motion.

        Parameters
        ----------
        start : mapping or None
            Position [rad] and velocity [rad/s] by joint, as far as they are known.
        t : int
            Instant [ns].

        Raises
        ------
        CtcError
            If it would lead beyond the limits.

        """
        self.motion = make_motion(self.config, self._route, start, t, self.limits)
        self._shape = _shape(self.config)

    def restart(self) -> None:
        """Forget a motion that began where the robot was: time went back."""
        if self.from_state:
            self.motion = None

    def follow(self, route: Route, begin: int) -> None:
        """
        Go through waypoints.

        Parameters
        ----------
        route : Route
            Some of it may be past.
        begin : int
            Instant until which the motion is the present one [ns].

        Raises
        ------
        CtcError
            If a waypoint is not allowed.

        """
        before = self.motion
        assert before is not None
        if isinstance(before, _Then) and before.end == begin:
            before = before.before  # What was to come at that instant never does.
        state = before.at(begin)
        ordered = route.ordered(self.config.joint_names)
        after = Waypoints(ordered.times, ordered.points, (begin, state))
        if self.limits is not None:
            check_limits('the motion', self.limits, after.extremes())
        self.motion = _Then(before, begin, after if ordered.times[0] > begin else self._fitting(
            lambda duration: smooth_start(after, begin, state, duration), begin, _JOIN))

    def update(self, now: int, begin: int) -> bool:
        """
        Return whether the motion passes into the sinusoid with changed parameters.

        Parameters
        ----------
        now : int
            Instant before which nothing is needed any more [ns].
        begin : int
            Instant from which on the motion may be another one [ns].

        """
        while isinstance(self.motion, (_Then, Transition)) and now >= self.motion.end:
            self.motion = self.motion.after
        before = self.motion
        if (before is None or self._shape == _shape(self.config) or self._route is not None
                or isinstance(before, (_Then, Transition))):
            return False
        after = make_motion(self.config.changed({'start_duration': 0.0}))
        self.motion = self._fitting(
            lambda duration: Transition(before, after, begin, duration), begin, _CHANGE)
        self._shape, self.in_force = _shape(self.config), begin
        return True

    def _fitting(self, make: Callable[[float], Transition], begin: int, least: float
                 ) -> Transition:
        """Return a transition that lasts `start_duration`, or longer if the limits ask for it."""
        duration = self.config.start_duration or least
        if self.limits is None:
            return make(duration)
        longer = shortest(make, begin, duration, self.limits)
        return make(longer if longer < inf else duration)


class _Then:
    """One motion until an instant, and another one from there on."""

    def __init__(self, before: TimedMotion, end: int, after: TimedMotion) -> None:
        self.before, self.end, self.after = before, end, after

    def at(self, t: int) -> Point:
        return (self.before if t < self.end else self.after).at(t)


def _shape(config: ReferenceConfig) -> tuple[tuple[float, ...], ...]:
    """Return the parameters of the sinusoid."""
    return config.center, config.amplitude, config.frequency, config.phase
