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
Messages of a topic as columns of numbers, many at once.

Messages that the same publisher sends differ in stamps and numbers only. Where these stand is
found once: a message is written again with numbers of which each is another one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
import dataclasses
from itertools import count, islice
import struct
from typing import Any, NamedTuple, Protocol

from ctc_chattering.bags.bag import Bag, is_cdr
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
import numpy as np
import numpy.typing as npt
from rosbags.typesys import get_typestore, Stores

#: Messages that are read at once, for the memory that they take.
_BLOCK = 50_000
#: Bytes of a message that begins with a stamp: seconds.
_SECONDS = slice(4, 8)
#: Nanoseconds.
_NANOSECONDS = slice(8, 12)
_TYPES = get_typestore(Stores.ROS2_JAZZY)


class MessageLayout(NamedTuple):
    """
    Positions of the numbers in messages that differ in stamp and numbers only.

    Attributes
    ----------
    frame : ndarray of uint8, shape (L,)
        Such a message.
    is_fixed : ndarray of bool, shape (L,)
        Which bytes all of them have in common.
    byte_indices : ndarray of int, shape (..., 8)
        Of the bytes of each number that is read.

    """

    frame: npt.NDArray[np.uint8]
    is_fixed: npt.NDArray[np.bool_]
    byte_indices: npt.NDArray[np.intp]

    @classmethod
    def of_message(cls, data: bytes, message: Any, numbers: Callable[[Any], Any]
                   ) -> MessageLayout | None:
        """
        Return the layout of a message; None if it is not written as `rosbags` writes it.

        Parameters
        ----------
        data : bytes
            As it is in the bag.
        message : object
            Deserialized.
        numbers : callable
            Returns the numbers that are read of a message, nested lists of one shape.

        """
        marks = count(1)
        marked = _marked(message, marks)
        again = bytes(_TYPES.serialize_cdr(marked, message.__msgtype__))
        if len(again) != len(data):
            return None
        frame, is_fixed = np.frombuffer(data, np.uint8), np.ones(len(data), bool)
        starts = {}
        for k in range(1, next(marks)):
            starts[_mark(k)] = start = again.index(struct.pack('<d', _mark(k)))
            is_fixed[start:start + 8] = False
        if hasattr(message, 'header'):
            is_fixed[_SECONDS] = is_fixed[_NANOSECONDS] = False
        # Between fields, for their alignment, there may be any bytes.
        is_fixed &= frame == np.frombuffer(again, np.uint8)
        first = np.vectorize(starts.__getitem__, [int])(np.array(numbers(marked), float))
        layout = cls(frame, is_fixed, first[..., np.newaxis] + np.arange(8))
        columns = layout.read([data])
        is_read = columns is not None and (
            columns.values.tobytes() == np.array(numbers(message), float).tobytes())
        return layout if is_read else None

    def read(self, messages: Sequence[bytes]) -> Columns | None:
        """Return messages as columns, without log times; None if one has another layout."""
        if any(len(data) != len(self.frame) for data in messages):
            return None
        rows = np.frombuffer(b''.join(messages), np.uint8).reshape(len(messages), -1)
        if not (rows[:, self.is_fixed] == self.frame[self.is_fixed]).all():
            return None
        stamps = np.zeros(len(rows), np.int64)
        if not self.is_fixed[_SECONDS].any():
            sec = rows[:, _SECONDS].copy().view('<i4')[:, 0].astype(np.int64)
            nanosec = rows[:, _NANOSECONDS].copy().view('<u4')[:, 0]
            stamps = sec * NANOSECONDS + nanosec
        return Columns(np.zeros_like(stamps), stamps,
                       np.take(rows, self.byte_indices, axis=1).view('<f8')[..., 0])


class Columns(NamedTuple):
    """Messages of one layout: log times and stamps [ns], shape (N,), and numbers, (N, ...)."""

    logged: npt.NDArray[np.int64]
    stamps: npt.NDArray[np.int64]
    values: Array


