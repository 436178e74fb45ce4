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
Reading topics and messages of an MCAP file.

`bag.py` opens each MCAP file of a bag as an `McapFile`. Names are those of the MCAP specification.
Messages of any encoding are bytes here. Chunks are unpacked by `compression.py`, since `mcap`
unpacks more than a file states. All of them are checked before the first message is read.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Collection, Iterator
from functools import lru_cache
from io import BytesIO
from math import inf
import mmap
from operator import attrgetter, itemgetter
from pathlib import Path
import struct
from typing import Any, NamedTuple
import zlib

from ctc_chattering.bags.bag_files import Span
from ctc_chattering.bags.compression import unpack
from ctc_chattering.errors import CtcError
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, Schema, Statistics
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
#: Beginning of a record: opcode, and length of its content.
RECORD = struct.Struct('<BQ')
#: Beginning of a message: channel, sequence number, log time and publish time [ns].
_MESSAGE = struct.Struct('<HIQQ')
#: Record of the footer, with start and checksum of the summary, and the closing magic.
_FOOTER = struct.Struct('<BQQQI8s')
#: Records outside chunks are read in groups of this size [bytes].
_GROUP_SIZE = 1 << 20
#: Key of the publishers' QoS in the metadata of a channel.
QOS = 'offered_qos_profiles'
#: Formats of definitions that `rosbags` reads, by their encodings.
_DEFINITIONS = {
    'ros2msg': MessageDefinitionFormat.MSG,
    'ros2idl': MessageDefinitionFormat.IDL,
    'omgidl': MessageDefinitionFormat.IDL}
#: Stands for the schema of a channel that has none, for example one of JSON.
NO_SCHEMA = Schema(0, b'', '', '')

#: Log time [ns], number of the channel, data.
_Message = tuple[int, int, bytes]
_LOG_TIME = itemgetter(0)


class _RecordBlock(NamedTuple):
    """
    Chunk, or group of records outside chunks.

    Attributes
    ----------
    begin, end : int
        Offsets in the file: of the chunk's content, or of the first and behind the last record.
    is_chunk : bool
    start : int
        Log time of the first message [ns].
    channels : set of int
        Channels with messages in it.

    """

    begin: int
    end: int
    is_chunk: bool
    start: int = 0
    channels: Collection[int] = ()


def unpack_chunk(record: bytes) -> tuple[Chunk, bytes]:
    """
    Unpack the content of a chunk's record.

    Raises
    ------
    CtcError
        If the records are not what the chunk states. Where it is damaged, errors of any kind.

    """
    stream = ReadDataStream(BytesIO(record))
    chunk: Chunk = Chunk.read(stream)
    content = unpack(chunk.data, chunk.compression)
    has_its_size = stream.count == len(record) and len(content) == chunk.uncompressed_size
    if not has_its_size:
        raise CtcError(f'a chunk of {chunk.uncompressed_size} bytes has another size')
    if chunk.uncompressed_crc not in (0, zlib.crc32(content)):
        raise CtcError('a chunk has a wrong checksum')
    return chunk, content


def map_file(path: Path) -> Any:
    """Map a file into memory."""
    with path.open('rb') as stream:
        if not path.stat().st_size:
            return b''
        return mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)


def read_summary(data: Any) -> Summary:
    """
    Return the summary section, or an empty one.

    A damaged one raises `CtcError`.
    """
    if data[-len(MAGIC):] != MAGIC:
        raise CtcError('the file is cut off')
    footer = len(data) - _FOOTER.size
    _, _, start, _, checksum, _ = _FOOTER.unpack_from(data, footer)
    end = footer + RECORD.size + 16  # The checksum covers the footer up to itself.
    if checksum not in (0, zlib.crc32(data[start or footer:end])):
        raise CtcError('the index has a wrong checksum')
    return SeekingReader(data).get_summary() or Summary()


