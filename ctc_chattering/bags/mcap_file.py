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
The messages of an MCAP file, whatever bytes of it are wrong.

A record is accepted if its length is exactly that of its fields. Behind wrong bytes, the next one
is looked for byte by byte; what a chunk contains has a checksum. Schemas and channels are taken
from everywhere, first of all from where a checksum covers them. What has none is left out if it
borders on wrong bytes: these may begin in it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
import hashlib
import mmap
from pathlib import Path
import re
import struct
from typing import Any, NamedTuple
import zlib

from ctc_chattering.bags import mcap_records as records
from ctc_chattering.bags.mcap_records import Channel, record_end, Schema, walk
from ctc_chattering.bags.qos import named_policies
from ctc_chattering.bags.writer import LIBRARY, TopicType
from ctc_chattering.errors import CtcError

_IN_CHUNKS = re.compile(rb'[\x03\x04\x06\x0f](?=.{5}\0\0\0)', re.DOTALL)
#: The same in a file without chunks, with the beginning of a serialized message.
_OUTSIDE = re.compile(
    rb'[\x03\x04\x0f](?=.{5}\0\0\0)|\x05(?=.{5}\0\0\0.{22}\0[\0-\x0b])', re.DOTALL)
_CHUNK_START = re.compile(rb'\x06(?=.{5}\0\0\0)', re.DOTALL)
_COMPRESSIONS = ('', 'lz4', 'zstd')
#: Latest time that a bag can have [ns].
_LATEST = 2 ** 63 - 1


class Found(NamedTuple):
    """A message: topic, type, log time [ns], data; its number among those of the topic, or 0."""

    topic: str
    kind: TopicType
    t: int
    data: bytes
    number: int


