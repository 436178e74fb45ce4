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
Read joint values of a topic into arrays.

A `SignalTopic` reads the numbers in some fields of each message. Joint names beside the first
field, or beside a field that contains it, say which column belongs to which joint. For `data` of
an array they are the labels of its dimensions. `bags/reader.py` reads runs with it, and
`identification/bag_motion.py` reads recordings of any robot.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
import dataclasses
from functools import cache
from itertools import islice
from operator import attrgetter
from typing import Any, NamedTuple

from ctc_chattering.bags.bag import Bag
from ctc_chattering.errors import CtcError, suggest
from ctc_chattering.numerics.linear_algebra import Array, Flags, Indices
from ctc_chattering.numerics.time_grid import NANOSECONDS, nanoseconds
import numpy as np
from numpy.lib.stride_tricks import as_strided
import numpy.typing as npt
from rosbags.interfaces import Connection

JOINT_STATE = 'sensor_msgs/msg/JointState'
MULTI_ARRAY = 'std_msgs/msg/Float64MultiArray'
#: Times [ns].
Instants = npt.NDArray[np.int64]
#: Log time [ns] and data.
_Serialized = tuple[int, bytes]
#: Messages that are read at once, which limits the memory.
_BLOCK_MESSAGES = 10_000
#: Bytes of the stamp in a message that begins with a header.
_STAMP = slice(4, 12)
_STAMP_TYPE = np.dtype([('sec', '<i4'), ('nanosec', '<u4')])
#: Fields in which messages have joint names.
_NAME_FIELDS = ('name', 'names', 'joint_names', 'dof_names')


class Signal(NamedTuple):
    """
    Values of a topic, of N messages and n joints.

    Attributes
    ----------
    logged : ndarray of int, shape (N,)
        Log times [ns].
    stamps : ndarray of int, shape (N,)
        Stamps of the headers [ns], 0 for messages without a header.
    values : tuple of ndarray, shape (N, n)
        An array for each field. A row is nan if the field is absent or has another length.

    """

    logged: Instants
    stamps: Instants
    values: tuple[Array, ...]

    def select(self, rows: Indices | Flags) -> Signal:
        """Return the signal with some of its messages."""
        values = tuple(x[rows] for x in self.values)
        return Signal(self.logged[rows], self.stamps[rows], values)

    def select_finite(self) -> Signal:
        """Return the messages in which all values are finite."""
        values = np.hstack(self.values)
        is_finite = np.asarray(np.isfinite(values).all(axis=1))
        return self.select(is_finite)


class SignalLayout(NamedTuple):
    """Joint names, if any, and number of values."""

    joints: tuple[str, ...]
    width: int


class SignalTopic(NamedTuple):
    """
    Topic of one type in an open bag.

    Attributes
    ----------
    bag : Bag
    name, message_type : str
    fields : tuple of str
        Fields to read, as ``a.b.c``. Messages without the first one are left out.
    connections : tuple of Connection
        The topic in each file of the bag.

    """

    bag: Bag
    name: str
    message_type: str
    fields: tuple[str, ...]
    connections: tuple[Connection, ...]

    def __str__(self) -> str:
        """Return name, type and number of messages."""
        count = sum(x.msgcount for x in self.connections)
        return f'{self.name} ({self.message_type}, {count} messages)'

    def read_layout(self) -> SignalLayout:
        """
        Return the layout of the first message.

        Raises
        ------
        CtcError
            If the first field has no numbers.

        """
        field = self.fields[0]
        message = next((x for _, x in self.bag.read(self.connections)), None)
        values = _numbers(message, field)
        if values is None:
            fields = [x.name for x in dataclasses.fields(message)] if message else []
            raise CtcError(f'{self.bag.path}: {self.name} has no numbers in {field}; it has: '
                           f'{", ".join(fields)}{suggest(field, fields)}')
        return SignalLayout(_joint_names(message, field), len(values))

    def read(self, joints: tuple[str, ...]) -> Signal:
        """
        Return the values of some joints.

        Messages that lack one of them, or have any name twice, are left out.
        """
        signal, = read_signals(self.bag, [(self, joints)])
        return signal

    def read_block(self, block: Sequence[_Serialized], joints: tuple[str, ...]) -> Signal:
        """Return the values of some joints in some messages."""
        alike = self._read_alike(block, joints) if block else None
        return alike or self._read_each(block, joints)

    def _read_alike(self, block: Sequence[_Serialized], joints: tuple[str, ...]) -> Signal | None:
        """
        Return messages that differ only in stamp and numbers, else None.

        Decoded numbers are views of the data. So those of all messages lie at equal distances.
        """
        times, contents = zip(*block)
        size = len(contents[0])
        if any(len(x) != size for x in contents):
            return None
        joined = bytearray().join(contents)
        rows = np.frombuffer(joined, np.uint8).reshape(-1, size)
        message = self.bag.decode(memoryview(rows[0]), self.message_type)
        fields = list(getattr(message, '__dataclass_fields__', ()))
        numbers = _find_numbers(message, (*self.fields, *fields), rows)
        names = _joint_names(message, self.fields[0]) or joints
        indices = _find_columns(names, joints)
        has_all = all(x in numbers and numbers[x].shape[1] == len(names) for x in self.fields)
        if not len(indices) or not has_all or 'header' in fields[1:]:
            return None
        values = tuple(numbers[x][:, indices] for x in self.fields)
        stamps = np.zeros(len(rows), np.int64)
        if fields[:1] == ['header']:
            if not self._begins_with_stamp(rows[0]):
                return None
            stamps = _stamps(rows)
            rows[:, _STAMP] = 0
        for views in numbers.values():
            views[...] = 0.0
        if (rows != rows[0]).any():
            return None
        return Signal(np.array(times), stamps, values)

    def _begins_with_stamp(self, row: npt.NDArray[np.uint8]) -> bool:
        """
        Return whether the stamp is in front, as in ROS 2 Jazzy.

        Bags may define other headers.
        """
        probe = row.copy()
        probe[_STAMP] = range(8)
        message = self.bag.decode(memoryview(probe), self.message_type)
        stamp = _value(message, 'header.stamp')
        return bool(stamp) and nanoseconds(stamp) == _stamps(probe[np.newaxis])[0]

    def _read_each(self, block: Sequence[_Serialized], joints: tuple[str, ...]) -> Signal:
        """Return the values of some joints, message by message."""
        logged, stamps = array('q'), array('q')
        buffers = [array('d') for _ in self.fields]
        nan_row = [np.nan] * len(joints)
        for t, data in block:
            message = self.bag.decode(data, self.message_type)
            names = _joint_names(message, self.fields[0]) or joints
            indices = _find_columns(names, joints)
            rows = [_numbers(message, field) for field in self.fields]
            if rows[0] is None or not len(indices):
                continue
            for buffer, row in zip(buffers, rows):
                if row is None or len(row) != len(names):
                    buffer.extend(nan_row)
                else:
                    buffer.frombytes(row[indices].tobytes())
            stamp = _value(message, 'header.stamp')
            stamps.append(nanoseconds(stamp) if stamp else 0)
            logged.append(t)
        values = tuple(np.frombuffer(x).reshape(-1, len(joints)) for x in buffers)
        return Signal(np.array(logged), np.array(stamps), values)