class Sink(Protocol):
    """Receiver of the messages of a topic, of one type, in the order of the bag."""

    name: str
    message_type: str

    def take(self, bag: Bag, t: int, data: bytes) -> None:
        """Take a message with its log time [ns]."""


def read_topics(bag: Bag, sinks: Sequence[Sink]) -> None:
    """Read the messages of several topics in one pass, which takes as long as for one of them."""
    wanted = {(x.topic, x.msgtype): sink for sink in sinks for x in bag.named(sink.name)
              if x.msgtype == sink.message_type and is_cdr(x)}
    connections = [x for x in bag.connections
                   if (x.topic, x.msgtype) in wanted and is_cdr(x)]
    for connection, t, data in bag.messages(connections) if connections else ():
        wanted[connection.topic, connection.msgtype].take(bag, t, data)


class ColumnSink:
    """
    Takes messages as columns, as long as they have one layout.

    Parameters
    ----------
    name, message_type : str
        Topic, as `Bag.named` takes it, and message type.
    numbers : callable
        As of `MessageLayout.of_message`. Where it raises an error, there are no columns.

    """

    def __init__(self, name: str, message_type: str, numbers: Callable[[Any], Any]) -> None:
        self.name, self.message_type, self._numbers = name, message_type, numbers
        self._layout: MessageLayout | None = None
        self._parts: list[Columns] = []
        self._logged: list[int] = []
        self._messages: list[bytes] = []
        self._has_one_layout = True

    def take(self, bag: Bag, t: int, data: bytes) -> None:
        """Take a message with its log time [ns]."""
        if self._layout is None and self._has_one_layout:
            self._layout = self._layout_of(bag, data)
            self._has_one_layout = self._layout is not None
        if self._has_one_layout:
            self._logged.append(t)
            self._messages.append(data)
            if len(self._messages) == _BLOCK:
                self._flush()

    def columns(self) -> Columns | None:
        """Return what was taken; None if messages have several layouts, or there are none."""
        self._flush()
        if not self._has_one_layout or not self._parts:
            return None
        return Columns(*map(np.concatenate, zip(*self._parts)))

    def _layout_of(self, bag: Bag, data: bytes) -> MessageLayout | None:
        try:
            message = bag.deserialize(data, self.message_type)
            return MessageLayout.of_message(data, message, self._numbers)
        except Exception:  # Of arbitrary bytes, decoders raise arbitrary exceptions.
            return None

    def _flush(self) -> None:
        if self._messages and self._layout is not None:
            columns = self._layout.read(self._messages)
            self._has_one_layout = self._has_one_layout and columns is not None
            if columns is not None:
                self._parts.append(columns._replace(logged=np.array(self._logged, np.int64)))
        self._messages, self._logged = [], []


def joint_values(fields: Sequence[str], joints: Sequence[str]) -> Callable[[Any], list[Array]]:
    """Return what reads our joints' values in some fields of a JointState or Float64MultiArray."""
    def numbers(message: Any) -> list[Array]:
        names = ([x.label for x in message.layout.dim] if hasattr(message, 'layout')
                 else list(message.name)) or list(joints)
        rows = [getattr(message, field) for field in fields]
        if len(set(names)) < len(names) or {len(row) for row in rows} != {len(names)}:
            raise ValueError(f'{names} and their values do not belong together')
        picked = [names.index(joint) for joint in joints]
        return [row[picked] for row in rows]
    return numbers


def _mark(k: int) -> float:
    """Return a number that no message has."""
    return (1.0 + k) * 1.234567890123456e-67


def _marked(value: Any, marks: Iterable[int]) -> Any:
    """Return a message, or a part of it, in which each number of its arrays is another mark."""
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return np.array([_mark(k) for k in islice(marks, len(value))])
    if isinstance(value, list):
        return [_marked(x, marks) for x in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return dataclasses.replace(value, **{
            field.name: _marked(getattr(value, field.name), marks)
            for field in dataclasses.fields(value)})
    return value
