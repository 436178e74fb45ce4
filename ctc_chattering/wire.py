"""
Fast passage between arrays and serialized messages whose names do not change.

Converting a message field by field between Python and C costs more than everything the controller
computes. A writer lays a message out once and afterwards replaces only the numbers in it.
A reader has ROS deserialize the first message and learns from it where the numbers stand; on every
later message it checks that all bytes between the numbers are those it has learned, and leaves any
other message to ROS. Nothing is judged here: lengths and values may be anything. Only a message
that counts more elements than it has bytes for never gets to ROS, which would print a line about
each one.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
import importlib
import struct
from typing import Any, NamedTuple

from builtin_interfaces.msg import Duration, Time
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from ctc_chattering.core.grid import NANOSECONDS
from ctc_chattering.errors import CtcError

#: Latest time that we take from a stamp, an hour before those of messages end [ns].
LATEST = (2 ** 31 - 3600) * NANOSECONDS
#: Encapsulation of little-endian CDR.
_LITTLE = b'\x00\x01\x00\x00'
#: Where a header's stamp stands, and the first byte behind it.
_STAMP, _BEHIND = 4, 12
_TIME = struct.Struct('<iI')
#: What a message consists of: so many bytes in words of four, a string, a sequence of doubles, or
#: a sequence of what the inner tuple says.
_HEADER = (8, 'string')
_LAYOUTS: dict[Any, tuple[Any, ...]] = {
    JointState: (*_HEADER, ('string',), 'doubles', 'doubles', 'doubles'),
    Float64MultiArray: (('string', 8), 4, 'doubles'),
    JointTrajectory: (
        *_HEADER, ('string',), ('doubles', 'doubles', 'doubles', 'doubles', 8))}
#: Messages of other layouts after which a reader leaves them all to ROS.
_PATIENCE = 1000


def message_type(kind: str) -> Any:
    """
    Return the message class called `kind`, for example ``std_msgs/msg/String``.

    Raises
    ------
    CtcError
        If there is none.

    """
    try:
        package, _, name = kind.split('/')
        return getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError, ValueError):
        raise CtcError(f'{kind}: this type of message is not installed') from None


def stamp(nanoseconds: int) -> Time:
    """Return `nanoseconds` as a message."""
    sec, nanosec = divmod(nanoseconds, NANOSECONDS)
    return Time(sec=sec, nanosec=nanosec)


def nanoseconds_of(time: Time | Duration) -> int:
    """Return a time message in nanoseconds."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


def read_clock(data: bytes) -> int:
    """Return the time that a serialized `Clock` says [ns]."""
    return nanoseconds_of(deserialize_message(data, Clock).clock)


def read_stamp(data: bytes) -> int | None:
    """Return the time [ns] at the beginning of a message, a header's or a `Clock`'s, if any."""
    if len(data) < _BEHIND:
        return None
    sec, nanosec = _TIME.unpack_from(data, _STAMP)
    t = int(sec * NANOSECONDS + nanosec)
    return t if 0 <= t <= LATEST and nanosec < NANOSECONDS else None


class State(NamedTuple):
    """A `JointState`: stamp [ns], joint names, and what it says of them."""

    t: int
    names: tuple[str, ...]
    position: Sequence[float]
    velocity: Sequence[float]
    effort: Sequence[float]


class Efforts(NamedTuple):
    """A `Float64MultiArray` of torques: labels of its layout (none, maybe) and values."""

    names: tuple[str, ...]
    values: Sequence[float]


#: Position, velocity and acceleration.
Point = tuple[Sequence[float], Sequence[float], Sequence[float]]


class Piece(NamedTuple):
    """A `JointTrajectory`: joint names, instants [ns], and (position, velocity, acceleration)."""

    names: tuple[str, ...]
    times: list[int]
    points: list[Point]
    #: Stamp of the message; 0 for now [ns].
    start: int = 0


def _deserialize(data: bytes, kind: Any) -> Any:
    """Have ROS read a message, unless a sequence in it cannot be as long as it says."""
    order = {b'\0\0': '>I', b'\0\1': '<I'}.get(bytes(data[:2]))
    if order is None:
        raise RuntimeError('failed to deserialize: the encapsulation is not CDR')
    with suppress(struct.error):  # It ends too early; ROS says so.
        _walk(data, struct.Struct(order), _LAYOUTS[kind], _STAMP)
    return deserialize_message(data, kind)


def _walk(data: bytes, word: struct.Struct, layout: tuple[Any, ...], at: int) -> int:
    """Return where what begins at byte `at` ends."""
    for part in layout:
        at += -at % 4
        if isinstance(part, int):
            at += part
            continue
        count, = word.unpack_from(data, at)
        at += 4
        if part == 'string':
            at += count
        elif count > len(data) - at:
            raise RuntimeError(
                f'failed to deserialize: {count} elements in {len(data) - at} bytes')
        elif part != 'doubles':
            for _ in range(count):
                at = _walk(data, word, part, at)
        elif count:
            at += (_STAMP - at) % 8 + 8 * count
    return at


