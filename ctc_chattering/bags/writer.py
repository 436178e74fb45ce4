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
Writing a rosbag2 bag: MCAP by `mcap`, with message definitions and QoS in it.

Also what a recorder knows of the messages that arrive: their log time, and how many were lost
before. Several publishers of one topic number their messages each for itself, and do not say who
they are. What each of them would send next is remembered, also of those that have gone.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
import dataclasses
import os
from pathlib import Path
import time
from typing import Any, BinaryIO, NamedTuple

from ctc_chattering.bags.bag import is_readable
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import NANOSECONDS
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Schema
from mcap.writer import Writer
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos
from rosbags.typesys import get_typestore, Stores
import yaml

#: Largest difference between the stamps of two topics that is no jump of time [ns].
_SKEW = NANOSECONDS


class LogTime:
    """
    Follows the stamps of several topics, and does not go back because one of them is ahead.

    A bag is read in the order of its log times, so they must not decrease if the order of arrival
    is to be preserved. A jump of time, as when a simulation restarts, is accepted when the next
    message of that topic follows it.

    Attributes
    ----------
    now : int
        The time [ns].

    """

    def __init__(self) -> None:
        self.now = 0
        self._begun = False
        self._jumps: dict[str, int] = {}

    def note(self, topic: str, stamp: int) -> None:
        """Take the stamp of a message of `topic` [ns]."""
        jump = self._jumps.pop(topic, None)
        if not self._begun:
            self._begun = True
            self.now = stamp
        elif abs(stamp - self.now) <= _SKEW:
            self.now = max(self.now, stamp)
        elif jump is not None and 0 <= stamp - jump <= _SKEW:
            self.now = stamp
        else:
            self._jumps[topic] = stamp


#: Publishers that are remembered.
_MANY = 16


class SequenceTracker:
    """Follows the numbers of one topic's messages."""

    def __init__(self) -> None:
        self._next: dict[int, None] = {}

    def lost(self, number: int, publishers: Callable[[], int]) -> int:
        """
        Return how many messages are missing before one.

        Parameters
        ----------
        number : int
            The publisher's number of the message.
        publishers : callable
            Returns how many there are now. With several, it is not known whose message is
            missing, and a number never seen may be a new publisher's; then it is 0.

        """
        before = number if number in self._next else None
        if before is None and publishers() == 1:
            before = max((x for x in self._next if x < number), default=None)
        if before is not None:
            del self._next[before]
        self._next[number + 1] = None
        if len(self._next) > _MANY:
            del self._next[next(iter(self._next))]
        return 0 if before is None else number - before


#: Age at which a file is ended and a new one begun [s]. The index of a file, about 1 kB for each
#: chunk, is in memory until the file ends.
_FILE_AGE = 600.0
#: Size at which a chunk is ended [bytes]: compressing takes some times as much memory.
_CHUNK = 1 << 18
#: Name of an attachment with the schemas and channels of the chunk beside it.
DESCRIPTIONS = 'descriptions'
#: The time at which a bag without messages begins [ns].
_NEVER = 2 ** 63 - 1


def offered_qos(depth: int, latched: bool) -> str:
    """Return the profile of a reliable publisher as a bag stores it, in YAML."""
    unlimited = {'sec': 9223372036, 'nsec': 854775807}
    return yaml.safe_dump([{
        'history': 'keep_last', 'depth': depth, 'reliability': 'reliable',
        'durability': 'transient_local' if latched else 'volatile', 'deadline': {**unlimited},
        'lifespan': {**unlimited}, 'liveliness': 'automatic',
        'liveliness_lease_duration': unlimited, 'avoid_ros_namespace_conventions': False}])


class TopicType(NamedTuple):
    """The type of a topic's messages with its definition, and the channel's metadata."""

    kind: str
    encoding: str
    definition: bytes
    metadata: dict[str, str]

    @property
    def schema(self) -> tuple[str, str, bytes]:
        """Name, encoding and definition of the type; both empty if readers do not know it."""
        definition = self.encoding, self.definition
        return (self.kind, *(definition if is_readable(self.kind, *definition) else ('', b'')))

    @property
    def profiles(self) -> list[Any]:
        """Profiles of the publishers, with names of their policies; none if they are damaged."""
        try:
            return dump_qos_v9(parse_qos(self.metadata.get('offered_qos_profiles', '')))
        except Exception:  # Of arbitrary text, any.
            return []


