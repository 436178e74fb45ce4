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
Messages: classes, stamps, and the numbers of the control loop.

ROS reads and writes a message of the control loop in full once. In the next ones only stamp and
numbers differ, and `Reader` and `Writer` touch these only. For a state and its torque that is a
tenth of a control cycle less than rclpy needs, whose messages are objects with a setter for each
field.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import importlib
import os
from pathlib import Path
import struct
from typing import Any, NamedTuple

from builtin_interfaces.msg import Duration, Time
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS, nanoseconds, seconds
import numpy as np
import rclpy
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

#: Position, velocity and acceleration.
Point = tuple[Sequence[float], Sequence[float], Sequence[float]]
#: Latest time that is taken from a stamp, an hour before the last possible one [ns].
LATEST = (2 ** 31 - 3600) * NANOSECONDS
#: A number by which rows are found: what ROS appends to a message it does not say.
MARK = 1.234567890123456e-67
#: Bytes before the content of a message in CDR.
_CDR_HEADER = 4
#: Bytes behind the accelerations of a `JointTrajectoryPoint`: count of efforts, and time.
_END_OF_POINT = 12
#: A stamp in CDR: seconds and nanoseconds.
_STAMP = struct.Struct('<iI')


def message_type(type_name: str) -> Any:
    """
    Return the message class of a name like ``std_msgs/msg/String``.

    Bags and graphs name types: only what a package of ROS lists as its messages is imported.

    Raises
    ------
    CtcError
        If there is none.

    """
    package, _, name = type_name.partition('/msg/')
    listed = Path('share/ament_index/resource_index/rosidl_interfaces', package)
    prefixes = [Path(rclpy.__file__).parents[4], *map(
        Path, filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)))]
    if not any(f'msg/{name}.idl' in (prefix / listed).read_text().split()
               for prefix in prefixes if (prefix / listed).is_file()):
        raise CtcError(f'{type_name}: this message type is not installed')
    return getattr(importlib.import_module(f'{package}.msg'), name)


def stamp(t: int) -> Time:
    """Return a time [ns] as a message."""
    sec, nanosec = divmod(t, NANOSECONDS)
    return Time(sec=sec, nanosec=nanosec)


def read_stamp(data: bytes) -> int:
    """
    Return the time at a message's beginning [ns].

    It is that of a `Clock`, or of a header.

    Raises
    ------
    CtcError
        If this is no time from 0 to `LATEST`.
    LookupError, struct.error
        If this is no message, or an incomplete one.

    """
    sec, nanosec = struct.unpack_from({0: '>iI', 1: '<iI'}[data[1]], data, _CDR_HEADER)
    t: int = sec * NANOSECONDS + nanosec
    if not (0 <= t <= LATEST and nanosec < NANOSECONDS):
        raise CtcError(f'{sec} s and {nanosec} ns are no time; allowed: 0 s to '
                       f'{seconds(LATEST)} s')
    return t


class LoopMessage(NamedTuple):
    """Stamp [ns], names and rows of a message."""

    t: int
    names: tuple[str, ...]
    rows: Sequence[Sequence[float]]


def _rows_format(sizes: Sequence[int]) -> str:
    """Return the CDR format of rows with counts between."""
    first, *following = sizes
    return f'{first}d' + ''.join(f'I4x{n}d' if n else 'I' for n in following)


