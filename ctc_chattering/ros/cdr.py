"""
Serialized messages as CDR has them, packed and unpacked with one `struct` per layout.

A message is four bytes of encapsulation, which give the byte order, and the fields. A string is a
count of bytes and the bytes, a sequence a count of elements and the elements, a count is a uint32.
Numbers are aligned to their size, counted from the end of the encapsulation.
"""

from __future__ import annotations

from collections.abc import Callable
from operator import itemgetter
import struct
from typing import Any, ClassVar

from ctc_chattering.errors import CtcError

#: Fields of a layout: a time (seconds, nanoseconds), a string, a sequence of doubles.
TIME, STRING, DOUBLES = 'iI', 'string', 'doubles'
#: Size of the encapsulation [bytes].
_BEGIN = 4


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
        The fields of the message: `TIME`, `STRING`, `DOUBLES`, the size of other numbers of four
        bytes, or a list with the fields of an element of a sequence.
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