class McapFile:
    """
    One file.

    Parameters
    ----------
    path : Path
        Where it is.

    Attributes
    ----------
    lost : int
        Bytes that could not be read; complete after `messages`.
    repeated : int
        Chunks that stood there before; complete after `messages`.

    """

    def __init__(self, path: Path) -> None:
        self.lost = self.repeated = 0
        with path.open('rb') as stream:
            self._data: Any = mmap.mmap(
                stream.fileno(), 0, access=mmap.ACCESS_READ) if path.stat().st_size else b''
        self._chunked = any(record_end(self._data, x.start())
                            for x in _CHUNK_START.finditer(self._data))
        self._records: dict[tuple[type, int], tuple[Any, bool]] = {}
        self._topics: dict[int, tuple[str, TopicType] | None] = {}
        self._counts: dict[int, int] | None = None
        self._numbered = False
        self._survey()

    @property
    def counts(self) -> dict[str, int] | None:
        """Return the number of messages by topic, as the index has it; None without it."""
        if self._counts is None:
            return None
        counts = Counter[str]()
        for channel, count in self._counts.items():
            topic = self._topic(channel)
            if topic is None:
                return None
            counts[topic[0]] += count
        return counts

    def messages(self, seen: set[bytes]) -> Iterator[Found]:
        """
        Yield the messages in the order of the file.

        Parameters
        ----------
        seen : set of bytes
            Digests of the chunks met so far, which are left out; those of this file are added.

        """
        for begin, end, is_safe in self._spans():
            if self._data[begin] == records.CHUNK:
                yield from self._in_chunk(self._data[begin:end], is_safe, seen)
            elif self._data[begin] == records.MESSAGE:
                if self._chunked or not is_safe:  # In chunked files, it is of a damaged chunk.
                    self.lost += end - begin
                else:
                    yield from self._message(self._data[begin + records.START.size:end])

    def _spans(self) -> Iterator[tuple[int, int, bool]]:
        """Yield begin and end of chunks, and of records outside; whether no wrong byte follows."""
        data, place = self._data, len(records.MAGIC)
        end = record_end(data, place)
        while not self._is_end(place):
            if end:
                following = record_end(data, end)
                yield place, end, following > 0 or self._is_end(end)
                place, end = end, following
            else:
                place = self._resumed(place + 1)
                end = record_end(data, place)

    def _is_end(self, place: int) -> bool:
        """Return whether the file ends at a place."""
        rest: bytes = self._data[place:place + len(records.MAGIC) + 1]
        return rest in (b'', records.MAGIC)

    def _resumed(self, place: int) -> int:
        """Return where the first record behind wrong bytes begins; the end if there is none."""
        data = self._data
        for match in (_IN_CHUNKS if self._chunked else _OUTSIDE).finditer(data, place):
            end = record_end(data, match.start())
            if end and (data[match.start()] != records.MESSAGE or record_end(data, end)):
                return match.start()
        return len(data)

    def _survey(self) -> None:
        """Find what says what the messages are, and how many; count the bytes between records."""
        data, index, is_sure = self._data, False, False
        before = min(len(records.MAGIC), len(data))
        for begin, end, is_safe in self._spans():
            self.lost, before, opcode = self.lost + begin - before, end, data[begin]
            if opcode == records.HEADER:
                self._numbered = data[begin:end].endswith(LIBRARY.encode())
            elif opcode == records.DATA_END:
                index, is_sure = True, _is_right(data, end)
            elif opcode in (records.SCHEMA, records.CHANNEL) and (is_safe or is_sure):
                self._note(data[begin:end], is_sure)
            elif opcode == records.STATISTICS and index:
                total, *_, found = records.fields(data, begin)
                if sum(records.counts(found).values()) == total:
                    self._counts = records.counts(found)
        self.lost += 0 if self._is_end(before) else len(data) - before

    def _note(self, data: bytes, is_sure: bool) -> None:
        """Take a schema or channel; of two that contradict each other the sure one, or none."""
        record = _description(data)
        if record is None:
            return
        key = type(record), record.number
        known, was_sure = self._records.get(key, (record, False))
        if is_sure or not was_sure:
            self._records[key] = (record if is_sure or known == record else None, is_sure)
            self._topics.clear()

    def _topic(self, channel: int) -> tuple[str, TopicType] | None:
        """Return topic and type of a channel; None if they are not known."""
        if channel not in self._topics:
            self._topics[channel] = self._described(channel)
        return self._topics[channel]

    def _described(self, channel: int) -> tuple[str, TopicType] | None:
        """Return topic and type of a channel from its record and the schema's."""
        record, _ = self._records.get((Channel, channel), (None, False))
        schema, _ = self._records.get((Schema, record.schema if record else 0), (None, False))
        if record is None or schema is None:
            return None
        profiles = named_policies(record.metadata.get('offered_qos_profiles', ''))
        return record.topic, TopicType(schema.name, schema.encoding, schema.data, {
            **record.metadata, 'offered_qos_profiles': profiles})

    def _in_chunk(self, chunk: bytes, is_safe: bool, seen: set[bytes]) -> Iterator[Found]:
        """Yield the messages of a chunk, all or none."""
        content = _content(chunk, is_safe)
        digest = hashlib.sha256(content or b'').digest()
        spans = list(walk(content)) if content else []
        if content is None or not spans or spans[-1][1] != len(content):
            self.lost += len(records.fields(chunk)[-1])
            return
        if digest in seen:
            self.repeated += 1
            return
        seen.add(digest)
        for begin, end in spans:
            if content[begin] in (records.SCHEMA, records.CHANNEL):
                self._note(content[begin:end], records.fields(chunk)[3] != 0)
            elif content[begin] == records.MESSAGE:
                yield from self._message(content[begin + records.START.size:end])

    def _message(self, body: bytes) -> Iterator[Found]:
        """Yield a message, if it has a type and a possible time."""
        channel, number, t, _ = records.MESSAGE_START.unpack_from(body)
        topic, data = self._topic(channel), body[records.MESSAGE_START.size:]
        if topic is None or t > _LATEST:
            self.lost += len(data)
        else:
            yield Found(*topic, t, data, number if self._numbered else 0)


def _description(data: bytes) -> Schema | Channel | None:
    """Return a schema or channel; None if it cannot be read."""
    try:
        return (records.read_schema if data[0] == records.SCHEMA else records.read_channel)(data)
    except (UnicodeDecodeError, struct.error):
        return None


def _content(chunk: bytes, is_safe: bool) -> bytes | None:
    """Return what a chunk contains; None if it is damaged, or may be and has no checksum."""
    try:
        content = records.chunk_content(chunk)
    except CtcError:
        raise
    except Exception:  # A damaged chunk may raise any exception.
        return None
    return content if is_safe or records.fields(chunk)[3] else None


def _is_right(data: Any, start: int) -> bool:
    """Return whether the index from `start` on has the checksum that stands at its end."""
    end = len(data) - len(records.MAGIC) - 4
    written = int.from_bytes(data[end:end + 4], 'little')
    return written != 0 and start < end and zlib.crc32(data[start:end]) == written
