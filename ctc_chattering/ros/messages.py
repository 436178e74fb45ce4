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
import os
from pathlib import Path
import struct
from typing import Any, NamedTuple

from builtin_interfaces.msg import Duration, Time
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import NANOSECONDS, nanoseconds, seconds
import rclpy
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

#: Position, velocity and acceleration.
Point = tuple[Sequence[float], Sequence[float], Sequence[float]]
#: Latest time that is taken from a stamp, an hour before the last possible one [ns].
LATEST = (2 ** 31 - 3600) * NANOSECONDS
#: A number by which rows are found: what ROS appends to a message it does not say.
MARK = 1.234567890123456e-67
#: A stamp in CDR: seconds and nanoseconds.
_STAMP = struct.Struct('<iI')


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
    listed = Path('share/ament_index/resource_index/rosidl_interfaces', package)
    prefixes = [Path(rclpy.__file__).parents[4], *map(
        Path, filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)))]
    if not any(f'msg/{name}.idl' in (prefix / listed).read_text().split()
               for prefix in prefixes if (prefix / listed).is_file()):
        raise CtcError(f'{kind}: this message type is not installed')
    return getattr(importlib.import_module(f'{package}.msg'), name)


def stamp(t: int) -> Time:
    """Return a time [ns] as a message."""
    sec, nanosec = divmod(t, NANOSECONDS)
    return Time(sec=sec, nanosec=nanosec)


def read_stamp(data: bytes) -> int:
    """
    Return the time in a `Clock`, or in a header, at the beginning of a serialized message [ns].

    Raises
    ------
    CtcError
        If this is no time from 0 to `LATEST`.
    LookupError, struct.error
        If this is no message, or an incomplete one.

    """
    sec, nanosec = struct.unpack_from({0: '>iI', 1: '<iI'}[data[1]], data, 4)
    t: int = sec * NANOSECONDS + nanosec
    if not (0 <= t <= LATEST and nanosec < NANOSECONDS):
        raise CtcError(f'{sec} s and {nanosec} ns are no time; allowed: 0 s to '
                       f'{seconds(LATEST)} s')
    return t


class LoopMessage(NamedTuple):
    """A message of the control loop: stamp (0 for none) [ns], names, rows of numbers."""

    t: int
    names: tuple[str, ...]
    rows: Sequence[Sequence[float]]


def _row_struct(sizes: Sequence[int]) -> struct.Struct:
    """Return rows of doubles as CDR has them: after the first each has its count before it."""
    first, *others = sizes
    return struct.Struct(f'<{first}d' + ''.join(f'I4x{n}d' if n else 'I' for n in others))


class Reader:
    """
    Reads messages that end with rows of doubles.

    Plant and controller answer each other by them, and to have ROS convert each field by field
    takes more than a tenth of a control cycle. ROS reads a message; one that has the same frame,
    which is all but stamp and numbers, then differs from it in these only.

    Parameters
    ----------
    kind : type
        Message class.
    content : callable
        Returns what is read of a message.
    stamped : bool
        Whether a stamp is at the beginning.

    """

    def __init__(self, kind: Any, content: Callable[[Any], LoopMessage], stamped: bool) -> None:
        self._kind, self._content, self._begin = kind, content, 12 if stamped else 4
        self._frame, self._struct = b'', _row_struct([0])
        self._names: tuple[str, ...] = ()

    def __call__(self, data: bytes) -> LoopMessage:
        """Return the content of a serialized message; raise `RuntimeError` if it is malformed."""
        end = len(data) - self._struct.size
        n = len(self._names)
        if self._frame and data[self._begin:end] == self._frame:
            values = self._struct.unpack_from(data, end)
            if set(values[n::n + 1]) <= {n}:  # The counts between the rows.
                sec, nanosec = _STAMP.unpack_from(data, 4) if self._begin > 4 else (0, 0)
                return LoopMessage(sec * NANOSECONDS + nanosec, self._names, [
                    values[k:k + n] for k in range(0, len(values), n + 1)])
        message = deserialize_message(data, self._kind)
        found = self._content(message)
        n = len(found.names)
        self._frame, self._names = b'', found.names
        if n and {len(row) for row in found.rows} == {n} and data[1] == 1 and (
                len(serialize_message(message)) == len(data)):
            self._struct = _row_struct([n] * len(found.rows))
            self._frame = data[self._begin:len(data) - self._struct.size]
        return found


def state_reader() -> Reader:
    """Return what reads `JointState` messages: positions, velocities, efforts."""
    return Reader(JointState, lambda m: LoopMessage(
        nanoseconds(m.header.stamp), tuple(m.name), (m.position, m.velocity, m.effort)), True)


def effort_reader() -> Reader:
    """Return what reads `Float64MultiArray` messages and their labels, if there are some."""
    return Reader(Float64MultiArray, lambda m: LoopMessage(
        0, tuple([x.label for x in m.layout.dim]), (m.data,)), False)


class Writer:
    """
    Writes messages that end with rows of doubles: the numbers of one that ROS has serialized.

    Parameters
    ----------
    message : object
        Of ROS; its last fields are the rows, all numbers `MARK`. A stamp is at its beginning.
    sizes : sequence of int
        The numbers in each row, at least one in the first.

    """

    def __init__(self, message: Any, sizes: Sequence[int]) -> None:
        self._data, self._struct = bytearray(serialize_message(message)), _row_struct(sizes)
        self._begin = self._data.index(struct.pack('<d', MARK))
        # Where rows are empty, rclpy leaves bytes behind the message, which other readers refuse.
        del self._data[self._begin + self._struct.size:]

    def write(self, *rows: Sequence[float], t: int | None = None) -> bytes:
        """Return the message with `rows` of their sizes, and stamp `t` [ns] if it has one."""
        if t is not None:
            _STAMP.pack_into(self._data, 4, *divmod(t, NANOSECONDS))
        values = [*rows[0]]
        for row in rows[1:]:
            values += (len(row), *row)
        self._struct.pack_into(self._data, self._begin, *values)
        return bytes(self._data)


def state_writer(names: Sequence[str], **sizes: int) -> Writer:
    """
    Return what writes `JointState` messages with `names`.

    It takes the rows from the first field that `sizes` names on: position, velocity and effort,
    each with so many numbers, or none.
    """
    of_fields = [sizes.get(name, 0) for name in ('position', 'velocity', 'effort')]
    message = JointState(name=names, **{name: [MARK] * n for name, n in sizes.items()})
    return Writer(message, of_fields[next(k for k, n in enumerate(of_fields) if n):])


def effort_writer(names: Sequence[str]) -> Writer:
    """Return what writes `Float64MultiArray` messages, labelled with `names`."""
    labels = [MultiArrayDimension(label=name, size=1, stride=1) for name in names]
    return Writer(Float64MultiArray(
        layout=MultiArrayLayout(dim=labels), data=[MARK] * len(names)), [len(names)])


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
