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
Writing a rosbag2 bag as MCAP.

`nodes/recorder.py` writes with a `BagWriter`, `repair.py` writes metadata. A file is cut into
chunks with checksums, which `flush` brings to the disk, so that a killed recorder loses little.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
import dataclasses
import os
from pathlib import Path
import time
from typing import Any, BinaryIO, NamedTuple
import zlib

from ctc_chattering.bags.bag_files import METADATA, Span
from ctc_chattering.bags.mcap_file import QOS
from ctc_chattering.errors import CtcError
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk, Schema
from mcap.writer import Writer
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2.metadata import dump_qos_v9
from rosbags.typesys import get_typestore, Stores
import yaml

#: After this time a new file begins. The index of a file, about 1 kB for each chunk, stays in
#: memory until its end.
_MAX_FILE_AGE_S = 600.0
#: Compression of a bag whose files and messages are not compressed as a whole.
NOT_COMPRESSED = {'compression_format': '', 'compression_mode': ''}
#: Size of a full chunk. Compressing takes some times as much memory.
CHUNK_SIZE_BYTES = 1 << 18
#: Duration without a limit, as ROS 2 writes it.
_UNLIMITED = QosTime(9223372036, 854775807)


def offered_qos(depth: int, latched: bool) -> str:
    """Return the QoS of a reliable publisher as YAML."""
    durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
    profile = Qos(
        QosHistory.KEEP_LAST,
        depth,
        QosReliability.RELIABLE,
        durability,
        deadline=_UNLIMITED,
        lifespan=_UNLIMITED,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=_UNLIMITED,
        avoid_ros_namespace_conventions=False)
    return yaml.safe_dump(dump_qos_v9([profile]))


class RecordedTopic(NamedTuple):
    """Schema and channel of a topic, and its messages' number."""

    schema: Schema
    channel: Channel
    messages: int = 0


def _entry(span: Span) -> dict[str, Any]:
    """Return a span as metadata have it."""
    return {
        'message_count': span.count,
        'starting_time': {'nanoseconds_since_epoch': span.begin},
        'duration': {'nanoseconds': max(0, span.end - span.begin)}}


def _topic_metadata(topic: RecordedTopic) -> dict[str, Any]:
    """Return name, type and QoS of a topic as metadata have it."""
    channel = topic.channel
    return {
        'name': channel.topic,
        'type': topic.schema.name,
        'serialization_format': channel.message_encoding,
        'offered_qos_profiles': yaml.safe_load(channel.metadata[QOS] or '[]'),
        'type_description_hash': channel.metadata.get('topic_type_hash', '')}


