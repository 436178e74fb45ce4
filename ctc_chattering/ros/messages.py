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

from collections.abc import Callable, Sequence
import importlib
from operator import itemgetter
import os
from pathlib import Path
import struct
from typing import Any, ClassVar, NamedTuple

from builtin_interfaces.msg import Duration, Time
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
import rclpy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

#: Fields of a layout: a time (seconds, nanoseconds), a string, a sequence of doubles, all that
#: follows.
TIME, STRING, DOUBLES, REST = 'iI', 'string', 'doubles', 'rest'
#: Size of the encapsulation [bytes].
_BEGIN = 4
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


def byte_order(data: bytes) -> str:
    """Return the byte order of a message as `struct` has it."""
    order = {b'\0\0': '>', b'\0\1': '<'}.get(data[:2])
    if order is None:
        raise CtcError('the encapsulation of the message is not CDR')
    return order


class Template:
    """
    The `struct` of all messages that differ from the last one in numbers only.

    Its values are the encapsulation, the numbers, and the counts and bytes between them.

    Attributes
    ----------
    layout : tuple
        The fields of the message: `TIME`, `STRING`, `DOUBLES`, `REST`, the size of other numbers
        of four bytes, or a list with the fields of an element of a sequence.
    fields : tuple
        The layout with a str for a string, a tuple for a sequence, the slice of the values for
        times and doubles, and nothing for other numbers.
    rows : list of slice
        Where the values have doubles.

    """

    layout: ClassVar[tuple[Any, ...]]

    def __init__(self) -> None:
        self._struct = struct.Struct('')
        self._constants: Callable[[Any], Any] = tuple
        self._expected: Any = None

    def unpack(self, data: bytes) -> tuple[Any, ...]:
        """Return the values of a message; raise `CtcError` if it is incomplete or not CDR."""
        try:
            values = self._struct.unpack_from(data)
            if self._constants(values) == self._expected:
                return values
        except struct.error:
            pass
        return self.parse(data)

    def parse(self, data: bytes) -> tuple[Any, ...]:
        """Take the template from a message, and return its values."""
        self._data, self._order = data, byte_order(data)
        self._codes, self._at, self._size = f'{self._order}{_BEGIN}s', _BEGIN, 1
        self._places = [0]
        self.rows: list[slice] = []
        self.fields = self._parse(self.layout)
        self._struct = struct.Struct(self._codes)
        self._constants = itemgetter(*self._places)
        values = self._struct.unpack_from(data)
        self._expected = self._constants(values)
        return values

    def _parse(self, part: Any) -> Any:
        """Return the fields of a part of the layout that begins at byte `_at`."""
        if isinstance(part, tuple):
            fields = [x for x in map(self._parse, part) if x is not None]
            return tuple(fields) if len(fields) > 1 else fields[0]
        if part == TIME:
            return self._append(TIME, 4, 8, 2)
        if part == REST:
            part = len(self._data) - self._at
        if isinstance(part, int):
            self._constant(f'{part}s', 4, part)
            return None
        count = self._constant('I', 4, 4)
        if part == STRING:
            text = self._constant(f'{count}s', 1, count)
            return text.partition(b'\0')[0].decode(errors='replace')
        if part == DOUBLES:
            row = self._append(f'{count}d', 8, 8 * count, count) if count else slice(0)
            self.rows += [row] * bool(count)
            return row
        return tuple([self._parse(x) for _ in range(count) for x in part])

    def _append(self, code: str, alignment: int, length: int, count: int = 1) -> slice:
        """Append `count` values, `length` bytes together; return their slice."""
        padding = (_BEGIN - self._at) % alignment
        self._codes += f'{padding}x{code}'
        self._at += padding + length
        self._size += count
        if self._at > len(self._data):
            raise CtcError(f'the message is incomplete: {len(self._data)} of {self._at} bytes')
        return slice(self._size - count, self._size)

    def _constant(self, code: str, alignment: int, length: int) -> Any:
        """Append a value that the next message must have as well, and return it."""
        self._places.append(self._append(code, alignment, length).start)
        return struct.unpack_from(self._order + code, self._data, self._at - length)[0]


class StateReader(Template):
    """Deserializes `JointState` messages."""

    layout = TIME, STRING, [STRING], DOUBLES, DOUBLES, DOUBLES

    def read(self, data: bytes) -> StateMessage:
        """Return the content of a message; raise `CtcError` if it is malformed."""
        x = self.unpack(data)
        time, _, names, position, velocity, effort = self.fields
        sec, nanosec = x[time]
        return StateMessage(
            sec * NANOSECONDS + nanosec, names, x[position], x[velocity], x[effort])


