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
Motions that excite all joints, for an identification.

`excite` draws these at random, and takes the first that keeps all limits. The motion leads from
where the robot stands to a few poses. At each pose every joint reverses once each way, lingering
near velocity 0. Then it creeps forth and back, since Stribeck friction shows only below its
velocity. Each joint slides already when it slows down to that. Last, every joint follows a
multisine. The motion begins and ends at rest.

Multisines: Swevers, Ganseman, Tükel, De Schutter & Van Brussel, "Optimal robot excitation and
identification", IEEE Transactions on Robotics and Automation 13 (1997) 730-740.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from math import ceil, inf, sqrt
from typing import NamedTuple

from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.interpolation import quintic
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.parameters import Config, LEAST, parameter, PerJoint, Strings
from ctc_chattering.trajectory.joint_limits import JointLimits
from ctc_chattering.trajectory.waypoints import Route
import numpy as np
from scipy.interpolate import BPoly, make_interp_spline  # type: ignore[import-untyped]


@dataclasses.dataclass(frozen=True)
class MotionShape:
    """
    Shape of the motion.

    The room of a joint is its greatest distance from the centre.
    """

    #: Part of a joint's range that stays free at each end.
    free_range: float = 0.05
    #: Velocity of a joint without a limit [rad/s or m/s].
    usual_velocity: float = 2.0
    #: Acceleration of a joint without a limit, over its velocity [1/s].
    usual_acceleration: float = 4.0
    #: Part of its limits that a scaled motion keeps, so that rounding does not exceed them.
    kept_part: float = 0.99
    #: Greatest distance of a pose from the centre as a part of the room. The reversals need more.
    pose_distance: float = 0.6
    #: Amplitude of the slow reversals as a part of the room.
    reversal_amplitude: float = 0.24
    #: Velocities of creeping at one pose after the other [rad/s or m/s].
    creeping_velocities: tuple[float, ...] = (0.02, 0.01, 0.005)
    #: Velocity of creeping over the velocity before, at most.
    creeping_ratio: float = 0.2
    #: Way before creeping, as a part of the amplitude of the reversals.
    creeping_way: float = 0.5
    #: Part of the time at a pose for creeping one way.
    creeping_part: float = 0.2
    min_creeping_s: float = 0.3
    #: Time of a stop after creeping.
    stop_s: float = 0.3
    #: Part of the time that is left beside ways, for the poses.
    poses_part: float = 0.6
    min_first_way_s: float = 2.0
    min_way_s: float = 1.0
    #: Rest at the end.
    rest_s: float = 0.5
    min_multisine_s: float = 10.0
    #: Time in which the multisine begins and ends.
    rise_s: float = 2.0
    max_frequency_hz: float = 0.5
    #: Steps of the waypoints of the multisine, and of the search for its largest values.
    waypoint_s: float = 0.15
    fine_s: float = 0.03


SHAPE = MotionShape()
#: Greatest velocity of the quintic from 0 to 1 in 1 s, at rest at its ends [1/s].
QUINTIC_VELOCITY = 1.875
#: Greatest acceleration of that quintic [1/s²].
QUINTIC_ACCELERATION = 10.0 / sqrt(3.0)


@dataclasses.dataclass(frozen=True)
class ExcitationConfig(Config):
    """Request for a motion."""

    joint_names: Strings = parameter(('joint1', 'joint2'), 'Joints of the motion.')
    duration: float = parameter(
        60.0, 'Time from the start of the motion to its end.', 's', minimum=LEAST, maximum=600.0
    )
    start: PerJoint = parameter(0.0, 'Position from which the robot comes.', 'rad', minimum=-inf)
    center: PerJoint = parameter(
        0.0,
        "Position about which the joints move. Default: the reference's centre.",
        'rad',
        minimum=-inf,
    )
    friction: PerJoint = parameter(
        0.0, "Expected Coulomb friction. Default: the plant's friction.", 'N*m'
    )
    position_range: PerJoint = parameter(
        0.8, 'Greatest distance from the centre.', 'rad', minimum=LEAST
    )
    velocity_scale: float = parameter(
        0.5,
        'Fraction of the limits of velocity and acceleration in the description to use. '
        f'A missing limit counts as {SHAPE.usual_velocity:g} rad/s.',
        minimum=LEAST,
        maximum=1.0,
    )
    poses: int = parameter(3, 'Number of poses with slow reversals.', minimum=1, maximum=100)
    clearance: float = parameter(
        0.02, 'Distance that links keep from each other.', 'm', minimum=0.001, maximum=1.0
    )
    floor: float = parameter(
        inf,
        'Height of a floor in the frame of the root link. Default: no floor.',
        'm',
        minimum=-inf,
    )
    evaluations: int = parameter(
        20,
        'Largest number of random motions to try. The first one within all limits is used.',
        minimum=1,
    )
    seed: int = parameter(0, 'Seed of the random motions.')


