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
The desired motion: a periodic one of every joint, or waypoints, with a smooth start or without.

The sinusoid is the paper's, q_d = center + amplitude sin(2π f t + phase). The trapezoid moves from
center - amplitude to center + amplitude and back with half the largest velocity of the sinusoid
and a quarter of its acceleration: constant acceleration for 1 / (π f), constant velocity and
deceleration for as long each, then rest until 2 / f is over.

`make_motion` returns the motion of a run, `MotionPlan` replaces it while a node runs, and
`reference_table` returns its samples as one array.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
import dataclasses
from functools import lru_cache
from math import ceil, cos, inf, log10, pi, sin
from typing import NamedTuple, Protocol, TypeVar

from ctc_chattering.dynamics.registry import DescribedConfig
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.angles import nearest
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.parameters import parameter, whole
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.joint_limits import (
    check_limits,
    DescribedLimits,
    JointLimits,
    LimitSet,
)
from ctc_chattering.trajectory.motions import (
    BRAKING_TIME,
    check_names,
    Route,
    smooth_start,
    Stop,
    TimedMotion,
    Transition,
    Waypoints,
)
import numpy as np


@dataclasses.dataclass(frozen=True)
class ReferenceConfig(DescribedConfig):
    """Parameters of the desired motion."""

    profile: str = parameter(
        'sinusoid', 'Between center - amplitude and center + amplitude: a sinusoid, or moves of '
        'trapezoidal velocity, half as fast, with a rest after each.',
        choices=('sinusoid', 'trapezoid'), read_only=True)
    center: tuple[float, ...] = parameter(
        (pi, 0.5 * pi), 'Centre of the sinusoid; by default 0 where there are not two joints.',
        'rad', minimum=-inf)
    amplitude: tuple[float, ...] = parameter(
        0.5, 'Amplitude of the sinusoid.', 'rad', minimum=-inf)
    frequency: tuple[float, ...] = parameter(1.0, 'Frequency of the sinusoid.', 'Hz')
    phase: tuple[float, ...] = parameter(
        0.0, 'Phase of the sinusoid at t = 0.', 'rad', minimum=-inf)
    trajectory_file: str = parameter(
        '', 'YAML file of waypoints, as trajectory_msgs/JointTrajectory, in place of the profile; '
        'empty for none.', read_only=True)
    start_duration: float = parameter(
        0.0, 'Time of a smooth start from where the robot is; 0 for none, as in the paper.', 's')


class Sinusoid:
    """
    The desired motion as a function of time.

    Parameters
    ----------
    config : ReferenceConfig

    """

    def __init__(self, config: ReferenceConfig) -> None:
        self._joints = [
            (c, a, 2.0 * pi * f, p) for c, a, f, p in zip(
                config.center, config.amplitude, config.frequency, config.phase)]

    def extremes(self) -> list[Point]:
        """Return the greatest and least position, velocity and acceleration of every joint."""
        rows = [(c, a, w) if w else (c + a * sin(p), 0.0, 0.0) for c, a, w, p in self._joints]
        return [tuple(zip(*(  # type: ignore[misc]
            (c + sign * a, sign * w * a, sign * w * w * a) for c, a, w in rows)))
            for sign in (1.0, -1.0)]

    def at(self, t: int) -> Point:
        """Return q_d [rad], dq_d [rad/s] and ddq_d [rad/s²], each of shape (n,), at `t` [ns]."""
        s = seconds(t if type(t) is int else whole('t', t))
        q_d, dq_d, ddq_d = map(list, zip(*(self._of_joint(s, *x) for x in self._joints)))
        return q_d, dq_d, ddq_d

    @staticmethod
    def _of_joint(s: float, center: float, amplitude: float, omega: float, phase: float
                  ) -> tuple[float, float, float]:
        """Return position, velocity and acceleration of a joint at `s` [s]."""
        angle = omega * s + phase
        x = amplitude * sin(angle)
        return center + x, omega * amplitude * cos(angle), -omega * omega * x


class Trapezoid(Sinusoid):
    """
    Moves of trapezoidal velocity with a rest after each, as a function of time.

    Parameters
    ----------
    config : ReferenceConfig

    """

    @staticmethod
    def _of_joint(s: float, center: float, amplitude: float, omega: float, phase: float
                  ) -> tuple[float, float, float]:
        """Return position, velocity and acceleration of a joint at `s` [s]."""
        slow = 0.5 * omega
        moves, angle = divmod(slow * s + phase, 2.0 * pi)
        size = -amplitude if moves % 2.0 else amplitude
        x, v, a = _move(angle)
        return center + size * x, slow * size * v, slow * slow * size * a