class Reader:
    """
    Reads messages that end with rows of doubles.

    ROS reads a message. The next one of the same frame, which is all but stamp and numbers, is
    unpacked at once.

    Parameters
    ----------
    message_class : type
        Message class.
    content : callable
        Returns the `LoopMessage` of a message of that class.
    stamped : bool
        Whether a stamp is at the beginning.

    """

    def __init__(self, message_class: Any, content: Callable[[Any], LoopMessage],
                 stamped: bool) -> None:
        self._class, self._content = message_class, content
        self._stamp_format = 'iI' if stamped else ''
        self._frame_index = len(self._stamp_format)
        self._layout: struct.Struct | None = None
        self._frame = b''
        self._counts: tuple[int, ...] = ()
        self._names: tuple[str, ...] = ()
        self._row_slices: list[slice] = []
        self._count_slice = slice(0)

    def __call__(self, data: bytes) -> LoopMessage:
        """Return the content of a message, or raise `RuntimeError`."""
        layout = self._layout
        if layout is not None and len(data) == layout.size:
            values = layout.unpack(data)
            index = self._frame_index
            if values[index] == self._frame and values[self._count_slice] == self._counts:
                return LoopMessage(
                    values[0] * NANOSECONDS + values[1] if index else 0, self._names,
                    list(map(values.__getitem__, self._row_slices)))
        return self._read_by_ros(data)

    def _read_by_ros(self, data: bytes) -> LoopMessage:
        """Return the content of a message, and remember its frame."""
        message = deserialize_message(data, self._class)
        content = self._content(message)
        n, rows = len(content.names), len(content.rows)
        is_little_endian = data[1] == 1
        self._layout = None
        if n and {len(row) for row in content.rows} == {n} and is_little_endian and (
                len(serialize_message(message)) == len(data)):
            head, tail = f'<4x{self._stamp_format}', _rows_format([n] * rows)
            length = len(data) - struct.calcsize(head) - struct.calcsize(f'<{tail}')
            self._layout = struct.Struct(f'{head}{length}s{tail}')
            self._names, self._counts = content.names, (n,) * (rows - 1)
            first = self._frame_index + 1
            self._frame = self._layout.unpack(data)[self._frame_index]
            self._count_slice = slice(first + n, None, n + 1)
            self._row_slices = [slice(k, k + n) for k in range(
                first, first + rows * (n + 1), n + 1)]
        return content


def state_reader() -> Reader:
    """Return a reader of `JointState` messages: positions, velocities, efforts."""
    return Reader(JointState, lambda m: LoopMessage(
        nanoseconds(m.header.stamp), tuple(m.name), (m.position, m.velocity, m.effort)), True)


def effort_reader() -> Reader:
    """Return a reader of `Float64MultiArray` messages with labels."""
    return Reader(Float64MultiArray, lambda m: LoopMessage(
        0, tuple([x.label for x in m.layout.dim]), (m.data,)), False)


class Writer:
    """
    Writes messages that end with rows of doubles.

    It replaces the numbers in a message that ROS has serialized.

    Parameters
    ----------
    message : object
        Of ROS. Its last fields are the rows, all numbers `MARK`. A stamp is at its beginning.
    sizes : sequence of int
        The numbers in each row, at least one in the first.

    """

    def __init__(self, message: Any, sizes: Sequence[int]) -> None:
        self._data = bytearray(serialize_message(message))
        self._layout = struct.Struct(f'<{_rows_format(sizes)}')
        self._begin = self._data.index(struct.pack('<d', MARK))
        # Where rows are empty, rclpy leaves bytes behind the message, which other readers refuse.
        del self._data[self._begin + self._layout.size:]

    def write(self, *rows: Sequence[float], t: int | None = None) -> bytes:
        """Return the message with `rows` and stamp `t` [ns]."""
        if t is not None:
            _STAMP.pack_into(self._data, _CDR_HEADER, *divmod(t, NANOSECONDS))
        values = [*rows[0]]
        for row in rows[1:]:
            values += (len(row), *row)
        self._layout.pack_into(self._data, self._begin, *values)
        return bytes(self._data)


def raw_sender(publisher: Publisher) -> Callable[[bytes], None]:
    """Return a function that publishes serialized messages."""
    send: Callable[[bytes], None] = publisher.handle.publish_raw
    return send


def state_writer(names: Sequence[str], **sizes: int) -> Writer:
    """
    Return a writer of `JointState` messages with `names`.

    It takes the rows from the first field that `sizes` names on: position, velocity and effort,
    each with so many numbers, or none.
    """
    of_fields = [sizes.get(name, 0) for name in ('position', 'velocity', 'effort')]
    message = JointState(name=names, **{name: [MARK] * n for name, n in sizes.items()})
    return Writer(message, of_fields[next(k for k, n in enumerate(of_fields) if n):])


def effort_writer(names: Sequence[str]) -> Writer:
    """Return a writer of `Float64MultiArray` messages, labelled with `names`."""
    labels = [MultiArrayDimension(label=name, size=1, stride=1) for name in names]
    return Writer(Float64MultiArray(
        layout=MultiArrayLayout(dim=labels), data=[MARK] * len(names)), [len(names)])


class TrajectoryMessage(NamedTuple):
    """
    Content of a `JointTrajectory`.

    Attributes
    ----------
    t : int
        Stamp [ns].
    names : tuple of str
        The joints.
    offsets : sequence of int
        Time from the stamp to each point [ns].
    rows : sequence of sequence of float
        Position, velocity and acceleration of the first point, then of the next ones.

    """

    t: int
    names: tuple[str, ...]
    offsets: Sequence[int]
    rows: Sequence[Sequence[float]]


