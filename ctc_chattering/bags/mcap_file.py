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
Reading an MCAP file of any recorder: topics, and messages in the order of their log times.

Messages of any encoding are read as bytes. The records are those of `mcap`; chunks are unpacked
here, as it unpacks more than a file states, and all of them are checked before the first message.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import suppress
from io import BytesIO
import mmap
from operator import attrgetter, itemgetter
from pathlib import Path
import struct
from typing import Any, NamedTuple
import zlib

from ctc_chattering.bags.compression import unpack
from ctc_chattering.errors import CtcError
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, Schema
from mcap.summary import Summary
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
    Qos,
)
from rosbags.rosbag2.metadata import parse_qos

MAGIC = b'\x89MCAP0\r\n'
#: Beginning of a record: its opcode, and the length of its content.
RECORD = struct.Struct('<BQ')
#: Beginning of a message: channel, sequence number, log time and time of publication [ns].
_MESSAGE = struct.Struct('<HIQQ')
#: Footer, with the offset and the checksum of the index, and the end of a file.
_END = struct.Struct('<BQQQI8s')
#: Size of a group of messages outside chunks that is read at once [bytes].
_GROUP = 1 << 20
#: Where the metadata of a channel have what its publishers offer.
QOS = 'offered_qos_profiles'
#: Formats of definitions that `rosbags` reads, by their names in a file.
_DEFINITIONS = {'ros2msg': MessageDefinitionFormat.MSG, 'ros2idl': MessageDefinitionFormat.IDL,
                'omgidl': MessageDefinitionFormat.IDL}
#: What stands for the schema of a channel without one, as of JSON.
NO_SCHEMA = Schema(0, b'', '', '')

#: Log time [ns], number of the channel, data.
_Message = tuple[int, int, bytes]
_LOG_TIME = itemgetter(0)


class _RecordBlock(NamedTuple):
    """
    A chunk, or some messages outside chunks that follow each other.

    Attributes
    ----------
    start : int
        Log time of its first message [ns].
    begin, end : int
        Offsets in the file: of a chunk's content, or of the first record and behind the last.
    is_chunk : bool
    channels : set of int, or None
        Those with messages in it; None where the index does not say.

    """

    start: int
    begin: int
    end: int
    is_chunk: bool
    channels: Collection[int] | None = None

    def has_any(self, channels: Collection[int]) -> bool:
        """Return whether it may have messages of some channels."""
        return self.channels is None or not set(channels).isdisjoint(self.channels)


def unpack_chunk(record: bytes) -> tuple[Chunk, bytes]:
    """
    Return a chunk and the records in it, from the content of its own record.

    Raises
    ------
    CtcError
        If the records are not what it states; where it is damaged, errors of any kind.

    """
    stream = ReadDataStream(BytesIO(record))
    chunk: Chunk = Chunk.read(stream)
    content = unpack(chunk.data, chunk.compression)
    if (stream.count, len(content)) != (len(record), chunk.uncompressed_size):
        raise CtcError(f'a chunk of {chunk.uncompressed_size} bytes has another size')
    if chunk.uncompressed_crc not in (0, zlib.crc32(content)):
        raise CtcError('a chunk has a wrong checksum')
    return chunk, content


def map_file(path: Path) -> Any:
    """Return the bytes of a file, which are read where they are used."""
    with path.open('rb') as stream:
        return mmap.mmap(
            stream.fileno(), 0, access=mmap.ACCESS_READ) if path.stat().st_size else b''


def read_index(data: Any) -> Summary | None:
    """Return the index of a file, None without one; raise `CtcError` if it is damaged."""
    if data[-len(MAGIC):] != MAGIC:
        raise CtcError('the file is cut off')
    footer = len(data) - _END.size
    _, _, start, _, checksum, _ = _END.unpack_from(data, footer)
    if checksum not in (0, zlib.crc32(data[start or footer:-12])):
        raise CtcError('the index has a wrong checksum')
    return SeekingReader(data).get_summary()


