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
_INCOMPLETE = 'the message is incomplete'


def byte_order(data: bytes) -> str:
    """Return the byte order of a message as `struct` has it."""
    order = {b'\0\0': '>', b'\0\1': '<'}.get(data[:2])
    if order is None:
        raise CtcError('the encapsulation of the message is not CDR')
    return order


def read_time(data: bytes) -> tuple[int, int]:
    """Return the seconds and nanoseconds at the beginning of a message."""
    try:
        sec, nanosec = struct.unpack_from(byte_order(data) + TIME, data, _BEGIN)
    except struct.error:
        raise CtcError(_INCOMPLETE) from None
    return sec, nanosec


class Template:
    """
    The `struct` of all messages that differ from the last one in numbers only.

    Its values are the numbers and, as bytes, what is between them, without the padding.

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
        self._unpack_from = struct.Struct('').unpack_from
        self._constants: Callable[[Any], Any] = tuple
        self._expected: Any = None

    def unpack(self, data: bytes) -> tuple[Any, ...]:
        """Return the values of a message; raise `CtcError` if it is incomplete or not CDR."""
        try:
            values = self._unpack_from(data)
            if self._constants(values) == self._expected:
                return values
        except struct.error:
            pass
        return self.parse(data)

    def parse(self, data: bytes) -> tuple[Any, ...]:
        """Take the template from a message, and return its values."""
        order = byte_order(data)
        self._data, self._at, self._begin = data, _BEGIN, 0
        self._uint32 = struct.Struct(order + 'I').unpack_from
        self._codes, self._size = [order], 0
        self._places: list[int] = []
        self.rows: list[slice] = []
        try:
            fields = self._parse(self.layout)
            self._end_of_constant()
            form = struct.Struct(''.join(self._codes))
            values = form.unpack_from(data)
        except struct.error:
            raise CtcError(_INCOMPLETE) from None
        self.fields, self.pack, self._unpack_from = fields, form.pack, form.unpack_from
        self._constants = itemgetter(*self._places)
        self._expected = self._constants(values)
        return values

    def _parse(self, part: Any) -> Any:
        """Return the fields of a part of the layout that begins at byte `_at`."""
        if isinstance(part, tuple):
            fields = [x for x in map(self._parse, part) if x is not None]
            return tuple(fields) if len(fields) > 1 else fields[0]
        self._align(4)
        if part == TIME:
            return self._numbers(TIME, 2, 4)
        if isinstance(part, int):
            self._at += part
            return None
        count = self._count()
        if part == DOUBLES:
            row = self._numbers(f'{count}d', count, 8) if count else slice(0)
            self.rows += [row] * bool(count)
            return row
        if part == STRING:
            self._at += count
            text = bytes(self._data[self._at - count:self._at])
            return text.partition(b'\0')[0].decode(errors='replace')
        return tuple([self._parse(x) for x in part * count])

    def _count(self) -> int:
        """Return the number of elements of what begins at byte `_at`."""
        count, = self._uint32(self._data, self._at)
        self._at += 4
        left = len(self._data) - self._at
        if count > left:
            raise CtcError(f'{_INCOMPLETE}: {left} bytes for {count} elements')
        return int(count)

    def _numbers(self, code: str, count: int, size: int) -> slice:
        """Append `count` numbers of `size` bytes, and return their slice."""
        self._align(size)
        self._end_of_constant()
        self._codes.append(code)
        self._at += count * size
        self._begin = self._at
        self._size += count
        return slice(self._size - count, self._size)

    def _align(self, size: int) -> None:
        """Append padding, which may be any bytes."""
        padding = (_BEGIN - self._at) % size
        if padding:
            self._end_of_constant()
            self._codes.append(f'{padding}x')
            self._at += padding
            self._begin = self._at

    def _end_of_constant(self) -> None:
        """Append the bytes since the last number or padding."""
        if self._at > self._begin:
            self._codes.append(f'{self._at - self._begin}s')
            self._places.append(self._size)
            self._size += 1
