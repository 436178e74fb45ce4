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
slowly, once each way, and creeps forth and back, since Stribeck friction shows only below its
velocity: each joint slides already when it slows down to that. Then every joint follows a
multisine. It begins and ends at rest.

Multisines: Swevers, Ganseman, Tükel, De Schutter & Van Brussel, "Optimal robot excitation and
identification", IEEE Transactions on Robotics and Automation 13 (1997) 730-740.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from math import ceil, inf, isfinite, pi, sqrt
from typing import Any, NamedTuple

from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.interpolation import quintic
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.parameters import Config, LEAST, parameter
from ctc_chattering.trajectory.joint_limits import JointLimits
from ctc_chattering.trajectory.motions import Route
import numpy as np
from scipy.linalg import null_space  # type: ignore[import-untyped]

#: Part of a joint's range that is left free at each end.
_MARGIN = 0.05
#: Without a limit: its velocity [rad/s or m/s], and acceleration by the velocity used [1/s].
_VELOCITY, _ACCELERATION = 2.0, 4.0
#: Amplitude of the slow reversals as a part of the room beside the centre.
_SLOW = 0.24
#: Velocities at which a joint creeps at one pose after the other [rad/s or m/s], at most this part
#: of that before; the way to it as a part of that amplitude; and the time in which it stops [s].
_CREEP, _CREEP_PART, _CREEP_WAY, _STOP = (0.02, 0.01, 0.005), 0.2, 0.5, 0.3
#: What a scaled motion keeps of its limits, so that rounding and the polynomials between two
#: waypoints do not exceed them.
_SCALE = 0.99
#: Greatest distance of a pose from the centre as a part of the room; the reversals take the rest.
_POSES = 0.6
#: Part of the time at the poses, and of that while joints creep one way; least time of the
#: reversals at one pose, of creeping and of the multisine; of the way to the first pose and of
#: those after it, and the rest at the end [s].
_SLOW_PART, _CREEP_TIME, _SLOW_LEAST, _CREEP_LEAST, _SINES_LEAST = 0.6, 0.2, 4.0, 0.3, 10.0
_FIRST_LEAST, _WAY_LEAST, _REST = 2.0, 1.0, 0.5
#: Greatest frequency of the multisine [Hz], and waypoints in the period of the fastest part.
_FREQUENCY, _WAYPOINTS = 0.5, 12
#: w(x) = (sin x - sin(2 x) / 2) / _PEAK has extremes of ±1, slope 0 and curvature 0 at 0 and 2π;
#: the greatest values of |w'| and |w''|.
_PEAK = 0.75 * sqrt(3.0)
_SLOPE, _CURVATURE = 2.0 / _PEAK, 2.7359 / _PEAK
#: Greatest velocity and acceleration of the quintic from 0 to 1 in 1 s, at rest at its ends.
_QUINTIC_VELOCITY, _QUINTIC_ACCELERATION = 1.875, 10.0 / sqrt(3.0)


