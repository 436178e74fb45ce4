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

"""Serialized messages as objects, by the definitions of their types."""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import Any

from ctc_chattering.bags.definitions import Definitions, Field, NUMBERS
from ctc_chattering.errors import CtcError
import numpy as np

_DTYPES = {order: {name: np.dtype(order + code) for name, code in NUMBERS.items()}
           for order in '<>'}
_CODES = {'u1': 'B', 'i1': 'b', 'u2': 'H', 'i2': 'h', 'u4': 'I', 'i4': 'i', 'u8': 'Q', 'i8': 'q',
          'f4': 'f', 'f8': 'd'}
_STRUCTS = {order: {name: struct.Struct(order + ('?' if name == 'bool' else _CODES[code]))
                    for name, code in NUMBERS.items()} for order in '<>'}
_BEGIN = 4


def decoded(data: bytes, kind: str, definitions: Definitions) -> Any:
    """
    Return a message: numbers, texts, arrays of numbers, and lists of all else, by name.

    Raises
    ------
    CtcError
        If it is no CDR.
    KeyError, ValueError, struct.error
        If a type is not known, or bytes are missing.

    """
    order = {b'\0\0': '>', b'\0\1': '<'}.get(bytes(data[:2]))
    if order is None:
        raise CtcError('not CDR')
    return _Message(data, order, definitions).read(kind)


class _Message:
    """A message that is read from its beginning to its end."""

    def __init__(self, data: bytes, order: str, definitions: Definitions) -> None:
        self._data, self._definitions, self._at = data, definitions, _BEGIN
        self._dtypes, self._structs = _DTYPES[order], _STRUCTS[order]

    def read(self, kind: str) -> Any:
        """Return what stands here, of a type that has fields."""
        found = SimpleNamespace()
        for field in self._definitions[kind]:
            setattr(found, field.name, self._field(field))
        return found

    def _field(self, field: Field) -> Any:
        kind, count = field.kind, field.length
        if count is None:
            return self._number(kind) if kind in NUMBERS else self._other(field)
        count = count or self._number('uint32')
        if kind not in NUMBERS:
            return [self._other(field) for _ in range(count)]
        dtype = self._dtypes[kind]
        if not count:
            return np.empty(0, dtype)
        begin = self._aligned(dtype.itemsize)
        self._at = begin + count * dtype.itemsize
        return np.frombuffer(self._data, dtype, count, begin)

    def _other(self, field: Field) -> Any:
        return self._text(field.kind) if field.is_base else self.read(field.kind)

    def _number(self, kind: str) -> Any:
        number = self._structs[kind]
        begin = self._aligned(number.size)
        self._at = begin + number.size
        return number.unpack_from(self._data, begin)[0]

    def _text(self, kind: str) -> str:
        if kind != 'string':
            raise KeyError(kind)
        length = self._number('uint32')
        begin, self._at = self._at, self._at + length
        if self._at > len(self._data):
            raise ValueError('a text is incomplete')
        return bytes(self._data[begin:self._at]).rstrip(b'\0').decode()

    def _aligned(self, size: int) -> int:
        """Return where a number of a size begins."""
        return self._at + (_BEGIN - self._at) % size