@dataclasses.dataclass(frozen=True)
class Bounds:
    """
    Bounds of a motion, each of shape (n,).

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
        return SHAPE.reversal_amplitude * self.room

    def time(self, distance: Array) -> float:
        """Return the duration [s] of a quintic over (n,) distances [rad]."""
        d = np.abs(distance) / SHAPE.kept_part
        return float(
            max(
                SHAPE.min_way_s,
                (QUINTIC_VELOCITY * d / self.velocity).max(),
                np.sqrt(QUINTIC_ACCELERATION * d / self.acceleration).max(),
            )
        )


def bounds_of(config: ExcitationConfig, limits: Sequence[JointLimits]) -> Bounds:
    """
    Return the bounds of a motion.

    Parameters
    ----------
    config : ExcitationConfig
        The request.
    limits : sequence of JointLimits, length n
        Limits of the description, in the order of its joints.

    Raises
    ------
    ParameterError
        If the centre is not within the limits.

    """
    low, high = np.array([joint.position for joint in limits], float).T
    margin = np.where(np.isfinite(high - low), SHAPE.free_range * (high - low), 0.0)
    low, high, center = low + margin, high - margin, np.array(config.center)
    for i in np.flatnonzero((center <= low) | (center >= high)).tolist():
        raise ParameterError(
            f'center of {limits[i].name}',
            config.center[i],
            f'more than {low[i]:.4g} and less than {high[i]:.4g} {limits[i].unit}, its limits '
            f'less {SHAPE.free_range:.0%} of the range at each end',
        )
    fastest = np.array([joint.velocity[1] for joint in limits])
    strongest = np.array([joint.acceleration[1] for joint in limits])
    velocity = config.velocity_scale * np.where(fastest < inf, fastest, SHAPE.usual_velocity)
    acceleration = np.where(
        strongest < inf, config.velocity_scale * strongest, SHAPE.usual_acceleration * velocity
    )
    room = np.minimum(config.position_range, np.minimum(center - low, high - center))
    return Bounds(center, room, velocity, acceleration)


class SlowSpan(NamedTuple):
    """Times at a pose: begin of reversals and creeping, and end [s]."""

    reverse: float
    creep: float
    end: float


@dataclasses.dataclass(frozen=True)
class Excitation:
    """
    A motion: waypoints joined by quintics.

    Attributes
    ----------
    names : tuple of str, length n
        Joints.
    times : ndarray, shape (W,)
        Times of the waypoints, the first of which is where it begins [s].
    points : ndarray, shape (W, 3, n)
        Position, velocity and acceleration at each [rad, rad/s, rad/s²].
    slow : tuple of SlowSpan
        Times at each pose.

    """

    names: tuple[str, ...]
    times: Array
    points: Array
    slow: tuple[SlowSpan, ...]

    @property
    def route(self) -> Route:
        """Return the waypoints, without the start."""
        return Route(
            self.names,
            [round(t * NANOSECONDS) for t in self.times[1:].tolist()],
            [tuple(x) for x in self.points[1:].tolist()],
        )

    def at(self, t: Array) -> Array:
        """Return position, velocity and acceleration at times t [s], shape (3, N, n)."""
        path = BPoly.from_derivatives(self.times, self.points)
        return np.array([path(np.minimum(t, self.times[-1]), order) for order in range(3)])


class Multisine(NamedTuple):
    """
    Random multisine of n joints, at rest at both ends.

    Attributes
    ----------
    times : ndarray, shape (W,)
        Times of the waypoints [s].
    points : ndarray, shape (W, 3, n)
        Position, velocity and acceleration at each.
    largest : ndarray, shape (3, n)
        Their largest magnitudes.

    """

    times: Array
    points: Array
    largest: Array

    @classmethod
    def draw(cls, duration: float, n: int, rng: np.random.Generator) -> Multisine:
        """Return a fifth-order spline, as quintics between waypoints."""
        t = np.linspace(0.0, duration, ceil(duration / SHAPE.waypoint_s) + 1)
        k = np.arange(1, max(3, int(SHAPE.max_frequency_hz * duration)) + 1)[:, None]
        phase, size = rng.uniform(0.0, 2.0 * np.pi, (2, *k.shape[:1], n))
        waves = np.sin(2.0 * np.pi / duration * t[:, None, None] * k + phase)
        progress = np.clip(np.minimum(t, duration - t) / SHAPE.rise_s, 0.0, 1.0)
        rise = quintic(progress, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)[0]
        at_rest = [(1, np.zeros(n)), (2, np.zeros(n))]
        path = make_interp_spline(
            t, rise[:, None] * (size / k * waves).sum(axis=1), 5, bc_type=(at_rest, at_rest)
        )
        fine = np.linspace(0.0, duration, ceil(duration / SHAPE.fine_s) + 1)
        points, rows = (np.array([path(x, order) for order in range(3)]) for x in (t, fine))
        return cls(t, points.transpose(1, 0, 2), np.abs(rows).max(axis=1))


def random_motion(
    config: ExcitationConfig, bounds: Bounds, share: Array, size: float, seed: int
) -> Excitation:
    """
    Return a motion of random poses, directions and sines.

    Parameters
    ----------
    config : ExcitationConfig
        Duration, start and number of poses.
    bounds : Bounds
        What it keeps.
    share : ndarray, shape (n,)
        Part of the room for each joint. A joint with less than all of it does not reverse slowly.
    size : float
        Factor of poses and sines.
    seed : int
        Seed of this motion, beside that of `config`.

    Raises
    ------
    ParameterError
        If the duration is too short.

    """
    rng, center, n = np.random.default_rng((config.seed, seed)), bounds.center, len(share)
    schedule = _Schedule.of(config, bounds)
    start = np.array(config.start)
    times, points = [0.0], [np.array([start, 0.0 * start, 0.0 * start])]
    spans = []

    def go(duration: float, q: Array, dq: Array | float = 0.0) -> None:
        """Add a waypoint."""
        times.append(times[-1] + duration)
        points.append(np.array([q, dq + 0.0 * q, 0.0 * q]))

    strata = rng.permuted(np.tile(np.arange(config.poses), (n, 1)), axis=1).T
    offsets = 2.0 * (strata + rng.uniform(0.2, 0.8, strata.shape)) / config.poses - 1.0
    turns = rng.choice((-1.0, 1.0), offsets.shape) * bounds.slow * (share == 1.0)
    way_s = bounds.time(SHAPE.creeping_way * bounds.slow)
    creeping_s = SHAPE.creeping_part * schedule.pose_s - way_s - SHAPE.stop_s
    quarter = 0.25 * (1.0 - 2.0 * SHAPE.creeping_part) * schedule.pose_s
    for k, (offset, turn) in enumerate(zip(offsets, turns)):
        pose = center + size * SHAPE.pose_distance * bounds.room * share * offset
        go(schedule.between_s if k else schedule.first_s, pose)
        reverse = times[-1]
        go(quarter, pose + turn)
        go(2.0 * quarter, pose - turn)
        go(quarter, pose)
        creep = times[-1]
        run_up = SHAPE.creeping_way * turn
        slowest = SHAPE.creeping_velocities[k % len(SHAPE.creeping_velocities)]
        speed = np.sign(turn) * np.minimum(slowest, SHAPE.creeping_ratio * np.abs(run_up) / way_s)
        for sign in (1.0, -1.0):
            q = points[-1][0]
            go(way_s, q + sign * run_up, sign * speed)
            go(creeping_s, q + sign * (run_up + speed * creeping_s), sign * speed)
            go(SHAPE.stop_s, q + sign * (run_up + speed * (creeping_s + 0.5 * SHAPE.stop_s)))
        spans.append(SlowSpan(reverse, creep, times[-1]))
    go(schedule.last_s, center)
    sines = Multisine.draw(schedule.multisine_s, n, rng)
    limits = np.array([bounds.room, bounds.velocity, bounds.acceleration])
    scale = (limits / np.maximum(sines.largest, 1e-300)).min(axis=0)
    rows = sines.points * size * share * SHAPE.kept_part * scale
    rows[-1] = 0.0  # Without rounding.
    begin = times[-1]
    times += (begin + sines.times[1:]).tolist()
    points += [row + np.array([center, 0.0 * center, 0.0 * center]) for row in rows[1:]]
    go(config.duration - times[-1], center)
    return Excitation(config.joint_names, np.array(times), np.array(points), tuple(spans))


class _Schedule(NamedTuple):
    """
    Durations of ways, of poses, and of the sines [s].

    Ways lead to, between and from the poses.
    """

    first_s: float
    between_s: float
    last_s: float
    pose_s: float
    multisine_s: float

    @classmethod
    def of(cls, config: ExcitationConfig, bounds: Bounds) -> _Schedule:
        """
        Return the times of a motion.

        Raise `ParameterError` if its duration is too short.
        """
        reach = SHAPE.pose_distance * bounds.room
        first_way = np.abs(np.array(config.start) - bounds.center) + reach
        first = max(bounds.time(first_way), SHAPE.min_first_way_s)
        between, last = bounds.time(2.0 * reach), bounds.time(reach)
        fixed = first + (config.poses - 1) * between + last + SHAPE.rest_s
        available = config.duration - fixed
        creeping_s = (
            bounds.time(SHAPE.creeping_way * bounds.slow) + SHAPE.min_creeping_s + SHAPE.stop_s
        )
        pose = max(
            4.0 * bounds.time(bounds.slow) / (1.0 - 2.0 * SHAPE.creeping_part),
            creeping_s / SHAPE.creeping_part,
        )
        needed = max(
            config.poses * pose / SHAPE.poses_part,
            SHAPE.min_multisine_s / (1.0 - SHAPE.poses_part),
        )
        if available < needed:
            raise ParameterError(
                'duration',
                config.duration,
                f'at least {ceil(fixed + needed)} s, for {config.poses} poses within these limits',
            )
        return cls(
            first,
            between,
            last,
            SHAPE.poses_part * available / config.poses,
            (1.0 - SHAPE.poses_part) * available,
        )
