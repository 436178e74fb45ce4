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

from bisect import bisect_right
from collections.abc import Sequence

from ctc_chattering.numerics.interpolation import quintic
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import seconds

Point = tuple[Vector, Vector, Vector]


class Trajectory:
    """
    Points of position, velocity and acceleration over integer nanoseconds.

    A new chunk replaces all points from its first instant on. Between two points the motion is
    the quintic that meets both; on a point it is that point, to the last bit. After the last one
    it goes on at that point's velocity for as long as `grace`, and then rests where it is.

    Parameters
    ----------
    grace : int
        How long the next chunk may be late [ns].

    """

    def __init__(self, grace: int = 0) -> None:
        self._grace = grace
        self._times: list[int] = []
        self._points: dict[int, Point] = {}

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
            x for row in self._points[self._times[-1]][1:] for x in row)

    def overdue(self, t: int) -> bool:
        """Return whether a chunk that should go on at `t` [ns] has not come within the grace."""
        return bool(self._times) and t > self._times[-1] + self._grace and not self.ends_at_rest

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
        while self._times and self._times[-1] >= times[0]:
            del self._points[self._times.pop()]
        self._times.extend(times)
        self._points.update(zip(times, points))

    def forget(self, before: int) -> None:
        """Drop the points that no instant from `before` [ns] on needs."""
        keep = max(0, bisect_right(self._times, before) - 1)
        for t in self._times[:keep]:
            del self._points[t]
        del self._times[:keep]

    def limit(self, most: int) -> None:
        """Drop the first points where there are more than `most`."""
        if len(self._times) > most:
            self.forget(self._times[-most])

    def at(self, t: int) -> Point | None:
        """
        Return position, velocity and acceleration at `t` [ns].

        None if the first point is still to come, or there is no point.
        """
        point = self._points.get(t)
        if point is not None:
            return point
        i = bisect_right(self._times, t)
        if i == 0:
            return None
        before = self._points[self._times[i - 1]]
        if i == len(self._times):
            return self._after(t, before)
        after = self._points[self._times[i]]
        h = seconds(self._times[i] - self._times[i - 1])
        s = seconds(t - self._times[i - 1]) / h
        joints = [quintic(s, h, *ends) for ends in zip(*before, *after)]
        return tuple(zip(*joints))  # type: ignore[return-value]

    def _after(self, t: int, last: Point) -> Point:
        """Return the motion after the last point."""
        q, dq, _ = last
        rest = (0.0,) * len(q)
        late = t - self._times[-1]
        h = seconds(min(late, self._grace))
        return (tuple(x + h * v for x, v in zip(q, dq)), dq if late <= self._grace else rest,
                rest)
