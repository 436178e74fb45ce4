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
Motions that excite all joints of a robot, for the identification of friction and model errors.

The motion leads from where the robot stands to a few poses, at each of which every joint reverses
once each way, lingering near velocity 0, and creeps forth and back, since Stribeck friction shows
only below its velocity: each joint slides already when it slows down to that. Then every joint
follows a multisine. It begins and ends at rest.

Multisines: Swevers, Ganseman, Tükel, De Schutter & Van Brussel, "Optimal robot excitation and
identification", IEEE Transactions on Robotics and Automation 13 (1997) 730-740.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from math import ceil, inf, isfinite, sqrt

from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.interpolation import quintic
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.parameters import Config, LEAST, parameter, PerJoint, Strings
from ctc_chattering.trajectory.joint_limits import JointLimits
from ctc_chattering.trajectory.waypoints import Route
import numpy as np
from scipy.interpolate import BPoly, make_interp_spline  # type: ignore[import-untyped]

#: Part of a joint's range that is left free at each end.
_MARGIN = 0.05
#: Without a limit: its velocity [rad/s or m/s], and acceleration by the velocity used [1/s].
_VELOCITY, _ACCELERATION = 2.0, 4.0
#: Amplitude of the slow reversals as a part of the room beside the centre.
_SLOW = 0.24
#: Velocities at which a joint creeps at one pose after the other [rad/s or m/s], at most this part
#: of that before; the way to it as a part of that amplitude; and the time in which it stops [s].
_CREEP, _CREEP_PART, _CREEP_WAY, _STOP = (0.02, 0.01, 0.005), 0.2, 0.5, 0.3
#: What a scaled motion keeps of its limits, so that rounding does not exceed them.
_SCALE = 0.99
#: Greatest distance of a pose from the centre as a part of the room; the reversals take the rest.
_POSES = 0.6
#: Part of the time at the poses, and of that while joints creep one way; least time of creeping
#: and of the multisine; of the way to the first pose and of those after it, and the rest at the
#: end [s].
_SLOW_PART, _CREEP_TIME, _CREEP_LEAST, _SINES_LEAST = 0.6, 0.2, 0.3, 10.0
_FIRST_LEAST, _WAY_LEAST, _REST = 2.0, 1.0, 0.5
#: Greatest frequency of the multisine [Hz], and the steps in which it is given and evaluated, and
#: the time in which it begins and ends [s].
_FREQUENCY, _STEP, _FINE, _RISE = 0.5, 0.15, 0.03, 2.0
#: Greatest velocity and acceleration of the quintic from 0 to 1 in 1 s, at rest at its ends.
_QUINTIC_VELOCITY, _QUINTIC_ACCELERATION = 1.875, 10.0 / sqrt(3.0)


@dataclasses.dataclass(frozen=True)
class ExcitationConfig(Config):
    """What is asked of the motion."""

    joint_names: Strings = parameter(('joint1', 'joint2'), 'Joints of the motion.')
    duration: float = parameter(
        60.0, 'Time from the start of the motion to its end.', 's', minimum=LEAST, maximum=600.0)
    start: PerJoint = parameter(
        0.0, 'Position from which the robot comes.', 'rad', minimum=-inf)
    center: PerJoint = parameter(
        0.0, "Position about which the joints move. Default: the reference's centre.", 'rad',
        minimum=-inf)
    friction: PerJoint = parameter(
        0.0, "Expected Coulomb friction. Default: the plant's friction.", 'N*m')
    position_range: PerJoint = parameter(
        0.8, 'Greatest distance from the centre.', 'rad', minimum=LEAST)
    velocity_scale: float = parameter(
        0.5, 'Fraction of the limits of velocity and acceleration in the description to use. '
        f'A missing limit counts as {_VELOCITY:g} rad/s.',
        minimum=LEAST, maximum=1.0)
    poses: int = parameter(3, 'Number of poses with slow reversals.', minimum=1, maximum=100)
    clearance: float = parameter(
        0.02, 'Distance that links keep from each other.', 'm', minimum=0.001, maximum=1.0)
    floor: float = parameter(
        inf, 'Height of a floor in the frame of the root link. Default: no floor.', 'm',
        minimum=-inf)
    evaluations: int = parameter(
        20, 'Largest number of random motions to try. The first one within all limits is used.',
        minimum=1)
    seed: int = parameter(0, 'Seed of the random motions.')


