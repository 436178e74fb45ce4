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

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
import dataclasses
import os
from pathlib import Path
import time
from typing import Any, BinaryIO, NamedTuple
import zlib

from ctc_chattering.bags.bag_files import METADATA
from ctc_chattering.bags.mcap_file import QOS
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import NANOSECONDS
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk, Schema
from mcap.writer import Writer
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
        self._last: dict[str, int] = {}

    def note(self, topic: str, stamp: int) -> None:
        """Take the stamp of a message of `topic` [ns]."""
        before = self._last.get(topic, stamp + 1)
        if not self._last or (abs(stamp - self.now) > _SKEW and 0 <= stamp - before <= _SKEW):
            self.now = stamp
        elif abs(stamp - self.now) <= _SKEW:
            self.now = max(self.now, stamp)
        self._last[topic] = stamp


class SequenceTracker:
    """Follows the numbers of one topic's messages."""

    def __init__(self) -> None:
        self._next: set[int] = set()

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
        self._next.discard(before or 0)
        self._next.add(number + 1)
        return 0 if before is None else number - before


#: Age at which a file is ended and a new one begun [s]. The index of a file, about 1 kB for each
#: chunk, is in memory until the file ends.
_FILE_AGE = 600.0
#: Compression of a bag whose files and messages are not compressed as a whole.
NOT_COMPRESSED = {'compression_format': '', 'compression_mode': ''}
#: Size at which a chunk is ended [bytes]: compressing takes some times as much memory.
CHUNK_SIZE = 1 << 18


def offered_qos(depth: int, latched: bool) -> str:
    """Return the profile of a reliable publisher as a bag stores it, in YAML."""
    unlimited = {'sec': 9223372036, 'nsec': 854775807}
    return yaml.safe_dump([{
        'history': 'keep_last', 'depth': depth, 'reliability': 'reliable',
        'durability': 'transient_local' if latched else 'volatile', 'deadline': {**unlimited},
        'lifespan': {**unlimited}, 'liveliness': 'automatic',
        'liveliness_lease_duration': unlimited, 'avoid_ros_namespace_conventions': False}])


@dataclasses.dataclass
class Span:
    """Number of messages, and the first and last log time [ns]."""

    count: int = 0
    begin: int = 2 ** 63 - 1  # Of a bag without messages, as of rosbag2.
    end: int = 0

    def entry(self) -> dict[str, Any]:
        """Return the span as the metadata of a bag have it."""
        return {'message_count': self.count,
                'starting_time': {'nanoseconds_since_epoch': self.begin},
                'duration': {'nanoseconds': max(0, self.end - self.begin)}}


class RecordedTopic(NamedTuple):
    """A topic of a bag: schema and channel as in a file, and its number of messages."""

    schema: Schema
    channel: Channel
    messages: int


def write_metadata(path: Path, files: Mapping[str, Span], topics: Sequence[RecordedTopic],
                   notes: Mapping[str, str], compression: Mapping[str, str] = NOT_COMPRESSED
                   ) -> None:
    """
    Write the metadata of a bag.

    Parameters
    ----------
    path : Path
        File to write.
    files : mapping of str to Span
        Names of the files of the bag, in the order of their times.
    topics : sequence of RecordedTopic
        Topics of all files.
    notes : mapping of str to str
        Remarks on the recording.
    compression : mapping of str to str
        Its mode and format, under the keys that metadata have for them.

    """
    spans = files.values()
    whole = Span(sum(x.count for x in spans), min(x.begin for x in spans),
                 max(x.end for x in spans))
    information = {
        'version': 9, 'storage_identifier': 'mcap', 'ros_distro': 'jazzy', **whole.entry(),
        'relative_file_paths': list(files),
        'files': [{'path': name, **span.entry()} for name, span in files.items()],
        'topics_with_message_count': [{
            'message_count': x.messages, 'topic_metadata': {
                'name': x.channel.topic, 'type': x.schema.name,
                'serialization_format': x.channel.message_encoding,
                'offered_qos_profiles': yaml.safe_load(x.channel.metadata[QOS] or '[]'),
                'type_description_hash': x.channel.metadata.get('topic_type_hash', '')}}
            for x in topics],
        **compression, 'custom_data': dict(notes) or None}
    # Keys are sorted: of metadata that are cut off, the version is missing.
    path.write_text(
        yaml.safe_dump({'rosbag2_bagfile_information': information}), encoding='utf-8')


