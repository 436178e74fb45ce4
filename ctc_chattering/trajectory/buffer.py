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

"""A desired motion that arrives in chunks, as a controller sees it."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence

from ctc_chattering.numerics.angles import expected, nearest
from ctc_chattering.numerics.interpolation import quintic
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import seconds

Point = tuple[Vector, Vector, Vector]


def following(times: Sequence[int], points: Sequence[Point], continuous: Sequence[bool],
              start: int, state: Point | None) -> Iterator[Point]:
    """
    Yield points in which each joint that turns endlessly follows the point before, by (AN1).

    Velocities count where both points have some.

    Parameters
    ----------
    times : sequence of int
        Instants [ns], increasing.
    points : sequence of (position, velocity, acceleration)
        Each of shape (n,) [rad, rad/s, rad/s²]; velocities may be empty.
    continuous : sequence of bool, shape (n,)
        Which joints turn endlessly.
    start, state : int, (position, velocity, acceleration) or None
        What the first one follows: instant [ns] and point; None for nothing.

    """
    last = state
    for t, (q, dq, ddq) in zip(times, points):
        if last is not None:
            rest = (0.0,) * len(q)
            speeds = (last[1], dq) if len(last[1]) and len(dq) else (rest, rest)
            h = seconds(t - start)
            q = tuple(nearest(x, expected(x0, v0, v, h)) if endless else x
                      for x, x0, v0, v, endless in zip(q, last[0], *speeds, continuous))
        start, last = t, (q, dq, ddq)
        yield last


class Trajectory:
    """
    Points of position, velocity and acceleration over integer nanoseconds.

    A new chunk replaces all points from its first instant on; continuous joints follow what was
    before it by the nearest turn. Between two points the motion is
    the quintic that meets both; on a point it is that point, to the last bit. After the last one
    it goes on at that point's velocity for as long as `grace`, and then rests where it is.

    Parameters
    ----------
    grace : int
        How long the next chunk may be late [ns].

    Attributes
    ----------
    grace : int
        As given.
    continuous : sequence of bool, shape (n,)
        Which joints turn endlessly; empty for none.

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
        """Instant of the last point [ns]; None without points."""
        return self._times[-1] if self._times else None

    @property
    def ends_at_rest(self) -> bool:
        """Whether nothing is to come after the last point: it has no velocity."""
        return bool(self._times) and not any(
            x for row in self._points[-1][1:] for x in row)

    def overdue(self, t: int) -> bool:
        """Return whether a chunk that should go on at `t` [ns] has not come within the grace."""
        return bool(self._times) and t > self._times[-1] + self.grace and not self.ends_at_rest

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
        if times:
            if any(self.continuous):
                points = list(following(
                    times, points, self.continuous, times[0], self.at(times[0])))
            kept = bisect_left(self._times, times[0])
            self._times[kept:], self._points[kept:] = times, points

    def forget(self, before: int) -> None:
        """Drop the points that no instant from `before` [ns] on needs."""
        keep = max(0, bisect_right(self._times, before) - 1)
        del self._times[:keep], self._points[:keep]

    def limit(self, most: int) -> None:
        """Drop the first points where there are more than `most`."""
        if len(self._times) > most:
            self.forget(self._times[-most])

    def at(self, t: int) -> Point | None:
        """
        Return position, velocity and acceleration at `t` [ns].

        None if the first point is still to come, or there is no point.
        """
        i = bisect_right(self._times, t)
        if i == 0:
            return None
        begin, before = self._times[i - 1], self._points[i - 1]
        if begin == t:
            return before
        if i == len(self._times):
            h, rest = seconds(min(t - begin, self.grace)), (0.0,) * len(before[0])
            return (tuple(x + h * v for x, v in zip(*before[:2])),
                    before[1] if t <= begin + self.grace else rest, rest)
        h = seconds(self._times[i] - begin)
        s = seconds(t - begin) / h
        joints = [quintic(s, h, *ends) for ends in zip(*before, *self._points[i])]
        return tuple(zip(*joints))  # type: ignore[return-value]