class _Writer:
    """Serializes messages that differ only in rows of `n` numbers: CDR, little-endian."""

    def __init__(self, n: int) -> None:
        self._n = n
        self._buffer = bytearray(_LITTLE)
        self._offsets: list[int] = []
        self._pack = struct.Struct(f'<{n}d').pack_into

    def _word(self, value: int) -> None:
        self._align(4)
        self._buffer += struct.pack('<I', value)

    def _string(self, text: str) -> None:
        data = text.encode() + b'\0'
        self._word(len(data))
        self._buffer += data

    def _header(self, names: Sequence[str]) -> None:
        """Append a header, its stamp to be filled in later, and the names."""
        self._stamp = _TIME.pack_into
        self._buffer += bytes(8)
        self._string('')
        self._word(len(names))
        for name in names:
            self._string(name)

    def _row(self, present: bool) -> None:
        """Append a sequence of `n` numbers, to be filled in later, or an empty one."""
        self._word(self._n if present else 0)
        if present:
            self._align(8)
            self._offsets.append(len(self._buffer))
            self._buffer += bytes(8 * self._n)

    def _align(self, size: int) -> None:
        self._buffer += bytes(-(len(self._buffer) - len(_LITTLE)) % size)

    def _fill(self, rows: Sequence[Sequence[float]]) -> bytes:
        for offset, row in zip(self._offsets, rows):
            self._pack(self._buffer, offset, *row)
        return bytes(self._buffer)


class StateWriter(_Writer):
    """
    Serializes `JointState` messages.

    Parameters
    ----------
    names : sequence of str
        Names in every message.
    fields : tuple of str
        The arrays it has, of position, velocity and effort.

    """

    def __init__(self, names: Sequence[str],
                 fields: Sequence[str] = ('position', 'velocity', 'effort')) -> None:
        super().__init__(len(names))
        self._header(names)
        for field in ('position', 'velocity', 'effort'):
            self._row(field in fields)

    def write(self, t: int, *rows: Sequence[float]) -> bytes:
        """Return the message with stamp `t` [ns] and `rows`, each of shape (n,)."""
        self._stamp(self._buffer, _STAMP, *divmod(t, NANOSECONDS))
        return self._fill(rows)


class EffortWriter(_Writer):
    """
    Serializes `Float64MultiArray` messages with the joint names as labels of the layout.

    Parameters
    ----------
    names : sequence of str
        Joint names.

    """

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(len(names))
        self._word(len(names))
        for name in names:  # A dimension each: label, size, stride.
            self._string(name)
            self._word(1)
            self._word(1)
        self._word(0)
        self._row(True)

    def write(self, values: Sequence[float]) -> bytes:
        """Return the message with `values`, shape (n,)."""
        return self._fill((values,))


class TrajectoryWriter(_Writer):
    """
    Serializes `JointTrajectory` messages with position, velocity and acceleration.

    Parameters
    ----------
    names : sequence of str
        Joint names.
    count : int
        Number of points.
    period : int
        Time from one point to the next [ns].

    """

    def __init__(self, names: Sequence[str], count: int, period: int) -> None:
        super().__init__(len(names))
        self._header(names)
        self._word(count)
        for k in range(count):
            for present in (True, True, True, False):  # Position to acceleration, effort.
                self._row(present)
            for word in divmod(k * period, NANOSECONDS):
                self._word(word)

    def write(self, t: int, points: Sequence[Point]) -> bytes:
        """Return the message whose first point is at `t` [ns]."""
        self._stamp(self._buffer, _STAMP, *divmod(t, NANOSECONDS))
        return self._fill([row for point in points for row in point])


class _Reader:
    """Remembers how often a message was not of the layout learned."""

    def __init__(self) -> None:
        self._misses = 0

    def _worth_learning(self, data: bytes, message: Any) -> bool:
        """
        Return whether the layout of `data` should be learned.

        Not of a big-endian message, nor of one with bytes behind its end; and not again and
        again where the sender leaves different bytes in the gaps each time.
        """
        self._misses += 1
        return (self._misses <= _PATIENCE and data[:_STAMP] == _LITTLE
                and not _says(data[:-1], message))


def _says(data: bytes, message: Any) -> bool:
    """Return whether ROS reads `message` from `data`."""
    try:
        return bool(_deserialize(data, type(message)) == message)
    except RuntimeError:
        return False