@dataclasses.dataclass(frozen=True)
class ExcitationConfig(Config):
    """What is asked of the motion."""

    joint_names: tuple[str, ...] = parameter(('joint1', 'joint2'), 'Joints of the motion.')
    duration: float = parameter(
        60.0, 'Time from the start of the motion to its end.', 's', minimum=LEAST, maximum=600.0)
    start: tuple[float, ...] = parameter(
        0.0, 'Position from which the robot comes.', 'rad', minimum=-inf)
    center: tuple[float, ...] = parameter(
        0.0, 'Position about which the joints move.', 'rad', minimum=-inf)
    position_range: tuple[float, ...] = parameter(
        0.8, 'Greatest distance from the centre.', 'rad', minimum=LEAST)
    velocity_scale: float = parameter(
        0.5, 'Part of the limits of velocity and acceleration in the description to use; '
        f'without these limits, {_VELOCITY:g} rad/s count.',
        minimum=LEAST, maximum=1.0)
    poses: int = parameter(3, 'Number of poses with slow reversals.', minimum=1, maximum=100)
    clearance: float = parameter(
        0.02, 'Distance that links keep from each other.', 'm', minimum=0.001, maximum=1.0)


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
        If the centre or the start is not within the limits.

    """
    room, velocity, acceleration = [], [], []
    for i, joint in enumerate(limits):
        low, high = joint.position
        if not low <= config.start[i] <= high:
            raise ParameterError(f'start of {joint.name}', config.start[i],
                                 f'{low:.4g} to {high:.4g} {joint.unit}, its limits')
        margin = _MARGIN * (high - low) if isfinite(high - low) else 0.0
        low, high, center = low + margin, high - margin, config.center[i]
        if not low < center < high:
            raise ParameterError(
                f'center of {joint.name}', center,
                f'more than {low:.4g} and less than {high:.4g} {joint.unit}, its limits less '
                f'{_MARGIN:.0%} of the range at each end')
        room.append(min(config.position_range[i], center - low, high - center))
        scale, fastest, strongest = (
            config.velocity_scale, joint.velocity[1], joint.acceleration[1])
        velocity.append(scale * (fastest if fastest < inf else _VELOCITY))
        acceleration.append(
            scale * strongest if strongest < inf else _ACCELERATION * velocity[-1])
    return Bounds(np.array(config.center), *map(np.array, (room, velocity, acceleration)))


class Quintics(NamedTuple):
    """
    Waypoints joined by quintics.

    Attributes
    ----------
    times : ndarray of int, shape (W,)
        Of the waypoints [ns]; the first is 0.
    points : ndarray, shape (3, W, m)
        Position, velocity and acceleration at each.

    """

    times: Any
    points: Array

    def at(self, t: Array) -> Array:
        """Return position, velocity and acceleration, (3, N, m), at the times `t`, (N,) [s]."""
        knots = self.times / NANOSECONDS
        i = np.clip(np.searchsorted(knots, t, 'right') - 1, 0, len(knots) - 2)
        h: Any = np.diff(knots)[i][:, np.newaxis]
        s = (t[:, np.newaxis] - knots[i][:, np.newaxis]) / h
        rows: Any = (*self.points[:, i], *self.points[:, i + 1])
        return np.array(quintic(s, h, *rows))


@dataclasses.dataclass(frozen=True)
class Excitation:
    """
    A motion.

    Attributes
    ----------
    names : tuple of str, length n
        Joints.
    path : Quintics
        Its waypoints, and where it begins.
    slow : tuple of (float, float)
        Time at which the reversals at each pose begin and end [s].
    creep : tuple of (float, float)
        Time at which joints begin and end to creep at each pose [s].

    """

    names: tuple[str, ...]
    path: Quintics
    slow: tuple[tuple[float, float], ...]
    creep: tuple[tuple[float, float], ...]

    @property
    def route(self) -> Route:
        """Return the waypoints, without the start."""
        points = self.path.points[:, 1:].transpose(1, 0, 2).tolist()
        return Route(self.names, self.path.times[1:].tolist(), [tuple(x) for x in points])


class Multisine(NamedTuple):
    """
    dq(t) = Σ a_k cos(k ω t) + b_k sin(k ω t) of n joints, with q(0) = 0, k = 1 … K.

    Attributes
    ----------
    cosines, sines : ndarray, shape (K, n)
        a_k and b_k [rad/s].
    period : float
        2π / ω [s].

    """

    cosines: Array
    sines: Array
    period: float

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration, each (N, n), at the times `t`, (N,) [s]."""
        rate = 2.0 * np.pi / self.period * np.arange(1, len(self.cosines) + 1)
        angle = np.outer(t, rate)
        c, s = np.cos(angle), np.sin(angle)
        a, b = self.cosines, self.sines
        return ((s / rate) @ a + ((1.0 - c) / rate) @ b, c @ a + s @ b,
                (c * rate) @ b - (s * rate) @ a)

    def times(self, size: Array | float) -> Multisine:
        """Return it `size` times as large, a number or one for each joint."""
        return self._replace(cosines=self.cosines * size, sines=self.sines * size)


def random_multisine(harmonics: int, period: float, joints: int, rng: np.random.Generator
                     ) -> Multisine:
    """
    Return random sines that are at rest at their ends, of any size.

    They have neither velocity nor acceleration at t = 0 and `period`, and their mean is q(0): a_k,
    k b_k and b_k / k each add up to 0.

    Parameters
    ----------
    harmonics : int
        K, at least 3.
    period : float
        Time that the motion takes [s].
    joints : int
        n.
    rng : Generator
        Of the coefficients.

    """
    root = np.sqrt(np.arange(1.0, harmonics + 1.0))[:, None]
    # In multiples of √k, in which lower harmonics have more of the motion and all have their part.
    cosines = null_space(root.T) @ rng.standard_normal((harmonics - 1, joints))
    sines = null_space(np.hstack((1.0 / root, root ** 3)).T) @ rng.standard_normal(
        (harmonics - 2, joints))
    return Multisine(root * cosines, root * sines, period)


