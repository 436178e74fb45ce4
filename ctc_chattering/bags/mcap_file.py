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
MCAP files: unpacked within limits, and what can be read of one whatever bytes of it are wrong.

`rosbags` reads bags; here is what it lacks. It unpacks as much as a file states, and reads no
file that is damaged.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from io import BytesIO
from itertools import islice
import mmap
from pathlib import Path
import re
import struct
from typing import Any, NamedTuple
import zlib

from ctc_chattering.errors import CtcError
import lz4.frame  # type: ignore[import-untyped]
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Schema
from mcap.summary import Summary
from rosbags.typesys import get_types_from_msg
import zstandard

_MAGIC = b'\x89MCAP0\r\n'
#: What a record begins with: kind and length.
_RECORD = struct.Struct('<BQ')
#: First and last time, size, checksum, and length of the compression's name of a chunk.
_CHUNK = struct.Struct('<QQQII')
#: Channel, number among those of its topic, log and publish time of a message.
_MESSAGE = struct.Struct('<HIQQ')
#: Footer, with the place and the checksum of the index, and the end of a file.
_END = struct.Struct('<BQQQI8s')
_DESCRIPTIONS = (Opcode.SCHEMA, Opcode.CHANNEL)
_CHUNK_START = re.compile(rb'\x06(?=.{5}\0\0\0)', re.DOTALL)
_DESCRIPTION_START = re.compile(rb'[\x03\x04](?=.{3}\0{5})', re.DOTALL)
#: Bytes that are unpacked in any case, those for each packed one, and the most of all.
_ALWAYS, _RATIO, _MOST = 1 << 25, 100, 1 << 27
#: Latest time that a bag can have [ns].
_LATEST = 2 ** 63 - 1


class UnknownDefinition(CtcError):
    """A file has the definition of a type that `rosbags` does not read."""


@cache
def is_readable(kind: str, encoding: str, definition: bytes) -> bool:
    """Return whether `rosbags` reads a definition; those of services are not of its kinds."""
    try:
        if encoding == 'ros2msg':
            get_types_from_msg(definition.decode(), kind)
    except Exception:  # Of arbitrary text, a parser raises arbitrary exceptions.
        return False
    return encoding in ('ros2msg', 'ros2idl', '')


def unpacked(data: bytes, compression: str, size: int | None = None) -> bytes:
    """
    Return what is packed; with a `size` [bytes] at most one byte more than that.

    Raises
    ------
    CtcError
        If it is more than is allowed for as much data, or the compression is not known.
        What unpacks raises errors of its own.

    """
    most = min(_MOST, _ALWAYS + _RATIO * len(data))
    if size is not None and size > most:
        raise CtcError(f'{len(data)} bytes would unpack to {size} bytes; allowed: up to {most}')
    wanted = 1 + (most if size is None else size)
    if compression == 'zstd':
        with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True) as stream:
            found = stream.read(wanted)
    elif compression == 'lz4':
        found = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=wanted)
    elif compression:
        raise CtcError(f'unknown compression {compression!r}; allowed: zstd, lz4')
    else:
        found = data
    if len(found) > most:
        raise CtcError(f'{len(data)} bytes unpack to more than {most} bytes, which is allowed')
    return bytes(found)


def unpacked_file(source: Path, target: Path) -> Path:
    """Unpack a file of zstd; return it. Raise `CtcError` if it is more than is allowed."""
    most = _ALWAYS + _RATIO * source.stat().st_size
    with source.open('rb') as packed, target.open('wb') as found, (
            zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)) as stream:
        while piece := stream.read(_ALWAYS):
            if found.write(piece) and found.tell() > most:
                raise CtcError(f'{source.name}: it unpacks to more than {most} bytes, which is '
                               'allowed for its size')
    return target


class _Chunk(NamedTuple):
    """
    The record of a chunk.

    Attributes
    ----------
    begin, start, end : int
        Where the record begins, where its packed data begin, and where both end.
    compression : str
        What it is packed with; empty for nothing.
    size, checksum : int
        Size [bytes] and CRC-32 of what is packed, as it states; a checksum of 0 for none.

    """

    begin: int
    start: int
    end: int
    compression: str
    size: int
    checksum: int


