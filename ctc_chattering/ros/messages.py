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
from itertools import zip_longest
import os
from pathlib import Path
import struct
from typing import Any, NamedTuple

from builtin_interfaces.msg import Duration, Time
from ctc_chattering.errors import CtcError
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
_MARK_BYTES = struct.pack('<d', MARK)
#: Bytes before the content of a message in CDR.
_CDR_HEADER = 4
#: CDR format of the count before a row.
_COUNT = 'I4x'
#: CDR format of what is behind a point of a `JointTrajectory`: count of efforts, and time.
_END_OF_POINT = '12s'
#: The same with the count of the next point's positions.
_NEXT_POINT = '16s'
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
        raise CtcError(f'{sec} s and {nanosec} ns are not a time; allowed: 0 s to '
                       f'{seconds(LATEST)} s')
    return t


class LoopMessage(NamedTuple):
    """
    Content of a message of the control loop.

    Attributes
    ----------
    t : int
        Stamp [ns].
    names : tuple of str
        The joints.
    rows : sequence of sequence of float
        Numbers of the joints. Those of a trajectory are position, velocity and acceleration of
        the first point, then of the next ones.
    offsets : sequence of int
        Time from the stamp to each point of a trajectory [ns].

    """

    t: int
    names: tuple[str, ...]
    rows: Sequence[Sequence[float]]
    offsets: Sequence[int] = ()


def _rows_format(sizes: Sequence[int], gaps: Sequence[str]) -> str:
    """Return the CDR format of rows, with the gaps between and behind them."""
    return ''.join(f'{n}d{gap}' for n, gap in zip_longest(sizes, gaps, fillvalue=''))


def _counts(sizes: Sequence[int]) -> list[str]:
    """Return the gaps between rows that end a message: the count of the next row."""
    return [_COUNT if n else 'I' for n in sizes[1:]]


def _trajectory_gaps(message: JointTrajectory) -> list[str] | None:
    """Return the CDR format of the bytes behind each row, or None where there are efforts."""
    if any(len(point.effort) for point in message.points):
        return None
    gaps = [_COUNT, _COUNT, _NEXT_POINT] * len(message.points)
    return [*gaps[:-1], _END_OF_POINT]


def _begin_of_rows(message: Any, rows: Sequence[Any]) -> int:
    """Return the number of bytes before the rows of a message, which are its own."""
    number, rows[0][0] = rows[0][0], MARK
    begin: int = serialize_message(message).index(_MARK_BYTES)
    rows[0][0] = number
    return begin


