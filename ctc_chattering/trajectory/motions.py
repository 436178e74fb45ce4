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
Motions as functions of time: through waypoints, and from one into another without a jump.

Waypoints are joined as joint_trajectory_controller of ros2_controllers does.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from math import isfinite
from typing import NamedTuple, Protocol

from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.angles import turned, turns_to
from ctc_chattering.numerics.interpolation import cubic, linear, quintic
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.parameters import Parameter, whole
from ctc_chattering.trajectory.buffer import following, Point

_FIELDS = ('positions', 'velocities', 'accelerations')
#: Parts of the way between two waypoints at which limits are checked.
_PARTS = 32


class Waypoints:
    """
    Waypoints joined by polynomials.

    Between two waypoints every joint follows a quintic where both have accelerations, otherwise
    a cubic where both have velocities, otherwise a straight line. The polynomials are closed on
    the left: a waypoint's velocity, where it jumps, is that of the motion which leaves it. The
    last waypoint is met as given; after it the motion rests there, whatever velocity it had.

    Parameters
    ----------
    times : sequence of int
        Instants [ns], strictly increasing.
    points : sequence of (position, velocity, acceleration)
        Each of shape (n,) [rad, rad/s, rad/s²]; the acceleration, or velocity and acceleration,
        may be empty.
    start : (int, (position, velocity, acceleration)), optional
        Instant [ns] and state from which the motion to the first waypoint begins, by the same
        rule. It is not needed, and passed over, from the first waypoint's instant on. Without
        it, and before it, the motion rests at its first position.

    Raises
    ------
    ParameterError
        Naming the first waypoint, counted from 0, that is not allowed.

    """

    def __init__(self, times: Sequence[int], points: Sequence[Point],
                 start: tuple[int, Point] | None = None) -> None:
        self._points = _checked(times, points)
        self._times = list(times)
        if start is not None and whole('start', start[0]) < self._times[0]:
            self._times.insert(0, start[0])
            self._points.insert(0, _waypoint('start', start[1], len(self._points[0][0])))

    @property
    def end(self) -> int:
        """Instant of the last waypoint [ns]."""
        return self._times[-1]

    def extremes(self) -> list[Point]:
        """Return points of every part of the motion, close enough to show what it reaches."""
        return [self.at(before + (after - before) * k // _PARTS)
                for before, after in pairwise(self._times) for k in range(_PARTS)
                ] + [self.at(self.end)]

    def at(self, t: int) -> Point:
        """Return position, velocity and acceleration, each of shape (n,), at `t` [ns]."""
        t = t if type(t) is int else whole('t', t)
        i = bisect_right(self._times, t)
        before = self._points[max(i - 1, 0)]
        if i == 0 or i == len(self._times):
            rest = (0.0,) * len(before[0])
            if t == self._times[-1]:
                return before[0], before[1] or rest, before[2] or rest
            return before[0], rest, rest
        after = self._points[i]
        h = seconds(self._times[i] - self._times[i - 1])
        s = seconds(t - self._times[i - 1]) / h
        if before[2] and after[2]:
            if not s:
                return before
            joints = [quintic(s, h, *ends) for ends in zip(*before, *after)]
        elif before[1] and after[1]:
            joints = [cubic(s, h, *ends) for ends in zip(*before[:2], *after[:2])]
        else:
            joints = [linear(s, h, *ends) for ends in zip(before[0], after[0])]
        return tuple(zip(*joints))  # type: ignore[return-value]


class Route(NamedTuple):
    """
    Waypoints of named joints, not yet checked.

    Attributes
    ----------
    names : sequence of str, shape (n,)
        Joints in the order of the numbers.
    times, points
        As `Waypoints` takes them.

    """

    names: Sequence[str]
    times: Sequence[int]
    points: Sequence[Point]

    def ordered(self, names: Sequence[str]) -> Route:
        """
        Return the same waypoints, checked, with the joints in the order of `names`.

        Raises
        ------
        ParameterError
            Unless they are for each of these joints, for no other, and `Waypoints` takes them.

        """
        check_names(self.names, names)
        order = [self.names.index(name) for name in names]
        points = [tuple(tuple(row[i] for i in order) if row else () for row in point)
                  for point in _checked(self.times, self.points, len(order))]
        return Route(tuple(names), tuple(self.times), tuple(points))  # type: ignore[arg-type]

    def by_the_short_way(self, continuous: Sequence[bool], start: tuple[int, Point] | None = None
                         ) -> Route:
        """
        Return the same waypoints, with continuous joints turned from each to the next by (AN1).

        Parameters
        ----------
        continuous : sequence of bool, shape (n,)
            Which joints turn endlessly.
        start : (int, (position, velocity, acceleration)), optional
            Instant [ns] and state from which the first waypoint after it is reached, or the last
            one; by default the first one stays as it is.

        """
        if not any(continuous):
            return self
        points = list(following(self.times, self.points, continuous, self.times[0], None))
        if start is None:
            return self._replace(points=points)
        begin, state = start
        i = min(bisect_right(self.times, begin), len(points) - 1)
        (reached,) = following(self.times[i:i + 1], points[i:i + 1], continuous, begin, state)
        turns = [turns_to(x, there) for x, there in zip(points[i][0], reached[0])]
        return self._replace(points=[
            (tuple(map(turned, q, turns)), dq, ddq) for q, dq, ddq in points])


def check_names(names: Sequence[str], needed: Sequence[str]) -> None:
    """Raise `ParameterError` unless joints are those that are needed, each of them once."""
    if sorted(names) != sorted(needed):
        raise ParameterError(
            'joint_names', tuple(names), 'each of these once: ' + ', '.join(needed))


def _checked(times: Sequence[int], points: Sequence[Point], n: int = 0) -> list[Point]:
    """Return points of n joints as tuples of floats; raise `ParameterError` for what is wrong."""
    if not len(points):
        raise ParameterError('points', [], 'one or more')
    if len(times) != len(points):
        raise ParameterError('times', tuple(times), f'one per point: {len(points)}')
    for i, t in enumerate(times):
        whole(f'times[{i}]', t)
    found: list[Point] = []
    for i, point in enumerate(points):
        found.append(_waypoint(f'points[{i}]', point, n))
        n = n or len(found[0][0])
    for i, (before, t) in enumerate(pairwise(times), 1):
        if t <= before:
            raise ParameterError(f'points[{i}].time_from_start', seconds(t),
                                 f'more than that of the point before, {seconds(before)} s')
    return found


def _waypoint(name: str, point: Point, n: int) -> Point:
    """Return a point of n joints as tuples of floats; raise `ParameterError` if it is none."""
    if len(point) != len(_FIELDS):
        raise ParameterError(name, point, ', '.join(_FIELDS))
    rows: list[tuple[float, ...]] = []
    for field, value in zip(_FIELDS, point):
        spec = Parameter(f'{name}.{field}', 'float[]', (), '', shape='n')
        row = spec.coerce(value)
        if row or not rows:
            spec.check(row, n or max(len(row), 1))
        if row and rows and not rows[-1]:
            raise ParameterError(spec.name, row, 'none without velocities')
        rows.append(row)
    q, dq, ddq = rows
    return q, dq, ddq


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


class Stop:
    """
    A motion that comes to rest on its own path: its time slows down until it stands.

    With τ = (t - t0) / T, the motion at t is the one before at s(t) = t0 + T (τ - τ³ + τ⁴/2). Its
    rate ds/dt = 1 - 3 τ² + 2 τ³ falls from 1 to 0. No velocity exceeds that of the path, and
    |ddq| is at most that of the path plus 1.5 |dq| / T.

    Parameters
    ----------
    before : TimedMotion
        The motion to stop.
    t0 : int
        Instant until which it is `before` [ns].
    duration : float
        T, until it rests [s].

    Attributes
    ----------
    end : int
        Instant from which on it rests [ns].

    """

    def __init__(self, before: TimedMotion, t0: int, duration: float) -> None:
        self._before, self.t0, self.end = before, t0, t0 + round(duration * NANOSECONDS)
        self._span = seconds(self.end - t0)

    def at(self, t: int) -> Point:
        """Return position, velocity and acceleration, each of shape (n,), at `t` [ns]."""
        if t <= self.t0:
            return self._before.at(t)
        s = seconds(min(t, self.end) - self.t0) / self._span
        passed = self._span * (s - s ** 3 + 0.5 * s ** 4)
        rate, change = 1.0 - s * s * (3.0 - 2.0 * s), 6.0 * s * (s - 1.0) / self._span
        q, dq, ddq = self._before.at(self.t0 + round(passed * NANOSECONDS))
        return (tuple(q), tuple(rate * v for v in dq),
                tuple(rate * rate * a + change * v for v, a in zip(dq, ddq)))


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

    Attributes
    ----------
    end : int
        That instant [ns].

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
        self.t0, self.end = t0, t0 + span
        self._span = seconds(span)

    def at(self, t: int) -> Point:
        """Return position, velocity and acceleration, each of shape (n,), at `t` [ns]."""
        if t >= self.end:
            return self.after.at(t)
        if t <= self.t0:
            return self.before.at(t)
        s = seconds(t - self.t0) / self._span
        w, dw, ddw = quintic(s, self._span, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
        rows = []
        for q, dq, ddq, x, dx, ddx in zip(*self.before.at(t), *self.after.at(t)):
            distance, difference = x - q, dx - dq
            rows.append((q + w * distance, dq + w * difference + dw * distance,
                         ddq + w * (ddx - ddq) + 2.0 * dw * difference + ddw * distance))
        return tuple(zip(*rows))  # type: ignore[return-value]


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
    start = _waypoint('start', start, len(motion.at(t0)[0]))
    before = braking(t0, start, min(duration, BRAKING_TIME) if duration > 0.0 else BRAKING_TIME)
    return Transition(before, motion, t0, duration)
