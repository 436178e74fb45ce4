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
The desired motion of a run.

It is periodic, or goes through waypoints. `ReferenceConfig` comes from the parameter file.
`make_motion` returns the motion of a run, with its smooth start, and `reference_table` returns its
samples as one array.

The sinusoid is the paper's, q_d = center + amplitude sin(2π f t + phase). The trapezoid moves from
center - amplitude to center + amplitude and back with half the largest velocity of the sinusoid
and a quarter of its acceleration: constant acceleration for 1 / (π f), constant velocity and
deceleration for as long each, then rest until 2 / f is over.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import dataclasses
from functools import lru_cache, partial
from math import cos, inf, pi, sin
from typing import NamedTuple

from ctc_chattering.dynamics.registry import DescribedConfig
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.angles import nearest
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import seconds
from ctc_chattering.parameters import checked_integer, LEAST, parameter, PerJoint
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.joint_limits import (
    check_limits,
    continuous_joints,
    describe_violations,
    JointLimits,
)
from ctc_chattering.trajectory.path_clock import PathClock, ScaledMotion
from ctc_chattering.trajectory.transitions import (
    sample_passage,
    shortest_duration,
    smooth_start,
    TimedMotion,
    Transition,
)
from ctc_chattering.trajectory.waypoints import Route, Waypoints
import numpy as np

#: Position, velocity and acceleration of one joint [rad, rad/s, rad/s²].
JointPoint = tuple[float, float, float]
#: Position [rad] and velocity [rad/s] of the robot by joint.
RobotState = Mapping[str, tuple[float, float]]
#: The same, hashable.
StateItems = tuple[tuple[str, tuple[float, float]], ...]


@dataclasses.dataclass(frozen=True)
class ReferenceConfig(DescribedConfig):
    """Parameters of the desired motion."""

    profile: str = parameter(
        'sinusoid', 'Motion between center - amplitude and center + amplitude. It is a sinusoid, '
        'or consists of moves with trapezoidal velocity at half the speed, with a rest after '
        'each.',
        choices=('sinusoid', 'trapezoid'), read_only=True)
    center: PerJoint = parameter(
        (pi, 0.5 * pi), 'Centre of the sinusoid. The default is for two joints; for other '
        'numbers it is 0.',
        'rad', minimum=-inf)
    amplitude: PerJoint = parameter(
        0.5, 'Amplitude of the sinusoid.', 'rad', minimum=-inf)
    frequency: PerJoint = parameter(1.0, 'Frequency of the sinusoid.', 'Hz')
    phase: PerJoint = parameter(
        0.0, 'Phase of the sinusoid at t = 0.', 'rad', minimum=-inf)
    trajectory_file: str = parameter(
        '', 'YAML file of waypoints as trajectory_msgs/JointTrajectory, instead of the profile; '
        'empty for no file.', read_only=True)
    start_duration: float = parameter(
        0.0, 'Duration of a smooth start from the present position; 0 for none, as in the paper.',
        's')
    speed_scaling: float = parameter(
        1.0, 'Speed of the motion as a share of its own; 0 holds the position. A change slews.',
        minimum=0.0, maximum=1.0)
    learning: bool = parameter(
        False, 'Learn from repeated passes of the motion a correction of the reference '
        '(docs/learning.md).', read_only=True)
    learning_gain: float = parameter(
        0.7, 'Share of the error that a pass corrects.', minimum=LEAST, maximum=1.0,
        read_only=True)
    learning_cutoff: float = parameter(
        0.0, 'Highest frequency that is learned; 0 for the highest that converges.', 'Hz',
        maximum=1e3, read_only=True)
    learning_bound: float = parameter(
        0.1, 'Largest correction of a joint.', 'rad', minimum=LEAST, maximum=1.0, read_only=True)
    learning_file: str = parameter(
        '', 'File of `ctc learn` with a correction to begin with; empty for none.', read_only=True)

    def validate(self) -> None:
        """Check what `DescribedConfig` checks, and that a learned file is used."""
        super().validate()
        if self.learning_file and not self.learning:
            raise ParameterError('learning_file', self.learning_file,
                                 'a file only with learning: true')


class StartError(CtcError):
    """
    A smooth start beyond the limits.

    Attributes
    ----------
    enough : float or None
        Duration that keeps the limits [s], None if no other does.

    """

    def __init__(self, duration: float, violations: str, enough: float | None) -> None:
        advice = f'{enough:g} s keeps them' if enough else 'no other duration keeps them'
        super().__init__(f'start_duration {duration:g} s: the start is beyond the limits of the '
                         f'description: {violations}; {advice}')
        self.enough = enough