def write_metadata(
        path: Path,
        files: Mapping[str, Span],
        topics: Sequence[RecordedTopic],
        notes: Mapping[str, str],
        compression: Mapping[str, str] = NOT_COMPRESSED) -> None:
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
        Mode and format, under their keys in the metadata.

    """
    spans = files.values()
    bag = Span(
        sum(x.count for x in spans),
        min(x.begin for x in spans),
        max(x.end for x in spans))
    information = {
        'version': 9,
        'storage_identifier': 'mcap',
        'ros_distro': 'jazzy',
        **_entry(bag),
        'relative_file_paths': list(files),
        'files': [{'path': name, **_entry(span)} for name, span in files.items()],
        'topics_with_message_count': [
            {'message_count': x.messages, 'topic_metadata': _topic_metadata(x)} for x in topics],
        **compression,
        'custom_data': dict(notes) or None}
    # Keys are sorted, so the version is last: it is missing where the file is cut off.
    path.write_text(
        yaml.safe_dump({'rosbag2_bagfile_information': information}), encoding='utf-8')


class BagWriter:
    """
    Bag that is being written.

    When the disk takes no more, `write`, `flush` or `close` raises an `OSError`. Only `abandon`
    may be called then.

    Parameters
    ----------
    path : Path
        Directory to create.

    Attributes
    ----------
    path : Path
        Directory.
    file : Path
        File that is being written.
    topics : dict
        Schema and channel of each topic. Their numbers do not matter.
    counts : Counter
        Number of messages by topic.
    notes : dict
        Remarks on the recording, for the metadata.

    Raises
    ------
    CtcError
        If it exists or cannot be created.

    """

    def __init__(self, path: Path) -> None:
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self.topics: dict[str, RecordedTopic] = {}
        self.notes: dict[str, str] = {}
        self._files: dict[str, Span] = {}
        #: Chunks that describe the topics added since the last flush.
        self._descriptions = b''
        self.counts: Counter[str] = Counter()
        self.path = path
        # Another thread waits for fsync, which takes seconds on a slow disk.
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

    def write(self, topic: str, message_type: str, t: int, data: bytes, qos: str) -> None:
        """
        Add a message, and its topic if new.

        Parameters
        ----------
        topic : str
            Full name.
        message_type : str
            Type of the message.
        t : int
            Log time [ns].
        data : bytes
            Serialized message.
        qos : str
            QoS that the publishers offer. That of the first message of a topic is used.

        """
        if topic not in self.topics:
            definition, _ = self._store.generate_msgdef(message_type, ros_version=2)
            metadata = {QOS: qos, 'topic_type_hash': self._store.hash_rihs01(message_type)}
            self.topics[topic] = RecordedTopic(
                Schema(0, definition.encode(), 'ros2msg', message_type),
                Channel(0, topic, 'cdr', metadata, 0))
        number = self._numbers.get(topic) or self._add_channel(self.topics[topic])
        self._writer.add_message(number, t, data, t)
        self.counts[topic] += 1
        span = self._span
        span.count += 1
        span.begin = min(t, span.begin)
        span.end = max(t, span.end)

    def flush(self) -> None:
        """
        Write all out, so that a killed process loses nothing.

        The disk is also asked to keep it (fsync), one request at a time, while writing goes on. An
        `OSError` of that is raised by a later call.
        """
        self._writer.flush()
        self._stream.write(self._descriptions)
        self._stream.flush()
        self._descriptions = b''
        if self._sync.done():
            self._sync.result()
            self._sync = self._pool.submit(os.fsync, self._stream.fileno())
        if time.monotonic() - self._begun >= _MAX_FILE_AGE_S:
            self._end_file()
            self._begin_file()

    def abandon(self) -> None:
        """Close without index and metadata, on a full disk."""
        for action in (self._sync.result, self._stream.close,
                       (self.path / METADATA).unlink):
            with suppress(OSError):
                action()

    def close(self) -> None:
        """Write index and metadata, which other tools need."""
        self._end_file()
        topics = [x._replace(messages=self.counts[name]) for name, x in self.topics.items()]
        write_metadata(self.path / METADATA, self._files, topics, self.notes)

    def _begin_file(self) -> None:
        """Begin a file, named as ROS does it."""
        self.file = self.path / f'{self.path.name}_{len(self._files)}.mcap'
        self._span = self._files[self.file.name] = Span()
        self._numbers: dict[str, int] = {}
        self._begun: float = time.monotonic()
        self._stream: BinaryIO = self.file.open('xb')
        self._writer: Any = Writer(self._stream, chunk_size=CHUNK_SIZE_BYTES)
        self._writer.start('ros2', 'ctc_chattering')

    def _end_file(self) -> None:
        """Write the index of a file."""
        self._writer.finish()
        self._stream.flush()
        self._sync.result()
        self._stream.close()

    def _add_channel(self, topic: RecordedTopic) -> int:
        """
        Describe a topic in the file and return its number.

        The first chunk with messages of a topic has its description. A damaged chunk must not take
        it along. So it is also in chunks without messages on both sides of that chunk.
        """
        schema, channel, _ = topic
        schema_id = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        number = self._writer.register_channel(channel.topic, 'cdr', schema_id, channel.metadata)
        records: Any = RecordBuilder()
        dataclasses.replace(schema, id=schema_id).write(records)
        dataclasses.replace(channel, id=number, schema_id=schema_id).write(records)
        data = records.end()
        Chunk('', data, 0, 0, zlib.crc32(data), len(data)).write(records)
        description = records.end()
        self._stream.write(description)
        self._descriptions += description
        self._numbers[channel.topic] = number
        return int(number)