def _records(data: Any, begin: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, begin and end of each record's content."""
    while begin < end:
        opcode, length = RECORD.unpack_from(data, begin)
        content = begin + RECORD.size
        begin = content + length
        if begin > end:
            raise CtcError('a record is longer than the rest of the file')
        yield opcode, content, begin


class McapFile:
    """
    Open MCAP file, which must be closed after use.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    schemas, channels : dict of int to record
        By their numbers.
    counts : Counter
        Number of messages by channel.
    span : Span
        Number and log times of the messages.

    Raises
    ------
    Exception
        Of any kind, if it is damaged.

    """

    def __init__(self, path: Path) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.counts: Counter[int] = Counter()
        self.span = Span()
        self._data = map_file(path)
        summary = read_summary(self._data)
        blocks = [self._describe(x) for x in self._find_blocks(summary.chunk_indexes)]
        self._blocks = sorted(blocks, key=attrgetter('start'))
        if not self.counts.keys() <= self.channels.keys():
            raise CtcError('there are messages of a topic that is not described')
        if summary.statistics is not None:
            self._check_counts(summary.statistics)

    def close(self) -> None:
        """Close the file."""
        if self._data:
            self._data.close()

    @property
    def connections(self) -> list[Connection]:
        """Return the topics of the file, with the channels as ids."""
        return [self._connection(x) for x in self.channels.values()]

    def messages(self, connections: Collection[Connection]
                 ) -> Iterator[tuple[Connection, int, bytes]]:
        """
        Yield messages of some topics in the order of log times.

        Each comes with its connection and log time [ns].
        """
        topics = {x.id: x for x in connections}
        blocks = [x for x in self._blocks if not topics.keys().isdisjoint(x.channels)]
        next_starts = [*(x.start for x in blocks[1:]), inf]
        waiting: list[_Message] = []
        for block, next_start in zip(blocks, next_starts):
            waiting += _messages(self._content(block), topics)
            waiting.sort(key=_LOG_TIME)
            due = bisect_left(waiting, next_start, key=_LOG_TIME)
            for t, number, data in waiting[:due]:
                yield topics[number], t, data
            del waiting[:due]

    def _find_blocks(self, chunk_indexes: Collection[ChunkIndex]) -> list[_RecordBlock]:
        """
        Return the blocks of the file.

        An indexed chunk that is not there raises `CtcError`.
        """
        missing = {x.chunk_start_offset for x in chunk_indexes}
        blocks: list[_RecordBlock] = []
        file_end = len(self._data) - len(MAGIC)
        for opcode, begin, end in _records(self._data, len(MAGIC), file_end):
            record = begin - RECORD.size
            if opcode == Opcode.CHUNK:
                missing.discard(record)
                blocks.append(_RecordBlock(begin, end, True))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
                group = blocks[-1] if blocks else None
                if group and not group.is_chunk and group.end == record and (
                        end - group.begin < _GROUP_SIZE):
                    blocks[-1] = group._replace(end=end)
                else:
                    blocks.append(_RecordBlock(record, end, False))
        if missing:
            raise CtcError('the index has chunks that are not there')
        return blocks

    def _describe(self, block: _RecordBlock) -> _RecordBlock:
        """
        Return a block with its channels and first log time.

        Topics and counts of the file are updated.
        """
        content = self._content(block)
        times: list[int] = []
        counts: Counter[int] = Counter()
        self._data.madvise(mmap.MADV_DONTNEED)  # Otherwise the file stays in memory.
        for opcode, begin, end in _records(content, 0, len(content)):
            if opcode == Opcode.MESSAGE:
                number, _, t, _ = _MESSAGE.unpack_from(content, begin)
                counts[number] += 1
                times.append(t)
            elif opcode == Opcode.SCHEMA:
                _register(Schema, content[begin:end], self.schemas)
            elif opcode == Opcode.CHANNEL:
                _register(Channel, content[begin:end], self.channels)
        if not times:
            return block
        start = min(times)
        self.counts += counts
        self.span.count += len(times)
        self.span.begin = min(self.span.begin, start)
        self.span.end = max(self.span.end, max(times))
        return block._replace(start=start, channels=counts.keys())

    def _check_counts(self, statistics: Statistics) -> None:
        """Raise `CtcError` if the statistics count other messages."""
        if self.span.count != statistics.message_count:
            raise CtcError(f'{self.span.count} messages, {statistics.message_count} according '
                           'to its index')
        if self.counts != Counter(statistics.channel_message_counts):
            raise CtcError('the index counts other messages of a topic')

    def _content(self, block: _RecordBlock) -> bytes:
        """Return the records of a block."""
        data: bytes = self._data[block.begin:block.end]
        return unpack_chunk(data)[1] if block.is_chunk else data

    def _connection(self, channel: Channel) -> Connection:
        """Return a topic as `rosbags` has it."""
        schema = self.schemas.get(channel.schema_id, NO_SCHEMA)
        form = _DEFINITIONS.get(schema.encoding, MessageDefinitionFormat.NONE)
        text = schema.data.decode(errors='replace')
        return Connection(
            channel.id,
            channel.topic,
            schema.name,
            MessageDefinition(form, text),
            '',
            self.counts[channel.id],
            ConnectionExtRosbag2(channel.message_encoding, read_qos(channel)),
            self)


def read_qos(channel: Channel) -> list[Qos]:
    """Return the QoS that the publishers of a channel offer, empty where it is none."""
    try:
        return list(_parse_qos(channel.metadata[QOS]))
    except Exception:  # Arbitrary text may raise any exception.
        return []


@lru_cache(maxsize=32)  # It takes time, and most topics have one of a few.
def _parse_qos(text: str) -> tuple[Qos, ...]:
    return tuple(parse_qos(text))


def _register(record_class: Any, content: bytes, records: dict[int, Any]) -> None:
    """Add a schema or channel; raise `CtcError` if there is another one of its number."""
    record = record_class.read(ReadDataStream(BytesIO(content)))
    if records.setdefault(record.id, record) != record:
        raise CtcError(f'{record_class.__name__.lower()} {record.id} is described in two ways')


def _messages(content: bytes, channels: Collection[int]) -> Iterator[_Message]:
    """Yield the messages of some channels among records."""
    for opcode, begin, end in _records(content, 0, len(content)):
        if opcode == Opcode.MESSAGE:
            number, _, t, _ = _MESSAGE.unpack_from(content, begin)
            if number in channels:
                yield t, number, content[begin + _MESSAGE.size:end]