class RandomMotion(NamedTuple):
    """
    What is drawn of a motion.

    Attributes
    ----------
    poses, turns : ndarray, shape (poses, n)
        Poses less the centre, and amplitudes of the slow reversals, with sign [rad].
    sines : Multisine
        As large as the bounds allow.

    """

    poses: Array
    turns: Array
    sines: Multisine


class RandomMotions:
    """
    Motions within bounds, all with the same times.

    Parameters
    ----------
    config : ExcitationConfig
        Duration, start and number of poses.
    bounds : Bounds
        What the motions keep.
    share : ndarray, shape (n,), optional
        Part of the room that each joint takes; one with less than all of it does not reverse
        slowly.

    Raises
    ------
    ParameterError
        If the duration is too short.

    """

    def __init__(self, config: ExcitationConfig, bounds: Bounds, share: Array | None = None
                 ) -> None:
        self._config, self._bounds = config, bounds
        self._share = np.ones(len(bounds.center)) if share is None else share
        self._ways, self._slow, self._period = _times(config, bounds)

    def draw(self, rng: np.random.Generator) -> RandomMotion:
        """Return random poses, directions and sines, these as large as the bounds allow."""
        bounds, count, n = self._bounds, self._config.poses, len(self._bounds.center)
        strata = rng.permuted(np.tile(np.arange(count), (n, 1)), axis=1).T
        offsets = 2.0 * (strata + rng.uniform(0.2, 0.8, strata.shape)) / count - 1.0
        turns = rng.choice((-1.0, 1.0), offsets.shape) * bounds.slow * (self._share == 1.0)
        sines = random_multisine(max(3, int(_FREQUENCY * self._period)), self._period, n, rng)
        rows = np.array(sines.at(np.linspace(0.0, self._period, 40 * len(sines.cosines) + 1)))
        most = np.abs(rows).max(axis=1)
        room = np.array([bounds.room, bounds.velocity, bounds.acceleration])
        sines = sines.times(self._share * _SCALE * (room / np.maximum(most, 1e-300)).min(axis=0))
        return RandomMotion(_POSES * bounds.room * self._share * offsets, turns, sines)

    def motion(self, drawn: RandomMotion, size: float = 1.0) -> Excitation:
        """Return the motion of a draw; poses and sines times `size`."""
        center, (first, between, last) = self._bounds.center, self._ways
        way = PathBuilder(np.array(self._config.start))
        slow: list[tuple[float, float]] = []
        creep: list[tuple[float, float]] = []
        creeping = _CREEP_TIME * self._slow
        for k, (offset, turn) in enumerate(zip(drawn.poses, drawn.turns)):
            pose = center + size * offset
            way.rest(pose, between if slow else first)
            begin = way.time
            way.reversals(pose, turn, self._slow - 2.0 * creeping)
            slow.append((begin, way.time))
            there = _creep_way(self._bounds)
            most = _CREEP_PART * _CREEP_WAY * np.abs(turn) / there
            speed = np.sign(turn) * np.minimum(_CREEP[k % len(_CREEP)], most)
            for sign, end in ((1.0, None), (-1.0, pose)):
                way.slide(sign * _CREEP_WAY * turn, sign * speed, there, creeping, end)
            creep.append((slow[-1][1], way.time))
        way.rest(center, last)
        way.series(drawn.sines.times(size))
        way.rest(center, self._config.duration - way.time)
        return Excitation(self._config.joint_names, way.path(), tuple(slow), tuple(creep))


