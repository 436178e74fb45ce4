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

"""Messages: their classes by name, times in them, and those of the control loop as numbers."""

from __future__ import annotations

from collections.abc import Sequence
import importlib
import os
from pathlib import Path
import struct
from typing import Any, NamedTuple

from builtin_interfaces.msg import Duration, Time
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
import rclpy
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

#: Position, velocity and acceleration.
Point = tuple[Sequence[float], Sequence[float], Sequence[float]]


class StateMessage(NamedTuple):
    """A `JointState`: stamp [ns], joint names, positions, velocities and efforts."""

    t: int
    names: tuple[str, ...]
    position: Sequence[float]
    velocity: Sequence[float]
    effort: Sequence[float]


class Efforts(NamedTuple):
    """A `Float64MultiArray` of torques: labels of its dimensions (possibly none) and values."""

    names: tuple[str, ...]
    values: Sequence[float]


class TrajectoryChunk(NamedTuple):
    """A `JointTrajectory`: joint names, times [ns], and (position, velocity, acceleration)."""

    names: tuple[str, ...]
    times: list[int]
    points: list[Point]
    #: Stamp of the message; 0 for now [ns].
    start: int = 0


class _Fields:
    """
    Takes the fields of a serialized message, one after the other.

    rclpy's `deserialize_message` takes as long, reads some incomplete messages as whole ones, and
    writes to the terminal about others.

    Parameters
    ----------
    data : bytes
        The message: CDR in either byte order.

    Raises
    ------
    CtcError
        If the message is not CDR, as by the other methods if it is incomplete.

    """

    def __init__(self, data: bytes) -> None:
        order = {b'\0\0': '>', b'\0\1': '<'}.get(data[:2])
        if order is None:
            raise CtcError('the encapsulation of the message is not CDR')
        self._order, self._data, self._at = order, memoryview(data)[4:], 0

    def numbers(self, code: str, size: int, count: int = 1) -> tuple[Any, ...]:
        """Return `count` numbers that have a `code` of `struct`, and a `size` [bytes]."""
        begin = self._at + -self._at % size
        self._at = begin + size * count
        try:
            return struct.unpack_from(f'{self._order}{count}{code}', self._data, begin)
        except struct.error:
            raise CtcError('the message is incomplete: '
                           f'{len(self._data)} of {self._at} bytes') from None

    def count(self) -> int:
        """Return a count of what follows."""
        return int(self.numbers('I', 4)[0])

    def time(self) -> int:
        """Return a time [ns]."""
        return int(self.numbers('i', 4)[0] * NANOSECONDS + self.count())

    def text(self) -> str:
        """Return a string."""
        text: bytes = self.numbers('s', 1, self.count())[0]
        return text.partition(b'\0')[0].decode(errors='replace')

    def texts(self) -> tuple[str, ...]:
        """Return a sequence of strings."""
        return tuple([self.text() for _ in range(self.count())])

    def doubles(self) -> tuple[float, ...]:
        """Return a sequence of doubles."""
        count = self.count()
        return self.numbers('d', 8, count) if count else ()


def read_state(data: bytes) -> StateMessage:
    """Return the content of a serialized `JointState`; raise `CtcError` if it is malformed."""
    it = _Fields(data)
    t, _ = it.time(), it.text()
    return StateMessage(t, it.texts(), it.doubles(), it.doubles(), it.doubles())


def read_efforts(data: bytes) -> Efforts:
    """Return the content of a `Float64MultiArray`; raise `CtcError` if it is malformed."""
    it = _Fields(data)
    names = tuple([(it.text(), it.count(), it.count())[0] for _ in range(it.count())])
    it.count()  # The offset of the data.
    return Efforts(names, it.doubles())


def read_chunk(data: bytes) -> TrajectoryChunk:
    """
    Return the content of a serialized `JointTrajectory`; raise `CtcError` if it is malformed.

    Missing velocities and accelerations are empty.
    """
    it = _Fields(data)
    start, _, names = it.time(), it.text(), it.texts()
    times: list[int] = []
    points: list[Point] = []
    for _ in range(it.count()):
        points.append((it.doubles(), it.doubles(), it.doubles()))
        it.doubles()  # The efforts.
        times.append(start + it.time())
    return TrajectoryChunk(names, times, points, start)


#: Where a package of ROS lists its interfaces, in each prefix.
_INTERFACES = Path('share/ament_index/resource_index/rosidl_interfaces')
#: Latest time that is taken from a stamp, an hour before the last possible one [ns].
LATEST = (2 ** 31 - 3600) * NANOSECONDS