class StateReader(_Reader):
    """Deserializes `JointState` messages."""

    def __init__(self) -> None:
        super().__init__()
        self._length = -1

    def read(self, data: bytes) -> State:
        """Return what a serialized message says."""
        if len(data) == self._length and data[:_STAMP] == _LITTLE:
            x = self._layout.unpack_from(data, _STAMP)
            n = self._n
            if x[2] == self._frame and x[3 + n] == n == x[4 + 2 * n]:
                return State(x[0] * NANOSECONDS + x[1], self._names,
                             x[3:3 + n], x[4 + n:4 + 2 * n], x[5 + 2 * n:])
        return self._learn(data)

    def _learn(self, data: bytes) -> State:
        message = _deserialize(data, JointState)
        state = State(nanoseconds_of(message.header.stamp), tuple(message.name),
                      tuple(message.position), tuple(message.velocity), tuple(message.effort))
        self._length = -1
        n = len(state.position)
        if (n and n == len(state.velocity) == len(state.effort)
                and self._worth_learning(data, message)):
            frame = len(data) - 24 * n - 16 - _BEHIND
            layout = struct.Struct(f'<iI{frame}s{n}dI4x{n}dI4x{n}d')
            x = layout.unpack_from(data, _STAMP)
            if (x[3:3 + n], x[4 + n:4 + 2 * n], x[5 + 2 * n:]) == state[2:]:
                self._length, self._layout, self._n = len(data), layout, n
                self._names, self._frame = state.names, x[2]
        return state


class EffortReader(_Reader):
    """Deserializes `Float64MultiArray` messages."""

    def __init__(self) -> None:
        super().__init__()
        self._length = -1
        self._frame = b''
        self._names: tuple[str, ...] = ()
        self._unpack = struct.Struct('').unpack_from

    def read(self, data: bytes) -> Efforts:
        """Return what a serialized message says."""
        if len(data) == self._length and data.startswith(self._frame):
            return Efforts(self._names, self._unpack(data, len(self._frame)))
        message = _deserialize(data, Float64MultiArray)
        efforts = Efforts(tuple(x.label for x in message.layout.dim), tuple(message.data))
        n = len(efforts.values)
        unpack = struct.Struct(f'<{n}d').unpack_from
        self._length = -1
        if (n and self._worth_learning(data, message)
                and unpack(data, len(data) - 8 * n) == efforts.values):
            self._length, self._unpack = len(data), unpack
            self._frame, self._names = data[:len(data) - 8 * n], efforts.names
        return efforts


class TrajectoryReader:
    """Deserializes `JointTrajectory` messages."""

    def __init__(self) -> None:
        self._start = -1
        self._frame = b''

    def read(self, data: bytes) -> Piece:
        """
        Return what a serialized message says.

        Missing velocities and accelerations are empty rows.
        """
        start = self._start
        if (0 <= start <= len(data) and data[:_STAMP] == _LITTLE
                and data[_BEHIND:start - 4] == self._frame):
            sec, nanosec = _TIME.unpack_from(data, _STAMP)
            piece = self._points(data, start, sec * NANOSECONDS + nanosec)
            if piece is not None:
                return piece
        return self._learn(data)

    def _points(self, data: bytes, start: int, t: int) -> Piece | None:
        """Return the piece from `t` [ns] on whose points begin at byte `start`; None if unlike."""
        n, size = self._n, self._point.size
        body = data[start:]
        if start % 8 == 4:  # The doubles of the first point, only, want padding before them.
            body = body[:4] + body[8:]
        end = int.from_bytes(data[start - 4:start], 'little') * size
        if len(body) < end:
            return None
        times: list[int] = []
        points: list[Point] = []
        for x in self._point.iter_unpack(body[:end]):
            if not x[0] == x[n + 1] == x[2 * n + 2] == n or x[-3]:
                return None
            points.append((x[1:n + 1], x[n + 2:2 * n + 2], x[2 * n + 3:3 * n + 3]))
            times.append(t + x[-2] * NANOSECONDS + x[-1])
        return Piece(self._names, times, points, t)

    def _learn(self, data: bytes) -> Piece:
        message = _deserialize(data, JointTrajectory)
        start = nanoseconds_of(message.header.stamp)
        piece = Piece(
            tuple(message.joint_names),
            [start + nanoseconds_of(p.time_from_start) for p in message.points],
            [(tuple(p.positions), tuple(p.velocities), tuple(p.accelerations))
             for p in message.points], start)
        self._start = -1
        n = len(piece.names)
        if n and piece.points and data[:_STAMP] == _LITTLE:
            self._n, self._names = n, piece.names
            self._point = struct.Struct(f'<I{n}dI4x{n}dI4x{n}dIiI')
            count = len(piece.points).to_bytes(4, 'little')
            for first in range(_BEHIND, len(data), 4):
                if data[first - 4:first] == count and self._points(data, first, start) == piece:
                    self._start, self._frame = first, data[_BEHIND:first - 4]
                    break
        return piece