class EffortReader(Template):
    """Deserializes `Float64MultiArray` messages."""

    layout = [(STRING, 8)], 4, DOUBLES

    def read(self, data: bytes) -> Efforts:
        """Return the content of a message; raise `CtcError` if it is malformed."""
        x = self.unpack(data)
        names, values = self.fields
        return Efforts(names, x[values])


#: The fields of a `JointTrajectoryPoint`.
_POINT = DOUBLES, DOUBLES, DOUBLES, DOUBLES, TIME


class TrajectoryReader(Template):
    """Deserializes `JointTrajectory` messages; missing velocities and accelerations are empty."""

    layout = TIME, STRING, [STRING], [_POINT]

    def read(self, data: bytes) -> TrajectoryChunk:
        """Return the content of a message; raise `CtcError` if it is malformed."""
        x = self.unpack(data)
        time, _, names, points = self.fields
        sec, nanosec = x[time]
        start = sec * NANOSECONDS + nanosec
        times = [start + x[at.start] * NANOSECONDS + x[at.start + 1] for *_, at in points]
        return TrajectoryChunk(names, times, [(x[q], x[dq], x[ddq]) for q, dq, ddq, *_ in points],
                               start)


class _Writer(Template):
    """Serializes messages that differ from `message`, of ROS or bytes, in stamp and doubles."""

    def __init__(self, message: Any) -> None:
        super().__init__()
        data = message if isinstance(message, bytes) else bytes(serialize_message(message))
        self._values = self.parse(data)

    def _write(self, rows: Sequence[Sequence[float]], t: int | None = None) -> bytes:
        values = list(self._values)
        if t is not None:
            values[self.fields[0]] = divmod(t, NANOSECONDS)
        for place, row in zip(self.rows, rows):
            values[place] = row
        return self._struct.pack(*values)


class StateWriter(_Writer):
    """Serializes `JointState` messages that have `names` and `fields`, of position to effort."""

    layout = StateReader.layout

    def __init__(self, names: Sequence[str],
                 fields: Sequence[str] = ('position', 'velocity', 'effort')) -> None:
        zeros = [0.0] * len(names)
        super().__init__(JointState(name=list(names), **dict.fromkeys(fields, zeros)))

    def write(self, t: int, *rows: Sequence[float]) -> bytes:
        """Return the message with stamp `t` [ns] and `rows`, each of shape (n,)."""
        return self._write(rows, t)


class EffortWriter(_Writer):
    """Serializes `Float64MultiArray` messages with `names` as labels of the dimensions."""

    layout = EffortReader.layout

    def __init__(self, names: Sequence[str]) -> None:
        message = Float64MultiArray(data=[0.0] * len(names))
        message.layout.dim = [MultiArrayDimension(label=x, size=1, stride=1) for x in names]
        super().__init__(message)

    def write(self, values: Sequence[float]) -> bytes:
        """Return the message with `values`, shape (n,)."""
        return self._write((values,))


class TrajectoryWriter(_Writer):
    """Serializes `JointTrajectory` messages of `count` points, one every `period` [ns]."""

    layout = TrajectoryReader.layout

    def __init__(self, names: Sequence[str], count: int, period: int) -> None:
        zeros = [0.0] * len(names)
        times = [divmod(k * period, NANOSECONDS) for k in range(count)]
        super().__init__(JointTrajectory(joint_names=list(names), points=[
            JointTrajectoryPoint(positions=zeros, velocities=zeros, accelerations=zeros,
                                 time_from_start=Duration(sec=sec, nanosec=nanosec))
            for sec, nanosec in times]))

    def write(self, t: int, points: Sequence[Point]) -> bytes:
        """Return the message whose first point is at `t` [ns]."""
        return self._write([row for point in points for row in point], t)


class ControllerStateWriter(_Writer):
    """Serializes `JointTrajectoryControllerState` messages with the filled fields of `message`."""

    layout = TIME, STRING, [STRING], _POINT, _POINT, _POINT, _POINT, REST

    def write(self, t: int, rows: Sequence[Sequence[float]]) -> bytes:
        """Return the message with stamp `t` [ns] and `rows`, each of shape (n,)."""
        return self._write(rows, t)


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


def read_stamp(data: bytes) -> int:
    """
    Return the time in a `Clock`, or in a header, at the beginning of a serialized message [ns].

    Raises
    ------
    CtcError
        If the message is incomplete, or this is no time from 0 to `LATEST`.

    """
    try:
        sec, nanosec = struct.unpack_from(byte_order(data) + TIME, data, 4)
    except struct.error:
        raise CtcError(f'the message is incomplete: {len(data)} bytes') from None
    t = sec * NANOSECONDS + nanosec
    if not (0 <= t <= LATEST and nanosec < NANOSECONDS):
        raise CtcError(
            f'{sec} s and {nanosec} ns are no time; allowed: 0 s to {seconds(LATEST)} s')
    return int(t)