def message_type(kind: str) -> Any:
    """
    Return the message class called `kind`, for example ``std_msgs/msg/String``.

    Bags and graphs name types: only what a package of ROS lists as its messages is imported.

    Raises
    ------
    CtcError
        If there is none.

    """
    package, _, name = kind.partition('/msg/')
    prefixes = [Path(rclpy.__file__).parents[4], *map(
        Path, filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)))]
    try:
        if any(f'msg/{name}.idl' in (prefix / _INTERFACES / package).read_text().split()
               for prefix in prefixes if (prefix / _INTERFACES / package).is_file()):
            return getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError, ValueError):
        pass
    raise CtcError(f'{kind}: this message type is not installed')


def stamp(nanoseconds: int) -> Time:
    """Return `nanoseconds` as a message."""
    sec, nanosec = divmod(nanoseconds, NANOSECONDS)
    return Time(sec=sec, nanosec=nanosec)


class Writer:
    """
    Serializes messages of the control loop that end with rows of doubles.

    Plant and controller answer each other by them: to have ROS convert them field by field takes
    more than a tenth of a control cycle.

    Parameters
    ----------
    head : sequence of str and int
        Strings and numbers before the rows; the first two are the stamp if there is one.
    rows, n : int
        How many rows there are, and the numbers in each.

    """

    def __init__(self, head: Sequence[str | int], rows: int, n: int) -> None:
        data = bytearray()
        for item in head:
            text = item.encode() + b'\0' if isinstance(item, str) else b''
            data += bytes(-len(data) % 4)
            data += struct.pack('<I', item if isinstance(item, int) else len(text)) + text
        self._head = bytearray(b'\0\1\0\0') + data
        code, at = f'<{-len(data) % 4}x', len(data) + -len(data) % 4
        for _ in range(rows):
            padding = -(at + 4) % 8
            code += f'I{padding}x{n}d'
            at += 4 + padding + 8 * n
        self._n, self._struct = n, struct.Struct(code)

    def write(self, *rows: Sequence[float], t: int | None = None) -> bytes:
        """Return the message with `rows`, each of shape (n,), and stamp `t` [ns] if it has one."""
        if t is not None:
            struct.pack_into('<iI', self._head, 4, *divmod(t, NANOSECONDS))
        return bytes(self._head) + self._struct.pack(
            *(x for row in rows for x in (self._n, *row)))


def state_writer(names: Sequence[str]) -> Writer:
    """Return what writes `JointState` messages: positions, velocities, efforts."""
    return Writer((0, 0, '', len(names), *names), 3, len(names))


def effort_writer(names: Sequence[str]) -> Writer:
    """Return what writes `Float64MultiArray` messages, labelled with `names`."""
    labels = [x for name in names for x in (name, 1, 1)]
    return Writer((len(names), *labels, 0), 1, len(names))


def joint_state(t: int, names: Sequence[str], **rows: Sequence[float]) -> JointState:
    """Return a `JointState` with stamp `t` [ns]; `rows` are its fields, each of shape (n,)."""
    return JointState(header=Header(stamp=stamp(t)), name=names, **rows)


def trajectory(names: Sequence[str], t: int, period: int, points: Sequence[Point]
               ) -> JointTrajectory:
    """Return a `JointTrajectory` of `points`, the first at `t` [ns], one every `period` [ns]."""
    message = JointTrajectory(header=Header(stamp=stamp(t)), joint_names=names)
    for k, (q, dq, ddq) in enumerate(points):
        sec, nanosec = divmod(k * period, NANOSECONDS)
        message.points.append(JointTrajectoryPoint(
            positions=q, velocities=dq, accelerations=ddq,
            time_from_start=Duration(sec=sec, nanosec=nanosec)))
    return message


def read_stamp(data: bytes) -> int:
    """
    Return the time in a `Clock`, or in a header, at the beginning of a serialized message [ns].

    Raises
    ------
    CtcError
        If the message is incomplete, or this is no time from 0 to `LATEST`.

    """
    it = _Fields(data)
    (sec,), nanosec = it.numbers('i', 4), it.count()
    t = sec * NANOSECONDS + nanosec
    if not (0 <= t <= LATEST and nanosec < NANOSECONDS):
        raise CtcError(
            f'{sec} s and {nanosec} ns are no time; allowed: 0 s to {seconds(LATEST)} s')
    return int(t)