@dataclasses.dataclass(frozen=True)
class Bounds:
    """
    What the motion keeps, each of shape (n,).

    Attributes
    ----------
    center, room : ndarray
        Centre, and greatest distance from it [rad].
    velocity, acceleration : ndarray
        Greatest magnitudes [rad/s, rad/s²].

    """

    center: Array
    room: Array
    velocity: Array
    acceleration: Array

    @property
    def slow(self) -> Array:
        """Amplitude of the slow reversals, shape (n,) [rad]."""
        return _SLOW * self.room

    def time(self, distance: Array) -> float:
        """Return the time that a quintic over a distance, shape (n,) [rad], takes [s]."""
        d = np.abs(distance) / _SCALE
        return float(max(_WAY_LEAST, (_QUINTIC_VELOCITY * d / self.velocity).max(),
                         np.sqrt(_QUINTIC_ACCELERATION * d / self.acceleration).max()))


def bounds_of(config: ExcitationConfig, limits: Sequence[JointLimits]) -> Bounds:
    """
    Return what a motion must keep.

    Parameters
    ----------
    config : ExcitationConfig
        What is asked for.
    limits : sequence of JointLimits, length n
        Of the description, in the order of its joints.

    Raises
    ------
    ParameterError
        If the centre is not within the limits.

    """
    room, velocity, acceleration = [], [], []
    for i, joint in enumerate(limits):
        low, high = joint.position
        margin = _MARGIN * (high - low) if isfinite(high - low) else 0.0
        low, high, center = low + margin, high - margin, config.center[i]
        if not low < center < high:
            raise ParameterError(
                f'center of {joint.name}', center,
                f'more than {low:.4g} and less than {high:.4g} {joint.unit}, its limits less '
                f'{_MARGIN:.0%} of the range at each end')
        room.append(min(config.position_range[i], center - low, high - center))
        scale, fastest, strongest = config.velocity_scale, joint.velocity[1], joint.acceleration[1]
        velocity.append(scale * (fastest if fastest < inf else _VELOCITY))
        acceleration.append(scale * strongest if strongest < inf else _ACCELERATION * velocity[-1])
    return Bounds(np.array(config.center), *map(np.array, (room, velocity, acceleration)))


@dataclasses.dataclass(frozen=True)
class Excitation:
    """
    A motion: waypoints joined by quintics.

    Attributes
    ----------
    names : tuple of str, length n
        Joints.
    times : ndarray, shape (W,)
        Of the waypoints, the first of which is where it begins [s].
    points : ndarray, shape (W, 3, n)
        Position, velocity and acceleration at each [rad, rad/s, rad/s²].
    slow : tuple of (float, float, float)
        Time at which joints begin to reverse, and to creep, and end it, at each pose [s].

    """

    names: tuple[str, ...]
    times: Array
    points: Array
    slow: tuple[tuple[float, float, float], ...]

    @property
    def route(self) -> Route:
        """Return the waypoints, without the start."""
        return Route(self.names, [round(t * NANOSECONDS) for t in self.times[1:].tolist()],
                     [tuple(x) for x in self.points[1:].tolist()])

    def at(self, t: Array) -> Array:
        """Return position, velocity and acceleration, (3, N, n), at the times `t`, (N,) [s]."""
        path = BPoly.from_derivatives(self.times, self.points)
        return np.array([path(np.minimum(t, self.times[-1]), order) for order in range(3)])


