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

"""The reference that a bag holds, at any instants at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from ctc_chattering.bags.bag import Bag
from ctc_chattering.bags.columns import MessageLayout
from ctc_chattering.numerics.angles import unwrapped
from ctc_chattering.numerics.interpolation import quintic
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS, nanoseconds
from ctc_chattering.ros import topics
from ctc_chattering.ros.topics import select
import numpy as np
import numpy.typing as npt

Instants = npt.NDArray[np.int64]


class RecordedReference(NamedTuple):
    """
    Points of the reference, as `trajectory.buffer.Trajectory` has them at the end.

    Attributes
    ----------
    t : ndarray of int, shape (K,)
        Instants, increasing [ns].
    points : ndarray, shape (K, 3, n)
        Position [rad], velocity [rad/s] and acceleration [rad/s²].

    """

    t: Instants
    points: Array

    def with_turns(self, continuous: Sequence[bool]) -> RecordedReference:
        """Return it with positions of endless joints that follow each other by (AN1)."""
        if not any(continuous) or not len(self.t):
            return self
        points = self.points.copy()
        seconds = (self.t - self.t[0]) / NANOSECONDS
        points[:, 0] = unwrapped(seconds, points[:, 0], points[:, 1], continuous)
        return RecordedReference(self.t, points)

    def at(self, instants: Instants) -> Array:
        """
        Return the points at instants that are not before the first one, shape (N, 3, n).

        On a point it is that point, to the last bit; between two it is the quintic that meets
        both, and after the last one rest.
        """
        first = np.searchsorted(self.t, instants, side='right') - 1
        second = np.minimum(first + 1, len(self.t) - 1)
        points = self.points[first]
        is_on_point = self.t[first] == instants
        points[(second == first) & ~is_on_point, 1:] = 0.0
        between = np.flatnonzero((second > first) & ~is_on_point)
        if len(between):
            begin, end = self.t[first[between]], self.t[second[between]]
            span: Any = ((end - begin) / NANOSECONDS)[:, np.newaxis]
            share = ((instants[between] - begin) / NANOSECONDS)[:, np.newaxis] / span
            ends = (self.points[k[between], i] for k in (first, second) for i in range(3))
            points[between] = np.stack(quintic(share, span, *ends), axis=1)
        return points


class ReferenceSink:
    """Takes the chunks of the reference for some joints."""

    name = topics.REFERENCE
    message_type = topics.TOPICS[topics.REFERENCE].kind

    def __init__(self, joints: tuple[str, ...]) -> None:
        self._joints = joints
        self._chunks: list[tuple[Instants, Array]] = []
        self._layouts: dict[int, _ChunkLayout] = {}
        #: Instant of the first point [ns].
        self.start = 0

    def take(self, bag: Bag, _t: int, data: bytes) -> None:
        """Take a chunk, which replaces all points from its first instant on."""
        layout = self._layouts.get(len(data))
        chunk = layout and layout.read(data)
        if not chunk:
            try:
                message = bag.deserialize(data, self.message_type)
                chunk = _chunk(message, self._joints)
            except Exception:  # Of arbitrary bytes, decoders raise arbitrary exceptions.
                return
            if layout := _ChunkLayout.of_message(data, message, self._joints):
                self._layouts[len(data)] = layout
        t, points = chunk
        if not len(t) or (np.diff(t) <= 0).any() or not np.isfinite(points).all():
            return
        self.start = self.start if self._chunks else int(t[0])
        _extend(self._chunks, t, points)

    def reference(self) -> RecordedReference:
        """Return what was taken."""
        if not self._chunks:
            return RecordedReference(
                np.zeros(0, np.int64), np.zeros((0, 3, len(self._joints))))
        return RecordedReference(*map(np.concatenate, zip(*self._chunks)))


def _extend(chunks: list[tuple[Instants, Array]], t: Instants, points: Array) -> None:
    """Add a chunk, which replaces all points from its first instant on."""
    while chunks and chunks[-1][0][-1] >= t[0]:
        old_t, old_points = chunks.pop()
        kept = int(np.searchsorted(old_t, t[0]))
        if kept:
            chunks.append((old_t[:kept], old_points[:kept]))
    chunks.append((t, points))


def _chunk(message: Any, joints: tuple[str, ...]) -> tuple[Instants, Array]:
    """Return instants and points of a message; raise `RejectedMessage` for other joints."""
    first = nanoseconds(message.header.stamp)
    rows = [select(joints, message.joint_names, x.positions.tolist(), x.velocities.tolist(),
                   x.accelerations.tolist()) for x in message.points]
    return (np.array([first + nanoseconds(x.time_from_start) for x in message.points], np.int64),
            np.array(rows, float).reshape(-1, 3, len(joints)))


class _ChunkLayout(NamedTuple):
    """Layout of a chunk, and times of its points after its stamp [ns]."""

    layout: MessageLayout
    time_from_start: Instants

    @classmethod
    def of_message(cls, data: bytes, message: Any, joints: tuple[str, ...]
                   ) -> _ChunkLayout | None:
        layout = MessageLayout.of_message(data, message, lambda marked: _chunk(marked, joints)[1])
        times = [nanoseconds(x.time_from_start) for x in message.points]
        return layout and cls(layout, np.array(times, np.int64))

    def read(self, data: bytes) -> tuple[Instants, Array] | None:
        """Return instants and points of a chunk; None if it has another layout."""
        columns = self.layout.read([data])
        return columns and (columns.stamps[0] + self.time_from_start, columns.values[0])
