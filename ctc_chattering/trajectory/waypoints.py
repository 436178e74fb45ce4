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
Waypoints of named joints, and the motion through them.

They come from a `trajectory_file` or from messages. They are joined as by
joint_trajectory_controller of ros2_controllers.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.angles import turned, turns_to
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import seconds
from ctc_chattering.parameters import checked_integer, Parameter
from ctc_chattering.trajectory.buffer import follow_turns, interpolate, Point

#: Names of a point's rows, in their order.
FIELDS = ('positions', 'velocities', 'accelerations')
#: Points between two waypoints at which limits are checked.
_CHECKS_PER_SEGMENT = 32
#: The same of a motion with many waypoints, which together have `_MAX_CHECKS` where they can.
_MIN_CHECKS_PER_SEGMENT = 8
_MAX_CHECKS = 1600


class PastWaypointsError(CtcError):
    """Waypoints that are all past."""


class Waypoints:
    """
    Waypoints joined by polynomials.

    Between two waypoints every joint follows a quintic where both have accelerations, otherwise
    a cubic where both have velocities, otherwise a straight line. The polynomials are closed on
    the left: a waypoint's velocity, where it jumps, is that of the motion which leaves it. The
    last waypoint is met as given. After it the motion rests there, whatever velocity it had.

    Parameters
    ----------
    times : sequence of int
        Instants [ns], strictly increasing.
    points : sequence of (position, velocity, acceleration)
        Each of shape (n,) [rad, rad/s, rad/s²]. The acceleration may be empty, or velocity and
        acceleration.
    start : (int, (position, velocity, acceleration)), optional
        Instant [ns] and state from which the motion to the first waypoint begins, by the same
        rule. It is ignored from the first waypoint's instant on. Without it, and before it, the
        motion rests at its first position.

    Raises
    ------
    ParameterError
        Naming the first waypoint, counted from 0, that is not allowed.

    """

    def __init__(
            self,
            times: Sequence[int],
            points: Sequence[Point],
            start: tuple[int, Point] | None = None) -> None:
        self._points = _check_points(times, points)
        self._times = list(times)
        if start is None:
            return
        t, state = start
        first_q, _, _ = self._points[0]
        if checked_integer('start', t) < self._times[0]:
            self._times.insert(0, t)
            self._points.insert(0, check_point('start', state, len(first_q)))

    @property
    def end(self) -> int:
        """Instant of the last waypoint [ns]."""
        return self._times[-1]

    def extremes(self) -> list[Point]:
        """Return points of every segment to check limits."""
        points = []
        checks = _MAX_CHECKS // len(self._times)
        checks = min(max(checks, _MIN_CHECKS_PER_SEGMENT), _CHECKS_PER_SEGMENT)
        for begin, end in pairwise(self._times):
            for k in range(checks):
                elapsed = (end - begin) * k // checks
                points.append(self.at(begin + elapsed))
        points.append(self.at(self.end))
        return points

    def at(self, t: int) -> Point:
        """Return the point at `t` [ns]."""
        t = t if type(t) is int else checked_integer('t', t)
        i = bisect_right(self._times, t)
        if 0 < i < len(self._times):
            return interpolate(t, self._times, self._points, i)
        last = max(i - 1, 0)
        q, dq, ddq = self._points[last]
        zeros = (0.0,) * len(q)
        if t == self.end:
            return q, dq or zeros, ddq or zeros
        return q, zeros, zeros


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
        Return checked waypoints with joints in order of `names`.

        Raises
        ------
        ParameterError
            Unless they are for each of these joints, for no other, and `Waypoints` takes them.

        """
        check_names(self.names, names)
        order = list(map(self.names.index, names))

        def reorder(row: Vector) -> Vector:
            return tuple(row[i] for i in order) if row else ()

        points = []
        for q, dq, ddq in _check_points(self.times, self.points, len(order)):
            points.append((reorder(q), reorder(dq), reorder(ddq)))
        return Route(tuple(names), tuple(self.times), tuple(points))

    def by_the_short_way(self, continuous: Sequence[bool], start: tuple[int, Point] | None = None
                         ) -> Route:
        """
        Return waypoints with continuous joints turned by (AN1).

        Parameters
        ----------
        continuous : sequence of bool, shape (n,)
            Mask of the joints that turn endlessly.
        start : (int, (position, velocity, acceleration)), optional
            Instant [ns] and state that the first waypoint after it follows, or the last waypoint.
            By default the first one stays as it is.

        """
        if not any(continuous):
            return self
        first = self.times[0]
        points = list(follow_turns(self.times, self.points, continuous, first, None))
        if start is None:
            return self._replace(points=points)
        begin, state = start
        i = min(bisect_right(self.times, begin), len(points) - 1)
        times = [self.times[i]]
        (reached,) = follow_turns(times, [points[i]], continuous, begin, state)
        q, _, _ = points[i]
        near_q, _, _ = reached
        turns = list(map(turns_to, q, near_q))
        turned_points = []
        for q, dq, ddq in points:
            turned_points.append((tuple(map(turned, q, turns)), dq, ddq))
        return self._replace(points=turned_points)


def check_names(names: Sequence[str], needed: Sequence[str]) -> None:
    """Raise `ParameterError` unless each needed joint is named once."""
    if sorted(names) != sorted(needed):
        allowed = 'each of these once: ' + ', '.join(needed)
        raise ParameterError('joint_names', tuple(names), allowed)


def _check_points(times: Sequence[int], points: Sequence[Point], n: int = 0) -> list[Point]:
    """Return checked points as tuples of floats."""
    count = len(points)
    if not count:
        raise ParameterError('points', [], 'one or more')
    if len(times) != count:
        raise ParameterError('times', tuple(times), f'one per point: {count}')
    checked_integer('times[0]', times[0])
    result: list[Point] = []
    for i, (t, point) in enumerate(zip(times, points)):
        checked = check_point(f'points[{i}]', point, n)
        result.append(checked)
        n = len(checked[0])
        previous = times[i - 1]
        if i and checked_integer(f'times[{i}]', t) <= previous:
            raise ParameterError(
                f'points[{i}].time_from_start',
                seconds(t),
                f'more than that of the point before, {seconds(previous)} s')
    return result


def check_point(name: str, point: Point, n: int) -> Point:
    """
    Return a point as tuples of floats.

    Parameters
    ----------
    name : str
        Name of the point in an error.
    point : (position, velocity, acceleration)
        Each of shape (n,). The acceleration may be empty, or velocity and acceleration.
    n : int
        Number of joints. 0 if the point decides it.

    Raises
    ------
    ParameterError
        If a row is not allowed.

    """
    if len(point) != len(FIELDS):
        raise ParameterError(name, point, ', '.join(FIELDS))
    rows: list[tuple[float, ...]] = []
    for field, value in zip(FIELDS, point):
        spec = Parameter(f'{name}.{field}', 'float[]', (), '', shape='n')
        row = spec.coerce(value)
        if row and rows and not rows[-1]:
            raise ParameterError(spec.name, row, 'none without velocities')
        if row or not rows:
            n = n or max(len(row), 1)
            spec.check(row, n)
        rows.append(row)
    q, dq, ddq = rows
    return q, dq, ddq
