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

"""Writing an MCAP file in chunks that can be read while it is written."""

from __future__ import annotations

from collections import Counter
import struct
from typing import BinaryIO
import zlib

from ctc_chattering.bags import mcap_records as records
from ctc_chattering.bags.mcap_records import Channel, packed, Schema

#: Size at which a chunk is written [bytes]: compressing takes some times as much memory.
_CHUNK = 1 << 18
_MESSAGE = struct.Struct(records.START.format + records.MESSAGE_START.format[1:])
_PLACE = struct.Struct('<QQ')


class McapWriter:
    """
    An MCAP file being written.

    Parameters
    ----------
    stream : file
        Empty; `McapWriter` does not close it.
    library : str
        What the file says it was written by.

    """

    def __init__(self, stream: BinaryIO, library: str) -> None:
        self._stream, self._place = stream, 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._described = 0
        self._counts: Counter[int] = Counter()
        self._times: list[int] = []
        self._chunks: list[bytes] = []
        self._begin_chunk()
        self._put(records.MAGIC + packed(records.HEADER, b'ros2', library.encode()))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Describe a type; return its number."""
        self._schemas.append(Schema(len(self._schemas) + 1, name, encoding, data))
        self._append(self._schemas[-1].packed())
        return len(self._schemas)

    def add_channel(self, topic: str, schema: int, metadata: dict[str, str]) -> int:
        """Describe a topic; return its number."""
        self._channels.append(Channel(len(self._channels) + 1, schema, topic, 'cdr', metadata))
        self._append(self._channels[-1].packed())
        return len(self._channels)

    def add_message(self, channel: int, t: int, data: bytes, number: int) -> None:
        """Add a message with log time `t` [ns] and its number among those of the channel."""
        self._index.setdefault(channel, []).append((t, self._size))
        self._append(_MESSAGE.pack(
            records.MESSAGE, records.MESSAGE_START.size + len(data), channel, number, t, t) + data)
        if self._size > _CHUNK:
            self._end_chunk()

    def flush(self) -> None:
        """
        End the chunk, and hand all over to the system.

        The first chunk with messages of a topic has their type. A damaged chunk must not take it
        along: it stands outside as well, on both sides of that chunk.
        """
        description = b''
        if len(self._channels) > self._described:
            self._described = len(self._channels)
            description = b''.join([*(x.packed() for x in self._schemas),
                                    *(x.packed() for x in self._channels)])
        self._put(description)
        self._end_chunk()
        self._put(description)
        self._stream.flush()

    def finish(self, name: str, metadata: dict[str, str]) -> None:
        """Write metadata and index; the stream is the caller's to close."""
        self.flush()
        place = self._place
        record = packed(records.METADATA, name.encode(), records.packed_texts(metadata))
        self._put(record + packed(records.DATA_END, 0))
        start, summary, offsets = self._place, b'', b''
        for group in ([x.packed() for x in self._schemas], [x.packed() for x in self._channels],
                      [self._statistics()], self._chunks,
                      [packed(records.METADATA_INDEX, place, len(record), name.encode())]):
            if data := b''.join(group):
                offsets += packed(records.SUMMARY_OFFSET, data[0], start + len(summary), len(data))
                summary += data
        footer = packed(records.FOOTER, start, start + len(summary), 0)
        summary += offsets + footer[:-4]
        self._put(summary + struct.pack('<I', zlib.crc32(summary)) + records.MAGIC)
        self._stream.flush()

    def _statistics(self) -> bytes:
        first, last = self._times or (0, 0)
        return packed(
            records.STATISTICS, self._counts.total(), len(self._schemas), len(self._channels), 0,
            1, len(self._chunks), first, last, records.packed_counts(self._counts.items()))

    def _put(self, data: bytes) -> None:
        self._place += len(data)
        self._stream.write(data)

    def _append(self, record: bytes) -> None:
        """Append a record to the chunk."""
        self._content.append(record)
        self._size += len(record)

    def _begin_chunk(self) -> None:
        self._content: list[bytes] = []
        self._size = 0
        self._index: dict[int, list[tuple[int, int]]] = {}

    def _end_chunk(self) -> None:
        """Write the chunk, if there are messages in it, with their places."""
        if not self._index:
            return
        times = [t for messages in self._index.values() for t, _ in messages]
        first, last, place, size = min(times), max(times), self._place, self._size
        chunk, name, compressed_size = records.packed_chunk(b''.join(self._content), first, last)
        self._put(chunk)
        places, start = [], self._place
        for channel, messages in self._index.items():
            places.append((channel, self._place))
            self._counts[channel] += len(messages)
            self._put(packed(records.MESSAGE_INDEX, channel, b''.join(
                _PLACE.pack(*message) for message in messages)))
        self._chunks.append(packed(
            records.CHUNK_INDEX, first, last, place, len(chunk), records.packed_counts(places),
            self._place - start, name.encode(), compressed_size, size))
        self._times = [min(first, *self._times), max(last, *self._times)] if self._times else [
            first, last]
        self._begin_chunk()