def _move(angle: float) -> tuple[float, float, float]:
    """Return a move from -1 to 1 in an angle of 3, and its two derivatives by the angle."""
    if angle < 1.0:
        return 0.5 * angle * angle - 1.0, angle, 1.0
    if angle < 2.0:
        return angle - 1.5, 1.0, 0.0
    rest = max(3.0 - angle, 0.0)
    return 1.0 - 0.5 * rest * rest, rest, -1.0 if rest else 0.0


def make_motion(config: ReferenceConfig, route: Route | None = None,
                start: Mapping[str, tuple[float, float]] | None = None, t0: int = 0,
                limits: DescribedLimits | None = None, continuous: Sequence[bool] | None = None
                ) -> TimedMotion:
    """
    Return the desired motion that a configuration describes.

    Parameters
    ----------
    config : ReferenceConfig
        Sinusoid or file, and the smooth start.
    route : Route, optional
        The waypoints of its `trajectory_file`, or others in place of the sinusoid.
    start : mapping, optional
        Position [rad] and velocity [rad/s] of the robot at `t0` by joint: where a smooth start
        begins, and the way to a first waypoint after `t0`. A joint that is left out begins on
        the motion.
    t0 : int
        Instant of the start [ns].
    limits : DescribedLimits, optional
        Of the joints of `config`, which the start and the motion must keep.
    continuous : sequence of bool, optional
        Which joints of `config` turn endlessly: they start at the angle nearest to the motion, and
        take the short way between waypoints. By default as `config` and `limits` say.

    Returns
    -------
    TimedMotion
        Its joints are in the order of `config.joint_names`.

    Raises
    ------
    CtcError
        If the waypoints are not allowed or not given, `start` is needed and not given, or
        something is beyond the limits: the message names joints and amounts, and for a smooth
        start that is too short a duration that would do.

    """
    names = config.joint_names
    if continuous is None:
        continuous = config.which_are_continuous(limits.continuous if limits else ())
    motion: Waypoints | Sinusoid
    if route is not None:
        route = route.ordered(names).by_the_short_way(continuous)
        start = _nearest(names, start, Waypoints(route.times, route.points).at(t0), continuous)
        motion = _through(route, names, start, t0, config.start_duration > 0.0)
    elif config.trajectory_file:
        raise CtcError(f'trajectory_file: {config.trajectory_file} has not been read')
    else:
        motion = (Trapezoid if config.profile == 'trapezoid' else Sinusoid)(config)
    if config.start_duration and start is None:
        raise ParameterError('start_duration', config.start_duration,
                             '0 where it is not known where the robot is')
    start = _nearest(names, start, motion.at(t0), continuous)
    begin = _begin(names, start or {}, motion.at(t0))
    if limits is not None:
        check_limits('the motion', limits, motion.extremes())
        if start:
            check_limits('the start', limits, [begin])
    if not config.start_duration:
        return motion

    def started(duration: float) -> Transition:
        return smooth_start(motion, t0, begin, duration)
    found = started(config.start_duration)
    if limits is not None and (text := limits.excess(_sampled(found))):
        duration = shortest(started, config.start_duration, limits)
        raise CtcError(f'start_duration {config.start_duration:g} s: the start is beyond the '
                       f'limits of the description: {text}; '
                       + (f'{duration:g} s would do' if duration < inf else 'no other would do'))
    return found


class Passage(TimedMotion, Protocol):
    """A motion from one into another."""

    t0: int
    end: int


P = TypeVar('P', bound=Passage)


def shortest(make: Callable[[float], Passage], duration: float, limits: LimitSet) -> float:
    """
    Return the shortest duration of a transition, to a tenth, that keeps the limits.

    Parameters
    ----------
    make : callable
        Returns the transition of a duration [s].
    duration : float
        The least one [s].
    limits : LimitSet
        What it must keep.

    Returns
    -------
    float
        inf if none of up to a thousand times `duration` keeps them.

    """
    def keeps(candidate: float) -> bool:
        return not limits.excess(_sampled(make(candidate)))
    if keeps(duration):
        return duration
    for k in range(1, 73):
        candidate = duration * 1.1 ** k
        digits = 1 - ceil(log10(candidate))
        candidate = ceil(candidate * 10.0 ** (digits + 1)) / 10.0 ** (digits + 1)
        if keeps(candidate):
            return candidate
    return inf