def _chunk_at(data: Any, begin: int) -> _Chunk | None:
    """Return the chunk whose record begins at a byte; None if its lengths do not fit."""
    name = begin + _RECORD.size + _CHUNK.size
    if name > len(data):
        return None
    _, length = _RECORD.unpack_from(data, begin)
    _, _, size, checksum, letters = _CHUNK.unpack_from(data, begin + _RECORD.size)
    start, end = name + letters + 8, begin + _RECORD.size + length
    if letters > 4 or start > end or end > len(data) or (
            int.from_bytes(data[start - 8:start], 'little') != end - start):
        return None
    compression = bytes(data[name:name + letters]).decode('ascii', 'replace')
    return _Chunk(begin, start, end, compression, size, checksum)


def _content(data: Any, chunk: _Chunk) -> bytes:
    """Return the records in a chunk; raise `CtcError` if they are not what it states."""
    found = unpacked(data[chunk.start:chunk.end], chunk.compression, chunk.size)
    if len(found) != chunk.size:
        raise CtcError(f'a chunk of {chunk.size} bytes has another size')
    if chunk.checksum not in (0, zlib.crc32(found)):
        raise CtcError('a chunk has a wrong checksum')
    return found


def _records(data: Any, begin: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield kind, begin of the content, and end of the records in a part of a file."""
    while begin + _RECORD.size <= end:
        kind, length = _RECORD.unpack_from(data, begin)
        begin += _RECORD.size
        if begin + length > end:
            break
        yield kind, begin, begin + length
        begin += length


def _goes_on(data: Any, place: int, end: int) -> bool:
    """Return whether a record, or the end, is at a place; else wrong bytes may begin before it."""
    kind, _, _ = next(_records(data, place, end), (0, 0, 0))
    return place == end or 0 < kind <= Opcode.DATA_END


def _mapped(path: Path) -> Any:
    """Return the bytes of a file, which are read where they are used."""
    with path.open('rb') as stream:
        return mmap.mmap(
            stream.fileno(), 0, access=mmap.ACCESS_READ) if path.stat().st_size else b''


def _index(path: Path, data: Any) -> Summary | None:
    """Return the index of a file, None without one; raise `CtcError` if it is not what it was."""
    if len(data) < _END.size or bytes(data[-len(_MAGIC):]) != _MAGIC:
        raise CtcError('the file is cut off')
    footer = len(data) - _END.size
    _, _, start, _, checksum, _ = _END.unpack_from(data, footer)
    if checksum not in (0, zlib.crc32(data[start or footer:-12])):
        raise CtcError('the index has a wrong checksum')
    with path.open('rb') as stream:
        return make_reader(stream).get_summary()


def check(path: Path) -> None:
    """
    Check that the chunks of a file unpack to what they state, and that its index is of them.

    Raises
    ------
    CtcError
        Otherwise, or if the file is cut off. Where it is damaged, errors of any kind.
    UnknownDefinition
        If all is well but for a definition.

    """
    data = _mapped(path)
    try:
        summary, chunks = _index(path, data), set()
        for kind, start, _ in _records(data, len(_MAGIC), len(data)):
            if kind == Opcode.CHUNK:
                chunk = _chunk_at(data, start - _RECORD.size)
                if chunk is None:
                    raise CtcError('a chunk has another length than it states')
                _content(data, chunk)
                chunks.add((chunk.begin, chunk.end - chunk.start, chunk.compression, chunk.size))
        if summary and not chunks >= {
                (x.chunk_start_offset, x.compressed_size, x.compression, x.uncompressed_size)
                for x in summary.chunk_indexes}:
            raise CtcError('the index has chunks that are not there')
    except CtcError as error:
        raise CtcError(f'{path.name}: {error}') from None
    for x in summary.schemas.values() if summary else ():
        if not is_readable(x.name, x.encoding, x.data):
            raise UnknownDefinition(f'the definition of {x.name} is not one of a message')


class Found(NamedTuple):
    """
    A message.

    Attributes
    ----------
    channel, schema : Channel, Schema
        Its topic and type.
    t, number : int
        Log time [ns], and number among those of the topic, if the file has these.
    data : bytes
        Serialized.

    """

    channel: Channel
    schema: Schema
    t: int
    number: int
    data: bytes


class DamagedFile:
    """
    What can be read of a file: whole chunks, by their checksums, and the records in them.

    Chunks are looked for byte by byte. Topics and types are taken from chunks and from the index;
    what stands outside counts where these do not have it, and only if it does not contradict
    itself. Without chunks, the records before the first wrong one are taken.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    counts : dict or None
        Number of messages by topic, as the index has it; None without it.
    lost : int
        Bytes that could not be read; complete after `messages`.

    """

    def __init__(self, path: Path) -> None:
        self._data, self.lost = _mapped(path), 0
        self._sure: dict[tuple[type, int], Any] = {}
        self._outside: dict[tuple[type, int], Any] = {}
        try:
            summary = _index(path, self._data)
        except Exception:  # A damaged index may raise any exception.
            summary = None
        self.counts: dict[str, int] | None = None
        if summary:
            self._sure.update({(Schema, x): record for x, record in summary.schemas.items()})
            self._sure.update({(Channel, x): record for x, record in summary.channels.items()})
        if summary and summary.statistics:
            counts = summary.statistics.channel_message_counts
            if counts.keys() <= summary.channels.keys():
                self.counts = {summary.channels[x].topic: count for x, count in counts.items()}

    def messages(self) -> Iterator[Found]:
        """Yield the messages in the order of the file."""
        data, place = self._data, len(_MAGIC)
        for match in _CHUNK_START.finditer(data):
            chunk = _chunk_at(data, match.start()) if match.start() >= place else None
            content = _whole(data, chunk) if chunk else None
            if chunk and content:
                self._between(place, chunk.begin)
                place = chunk.end
                for kind, start, end in _records(content, 0, len(content)):
                    if kind in _DESCRIPTIONS:
                        self._note(content, start, end, chunk.checksum != 0)
                    elif kind == Opcode.MESSAGE:
                        yield from self._message(content, start, end)
        end = len(data) - (len(_MAGIC) if bytes(data[-len(_MAGIC):]) == _MAGIC else 0)
        if place > len(_MAGIC):
            self._between(place, end)
        else:
            yield from self._without_chunks(place, end)

    def _between(self, place: int, end: int) -> None:
        """Take the descriptions between two whole chunks, and count the bytes of no record."""
        data = self._data
        for kind, start, stop in _records(data, place, end):
            if kind == Opcode.CHUNK:
                self.lost += stop - start
            elif kind in _DESCRIPTIONS and _goes_on(data, stop, end):
                self._note(data, start, stop)
            place = stop
        self.lost += end - place
        for match in _DESCRIPTION_START.finditer(data, place, end):
            for _, start, stop in islice(_records(data, match.start(), end), 1):
                if _goes_on(data, stop, end):
                    self._note(data, start, stop)

    def _without_chunks(self, place: int, end: int) -> Iterator[Found]:
        """Yield the messages of a file that has no chunks."""
        data = self._data
        for kind, start, stop in _records(data, place, end):
            if not _goes_on(data, stop, end):
                break
            if kind in _DESCRIPTIONS:
                self._note(data, start, stop)
            elif kind == Opcode.MESSAGE:
                yield from self._message(data, start, stop)
            place = stop
        self.lost += end - place

    def _note(self, data: Any, start: int, end: int, is_sure: bool = False) -> None:
        """Take the description of a topic or a type, if it can be read."""
        kind = Schema if data[start - _RECORD.size] == Opcode.SCHEMA else Channel
        stream = ReadDataStream(BytesIO(data[start:end]))
        try:
            record: Any = kind.read(stream)
        except Exception:  # Of arbitrary bytes, any.
            return
        if stream.count != end - start:
            return
        if is_sure:
            self._sure[kind, record.id] = record
        elif self._outside.setdefault((kind, record.id), record) != record:
            self._outside[kind, record.id] = None

    def _message(self, data: Any, start: int, end: int) -> Iterator[Found]:
        """Yield a message, if it has a type and a possible time."""
        begin = start + _MESSAGE.size
        number, sequence, t, _ = _MESSAGE.unpack_from(data, start) if begin <= end else (0,) * 4
        channel = self._described(Channel, number)
        schema = self._described(Schema, channel.schema_id) if channel else None
        if begin > end or schema is None or t > _LATEST:
            self.lost += end - start
        else:
            yield Found(channel, schema, t, sequence, bytes(data[begin:end]))

    def _described(self, kind: type, number: int) -> Any:
        """Return the description of a topic or a type; None without one."""
        return self._sure.get((kind, number)) or self._outside.get((kind, number))


def _whole(data: Any, chunk: _Chunk) -> bytes | None:
    """Return the records in a chunk; None if it is damaged."""
    try:
        content = _content(data, chunk)
    except Exception:  # A damaged chunk may raise any exception.
        return None
    ends = [end for _, _, end in _records(content, 0, len(content))]
    return content if ends and ends[-1] == len(content) else None
