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

"""The records of MCAP files, by the specification (https://mcap.dev/spec)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
import struct
from typing import Any, NamedTuple
import zlib

from ctc_chattering.bags.compression import compressed, decompressed

MAGIC = b'\x89MCAP0\r\n'
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = 11, 12, 13, 14, 15
#: The fields of each record: numbers, and what has its length in front as 4 ("s") or 8 ("b")
#: bytes. The data of a message follow its fields.
_FIELDS = {
    HEADER: 'ss', FOOTER: 'QQI', SCHEMA: 'Hsss', CHANNEL: 'HHsss', MESSAGE: 'HIQQ',
    CHUNK: 'QQQIsb', MESSAGE_INDEX: 'Hs', CHUNK_INDEX: 'QQQQsQsQQ', 9: 'QQssbI', 10: 'QQQQQss',
    STATISTICS: 'QHIIIIQQs', METADATA: 'ss', METADATA_INDEX: 'QQs', SUMMARY_OFFSET: 'BQQ',
    DATA_END: 'I'}
_NUMBERS = {x: struct.Struct(f'<{x}') for x in 'BHIQ'}
_LENGTHS = {'s': _NUMBERS['I'], 'b': _NUMBERS['Q']}
#: What a record begins with: kind and length; and the fields of a message.
START, MESSAGE_START = struct.Struct('<BQ'), struct.Struct('<HIQQ')
_COUNT = struct.Struct('<HQ')
#: Bytes of the checksum and the magic at the end of a file.
_END = struct.Struct('<I8s')


class Schema(NamedTuple):
    """The definition of a type."""

    number: int
    name: str
    encoding: str
    data: bytes

    def packed(self) -> bytes:
        """Return the record."""
        return packed(SCHEMA, self.number, self.name.encode(), self.encoding.encode(), self.data)


class Channel(NamedTuple):
    """A topic."""

    number: int
    schema: int
    topic: str
    encoding: str
    metadata: dict[str, str]

    def packed(self) -> bytes:
        """Return the record."""
        return packed(CHANNEL, self.number, self.schema, self.topic.encode(),
                      self.encoding.encode(), packed_texts(self.metadata))


def packed(kind: int, *fields: Any) -> bytes:
    """Return a record of numbers and bytes."""
    parts = []
    for code, value in zip(_FIELDS[kind], fields):
        if code in _LENGTHS:
            parts += [_LENGTHS[code].pack(len(value)), value]
        else:
            parts.append(_NUMBERS[code].pack(value))
    body = b''.join(parts)
    return START.pack(kind, len(body)) + body


def record_end(data: Any, place: int) -> int:
    """Return where the record at a place ends; 0 if there is none."""
    if place + START.size > len(data):
        return 0
    kind, length = START.unpack_from(data, place)
    place += START.size
    end: int = place + length
    if kind not in _FIELDS or end > len(data):
        return 0
    if kind == MESSAGE:
        return end if length >= MESSAGE_START.size else 0
    for code in _FIELDS[kind]:
        prefix = place
        place += (_LENGTHS.get(code) or _NUMBERS[code]).size
        if place > end:
            return 0
        if code in _LENGTHS:
            place += _LENGTHS[code].unpack_from(data, prefix)[0]
    return end if place == end else 0


def walk(data: Any, place: int = 0) -> Iterator[tuple[int, int]]:
    """Yield begin and end of the records from a place on, as far as there are any."""
    while end := record_end(data, place):
        yield place, end
        place = end


def fields(data: Any, place: int = 0) -> list[Any]:
    """Return the fields of the record at a place, numbers and bytes."""
    kind, _ = START.unpack_from(data, place)
    place += START.size
    found: list[Any] = []
    for code in _FIELDS[kind]:
        number = _LENGTHS.get(code) or _NUMBERS[code]
        (value,) = number.unpack_from(data, place)
        place += number.size
        if code in _LENGTHS:
            place, value = place + value, bytes(data[place:place + value])
        found.append(value)
    return found


def read_schema(data: Any, place: int = 0) -> Schema:
    """Return the definition of a type at a place."""
    number, name, encoding, text = fields(data, place)
    return Schema(number, name.decode(), encoding.decode(), text)


def read_channel(data: Any, place: int = 0) -> Channel:
    """Return the topic at a place."""
    number, schema, topic, encoding, metadata = fields(data, place)
    return Channel(number, schema, topic.decode(), encoding.decode(), texts(metadata))


def packed_texts(values: Mapping[str, str]) -> bytes:
    """Return texts by name, as a record has them."""
    words = (x.encode() for item in values.items() for x in item)
    return b''.join(_LENGTHS['s'].pack(len(x)) + x for x in words)


def texts(data: bytes) -> dict[str, str]:
    """Return texts by name."""
    words, place = [], 0
    while place < len(data):
        (length,) = _LENGTHS['s'].unpack_from(data, place)
        place += _LENGTHS['s'].size
        words.append(data[place:place + length].decode())
        place += length
    return dict(zip(words[::2], words[1::2]))


def packed_counts(counts: Iterable[tuple[int, int]]) -> bytes:
    """Return numbers by channel, as a record has them."""
    return b''.join(_COUNT.pack(*item) for item in counts)


def counts(data: bytes) -> dict[int, int]:
    """Return numbers by channel."""
    return dict(_COUNT.iter_unpack(data))


def packed_chunk(content: bytes, first: int, last: int) -> tuple[bytes, str, int]:
    """
    Return a chunk, its compression, and its compressed size [bytes].

    Parameters
    ----------
    content : bytes
        Records.
    first, last : int
        Earliest and latest log time of its messages [ns].

    """
    name, data = compressed(content)
    return packed(CHUNK, first, last, len(content), zlib.crc32(content), name.encode(), data
                  ), name, len(data)


def chunk_content(data: Any, place: int = 0) -> bytes:
    """
    Return the records in the chunk at a place.

    Raises
    ------
    CtcError
        If what it was compressed with is not installed.
    ValueError
        If its checksum or size is wrong. What decompresses raises errors of its own.

    """
    _, _, size, checksum, name, content = fields(data, place)
    found = decompressed(content, name.decode(), size)
    if len(found) != size:
        raise ValueError(f'a chunk has {len(found)} bytes instead of {size}')
    if checksum not in (0, zlib.crc32(found)):
        raise ValueError('wrong checksum of a chunk')
    return found


def summary_place(data: Any) -> int:
    """
    Return where the index of a file begins; 0 without one.

    Raises
    ------
    ValueError
        If the file is cut off, or its index is not what was written.

    """
    footer = len(data) - len(MAGIC) - len(packed(FOOTER, 0, 0, 0))
    if bytes(data[-len(MAGIC):]) != MAGIC or footer < len(MAGIC) or data[footer] != FOOTER:
        raise ValueError('is cut off')
    start, _, written = fields(data, footer)
    with memoryview(data) as view, view[start or footer:-_END.size] as index:
        if written not in (0, zlib.crc32(index)):
            raise ValueError('has a wrong checksum of its index')
    return int(start)