def _sampled(transition: Passage) -> list[Point]:
    """Return points of a transition, a millisecond apart or a two-thousandth of it."""
    t0, end = transition.t0, transition.end
    step = max(NANOSECONDS // 1000, (end - t0) // 2000)
    return [transition.at(t) for t in (*range(t0, end, step), end)]


def _through(route: Route, names: Sequence[str],
             start: Mapping[str, tuple[float, float]] | None, t0: int, smooth: bool) -> Waypoints:
    """Return the way from a start through waypoints; a smooth start takes away its velocity."""
    if start is None:
        return Waypoints(route.times, route.points)
    rest = (0.0,) * len(names)
    q, dq, ddq = _begin(names, start, (route.points[0][0], rest, rest))
    return Waypoints(route.times, route.points, (t0, (q, rest if smooth else dq, ddq)))


def _nearest(names: Sequence[str], start: Mapping[str, tuple[float, float]] | None, there: Point,
             continuous: Sequence[bool]) -> Mapping[str, tuple[float, float]] | None:
    """Return a start with the turns of continuous joints that bring it nearest to a motion."""
    if start is None or not any(continuous):
        return start
    targets = {name: target for name, target, endless in zip(names, there[0], continuous)
               if endless}
    return {name: (nearest(q, targets.get(name, q)), dq)
            for name, (q, dq) in start.items()}


def _begin(names: Sequence[str], start: Mapping[str, tuple[float, float]], there: Point) -> Point:
    """Return the robot's state, without acceleration, and `there` of joints it does not have."""
    rows = [(*start[name], 0.0) if name in start else row
            for name, row in zip(names, zip(*there))]
    return tuple(zip(*rows))  # type: ignore[return-value]


def reference_table(config: ReferenceConfig, route: Route | None,
                    start: tuple[tuple[str, tuple[float, float]], ...], joints: tuple[str, ...],
                    period: int, count: int, continuous: tuple[bool, ...] = ()) -> Array:
    """
    Return the desired motion at ``k period``, shape (count, 3, n) [rad, rad/s, rad/s²].

    It is kept for other runs with this motion: do not write into it.

    Parameters
    ----------
    config, route
        As `make_motion` takes them.
    start : tuple of (str, (float, float))
        Position [rad] and velocity [rad/s] of the robot at the start by joint.
    joints : tuple of str, shape (n,)
        Order of the joints.
    period : int
        [ns].
    count : int
        Number of samples.
    continuous : tuple of bool
        Which joints of `config` turn endlessly.

    """
    order = tuple(config.joint_names.index(name) for name in joints)
    if route is not None:
        motion = make_motion(config, route, dict(start), continuous=continuous)
        return _samples_of(motion, order, period, count)
    table: Array = _kept(config, start, order, period, count, continuous)
    return table


@lru_cache(128)
def _kept(config: ReferenceConfig, start: tuple[tuple[str, tuple[float, float]], ...],
          order: tuple[int, ...], period: int, count: int, continuous: tuple[bool, ...]) -> Array:
    """Return the samples of a sinusoid and its start, which are the same in many runs."""
    motion = make_motion(config, None, dict(start), continuous=continuous)
    if not isinstance(motion, Transition):
        return _samples_of(motion, order, period, count)
    # What comes after the start does not depend on it.
    alone = config.changed({'start_duration': 0.0})
    table: Array = _kept(alone, (), order, period, count, continuous).copy()
    inside = min(-(-motion.end // period), count)
    table[:inside] = _samples_of(motion, order, period, inside)
    return table


def _samples_of(motion: TimedMotion, order: Sequence[int], period: int, count: int) -> Array:
    """Return the samples of a motion, of its joints in an order."""
    rows = np.array([motion.at(k * period) for k in range(count)]).reshape(count, 3, -1)
    # In the order of rows, in which the loop is compiled: for another one it would be once more.
    table: Array = np.ascontiguousarray(rows[:, :, list(order)])
    return table


#: Without a start duration: time over which waypoints that begin in the past are joined, and over
#: which the motion passes into one with changed parameters [s].
_JOIN, _CHANGE = 0.5, 2.0
#: Greatest speed of the way into waypoints that are late, over the greatest of their own.
_MAX_HASTE = 1.5
#: Speed that is never too fast for it [rad/s or m/s].
_GENTLE_SPEED = 0.5


class Followed(NamedTuple):
    """Outcome of waypoints that were accepted."""

    #: Number of waypoints, and of those that were past.
    waypoints: int
    past: int
    #: Instant at which the motion comes to rest, also where there is no waypoint [ns].
    end: int
    #: Joints of which a position is that of another turn than was written.
    turned: tuple[str, ...] = ()


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

    @property
    def continuous(self) -> tuple[bool, ...]:
        """Mask of the joints that turn endlessly, shape (n,)."""
        return self.config.which_are_continuous(self.limits.continuous if self.limits else ())

    def follow(self, route: Route, now: int, begin: int, epoch: int = 0) -> Followed:
        """
        Go through waypoints; stop without any.

        Those until `begin` are left out. Where the next one is too near in time for the speed that
        the waypoints have, the motion passes into theirs instead, and is late.

        Parameters
        ----------
        route : Route
            Some of it may be past.
        now, begin : int
            Present instant, and the one until which the motion is the present one [ns].
        epoch : int
            Instant 0 by the clock that a user of the waypoints knows, for messages [ns].

        Raises
        ------
        CtcError
            If a waypoint is not allowed, or all are past.

        """
        before = self.motion
        assert before is not None
        if isinstance(before, Transition) and before.t0 == begin - 1:
            before = before.before  # What was to come at that instant never does.
        if not len(route.points):
            return self._stop(route.names, before, begin)
        state = before.at(begin)
        written = route.ordered(self.config.joint_names)
        route = written.by_the_short_way(self.continuous, (begin, state))
        if route.times[-1] <= now:
            due, present = (seconds(epoch + t) for t in (route.times[-1], now))
            raise CtcError(f'all waypoints are past: the last one was due at {due:.3f} s, now it '
                           f'is {present:.3f} s; are the clocks synchronised?')
        left_out = bisect_right(route.times, begin)
        after = Waypoints(route.times, route.points, (begin, state))
        if self.limits is not None:
            check_limits('the motion', self.limits, after.extremes())
        passage = self._late(route, left_out, after, begin, state) if left_out else after
        # In a nanosecond, so that every sample is of the one or the other.
        self.motion = Transition(before, passage, begin - 1, 1e-9)
        turned = tuple(name for i, name in enumerate(route.names) if any(
            a[0][i] != b[0][i] for a, b in zip(written.points, route.points)))
        return Followed(len(route.points), left_out, max(route.times[-1], passage.end), turned)

    def _late(self, route: Route, left_out: int, whole: Waypoints, begin: int, state: Point
              ) -> Waypoints | Transition:
        """Return the way from a state into waypoints of which the first ones are past."""
        fastest = max(abs(x) for point in (*whole.extremes(), state) for x in point[1])
        limits = self.limits or LimitSet(list(map(JointLimits, route.names)))
        limits = limits.slower(max(_MAX_HASTE * fastest, _GENTLE_SPEED))
        if left_out < len(route.points):
            direct = Waypoints(route.times[left_out:], route.points[left_out:], (begin, state))
            if not limits.excess(direct.extremes()):
                return direct
        return _fitting(lambda duration: smooth_start(whole, begin, state, duration),
                        self.config.start_duration or _JOIN, limits)

    def _stop(self, names: Sequence[str], before: TimedMotion, begin: int) -> Followed:
        """Bring a motion to rest on its path; joints may be named, then all of them."""
        if names:
            check_names(names, self.config.joint_names)
        if isinstance(before, Stop):
            return Followed(0, 0, before.end)
        stop = _fitting(lambda duration: Stop(before, begin, duration), BRAKING_TIME, self.limits)
        self.motion = stop
        return Followed(0, 0, stop.end)

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
        while isinstance(self.motion, Transition) and now >= self.motion.end:
            self.motion = self.motion.after
        if isinstance(self.motion, Stop) and now >= self.motion.end:
            self.motion = Waypoints([self.motion.end], [self.motion.at(self.motion.end)])
        before = self.motion
        if (before is None or self._shape == _shape(self.config) or self._route is not None
                or isinstance(before, Transition)):
            return False
        after = make_motion(self.config.changed({'start_duration': 0.0}))
        self.motion = _fitting(
            lambda duration: Transition(before, after, begin, duration),
            self.config.start_duration or _CHANGE, self.limits)
        self._shape, self.in_force = _shape(self.config), begin
        return True


def _fitting(make: Callable[[float], P], duration: float, limits: LimitSet | None) -> P:
    """Return a passage that lasts `duration` [s], or longer if limits ask for it."""
    if limits is None:
        return make(duration)
    longer = shortest(make, duration, limits)
    return make(longer if longer < inf else duration)


def _shape(config: ReferenceConfig) -> tuple[tuple[float, ...], ...]:
    """Return the parameters of the sinusoid."""
    return config.center, config.amplitude, config.frequency, config.phase
