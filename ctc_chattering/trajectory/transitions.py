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
Motions that lead from one motion into another.

They are a braking, a smooth start and a transition. The way back of a controller, the start of a
reference and its replacements are made of them. A stop on the path is in `path_clock`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil, inf, log10
from typing import Protocol, TypeVar

from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.interpolation import quintic
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.joint_limits import describe_violations, JointLimits
from ctc_chattering.trajectory.waypoints import check_point, Waypoints
import numpy as np

#: Longest time in which a robot that moves is brought to rest [s].
BRAKING_TIME = 0.5
#: Shortest step between the points of a passage at which limits are checked [ns].
_CHECK_STEP_NS = NANOSECONDS // 1000
#: Largest number of these steps.
_MAX_CHECKS = 2000
#: A search for a duration looks at every so many steps first.
_COARSE_STEPS = 20
#: Factor from one duration that is tried to the next.
_GROWTH = 1.1
#: Number of durations that are tried. The last is a thousand times the first.
_MAX_TRIALS = 72


class TimedMotion(Protocol):
    """A motion as a function of time."""

    def at(self, t: int) -> Point:
        """Return the point at `t` [ns]."""


class Passage(TimedMotion, Protocol):
    """A motion from `t0` to `end` [ns]."""

    t0: int
    end: int


P = TypeVar('P', bound=Passage)


def braking(t0: int, start: Point, duration: float) -> Waypoints:
    """
    Return the motion from a state to rest.

    The velocity falls to 0 as a cubic in time. Without a first acceleration the joint goes on by
    half of |dq0| duration, and its acceleration stays within 1.5 |dq0| / duration.

    Parameters
    ----------
    t0 : int
        Instant at which it begins [ns]. Before that it rests.
    start : (position, velocity, acceleration), each of shape (n,)
        State at `t0` [rad, rad/s, rad/s²].
    duration : float
        Time that it takes [s].

    Raises
    ------
    ParameterError
        If the place where it comes to rest is not finite.

    """
    # The quintic that ends at rest at this place has no term of fifth order: the velocity is of
    # fourth order at the most, and a cubic without a first acceleration.
    q, dq, ddq = np.array(start)
    distance = duration * (0.5 * dq + duration * ddq / 12.0)
    goal = tuple((q + distance).tolist())
    zeros = (0.0,) * len(goal)
    end = t0 + round(duration * NANOSECONDS)
    return Waypoints(
        [end],
        [(goal, zeros, zeros)],
        (t0, start))


class Transition:
    """
    A mean of two motions that shifts from one to the other.

    q = (1 - σ) origin + σ target, with σ the quintic from 0 to 1 that begins and ends without
    velocity and acceleration. On every joint it is thus between the two motions at every instant,
    whatever their phases are, and position, velocity and acceleration are continuous where theirs
    are. Let d be the greatest distance between the two. Then |dq| is at most that of the faster
    one plus 1.875 d / duration. |ddq| is at most the greater one plus 3.75 / duration times the
    greatest difference of the velocities plus 5.774 d / duration².

    Parameters
    ----------
    origin, target : TimedMotion
        The two motions, of as many joints.
    t0 : int
        Instant until which it is `origin` [ns].
    duration : float
        Time from there to the instant from which on it is `target`, to the last bit [s]. With 0
        it is `target` from `t0` on.

    Attributes
    ----------
    end : int
        That instant [ns].

    """

    def __init__(self, origin: TimedMotion, target: TimedMotion, t0: int, duration: float) -> None:
        self.t0 = t0
        self.end = t0 + round(duration * NANOSECONDS)
        self._span = seconds(self.end - t0)
        self.origin = origin
        self.target = target

    def at(self, t: int) -> Point:
        """Return the point at `t` [ns]."""
        if t >= self.end:
            return self.target.at(t)
        if t <= self.t0:
            return self.origin.at(t)
        duration = t - self.t0
        s = seconds(duration) / self._span
        w, dw, ddw = quintic(s, self._span, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
        joints = []
        for q, dq, ddq, target_q, target_dq, target_ddq in zip(
                *self.origin.at(t), *self.target.at(t)):
            gap = target_q - q
            gap_rate = target_dq - dq
            mean_dq = dq + w * gap_rate
            mean_ddq = ddq + w * (target_ddq - ddq)
            joints.append((
                q + w * gap,
                mean_dq + dw * gap,
                mean_ddq + 2.0 * dw * gap_rate + ddw * gap))
        return tuple(zip(*joints))  # type: ignore[return-value]


def smooth_start(motion: TimedMotion, t0: int, start: Point, duration: float) -> Transition:
    """
    Return a motion from a state into another motion.

    The robot brakes from its velocity while the mean shifts from where it comes to rest to the
    motion. From rest it therefore never leaves the hull of its position and of the motion. A
    robot that moves leaves it by its braking distance at the most. Without acceleration that is
    |dq0| min(duration, `BRAKING_TIME`) / 2.

    Parameters
    ----------
    motion : TimedMotion
        Motion to pass into.
    t0 : int
        Instant of the start [ns].
    start : (position, velocity, acceleration), each of shape (n,)
        State at `t0` [rad, rad/s, rad/s²]. Before that it rests there.
    duration : float
        Time until it is the motion itself [s].

    Raises
    ------
    ParameterError
        If the duration is less than a nanosecond or not finite, the state is not finite numbers,
        as many as the motion has joints, or the robot would not stop at a finite position.

    """
    if not 1e-9 <= duration < inf:
        raise ParameterError('duration', duration, 'a finite number of seconds >= 1e-9')
    q, _, _ = motion.at(t0)
    start = check_point('start', start, len(q))
    braking_time = min(duration, BRAKING_TIME)
    stop = braking(t0, start, braking_time)
    return Transition(stop, motion, t0, duration)


def sample_passage(passage: Passage) -> list[Point]:
    """Return points of a passage to check limits."""
    return list(map(passage.at, _check_instants(passage)))


def _check_instants(passage: Passage) -> list[int]:
    """Return times at which limits are checked [ns]."""
    t0 = passage.t0
    end = passage.end
    step = max(_CHECK_STEP_NS, (end - t0) // _MAX_CHECKS)
    return [*range(t0, end, step), end]


def shortest_duration(make: Callable[[float], Passage], duration: float,
                      limits: Sequence[JointLimits]) -> float | None:
    """
    Return the shortest duration that keeps limits, to a tenth.

    Parameters
    ----------
    make : callable
        Returns the passage of a duration [s].
    duration : float
        Lower bound [s].
    limits : sequence of JointLimits, length n
        Limits to keep.

    Returns
    -------
    float or None
        None if none of up to a thousand times `duration` keeps them.

    """
    candidates = [duration]
    for k in range(1, _MAX_TRIALS + 1):
        candidate = duration * _GROWTH ** k
        scale = 10.0 ** (2 - ceil(log10(candidate)))
        candidates.append(ceil(candidate * scale) / scale)
    for candidate in candidates:
        if _keeps_limits(make(candidate), limits):
            return candidate
    return None


def _keeps_limits(passage: Passage, limits: Sequence[JointLimits]) -> bool:
    """Return whether points of a passage keep limits; few of them refuse most passages."""
    instants = _check_instants(passage)
    return not any(describe_violations(limits, list(map(passage.at, some)))
                   for some in (instants[::_COARSE_STEPS], instants))


def fit_duration(make: Callable[[float], P], duration: float,
                 limits: Sequence[JointLimits] | None) -> P:
    """Return a passage that is as slow as limits require."""
    if limits is not None:
        duration = shortest_duration(make, duration, limits) or duration
    return make(duration)
