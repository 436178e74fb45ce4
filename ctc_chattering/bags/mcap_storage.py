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

"""The MCAP files of bags, with or without index."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
import mmap
from operator import itemgetter
from pathlib import Path
from typing import Any

from ctc_chattering.bags import mcap_records as records
from ctc_chattering.bags.mcap_records import Channel, Schema
from ctc_chattering.bags.qos import profiles
from ctc_chattering.bags.storage import Connection, Key, Message, Storage

_START = records.START.size
_NO_SCHEMA = Schema(0, 'none', '', b'')


class McapStorage(Storage):
    """
    An MCAP file; messages outside chunks come in the order of the file.

    Raises
    ------
    ValueError
        If it is empty, cut off, or its index has another checksum.

    """

    def __init__(self, path: Path) -> None:
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        #: First log time [ns], place, and, if known, channels of each chunk.
        self._chunks: list[tuple[int, int, frozenset[int] | None]] = []
        self._counts: Counter[int] = Counter()
        self._times: list[int] = []
        if not path.stat().st_size:
            raise ValueError('is empty')
        with path.open('rb') as stream:
            self._data: Any = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        try:
            self._read_index(records.summary_place(self._data))
            self.connections = [self._connection(x) for x in self._channels.values()]
        except Exception:
            self.close()
            raise
        self.span = (self._times[0], self._times[1]) if self._counts.total() else None

    def close(self) -> None:
        """Close the file."""
        self._data.close()

    def _read_index(self, start: int) -> None:
        """Read the index; the whole file where there is none, or not all that is needed."""
        chunks = None
        for place in _places(self._data, start) if start else ():
            if self._data[place] == records.CHUNK_INDEX:
                first, _, at, _, places, *_ = records.fields(self._data, place)
                self._chunks.append((first, at, frozenset(records.counts(places)) or None))
            elif self._data[place] == records.STATISTICS:
                *_, chunks, first, last, counts = records.fields(self._data, place)
                self._times = [first, last]
                self._counts.update(records.counts(counts))
            else:
                self._note(self._data, place)
        if (chunks != len(self._chunks) or not self._counts.keys() <= self._channels.keys()
                or any(x.schema not in self._schemas for x in self._channels.values())):
            self._scan()
        self._chunks.sort(key=itemgetter(0, 1))

    def _scan(self) -> None:
        """Read the whole file for what is in it."""
        self._chunks.clear()
        self._counts.clear()
        self._times.clear()
        for place in _places(self._data, len(records.MAGIC)):
            if self._data[place] == records.CHUNK:
                self._chunks.append((records.fields(self._data, place)[0], place, None))
                content = records.chunk_content(self._data, place)
                for inner in _places(content):
                    self._note(content, inner)
            else:
                self._note(self._data, place)

    def _note(self, data: Any, place: int) -> None:
        """Count a message, or describe what others are."""
        if data[place] == records.MESSAGE:
            channel, _, t, _ = records.MESSAGE_START.unpack_from(data, place + _START)
            self._counts[channel] += 1
            self._times = [min(t, *self._times), max(t, *self._times)] if self._times else [t, t]
        elif data[place] == records.SCHEMA:
            schema = records.read_schema(data, place)
            self._schemas[schema.number] = schema
        elif data[place] == records.CHANNEL:
            channel = records.read_channel(data, place)
            self._channels[channel.number] = channel

    def _connection(self, channel: Channel) -> Connection:
        schema = self._schemas.get(channel.schema, _NO_SCHEMA)
        return Connection(
            channel.topic, schema.name, self._counts[channel.number], schema.encoding,
            schema.data.decode(errors='replace'), profiles(channel.metadata.get(
                'offered_qos_profiles', '')), channel.encoding)

    def messages(self, keys: Collection[Key]) -> Iterator[Message]:
        """Yield topic and type, log time [ns] and data of some topics, in the order of time."""
        wanted = {number: connection.key for number, connection in zip(
            self._channels, self.connections) if connection.key in keys}
        chunks = [x for x in self._chunks if x[2] is None or not x[2].isdisjoint(wanted)]
        waiting: list[Message] = []
        for (_, place, _), later in zip(chunks, [*chunks[1:], None]):
            waiting += _messages(records.chunk_content(self._data, place), wanted)
            waiting.sort(key=itemgetter(1))
            ready = bisect_left(waiting, later[0], key=itemgetter(1)) if later else len(waiting)
            yield from waiting[:ready]
            del waiting[:ready]
        if not self._chunks:
            yield from _messages(self._data, wanted, len(records.MAGIC))


def _places(data: Any, place: int = 0) -> Iterator[int]:
    """Yield where records begin, of whatever kind."""
    end = len(data) - (len(records.MAGIC) if place else 0)
    while place < end:
        yield place
        _, length = records.START.unpack_from(data, place)
        place += _START + length
    if place != end:
        raise ValueError(f'the last record ends {place - end} bytes too late')


def _messages(data: Any, wanted: Mapping[int, Key], start: int = 0) -> Iterator[Message]:
    """Yield messages of some channels."""
    for place in _places(data, start):
        if data[place] == records.MESSAGE:
            begin = place + _START
            channel, _, t, _ = records.MESSAGE_START.unpack_from(data, begin)
            if channel in wanted:
                _, length = records.START.unpack_from(data, place)
                yield (wanted[channel], t,
                       data[begin + records.MESSAGE_START.size:begin + length])