def _doubles(data: bytes | bytearray) -> Array:
    """Return all doubles that may be in a message, aligned as CDR has them."""
    return np.frombuffer(data, float, (len(data) - _CDR_HEADER) // 8, _CDR_HEADER)


class TrajectoryFrame:
    """
    A serialized `JointTrajectory` whose stamp and numbers are replaced.

    Parameters
    ----------
    message : JointTrajectory
        Its joints and times, no efforts. The numbers of its points are lost.

    Attributes
    ----------
    size : int
        Length of the message in bytes.

    """

    def __init__(self, message: JointTrajectory) -> None:
        row = [MARK] * len(message.joint_names)
        for point in message.points:
            point.positions = point.velocities = point.accelerations = row
        data = serialize_message(message)
        self._indices = np.flatnonzero(_doubles(data) == MARK)
        # As in a `Writer`, rclpy leaves bytes behind the message.
        self.size = _CDR_HEADER + 8 * (int(self._indices[-1]) + 1) + _END_OF_POINT
        self._data = bytearray(data[:self.size])
        self._doubles = _doubles(self._data)

    def fill(self, t: int, numbers: Array) -> bytes:
        """Return the message with all numbers of its points, from `t` [ns] on."""
        _STAMP.pack_into(self._data, _CDR_HEADER, *divmod(t, NANOSECONDS))
        self._doubles[self._indices] = numbers
        return bytes(self._data)

    def take_bytes(self, data: bytes) -> bool:
        """
        Take the bytes of a received message, and return whether it has this layout.

        Bytes that only align others are its sender's. ROS does not set them.
        """
        if len(data) != self.size or data[:_CDR_HEADER] != self._data[:_CDR_HEADER]:
            return False
        self._data[:] = data
        return True

    def numbers(self, data: bytes) -> Array:
        """Return all numbers of the points in another message of this frame."""
        numbers: Array = _doubles(data)[self._indices]
        return numbers


class TrajectoryReader:
    """
    Reads `JointTrajectory` messages.

    ROS reads a message. The next one is of the same frame if it differs in stamp and numbers only,
    and then needs no ROS.
    """

    def __init__(self) -> None:
        self._frame: TrajectoryFrame | None = None
        self._last: TrajectoryMessage

    def __call__(self, data: bytes) -> TrajectoryMessage:
        """Return the content of a message, or raise `RuntimeError`."""
        frame = self._frame
        if frame is None or len(data) != frame.size:
            return self._read_by_ros(data)
        sec, nanosec = _STAMP.unpack_from(data, _CDR_HEADER)
        t = sec * NANOSECONDS + nanosec
        numbers = frame.numbers(data)
        if frame.fill(t, numbers) != data:
            return self._read_by_ros(data)
        rows = numbers.reshape(-1, len(self._last.names)).tolist()
        return self._last._replace(t=t, rows=rows)

    def _read_by_ros(self, data: bytes) -> TrajectoryMessage:
        """Return the content of a message, and remember its frame."""
        message = deserialize_message(data, JointTrajectory)
        rows = [row for point in message.points
                for row in (point.positions, point.velocities, point.accelerations)]
        content = self._last = TrajectoryMessage(
            nanoseconds(message.header.stamp), tuple(message.joint_names),
            [nanoseconds(point.time_from_start) for point in message.points], rows)
        n = len(content.names)
        has_frame = n and {len(row) for row in rows} == {n} and not any(
            len(point.effort) for point in message.points)
        frame = TrajectoryFrame(message) if has_frame else None
        self._frame = frame if frame is not None and frame.take_bytes(data) else None
        return content


class TrajectoryWriter:
    """
    Writes `JointTrajectory` messages of equal length.

    Parameters
    ----------
    names : sequence of str
        The joints.
    period, count : int
        Time from point to point [ns], and number of points.

    """

    def __init__(self, names: Sequence[str], period: int, count: int) -> None:
        message = JointTrajectory(joint_names=names)
        for k in range(count):
            sec, nanosec = divmod(k * period, NANOSECONDS)
            message.points.append(JointTrajectoryPoint(
                time_from_start=Duration(sec=sec, nanosec=nanosec)))
        self._frame = TrajectoryFrame(message)

    def write(self, t: int, points: Sequence[Point]) -> bytes:
        """Return the message with `points` from `t` [ns] on."""
        return self._frame.fill(t, np.array(points, float).reshape(-1))