class Reader:
    """
    Reads messages with rows of doubles.

    ROS reads a message. The next one of the same frame, which is all but stamp and numbers, is
    unpacked at once.

    Parameters
    ----------
    message_class : type
        Message class.
    content : callable
        Returns the `LoopMessage` of a message of that class. Its rows are those of the message.
    gaps : callable
        Returns the CDR format of the bytes between the rows of a message, and behind the last.
        It returns None if the message has no frame.
    stamped : bool
        Whether a stamp is at the beginning.

    """

    def __init__(self, message_class: Any, content: Callable[[Any], LoopMessage],
                 gaps: Callable[[Any], Sequence[str] | None], stamped: bool = True) -> None:
        self._class, self._content, self._gaps = message_class, content, gaps
        self._stamp_format = 'iI' if stamped else ''
        #: Index of the first value that is no part of the stamp.
        self._begin = len(self._stamp_format)
        self._layout: struct.Struct | None = None
        self._names: tuple[str, ...] = ()
        self._offsets: Sequence[int] = ()
        #: Values before, between and behind the rows, and their indices.
        self._frame: tuple[object, ...] = ()
        self._frame_slice = slice(0)
        self._row_slices: list[slice] = []

    def __call__(self, data: bytes) -> LoopMessage:
        """Return the content of a message, or raise `RuntimeError`."""
        layout = self._layout
        if layout is not None and len(data) == layout.size:
            values = layout.unpack(data)
            if values[self._frame_slice] == self._frame:
                t = values[0] * NANOSECONDS + values[1] if self._begin else 0
                rows = list(map(values.__getitem__, self._row_slices))
                return LoopMessage(t, self._names, rows, self._offsets)
        return self._read_by_ros(data)

    def _read_by_ros(self, data: bytes) -> LoopMessage:
        """Return the content of a message, and remember its frame."""
        message = deserialize_message(data, self._class)
        _, self._names, rows, self._offsets = content = self._content(message)
        gaps, n = self._gaps(message), len(self._names)
        is_little_endian = data[1] == 1
        self._layout = None
        if n and gaps is not None and {len(row) for row in rows} == {n} and is_little_endian:
            head = f'<{_CDR_HEADER}x{self._stamp_format}'
            length = _begin_of_rows(message, rows) - struct.calcsize(head)
            layout = struct.Struct(f'{head}{length}s{_rows_format([n] * len(rows), gaps)}')
            if layout.size == len(data):
                self._remember_frame(layout, data, n)
        return content

    def _remember_frame(self, layout: struct.Struct, data: bytes, n: int) -> None:
        """Keep the frame of a message with rows of `n` numbers."""
        self._layout = layout
        values = layout.unpack(data)
        self._frame_slice = slice(self._begin, None, n + 1)
        self._frame = values[self._frame_slice]
        first = self._begin + 1
        self._row_slices = [slice(k, k + n) for k in range(first, len(values), n + 1)]


def state_reader() -> Reader:
    """Return a reader of `JointState` messages: positions, velocities, efforts."""
    return Reader(JointState, lambda m: LoopMessage(
        nanoseconds(m.header.stamp), tuple(m.name), (m.position, m.velocity, m.effort)),
        lambda _: [_COUNT, _COUNT])


def effort_reader() -> Reader:
    """Return a reader of `Float64MultiArray` messages with labels."""
    return Reader(Float64MultiArray, lambda m: LoopMessage(
        0, tuple([x.label for x in m.layout.dim]), (m.data,)), lambda _: [], stamped=False)


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
        self._layout = struct.Struct(f'<{_rows_format(sizes, _counts(sizes))}')
        self._begin = self._data.index(_MARK_BYTES)
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


def trajectory_reader() -> Reader:
    """Return a reader of `JointTrajectory` messages without their efforts."""
    return Reader(JointTrajectory, lambda m: LoopMessage(
        nanoseconds(m.header.stamp), tuple(m.joint_names),
        [row for point in m.points
         for row in (point.positions, point.velocities, point.accelerations)],
        [nanoseconds(point.time_from_start) for point in m.points]), _trajectory_gaps)


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
        row = [MARK] * len(names)
        message = JointTrajectory(joint_names=names)
        for k in range(count):
            sec, nanosec = divmod(k * period, NANOSECONDS)
            message.points.append(JointTrajectoryPoint(
                positions=row, velocities=row, accelerations=row,
                time_from_start=Duration(sec=sec, nanosec=nanosec)))
        self._data = bytearray(serialize_message(message))
        # As in a `Writer`, rclpy leaves bytes behind the message.
        end = self._data.rindex(_MARK_BYTES) + len(_MARK_BYTES) + struct.calcsize(_END_OF_POINT)
        del self._data[end:]
        self._doubles = np.frombuffer(
            self._data, float, (end - _CDR_HEADER) // 8, _CDR_HEADER)
        self._indices = np.flatnonzero(self._doubles == MARK)

    def write(self, t: int, points: Sequence[Point]) -> bytes:
        """Return the message with `points` from `t` [ns] on."""
        _STAMP.pack_into(self._data, _CDR_HEADER, *divmod(t, NANOSECONDS))
        self._doubles[self._indices] = np.array(points, float).reshape(-1)
        return bytes(self._data)
