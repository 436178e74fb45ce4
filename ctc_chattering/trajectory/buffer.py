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
Buffer of a desired motion that arrives in chunks.

`controller/desired_motion.py` fills it from messages and reads it at the stamp of each state.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence

from ctc_chattering.numerics.angles import expected, nearest
from ctc_chattering.numerics.interpolation import cubic, linear, quintic
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import seconds

#: Position, velocity and acceleration, each of shape (n,) [rad, rad/s, rad/s²].
Point = tuple[Vector, Vector, Vector]


def interpolate(t: int, times: Sequence[int], points: Sequence[Point], i: int) -> Point:
    """
    Return the point at `t` [ns] between two points.

    The polynomial from point i - 1 to point i is a quintic where both have accelerations,
    otherwise a cubic where both have velocities, otherwise a straight line. The quintic is closed
    on the left: at point i - 1 it is that point, to the last bit.
    """
    start = points[i - 1]
    q, dq, ddq = start
    goal = points[i]
    goal_q, goal_dq, goal_ddq = goal
    begin = times[i - 1]
    h = seconds(times[i] - begin)
    s = seconds(t - begin) / h
    if ddq and goal_ddq:
        if t == begin:
            return start
        joints = [quintic(s, h, *ends) for ends in zip(*start, *goal)]
    elif dq and goal_dq:
        joints = [cubic(s, h, *ends) for ends in zip(q, dq, goal_q, goal_dq)]
    else:
        joints = [linear(s, h, *ends) for ends in zip(q, goal_q)]
    return tuple(zip(*joints))  # type: ignore[return-value]


def follow_turns(
        times: Sequence[int],
        points: Sequence[Point],
        continuous: Sequence[bool],
        start: int,
        state: Point | None) -> Iterator[Point]:
    """
    Yield points with continuous joints turned by (AN1).

    Each follows the point before it. Velocities count where both points have them.

    Parameters
    ----------
    times : sequence of int
        Instants [ns], increasing.
    points : sequence of (position, velocity, acceleration)
        Each of shape (n,) [rad, rad/s, rad/s²], velocities maybe empty.
    continuous : sequence of bool, shape (n,)
        Mask of the joints that turn endlessly.
    start : int
        Instant of `state` [ns].
    state : (position, velocity, acceleration) or None
        State that the first point follows. With None that point stays as it is.

    """
    for t, (q, dq, ddq) in zip(times, points):
        if state is not None:
            q0, dq0, _ = state
            zeros = (0.0,) * len(q)
            has_speeds = len(dq0) and len(dq)
            speeds = (dq0, dq) if has_speeds else (zeros, zeros)
            h = seconds(t - start)
            turned = []
            for x, x0, v0, v, endless in zip(q, q0, *speeds, continuous):
                target = expected(x0, v0, v, h)
                turned.append(nearest(x, target) if endless else x)
            q = tuple(turned)
        start, state = t, (q, dq, ddq)
        yield state


class Trajectory:
    """
    Points of position, velocity and acceleration over integer nanoseconds.

    A new chunk replaces all points from its first instant on. Its continuous joints take the turn
    that is nearest to the motion before it. Between two points the motion is the quintic that
    meets both. On a point it is that point, to the last bit. After the last point it continues at
    that point's velocity for as long as `grace`. Then it rests.

    Parameters
    ----------
    grace : int
        Time by which the next chunk may be late [ns].

    Attributes
    ----------
    continuous : sequence of bool, shape (n,)
        Mask of the joints that turn endlessly. Empty for none.

    """

    def __init__(self, grace: int = 0) -> None:
        self.grace = grace
        self.continuous: Sequence[bool] = ()
        self._times: list[int] = []
        self._points: list[Point] = []

    def __len__(self) -> int:
        """Return the number of points held."""
        return len(self._times)

    @property
    def end(self) -> int | None:
        """Instant of the last point [ns], or None."""
        return self._times[-1] if self._times else None

    @property
    def ends_at_rest(self) -> bool:
        """Rest at the last point: no chunk need follow."""
        if not self._points:
            return False
        _, dq, ddq = self._points[-1]
        return not any((*dq, *ddq))

    def overdue(self, t: int) -> bool:
        """Return whether the next chunk is late at `t` [ns]."""
        is_late = bool(self._times) and t > self._times[-1] + self.grace
        return is_late and not self.ends_at_rest

    def extend(self, times: Sequence[int], points: Sequence[Point]) -> None:
        """
        Add a chunk.

        Parameters
        ----------
        times : sequence of int
            Instants [ns], increasing.
        points : sequence of (position, velocity, acceleration)
            Each of shape (n,) [rad, rad/s, rad/s²].

        """
        if not times:
            return
        begin = times[0]
        if any(self.continuous):
            state = self._turns_beside(begin)
            points = list(follow_turns(times, points, self.continuous, begin, state))
        seam = bisect_left(self._times, begin)
        self._times[seam:] = times
        self._points[seam:] = points

    def _turns_beside(self, t: int) -> Point | None:
        """Return the point at `t` [ns] whose turns a new chunk follows."""
        return self.at(t)

    def forget(self, t: int) -> None:
        """Drop the points not needed from `t` [ns] on."""
        count = max(0, bisect_right(self._times, t) - 1)
        del self._times[:count]
        del self._points[:count]

    def limit(self, max_count: int) -> None:
        """Keep the last `max_count` points."""
        if len(self._times) > max_count:
            first_kept = self._times[-max_count]
            self.forget(first_kept)

    def at(self, t: int) -> Point | None:
        """Return the point at `t` [ns], if one is known."""
        i = bisect_right(self._times, t)
        if i == 0:
            return None
        lateness = t - self._times[i - 1]
        if lateness == 0:
            return self._points[i - 1]
        if i < len(self._times):
            return interpolate(t, self._times, self._points, i)
        q, dq, _ = self._points[-1]
        h = seconds(min(lateness, self.grace))
        q = tuple(x + h * v for x, v in zip(q, dq))
        zeros = (0.0,) * len(q)
        if lateness > self.grace:
            dq = zeros
        return q, dq, zeros