class JointSinusoid(NamedTuple):
    """Sinusoid of one joint."""

    center: float
    amplitude: float
    #: 2π times the frequency [rad/s].
    omega: float
    phase: float

    def at(self, s: float) -> JointPoint:
        """Return the point at `s` [s]."""
        center, amplitude, omega, phase = self
        angle = omega * s + phase
        x = amplitude * sin(angle)
        return (
            center + x,
            omega * amplitude * cos(angle),
            -omega * omega * x)

    def extreme(self, sign: float) -> JointPoint:
        """Return the greatest (sign 1) or least values."""
        center, size, omega, phase = self
        if not omega:  # The joint stands.
            return center + size * sin(phase), 0.0, 0.0
        size *= sign
        return (
            center + size,
            omega * size,
            omega * omega * size)


class JointTrapezoid(JointSinusoid):
    """Moves of one joint with trapezoidal velocity."""

    def at(self, s: float) -> JointPoint:
        """Return the point at `s` [s]."""
        slow = 0.5 * self.omega
        angle = slow * s + self.phase
        moves, angle_of_move = divmod(angle, 2.0 * pi)
        size = -self.amplitude if moves % 2.0 else self.amplitude
        x, v, a = _unit_move(angle_of_move)
        return (
            self.center + size * x,
            slow * size * v,
            slow * slow * size * a)


def _unit_move(angle: float) -> JointPoint:
    """Return a move from -1 to 1 within an angle of 3."""
    if angle < 1.0:
        return 0.5 * angle * angle - 1.0, angle, 1.0
    if angle < 2.0:
        return angle - 1.5, 1.0, 0.0
    remaining = max(3.0 - angle, 0.0)
    return (
        1.0 - 0.5 * remaining * remaining,
        remaining,
        -1.0 if remaining else 0.0)


class Sinusoid:
    """
    The desired motion as a function of time.

    Parameters
    ----------
    config : ReferenceConfig

    """

    _profile: type[JointSinusoid] = JointSinusoid

    def __init__(self, config: ReferenceConfig) -> None:
        omega = [2.0 * pi * f for f in config.frequency]
        self._joints = list(map(
            self._profile,
            config.center,
            config.amplitude,
            omega,
            config.phase))

    def extremes(self) -> list[Point]:
        """Return the greatest and least values of every joint."""
        points = []
        for sign in (1.0, -1.0):
            joints = [joint.extreme(sign) for joint in self._joints]
            points.append(tuple(zip(*joints)))
        return points  # type: ignore[return-value]

    def at(self, t: int) -> Point:
        """Return q_d, dq_d and ddq_d at `t` [ns]."""
        s = seconds(t if type(t) is int else checked_integer('t', t))
        joints = [joint.at(s) for joint in self._joints]
        q_d, dq_d, ddq_d = map(list, zip(*joints))
        return q_d, dq_d, ddq_d


class Trapezoid(Sinusoid):
    """
    Moves of trapezoidal velocity with a rest after each.

    Parameters
    ----------
    config : ReferenceConfig

    """

    _profile = JointTrapezoid


def make_motion(config: ReferenceConfig, route: Route | None = None,
                start: RobotState | None = None, t0: int = 0,
                limits: Sequence[JointLimits] | None = None,
                continuous: Sequence[bool] = ()) -> TimedMotion:
    """
    Return the desired motion that a configuration describes.

    Parameters
    ----------
    config : ReferenceConfig
        Profile or file, and the smooth start.
    route : Route, optional
        The waypoints of its `trajectory_file`, or others in place of the profile.
    start : mapping, optional
        Position [rad] and velocity [rad/s] of the robot at `t0` by joint. There a smooth start
        begins, and the way to a first waypoint after `t0`. A joint that is left out begins on
        the motion.
    t0 : int
        Instant of the start [ns].
    limits : sequence of JointLimits, length n, optional
        Limits of the joints of `config`, which the start and the motion must keep.
    continuous : sequence of bool, optional
        Mask of the joints of `config` that turn endlessly. They start at the angle nearest to the
        motion, and take the short way between waypoints. By default as `config` and `limits` say.

    Returns
    -------
    TimedMotion
        Its joints are in the order of `config.joint_names`.

    Raises
    ------
    CtcError
        If the waypoints are not allowed or not given, `start` is needed and not given, or
        something is beyond the limits. The message names joints and amounts, and for a smooth
        start that is too short a duration that would do.

    """
    if not continuous:
        continuous = continuous_joints(config, limits)
    motion: Waypoints | Sinusoid
    if route is not None:
        route = route.ordered(config.joint_names).by_the_short_way(continuous)
        motion = Waypoints(route.times, route.points)
        if start is not None:
            q, dq, zeros = _state(config, start, motion.at(t0), continuous)
            dq = zeros if config.start_duration else dq  # A smooth start takes the velocity away.
            motion = Waypoints(route.times, route.points, (t0, (q, dq, zeros)))
    elif config.trajectory_file:
        raise CtcError(f'trajectory_file: {config.trajectory_file} has not been read')
    elif config.profile == 'trapezoid':
        motion = Trapezoid(config)
    else:
        motion = Sinusoid(config)
    if config.start_duration and start is None:
        raise ParameterError('start_duration', config.start_duration,
                             '0 where it is not known where the robot is')
    state = _state(config, start or {}, motion.at(t0), continuous)
    if limits is not None:
        check_limits('the motion', limits, motion.extremes())
        if start:
            check_limits('the start', limits, [state])
    if not config.start_duration:
        return motion
    return _start_smoothly(partial(smooth_start, motion, t0, state), config, limits)


