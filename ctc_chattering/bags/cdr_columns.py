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
Numbers of serialized messages as columns, without an object for each message.

Messages of one layout (equal length, counts of sequences, lengths of strings, and names) are
stacked, and a field is a range of columns of the stack. Layouts follow from the definitions of the
types, so that any type with a definition can be read. Where there are sequences of structures,
their numbers, and their names, follow each other.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
import dataclasses
from typing import NamedTuple

from ctc_chattering.bags.definitions import Definitions, Field, NUMBERS
from ctc_chattering.errors import CtcError
import numpy as np
import numpy.typing as npt

#: Fields of strings that name joints, as messages call them.
NAMES = ('name', 'names', 'joint_names', 'dof_names', 'label')
#: Messages that are stacked at once.
_STACKED = 4096
#: Size of the encapsulation [bytes].
_BEGIN = 4
Floats = npt.NDArray[np.float64]


class Block(NamedTuple):
    """
    Messages of one layout.

    Attributes
    ----------
    place : ndarray of int, shape (N,)
        Their numbers among all messages.
    names : dict of str to tuple of str
        Names by field.
    numbers : dict of str to ndarray, shape (N, count)
        Numbers by field; without the fields that are not there.

    """

    place: npt.NDArray[np.intp]
    names: dict[str, tuple[str, ...]]
    numbers: dict[str, Floats]


@dataclasses.dataclass
class _CdrLayout:
    """Where a message has what: fields as (first byte, count, code), and bytes that are fixed."""

    names: dict[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    numbers: dict[str, list[tuple[int, int, str]]] = dataclasses.field(default_factory=dict)
    fixed: list[tuple[int, int]] = dataclasses.field(default_factory=list)


class _CdrParser:
    """Finds the layout of one message."""

    def __init__(self, data: bytes, definitions: Definitions) -> None:
        order = {b'\0\0': '>', b'\0\1': '<'}.get(data[:2])
        if order is None:
            raise CtcError('not CDR')
        self._data, self._definitions, self._order = data, definitions, order
        self._at = _BEGIN
        self.layout = _CdrLayout(fixed=[(0, _BEGIN)])

    def parse(self, kind: str, path: str = '') -> None:
        """Append the fields of a type."""
        for field in self._definitions[kind]:
            self._field(field, f'{path}.{field.name}' if path else field.name)

    def _field(self, field: Field, path: str) -> None:
        count = 1 if field.length is None else field.length or self._count()
        if field.is_base:
            self._base(field.kind, path, count)
        else:
            for _ in range(count):
                self.parse(field.kind, path)

    def _base(self, name: str, path: str, count: int) -> None:
        """Append `count` numbers or strings."""
        if name == 'string':
            for _ in range(count):
                self._string(path)
        elif count:
            code = self._order + NUMBERS[name]
            begin = self._take(np.dtype(code).itemsize, count)
            self.layout.numbers.setdefault(path, []).append((begin, count, code))

    def _string(self, path: str) -> None:
        length = self._count()
        begin = self._take(1, length)
        if path.rpartition('.')[2] in NAMES:
            self.layout.fixed.append((begin, begin + length))
            text = self._data[begin:begin + length].partition(b'\0')[0].decode(errors='replace')
            self.layout.names[path] = (*self.layout.names.get(path, ()), text)

    def _count(self) -> int:
        begin = self._take(4, 1)
        self.layout.fixed.append((begin, begin + 4))
        return int(np.frombuffer(self._data, f'{self._order}u4', 1, begin)[0])

    def _take(self, size: int, count: int) -> int:
        """Return where `count` values of a size begin, and go on behind them."""
        begin = self._at + (_BEGIN - self._at) % size
        self._at = begin + size * count
        if self._at > len(self._data):
            raise CtcError(f'the message is incomplete: {len(self._data)} of {self._at} bytes')
        return begin


def field_names(data: bytes, kind: str, definitions: Definitions) -> dict[str, int]:
    """Return the fields with numbers of a message, as far as it can be read, and their counts."""
    parser = _CdrParser(data, definitions)
    with suppress(KeyError, CtcError):
        parser.parse(kind)
    return {path: sum(count for _, count, _ in parts)
            for path, parts in parser.layout.numbers.items()}


def blocks(messages: Iterable[bytes], kind: str, definitions: Definitions,
           fields: Sequence[str]) -> Iterator[Block]:
    """
    Yield the numbers of messages; those that cannot be decoded are left out.

    Parameters
    ----------
    messages : iterable of bytes
        Serialized.
    kind : str
        Their type.
    definitions : mapping
        Fields by type.
    fields : sequence of str
        Fields wanted, with dots, as in ``header.stamp.sec``. What stands behind the first one need
        not be decodable.

    """
    waiting: dict[int, list[tuple[int, bytes]]] = {}
    for number, data in enumerate(messages):
        same = waiting.setdefault(len(data), [])
        same.append((number, data))
        if len(same) == _STACKED:
            yield from _decoded(waiting.pop(len(data)), kind, definitions, fields)
    for same in waiting.values():
        yield from _decoded(same, kind, definitions, fields)


def _decoded(same: list[tuple[int, bytes]], kind: str, definitions: Definitions,
             fields: Sequence[str]) -> Iterator[Block]:
    """Yield blocks of messages of one length."""
    place = np.array([number for number, _ in same])
    stack = np.frombuffer(b''.join(data for _, data in same), np.uint8).reshape(len(same), -1)
    while len(place):
        layout = _layout(stack[0].tobytes(), kind, definitions, fields)
        alike = np.ones(len(place), bool)
        if layout is None:
            alike[1:] = False
        else:
            at = np.concatenate([np.arange(*span) for span in layout.fixed])
            alike = (stack[:, at] == stack[0, at]).all(axis=1)
            mine = stack[alike]
            yield Block(place[alike], layout.names, {
                path: np.concatenate([
                    np.ascontiguousarray(mine[:, a:a + count * np.dtype(code).itemsize]
                                         ).view(code).astype(float)
                    for a, count, code in layout.numbers[path]], axis=1)
                for path in fields if path in layout.numbers})
        place, stack = place[~alike], stack[~alike]


def _layout(data: bytes, kind: str, definitions: Definitions, fields: Sequence[str]
            ) -> _CdrLayout | None:
    """Return the layout of a message; None if it cannot be read as far as the fields."""
    try:
        parser = _CdrParser(data, definitions)
    except CtcError:
        return None
    try:
        parser.parse(kind)
    except (KeyError, CtcError):
        return parser.layout if fields[0] in parser.layout.numbers else None
    return parser.layout
