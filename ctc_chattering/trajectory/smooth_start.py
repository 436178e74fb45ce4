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

"""Motions that begin where the robot is, and pass into another motion without a jump."""

from __future__ import annotations

from math import isfinite
from typing import Any, Protocol, TypeVar

from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.polynomials import quintic
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.waypoints import Waypoints

T = TypeVar('T', bound=Any)

#: Longest time in which a robot that moves is brought to rest [s].
BRAKING_TIME = 0.5


class TimedMotion(Protocol):
    """A motion as a function of time."""

    def at(self, t: int) -> Point:
        """Return position, velocity and acceleration, each of shape (n,), at `t` [ns]."""


def braking(t0: int, start: Point, duration: float) -> Waypoints:
    """
    Return the motion from a state to rest: the velocity falls to 0 as a cubic in time.

    Without a first acceleration the joint goes on by half of |dq0| duration, and its acceleration
    stays within 1.5 |dq0| / duration.

    Parameters
    ----------
    t0 : int
        Instant at which it begins [ns]; before that it rests.
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
    end = tuple(q + duration * (0.5 * dq + duration * ddq / 12.0) for q, dq, ddq in zip(*start))
    rest = (0.0,) * len(end)
    return Waypoints([t0 + round(duration * NANOSECONDS)], [(end, rest, rest)], (t0, start))


class Transition:
    """
    One motion until an instant, then a mean of two that shifts, then the other one.

    q = (1 - σ) before + σ after, with σ the quintic from 0 to 1 that begins and ends without
    velocity and acceleration. On every joint it is thus between the two motions at every instant,
    whatever their phases are, and position, velocity and acceleration are continuous where theirs
    are. |dq| is at most that of the faster one plus 1.875 d / duration, with d the greatest
    distance between the two; |ddq| at most the greater one plus 3.75 / duration times the greatest
    difference of the velocities plus 5.774 d / duration².

    Parameters
    ----------
    before, after : TimedMotion
        The two motions, of as many joints.
    t0 : int
        Instant until which it is `before` [ns].
    duration : float
        Time from there to the instant from which on it is `after`, to the last bit [s].

    Raises
    ------
    ParameterError
        If the duration is less than a nanosecond or not finite.

    """

    def __init__(self, before: TimedMotion, after: TimedMotion, t0: int, duration: float) -> None:
        span = round(duration * NANOSECONDS) if isfinite(duration) else 0
        if span < 1:
            raise ParameterError('duration', duration, 'a finite number of seconds >= 1e-9')
        self.before, self.after = before, after
        self._t0, self.end = t0, t0 + span
        self._span = seconds(span)

    def at(self, t: int) -> Point:
        """Return position, velocity and acceleration, each of shape (n,), at `t` [ns]."""
        if t >= self.end:
            return self.after.at(t)
        if t <= self._t0:
            return self.before.at(t)
        s = seconds(t - self._t0) / self._span
        weight = quintic(s, self._span, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
        return tuple(zip(*(  # type: ignore[return-value]
            mean(weight, joint[:3], joint[3:])
            for joint in zip(*self.before.at(t), *self.after.at(t)))))


def mean(weight: tuple[T, T, T], before: tuple[T, ...], after: tuple[T, ...]) -> tuple[T, T, T]:
    """
    Return the mean of two motions of a joint, for numbers or arrays of as many instants.

    Parameters
    ----------
    weight : (σ, dσ/dt, d²σ/dt²)
        Share of `after`.
    before, after : (position, velocity, acceleration)
        The two motions.

    """
    (w, dw, ddw), (q, dq, ddq), (x, dx, ddx) = weight, before, after
    distance, difference = x - q, dx - dq
    return (q + w * distance, dq + w * difference + dw * distance,
            ddq + w * (ddx - ddq) + 2.0 * dw * difference + ddw * distance)


def smooth_start(motion: TimedMotion, t0: int, start: Point, duration: float) -> Transition:
    """
    Return a motion that begins at a state and passes into a given one.

    The robot brakes from its velocity while the mean shifts from where it comes to rest to the
    motion. From rest it therefore never leaves the hull of its position and of the motion; a
    robot that moves leaves it by its braking distance at the most, which is
    |dq0| min(duration, `BRAKING_TIME`) / 2 where it does not accelerate.

    Parameters
    ----------
    motion : TimedMotion
        What to pass into.
    t0 : int
        Instant of the start [ns].
    start : (position, velocity, acceleration), each of shape (n,)
        State at `t0` [rad, rad/s, rad/s²]; before that it rests there.
    duration : float
        Time until it is the motion itself [s].

    Raises
    ------
    ParameterError
        If the duration is less than a nanosecond or not finite, the state is not finite numbers,
        as many as the motion has joints, or the robot would not stop at a finite position.

    """
    n = len(motion.at(t0)[0])
    for name, row in zip(('q0', 'dq0', 'ddq0'), start):
        if len(row) != n or not all(map(isfinite, row)):
            raise ParameterError(name, tuple(row), f'{n} finite numbers, one per joint')
    before = braking(t0, start, min(duration, BRAKING_TIME) if duration > 0.0 else BRAKING_TIME)
    return Transition(before, motion, t0, duration)