@dataclasses.dataclass
class Span:
    """Number of messages, and the first and last log time [ns]."""

    count: int = 0
    begin: int = _NEVER
    end: int = 0

    def entry(self) -> dict[str, Any]:
        """Return the span as the metadata of a bag have it."""
        return {'message_count': self.count,
                'starting_time': {'nanoseconds_since_epoch': self.begin},
                'duration': {'nanoseconds': max(0, self.end - self.begin)}}


class _Sync:
    """Has the disk take what a file holds, in a thread of its own: a slow one takes seconds."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1)
        self._last: Future[None] | None = None

    def begin(self, file: int) -> None:
        """Begin, unless the last call is still at work; raise what came of that one."""
        if self._last is None or self._last.done():
            self.end()
            self._last = self._pool.submit(os.fsync, file)

    def end(self) -> None:
        """Wait for the last call, and raise what came of it."""
        last, self._last = self._last, None
        if last is not None:
            last.result()


class BagWriter:
    """
    A bag being written.

    When the disk is full, `write`, `flush` or `close` raises an `OSError`, once; the bag is closed
    then, with what was written before, and later calls do nothing.

    Parameters
    ----------
    path : Path
        Directory to create.
    clock : callable
        Returns the time that the age of a file is measured by [s].

    Attributes
    ----------
    file : Path
        The file that is being written.
    counts : dict
        Number of messages by topic.

    Raises
    ------
    CtcError
        If it exists or cannot be made.

    """

    def __init__(self, path: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._types: dict[str, TopicType] = {}
        self._custom: dict[str, str] = {}
        self._spans: dict[str, Span] = {}
        self.counts: dict[str, int] = {}
        self.path = path
        self._sync = _Sync()
        try:
            path.mkdir(parents=True)
            self._begin_file()
        except FileExistsError:
            raise CtcError(f'{path}: exists already, not overwritten') from None
        except OSError as error:
            raise CtcError(f'{path}: {error.strerror or error}') from None

    @property
    def span(self) -> Span:
        """Return the number of all messages, and the first and last log time."""
        spans = self._spans.values()
        return Span(sum(x.count for x in spans), min(x.begin for x in spans),
                    max(x.end for x in spans))

    def write(self, topic: str, kind: str, t: int, data: bytes, qos: str) -> None:
        """
        Add a message.

        Parameters
        ----------
        topic, kind : str
            Full name and message type.
        t : int
            Log time [ns].
        data : bytes
            Serialized message.
        qos : str
            What the publishers offer; used for the first message of a topic.

        """
        if topic not in self._types:
            definition, _ = self._store.generate_msgdef(kind, ros_version=2)
            self.add_topic(topic, TopicType(
                kind, 'ros2msg', definition.encode(),
                {'offered_qos_profiles': qos, 'topic_type_hash': self._store.hash_rihs01(kind)}))
        self.add_message(topic, t, data)

    def add_topic(self, topic: str, kind: TopicType) -> None:
        """Say what the messages of a topic are."""
        self._types[topic] = kind
        self.counts[topic] = 0

    def add_message(self, topic: str, t: int, data: bytes) -> None:
        """Add a message of a topic that `add_topic` was called for, with log time `t` [ns]."""
        if self._stream.closed:
            return
        try:
            if self._flushed - self._begun >= _FILE_AGE:
                self._end_file()
                self._begin_file()
            channel = self._channels.get(topic) or self._add_channel(topic)
            number = (self.counts[topic] + 1) & 0xffffffff
            self._writer.add_message(channel, t, data, t, number)
        except OSError:
            self.abandon()
            raise
        span = self._span
        span.count += 1
        span.begin, span.end = min(t, span.begin), max(t, span.end)
        self.counts[topic] += 1

    def note(self, key: str, value: str) -> None:
        """Have the bag's metadata say something about the recording."""
        self._custom[key] = value

    def flush(self) -> None:
        """
        Write all out, so that it can be read even if this process is killed.

        The disk is asked to keep it, too. What comes of that is raised by a later call, as
        `OSError`; as long as the disk takes, no more is asked of it, while writing goes on.
        """
        if self._stream.closed:
            return
        try:
            # The first chunk with messages of a topic has its type. A damaged chunk must not take
            # it along: it stands on both sides of that chunk as well.
            descriptions = self._descriptions.end()
            self._describe(descriptions)
            self._writer.flush()
            self._describe(descriptions)
            self._stream.flush()
            self._sync.begin(self._stream.fileno())
            self._flushed = self._clock()
        except OSError:
            self.abandon()
            raise

    def abandon(self) -> None:
        """Close without index and metadata: the disk takes no more."""
        for action in (self._sync.end, self._stream.close,
                       (self.path / 'metadata.yaml.tmp').unlink):
            with suppress(OSError):
                action()

    def close(self) -> None:
        """Write index and metadata; without them, tools cannot open the bag."""
        if self._stream.closed:
            return
        try:
            self._end_file()
            file = self.path / 'metadata.yaml.tmp'
            # Keys are sorted: of metadata that are cut off, the version is missing.
            file.write_text(yaml.safe_dump(
                {'rosbag2_bagfile_information': self._information()}), encoding='utf-8')
            file.replace(self.path / 'metadata.yaml')
        except OSError:
            self.abandon()
            raise

    def _begin_file(self) -> None:
        """Begin a file, named as the recorder of ROS names it."""
        self.file = self.path / f'{self.path.name}_{len(self._spans)}.mcap'
        self._span = self._spans[self.file.name] = Span()
        self._channels: dict[str, int] = {}
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._begun = self._flushed = self._clock()
        #: Of topics that are new since the last flush.
        self._descriptions: Any = RecordBuilder()
        self._stream: BinaryIO = self.file.open('xb')
        self._writer: Any = Writer(self._stream, chunk_size=_CHUNK)
        self._writer.start('ros2', 'ctc_chattering')

    def _describe(self, descriptions: bytes) -> None:
        """Write schemas and channels, if there are any, with a checksum."""
        if descriptions:
            self._writer.add_attachment(0, 0, DESCRIPTIONS, 'application/mcap', descriptions)

    def _end_file(self) -> None:
        """Write the index of a file."""
        self._writer.add_metadata(
            'rosbag2', {'serialized_metadata': yaml.safe_dump(self._information())})
        self._writer.finish()
        self._stream.flush()
        self._sync.end()
        self._stream.close()

    def _add_channel(self, topic: str) -> int:
        """Describe a topic in the file; return its number."""
        kind = self._types[topic]
        metadata = {**kind.metadata,
                    'offered_qos_profiles': yaml.safe_dump(kind.profiles) if kind.profiles else ''}
        schema = self._schemas.get(kind.schema)
        if schema is None:
            name, encoding, definition = kind.schema
            schema = self._writer.register_schema(name, encoding, definition)
            self._schemas[kind.schema] = schema
            Schema(schema, definition, encoding, name).write(self._descriptions)
        channel: int = self._writer.register_channel(topic, 'cdr', schema, metadata)
        Channel(channel, topic, 'cdr', metadata, schema).write(self._descriptions)
        self._channels[topic] = channel
        return channel

    def _information(self) -> dict[str, Any]:
        """Return the metadata of the bag as the recorder of ROS writes them."""
        return {
            'version': 9, 'storage_identifier': 'mcap', 'ros_distro': 'jazzy', **self.span.entry(),
            'relative_file_paths': list(self._spans),
            'files': [{'path': name, **span.entry()} for name, span in self._spans.items()],
            'topics_with_message_count': [
                {'topic_metadata': _topic_metadata(topic, self._types[topic]),
                 'message_count': count} for topic, count in self.counts.items()],
            'compression_format': '', 'compression_mode': '', 'custom_data': self._custom or None}


def _topic_metadata(topic: str, kind: TopicType) -> dict[str, Any]:
    return {'name': topic, 'type': kind.kind, 'serialization_format': 'cdr',
            'offered_qos_profiles': kind.profiles,
            'type_description_hash': kind.metadata.get('topic_type_hash', '')}