def _state(config: ReferenceConfig, start: RobotState, default: Point, continuous: Sequence[bool]
           ) -> Point:
    """
    Return the robot's state, without acceleration.

    A joint that turns endlessly is at the angle nearest to its default, and one of which nothing
    is known has its default.
    """
    joints = []
    for name, joint, endless in zip(config.joint_names, zip(*default), continuous):
        if name in start:
            q, dq = start[name]
            default_q, _, _ = joint
            joint = (nearest(q, default_q) if endless else q, dq, 0.0)
        joints.append(joint)
    return tuple(zip(*joints))  # type: ignore[return-value]


def _start_smoothly(make: Callable[[float], Transition], config: ReferenceConfig,
                    limits: Sequence[JointLimits] | None) -> Transition:
    """Return a smooth start that keeps limits, or raise `StartError`."""
    duration = config.start_duration
    start = make(duration)
    if limits is None:
        return start
    enough = shortest_duration(make, duration, limits)
    if enough == duration:
        return start
    raise StartError(duration, describe_violations(limits, sample_passage(start)), enough)


def reference_table(
        config: ReferenceConfig,
        route: Route | None,
        start: StateItems,
        joints: tuple[str, ...],
        period: int,
        count: int,
        continuous: tuple[bool, ...] = ()) -> Array:
    """
    Return samples of the desired motion, shape (count, 3, n).

    Sample k is at k `period` [rad, rad/s, rad/s²]. The table is kept for other runs with this
    motion: do not write into it.

    Parameters
    ----------
    config, route
        As `make_motion` takes them.
    start : tuple of (str, (float, float))
        Position [rad] and velocity [rad/s] of the robot at the start by joint.
    joints : tuple of str, shape (n,)
        Order of the joints.
    period : int
        Control period [ns].
    count : int
        Number of samples.
    continuous : tuple of bool
        Mask of the joints of `config` that turn endlessly.

    """
    order = tuple(config.joint_names.index(name) for name in joints)
    if route is not None or config.speed_scaling != 1.0:
        motion = make_motion(config, route, dict(start), continuous=continuous)
        clock = PathClock.steady(config.speed_scaling)
        return _sample(ScaledMotion(motion, clock), order, period, count)
    table: Array = _profile_table(config, start, order, period, count, continuous)
    return table


@lru_cache(128)
def _profile_table(
        config: ReferenceConfig,
        start: StateItems,
        order: tuple[int, ...],
        period: int,
        count: int,
        continuous: tuple[bool, ...]) -> Array:
    """Return samples of a profile, which many runs share."""
    motion = make_motion(config, None, dict(start), continuous=continuous)
    if not isinstance(motion, Transition):
        return _sample(motion, order, period, count)
    # What comes after the start does not depend on it.
    profile = config.changed({'start_duration': 0.0})
    table: Array = _profile_table(profile, (), order, period, count, continuous).copy()
    start_count = min(-(-motion.end // period), count)
    table[:start_count] = _sample(motion, order, period, start_count)
    return table


def _sample(motion: TimedMotion, order: Sequence[int], period: int, count: int) -> Array:
    """Return samples of a motion, its joints in order."""
    points = [motion.at(k * period) for k in range(count)]
    rows = np.array(points).reshape(count, 3, -1)
    ordered = rows[:, :, list(order)]
    # In the order of rows, in which the loop is compiled: for another one it would be once more.
    table: Array = np.ascontiguousarray(ordered)
    return table