class BagWriter:
    """
    A bag being written.

    When the disk takes no more, `write`, `flush` or `close` raises an `OSError`; `abandon` is all
    that is left to do then.

    Parameters
    ----------
    path : Path
        Directory to create.

    Attributes
    ----------
    path, file : Path
        As given, and the file that is being written.
    topics : dict
        What is known of each topic; the numbers in the records do not matter.
    counts : Counter
        Number of messages by topic.
    notes : dict
        What the bag's metadata say of the recording.

    Raises
    ------
    CtcError
        If it exists or cannot be made.

    """

    def __init__(self, path: Path) -> None:
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self.topics: dict[str, tuple[Schema, Channel]] = {}
        self.notes: dict[str, str] = {}
        self._files: dict[str, Span] = {}
        #: Of topics that are new since the last flush.
        self._descriptions = b''
        self.counts: Counter[str] = Counter()
        self.path = path
        # A slow disk takes seconds for what it is asked to keep.
        self._pool = ThreadPoolExecutor(1)
        self._sync: Future[None] = Future()
        self._sync.set_result(None)
        try:
            path.mkdir(parents=True)
            self._begin_file()
        except FileExistsError:
            raise CtcError(f'{path}: exists already, not overwritten') from None
        except OSError as error:
            raise CtcError(f'{path}: {error.strerror or error}') from None

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
        if topic not in self.topics:
            definition, _ = self._store.generate_msgdef(kind, ros_version=2)
            metadata = {QOS: qos, 'topic_type_hash': self._store.hash_rihs01(kind)}
            self.topics[topic] = (Schema(0, definition.encode(), 'ros2msg', kind),
                                  Channel(0, topic, 'cdr', metadata, 0))
        self.add_message(topic, t, data)

    def add_message(self, topic: str, t: int, data: bytes) -> None:
        """Add a message of one of `topics` with log time `t` [ns]."""
        number = self._numbers.get(topic) or self._add_channel(*self.topics[topic])
        self._writer.add_message(number, t, data, t)
        self.counts[topic] += 1
        span = self._span
        span.count += 1
        span.begin, span.end = min(t, span.begin), max(t, span.end)

    def flush(self) -> None:
        """
        Write all out, so that it can be read even if this process is killed.

        The disk is asked to keep it, too. What comes of that is raised by a later call, as
        `OSError`; as long as the disk takes, no more is asked of it, while writing goes on.
        """
        self._writer.flush()
        self._stream.write(self._descriptions)
        self._stream.flush()
        self._descriptions = b''
        if self._sync.done():
            self._sync.result()
            self._sync = self._pool.submit(os.fsync, self._stream.fileno())
        if time.monotonic() - self._begun >= _FILE_AGE:
            self._end_file()
            self._begin_file()

    def abandon(self) -> None:
        """Close without index and metadata: the disk takes no more."""
        for action in (self._sync.result, self._stream.close,
                       (self.path / METADATA).unlink):
            with suppress(OSError):
                action()

    def close(self) -> None:
        """Write index and metadata; without them, tools cannot open the bag."""
        self._end_file()
        topics = [RecordedTopic(schema, channel, self.counts[topic])
                  for topic, (schema, channel) in self.topics.items()]
        write_metadata(self.path / METADATA, self._files, topics, self.notes)

    def _begin_file(self) -> None:
        """Begin a file, named as the recorder of ROS names it."""
        self.file = self.path / f'{self.path.name}_{len(self._files)}.mcap'
        self._span = self._files[self.file.name] = Span()
        self._numbers: dict[str, int] = {}
        self._begun: float = time.monotonic()
        self._stream: BinaryIO = self.file.open('xb')
        self._writer: Any = Writer(self._stream, chunk_size=CHUNK_SIZE)
        self._writer.start('ros2', 'ctc_chattering')

    def _end_file(self) -> None:
        """Write the index of a file."""
        self._writer.finish()
        self._stream.flush()
        self._sync.result()
        self._stream.close()

    def _add_channel(self, schema: Schema, channel: Channel) -> int:
        """
        Describe a topic in the file; return its number.

        The first chunk with messages of a topic has its description. A damaged chunk must not take
        it along: it is in chunks without messages on both sides of that chunk as well.
        """
        kind = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        number = self._writer.register_channel(channel.topic, 'cdr', kind, channel.metadata)
        records: Any = RecordBuilder()
        dataclasses.replace(schema, id=kind).write(records)
        dataclasses.replace(channel, id=number, schema_id=kind).write(records)
        data = records.end()
        Chunk('', data, 0, 0, zlib.crc32(data), len(data)).write(records)
        description = records.end()
        self._stream.write(description)
        self._descriptions += description
        self._numbers[channel.topic] = number
        return int(number)