def _records(data: Any, begin: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield the opcode of each record, and where its content begins and ends."""
    while begin < end:
        opcode, length = RECORD.unpack_from(data, begin)
        content = begin + RECORD.size
        begin = content + length
        if begin > end:
            raise CtcError('a record is longer than the rest of the file')
        yield opcode, content, begin


class McapFile:
    """
    An open MCAP file; close it after use.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    schemas, channels : dict of int to record
        By their numbers.
    counts : dict of int to int
        Number of messages by channel.
    start_time, end_time : int
        Log times of the first message and behind the last one [ns].

    Raises
    ------
    Exception
        Of any kind, if it is damaged.

    """

    def __init__(self, path: Path) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.counts: Counter[int] = Counter()
        self.start_time, self.end_time = 2 ** 63 - 1, 0
        self._data = map_file(path)
        summary = read_index(self._data) or Summary()
        self._blocks = self._find_blocks(summary.chunk_indexes)
        if not self._describe_by_index(summary):
            self._blocks = [self._describe_block(block) for block in self._blocks]
        self._blocks.sort(key=attrgetter('start'))
        if not self.counts.keys() <= self.channels.keys():
            raise CtcError('there are messages of a topic that is not described')

    def close(self) -> None:
        """Close the file."""
        if self._data:
            self._data.close()

    @property
    def message_count(self) -> int:
        """Return the number of all messages."""
        return self.counts.total()

    @property
    def connections(self) -> list[Connection]:
        """Topics of the file, as `rosbags` has them; the id is the number of the channel."""
        return [self._connection(number, channel) for number, channel in self.channels.items()]

    def messages(self, connections: Collection[Connection]
                 ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield connection, log time [ns] and data of some topics, in the order of log times."""
        topics = {x.id: x for x in connections}
        waiting: list[_Message] = []
        for block in self._blocks:
            if not block.has_any(topics):
                continue
            due = bisect_left(waiting, block.start, key=_LOG_TIME)
            yield from ((topics[number], t, data) for t, number, data in waiting[:due])
            del waiting[:due]
            waiting += _messages(self._content(block), topics)
            waiting.sort(key=_LOG_TIME)
        yield from ((topics[number], t, data) for t, number, data in waiting)

    def _find_blocks(self, indexes: Collection[ChunkIndex]) -> list[_RecordBlock]:
        """
        Return the blocks of the file, in its order.

        Raises
        ------
        CtcError
            If a chunk does not unpack to what it states, or the index has chunks that are not
            there. Where the file is damaged, errors of any kind.

        """
        expected = {x.chunk_start_offset: x for x in indexes}
        blocks: list[_RecordBlock] = []
        for opcode, begin, end in _records(self._data, len(MAGIC), len(self._data) - len(MAGIC)):
            record = begin - RECORD.size
            if opcode == Opcode.CHUNK:
                chunk, _ = unpack_chunk(self._data[begin:end])
                self._data.madvise(mmap.MADV_DONTNEED)  # It would stay in memory, else.
                index = expected.pop(record, None)
                if index and not _describes(index, chunk):
                    raise CtcError('the index has other chunks than the file')
                # Nothing protects the times in a chunk's own head.
                start, channels = (index.message_start_time, index.message_index_offsets.keys()
                                   ) if index else (0, ())
                blocks.append(_RecordBlock(start, begin, end, True, channels or None))
            elif opcode == Opcode.MESSAGE:
                _, _, t, _ = _MESSAGE.unpack_from(self._data, begin)
                last = blocks[-1] if blocks else None
                if last and not last.is_chunk and last.end - last.begin < _GROUP and (
                        last.end == record):
                    blocks[-1] = last._replace(start=min(t, last.start), end=end)
                else:
                    blocks.append(_RecordBlock(t, record, end, False))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._note(opcode, self._data[begin:end])
        if expected:
            raise CtcError('the index has chunks that are not there')
        return blocks

    def _describe_by_index(self, summary: Summary) -> bool:
        """Take topics and counts from the index; return whether it has all of them."""
        statistics = summary.statistics
        if statistics is None or len(summary.channels) != statistics.channel_count or (
                len(summary.schemas) != statistics.schema_count):
            return False
        self.schemas, self.channels = summary.schemas, summary.channels
        self.counts.update(statistics.channel_message_counts)
        if self.counts.total() != statistics.message_count:
            raise CtcError('the counts of messages in the index contradict each other')
        if statistics.message_count:
            self.start_time = statistics.message_start_time
            self.end_time = statistics.message_end_time + 1
        return True

    def _describe_block(self, block: _RecordBlock) -> _RecordBlock:
        """Take topics and counts from a block; return it with its first log time."""
        content, times = self._content(block), []
        for opcode, begin, end in _records(content, 0, len(content)):
            if opcode == Opcode.MESSAGE:
                number, _, t, _ = _MESSAGE.unpack_from(content, begin)
                self.counts[number] += 1
                times.append(t)
            else:
                self._note(opcode, content[begin:end])
        if not times:
            return block
        self.start_time = min(self.start_time, min(times))
        self.end_time = max(self.end_time, max(times) + 1)
        return block._replace(start=min(times))

    def _note(self, opcode: int, content: bytes) -> None:
        """Take a schema or a channel from its record."""
        stream = ReadDataStream(BytesIO(content))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            if self.schemas.setdefault(schema.id, schema) != schema:
                raise CtcError(f'schema {schema.id} is described in two ways')
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            if self.channels.setdefault(channel.id, channel) != channel:
                raise CtcError(f'channel {channel.id} is described in two ways')

    def _content(self, block: _RecordBlock) -> bytes:
        """Return the records of a block."""
        data: bytes = self._data[block.begin:block.end]
        return unpack_chunk(data)[1] if block.is_chunk else data

    def _connection(self, number: int, channel: Channel) -> Connection:
        """Return a topic as `rosbags` has it."""
        schema = self.schemas.get(channel.schema_id, NO_SCHEMA)
        form = _DEFINITIONS.get(schema.encoding, MessageDefinitionFormat.NONE)
        is_text = form != MessageDefinitionFormat.NONE
        definition = MessageDefinition(
            form, schema.data.decode(errors='replace') if is_text else '')
        profiles: list[Qos] = []
        with suppress(Exception):  # Of arbitrary text, any; it matters for replay only.
            profiles = parse_qos(channel.metadata[QOS])
        return Connection(
            number, channel.topic, schema.name, definition, '', self.counts[number],
            ConnectionExtRosbag2(channel.message_encoding, profiles), self)


def _describes(index: ChunkIndex, chunk: Chunk) -> bool:
    """Return whether sizes and compression of a chunk are those in the index."""
    return (index.compressed_size == len(chunk.data)
            and index.compression == chunk.compression
            and index.uncompressed_size == chunk.uncompressed_size)


def _messages(content: bytes, channels: Collection[int]) -> Iterator[_Message]:
    """Yield the messages of some channels among records, in their order."""
    for opcode, begin, end in _records(content, 0, len(content)):
        if opcode == Opcode.MESSAGE:
            number, _, t, _ = _MESSAGE.unpack_from(content, begin)
            if number in channels:
                yield t, number, content[begin + _MESSAGE.size:end]