def read_signals(
        bag: Bag,
        requests: Sequence[tuple[SignalTopic, tuple[str, ...]]]) -> list[Signal]:
    """
    Return the values of some joints on each of several topics.

    The bag is read once, as each pass unpacks all of it. `SignalTopic.read` says which messages
    are left out.
    """
    readable: list[Connection] = []
    indices: dict[tuple[str, str], int] = {}
    for index, (topic, _) in enumerate(requests):
        for x in bag.select_readable(topic.connections):
            readable.append(x)
            indices[x.topic, x.msgtype] = index
    # Without any block there are arrays of no rows.
    blocks = [[topic.read_block([], joints)] for topic, joints in requests]
    messages = bag.messages(readable) if readable else iter(())
    while block := list(islice(messages, _BLOCK_MESSAGES)):
        by_request: list[list[_Serialized]] = [[] for _ in requests]
        for x, t, data in block:
            by_request[indices[x.topic, x.msgtype]].append((t, data))
        for signals, (topic, joints), own in zip(blocks, requests, by_request):
            signals.append(topic.read_block(own, joints))
    return [_join(signals) for signals in blocks]


def _join(signals: Sequence[Signal]) -> Signal:
    """Return the messages of several signals, one after the other."""
    logged, stamps, values = zip(*signals)
    return Signal(
        np.concatenate(logged),
        np.concatenate(stamps),
        tuple(np.concatenate(x) for x in zip(*values)))


def _stamps(rows: npt.NDArray[np.uint8]) -> Instants:
    """Return the stamps in messages that begin with one [ns]."""
    stamp = rows[:, _STAMP].copy().view(_STAMP_TYPE)[:, 0]
    stamps: Instants = NANOSECONDS * stamp['sec'].astype(np.int64) + stamp['nanosec']
    return stamps


def _find_numbers(message: Any, fields: Sequence[str], rows: npt.NDArray[np.uint8]
                  ) -> dict[str, Array]:
    """
    Return views of the numbers in messages alike, by field.

    Parameters
    ----------
    message : object
        The first message, decoded from the first row.
    fields : sequence of str
        Fields to look at. Those without such numbers are left out.
    rows : ndarray, shape (N, L)
        Data of the messages.

    """
    numbers = {}
    for field in fields:
        value = _value(message, field)
        is_double = getattr(value, 'dtype', None) == np.float64
        if is_double and np.may_share_memory(value, rows):
            numbers[field] = as_strided(
                value,
                (len(rows), len(value)),
                (rows.shape[1], value.itemsize))
    return numbers


@cache
def _find_columns(names: tuple[str, ...], joints: tuple[str, ...]) -> Indices:
    """Return the columns of joints, empty if one lacks or any name repeats."""
    distinct = set(names)
    is_complete = distinct.issuperset(joints) and len(distinct) == len(names)
    indices = [names.index(x) for x in joints] if is_complete else []
    return np.array(indices, int)


_getter = cache(attrgetter)


def _value(message: Any, path: str) -> Any:
    """Return the content of a field, or None."""
    try:
        return _getter(path)(message)
    except AttributeError:
        return None


def _numbers(message: Any, field: str) -> Array | None:
    """Return the numbers in a field, None if there are none."""
    value = _value(message, field)
    if value is None:
        return None
    try:
        numbers = np.asarray(value, float).reshape(-1)
    except (TypeError, ValueError):
        return None
    return numbers if numbers.size else None


def _joint_names(message: Any, field: str) -> tuple[str, ...]:
    """Return the joint names that belong to a field."""
    if field == 'data':  # Of a Float64MultiArray.
        return tuple(x.label for x in _value(message, 'layout.dim') or ())
    while field:  # Look beside the field, then beside each field that contains it.
        field, dot, _ = field.rpartition('.')
        for name in _NAME_FIELDS:
            names = _value(message, f'{field}{dot}{name}')
            if names:
                return (names,) if isinstance(names, str) else tuple(names)
    return ()