def multisine(duration: float, n: int, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """
    Return a random multisine of n joints, at rest at both ends, of any size.

    It is a spline of fifth order, which the quintics between its waypoints meet.

    Returns
    -------
    times : ndarray, shape (W,)
        Of the waypoints [s].
    points : ndarray, shape (W, 3, n)
        Position, velocity and acceleration at each.
    largest : ndarray, shape (3, n)
        Their largest magnitudes.

    """
    t = np.linspace(0.0, duration, ceil(duration / _STEP) + 1)
    k = np.arange(1, max(3, int(_FREQUENCY * duration)) + 1)[:, None]
    phase, size = rng.uniform(0.0, 2.0 * np.pi, (2, *k.shape[:1], n))
    waves = np.sin(2.0 * np.pi / duration * t[:, None, None] * k + phase)
    rise = quintic(np.clip(np.minimum(t, duration - t) / _RISE, 0.0, 1.0), 1.0,
                   0.0, 0.0, 0.0, 1.0, 0.0, 0.0)[0]
    rest = [(1, np.zeros(n)), (2, np.zeros(n))]
    path = make_interp_spline(t, rise[:, None] * (size / k * waves).sum(axis=1), 5,
                              bc_type=(rest, rest))
    fine = np.linspace(0.0, duration, ceil(duration / _FINE) + 1)
    points, rows = (np.array([path(x, order) for order in range(3)]) for x in (t, fine))
    return t, points.transpose(1, 0, 2), np.abs(rows).max(axis=1)


def random_motion(config: ExcitationConfig, bounds: Bounds, share: Array, size: float, seed: int
                  ) -> Excitation:
    """
    Return a motion of random poses, directions and sines, these as large as the bounds allow.

    Parameters
    ----------
    config : ExcitationConfig
        Duration, start and number of poses.
    bounds : Bounds
        What it keeps.
    share : ndarray, shape (n,)
        Part of the room that each joint takes; one with less than all of it does not reverse
        slowly.
    size : float
        Poses and sines are made so many times as large.
    seed : int
        Of what is random; `config` has another one.

    Raises
    ------
    ParameterError
        If the duration is too short.

    """
    rng, center = np.random.default_rng((config.seed, seed)), bounds.center
    (first, between, last), slow, left = _times(config, bounds)
    start = np.array(config.start)
    times, points = [0.0], [np.array([start, 0.0 * start, 0.0 * start])]
    spans = []

    def go(duration: float, q: Array, dq: Array | float = 0.0) -> None:
        """Add a waypoint."""
        times.append(times[-1] + duration)
        points.append(np.array([q, dq + 0.0 * q, 0.0 * q]))

    strata = rng.permuted(np.tile(np.arange(config.poses), (len(start), 1)), axis=1).T
    offsets = 2.0 * (strata + rng.uniform(0.2, 0.8, strata.shape)) / config.poses - 1.0
    turns = rng.choice((-1.0, 1.0), offsets.shape) * bounds.slow * (share == 1.0)
    there = bounds.time(_CREEP_WAY * bounds.slow)
    creeping = _CREEP_TIME * slow - there - _STOP
    for k, (offset, turn) in enumerate(zip(offsets, turns)):
        pose = center + size * _POSES * bounds.room * share * offset
        go(between if k else first, pose)
        begin, quarter = times[-1], 0.25 * (1.0 - 2.0 * _CREEP_TIME) * slow
        go(quarter, pose + turn)
        go(2.0 * quarter, pose - turn)
        go(quarter, pose)
        middle, way = times[-1], _CREEP_WAY * turn
        speed = np.sign(turn) * np.minimum(_CREEP[k % len(_CREEP)],
                                           _CREEP_PART * np.abs(way) / there)
        for sign in (1.0, -1.0):
            place = points[-1][0]
            go(there, place + sign * way, sign * speed)
            go(creeping, place + sign * (way + speed * creeping), sign * speed)
            go(_STOP, place + sign * (way + speed * (creeping + 0.5 * _STOP)))
        spans.append((begin, middle, times[-1]))
    go(last, center)
    t, rows, largest = multisine(left, len(start), rng)
    room = np.array([bounds.room, bounds.velocity, bounds.acceleration])
    rows = rows * size * share * _SCALE * (room / np.maximum(largest, 1e-300)).min(axis=0)
    rows[-1] = 0.0  # Without rounding.
    begin = times[-1]
    times += (begin + t[1:]).tolist()
    points += [row + np.array([center, 0.0 * center, 0.0 * center]) for row in rows[1:]]
    go(config.duration - times[-1], center)
    return Excitation(config.joint_names, np.array(times), np.array(points), tuple(spans))


def _times(config: ExcitationConfig, bounds: Bounds
           ) -> tuple[tuple[float, float, float], float, float]:
    """Return the times to, between and from the poses, at each of them, and of the sines [s]."""
    reach = _POSES * bounds.room
    first, between, last = (bounds.time(distance) for distance in (
        np.abs(np.array(config.start) - bounds.center) + reach, 2.0 * reach, reach))
    count, first = config.poses, max(first, _FIRST_LEAST)
    fixed = first + (count - 1) * between + last + _REST
    left = config.duration - fixed
    slow = max(4.0 * bounds.time(bounds.slow) / (1.0 - 2.0 * _CREEP_TIME),
               (bounds.time(_CREEP_WAY * bounds.slow) + _CREEP_LEAST + _STOP) / _CREEP_TIME)
    least = max(count * slow / _SLOW_PART, _SINES_LEAST / (1.0 - _SLOW_PART))
    if left < least:
        raise ParameterError('duration', config.duration, f'at least {ceil(fixed + least)} s, for '
                             f'{count} poses within these limits')
    return (first, between, last), _SLOW_PART * left / count, (1.0 - _SLOW_PART) * left
