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
Recorded reference, evaluated at any instants at once.

`bags/reader.py` needs what was desired at the stamps of all states. The result is that of
`trajectory/buffer.py`, which the controller used, to the last bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from ctc_chattering.bags.bag import Bag
from ctc_chattering.bags.signals import Instants
from ctc_chattering.configuration.topics import REFERENCE, select, TOPICS
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.angles import unwrapped, within_half_turn
from ctc_chattering.numerics.interpolation import quintic
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS, nanoseconds
import numpy as np


class RecordedReference(NamedTuple):
    """
    Points of the reference.

    They are those that `trajectory.buffer.Trajectory` has at the end.

    Attributes
    ----------
    start : int
        Instant of the first point that was received [ns].
    t : ndarray of int, shape (K,)
        Instants, increasing [ns].
    points : ndarray, shape (K, 3, n)
        Position [rad], velocity [rad/s] and acceleration [rad/s²].

    """

    start: int
    t: Instants
    points: Array

    def with_turns(self, continuous: Sequence[bool]) -> RecordedReference:
        """Return it with counted turns of endless joints, by (AN1)."""
        points = self.points.copy()
        seconds = (self.t - self.t[0]) / NANOSECONDS
        q = points[:, 0]
        dq = points[:, 1]
        points[:, 0] = unwrapped(seconds, q, dq, continuous)
        return self._replace(points=points)

    def correction_at(self, instants: Instants, desired: RecordedReference) -> Array | None:
        """
        Return what it has beyond the desired motion, shape (N, 3, n).

        It is nan where that motion is not known, and None if nothing of it was recorded.
        """
        if not len(desired.t):
            return None
        correction = self.at(instants) - desired.at(np.maximum(instants, desired.t[0]))
        correction[:, 0] = within_half_turn(correction[:, 0])
        before = self.t[np.searchsorted(self.t, instants, side='right') - 1]
        correction[np.isin(before, desired.t, invert=True)] = np.nan
        return correction

    def at(self, instants: Instants) -> Array:
        """
        Return the points at some instants, shape (N, 3, n).

        No instant may be earlier than the first point.

        On a point it is that point, to the last bit. Between two points it is the quintic that
        meets both. After the last one it rests.
        """
        first = np.searchsorted(self.t, instants, side='right') - 1
        second = np.minimum(first + 1, len(self.t) - 1)
        points = self.points[first]
        is_between = self.t[first] != instants
        is_behind = is_between & (second == first)
        points[is_behind, 1:] = 0.0
        rows = np.flatnonzero(is_between & ~is_behind)
        if len(rows):
            first = first[rows]
            second = second[rows]
            begin = self.t[first]
            duration = self.t[second] - begin
            elapsed = instants[rows] - begin
            span: Any = duration[:, np.newaxis] / NANOSECONDS
            since = elapsed[:, np.newaxis] / NANOSECONDS
            motion = quintic(
                since / span,
                span,
                *self.points[first].swapaxes(0, 1),
                *self.points[second].swapaxes(0, 1))
            points[rows] = np.stack(motion, axis=1)
        return points


def read_reference(bag: Bag, joints: tuple[str, ...], topic: str = REFERENCE
                   ) -> RecordedReference:
    """
    Return the recorded reference of some joints, of `DESIRED` without its correction.

    Chunks that the controller refuses are left out.
    """
    chunks: list[tuple[Instants, Array]] = []
    start = 0
    message_type = TOPICS[topic].kind
    connections = [x for x in bag.named(topic) if x.msgtype == message_type]
    for _, message in bag.read(connections):
        try:
            t, points = _read_chunk(message, joints)
        except CtcError:
            continue
        step = np.diff(t)
        if not len(t) or (step <= 0).any():
            continue
        start = start if chunks else int(t[0])
        _extend(chunks, t, points)
    if not chunks:
        no_points = np.zeros((0, 3, len(joints)))
        return RecordedReference(0, np.zeros(0, np.int64), no_points)
    return RecordedReference(start, *map(np.concatenate, zip(*chunks)))


def _extend(chunks: list[tuple[Instants, Array]], t: Instants, points: Array) -> None:
    """Add a chunk in the place of all later points."""
    while chunks and chunks[-1][0][-1] >= t[0]:
        old_t, old_points = chunks.pop()
        count = int(np.searchsorted(old_t, t[0]))
        if count:
            earlier = old_t[:count], old_points[:count]
            chunks.append(earlier)
    chunks.append((t, points))


def _read_chunk(message: Any, joints: tuple[str, ...]) -> tuple[Instants, Array]:
    """
    Return instants and points of a message.

    A message of other joints raises `RejectedMessage`.
    """
    first = nanoseconds(message.header.stamp)
    times = [first + nanoseconds(x.time_from_start) for x in message.points]
    rows: list[Any] = []
    for point in message.points:
        rows += point.positions, point.velocities, point.accelerations
    values = select(joints, message.joint_names, *(x.tolist() for x in rows))
    points = np.array(values, float).reshape(-1, 3, len(joints))
    return np.array(times, np.int64), points