def _times(config: ExcitationConfig, bounds: Bounds
           ) -> tuple[tuple[float, float, float], float, float]:
    """Return the times to, between and from the poses, at each of them, and of the sines [s]."""
    reach = _POSES * bounds.room
    first, between, last = (_way_time(distance, bounds) for distance in (
        np.abs(np.array(config.start) - bounds.center) + reach, 2.0 * reach, reach))
    count, first = config.poses, max(first, _FIRST_LEAST)
    fixed = first + (count - 1) * between + last + _REST
    left = config.duration - fixed
    slow = max(_slow_time(bounds) / (1.0 - 2.0 * _CREEP_TIME),
               (_creep_way(bounds) + _CREEP_LEAST + _STOP) / _CREEP_TIME)
    least = max(count * slow / _SLOW_PART, _SINES_LEAST / (1.0 - _SLOW_PART))
    if left < least:
        raise ParameterError('duration', config.duration, f'at least {ceil(fixed + least)} s, for '
                             f'{count} poses within these limits')
    return (first, between, last), _SLOW_PART * left / count, (1.0 - _SLOW_PART) * left


def _way_time(distance: Array, bounds: Bounds) -> float:
    """Return the time that a quintic over a distance, shape (n,) [rad], takes [s]."""
    d = np.abs(distance) / _SCALE
    return float(max(_WAY_LEAST, (_QUINTIC_VELOCITY * d / bounds.velocity).max(),
                     np.sqrt(_QUINTIC_ACCELERATION * d / bounds.acceleration).max()))


def _creep_way(bounds: Bounds) -> float:
    """Return the time until joints creep [s]."""
    return _way_time(_CREEP_WAY * bounds.slow, bounds)


def _slow_time(bounds: Bounds) -> float:
    """Return the least time for the reversals at a pose [s]."""
    d = bounds.slow / _SCALE
    return float(max(_SLOW_LEAST, 2.0 * pi * max(
        (_SLOPE * d / bounds.velocity).max(),
        np.sqrt(_CURVATURE * d / bounds.acceleration).max())))


class PathBuilder:
    """
    Waypoints that are added one after the other.

    Parameters
    ----------
    start : ndarray, shape (m,)
        Where it begins, at rest.

    Attributes
    ----------
    time : float
        Of the last one [s].

    """

    def __init__(self, start: Array) -> None:
        self.time = 0.0
        self._times = [0]
        self._points: list[Sequence[Array]] = [(start, 0.0 * start, 0.0 * start)]

    def path(self) -> Quintics:
        """Return the waypoints."""
        return Quintics(np.array(self._times), np.array(self._points).transpose(1, 0, 2))

    def rest(self, q: Array, duration: float) -> None:
        """Go to `q`, shape (m,), and be at rest there after `duration` [s]."""
        self._add(duration, q, 0.0 * q, 0.0 * q)

    def slide(self, way: Array, speed: Array, there: float, duration: float, end: Array | None
              ) -> None:
        """
        Go a way, shape (m,), creep on at a speed, and stop; all in `duration` [s].

        The way takes the time `there`; the stop is at `end`, or as far on as the speed leads.
        """
        creeping = duration - there - _STOP
        place = self._points[-1][0] + way
        self._add(there, place, speed, 0.0 * way)
        place = place + speed * creeping
        self._add(creeping, place, speed, 0.0 * way)
        self.rest(place + 0.5 * _STOP * speed if end is None else end, _STOP)

    def reversals(self, pose: Array, amplitude: Array, duration: float) -> None:
        """Go from a pose, shape (m,), by `amplitude` one way, then the other, and back."""
        rate, count = 2.0 * pi / duration, 2 * _WAYPOINTS
        begin = self.time
        for k in range(1, count + 1):
            x = 2.0 * pi * k / count if k < count else 0.0
            w, dw, ddw = (np.sin(x) - 0.5 * np.sin(2.0 * x), np.cos(x) - np.cos(2.0 * x),
                          2.0 * np.sin(2.0 * x) - np.sin(x))
            a = amplitude / _PEAK
            self._add(begin + duration * k / count - self.time,
                      pose + a * w, a * rate * dw, a * rate * rate * ddw)

    def series(self, sines: Multisine) -> None:
        """Follow sines once, from where the motion rests."""
        count = _WAYPOINTS * len(sines.cosines)
        shares = np.arange(1, count + 1) / count
        begin, place = self.time, self._points[-1][0]
        for share, *rows in zip(shares, *sines.at(sines.period * shares)):
            if share == 1.0:  # Without the rounding of 2π.
                rows = [0.0 * row for row in rows]
            self._add(begin + sines.period * float(share) - self.time, place + rows[0], *rows[1:])

    def _add(self, duration: float, *point: Array) -> None:
        self.time += duration
        self._times.append(round(self.time * NANOSECONDS))
        self._points.append(point)
