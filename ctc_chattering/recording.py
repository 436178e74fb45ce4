"""Writing a rosbag2 bag: MCAP, compressed, with message definitions and QoS in it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from io import BytesIO
import os
from pathlib import Path
import struct
import tempfile
from typing import Any
import zlib

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.rosbag2.storage_mcap import Channel, McapWriter, write_channel, write_string
from rosbags.typesys import get_typestore, Stores

from ctc_chattering.errors import CtcError
from ctc_chattering.index_checksum import write_index_checksum

#: Size at which a chunk is written [bytes]: compressing takes some times as much memory.
_CHUNK = 1 << 18
_FOREVER = QosTime(9223372036, 854775807)


def offered_qos(depth: int, latched: bool) -> Qos:
    """Return the profile of a reliable publisher as a bag stores it."""
    return Qos(
        QosHistory.KEEP_LAST, depth, QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        _FOREVER, _FOREVER, QosLiveliness.AUTOMATIC, _FOREVER, False)


class _Spool:
    """
    The index of each chunk, which the writer needs again at the end only.

    It takes the place of the writer's list, and keeps them in a file without a name: many flushes
    make many chunks, and a recording may last for days.
    """

    _LENGTH = struct.Struct('<I')

    def __init__(self, folder: Path) -> None:
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def append(self, record: BytesIO) -> None:
        data = record.getbuffer()
        self._file.write(self._LENGTH.pack(len(data)))
        self._file.write(data)
        self._count += 1

    def close(self) -> None:
        self._file.close()

    def __iter__(self) -> Iterator[BytesIO]:
        self._file.seek(0)
        for _ in range(self._count):
            record = BytesIO()
            (length,) = self._LENGTH.unpack(self._file.read(self._LENGTH.size))
            record.write(self._file.read(length))
            yield record


class _Storage(McapWriter):
    """
    The MCAP file as the recorder of ROS names it, with the hash of each type.

    `chunks` is a list in rosbags, of which it uses what `_Spool` has.
    """

    #: A record of a message: opcode, length, channel, number, log time, time of publication.
    _MESSAGE = struct.Struct('<BQHIQQ')
    #: What precedes the checksum in a record of a chunk: opcode, length, times, size.
    _BEFORE_CRC = struct.Struct('<BQQQQ')

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        super().__init__(path, compression)
        self.path = self.path.rename(path / f'{path.name}_0.mcap')
        self.chunks: Any = _Spool(path)

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        """Add a topic."""
        metadata = BytesIO()
        for text in ('offered_qos_profiles', offered_qos_profiles,
                     'topic_type_hash', connection.digest):
            write_string(metadata, text)
        self.channels.append(Channel(
            connection.id, connection.msgtype, connection.topic, 'cdr', metadata.getvalue()))
        self.channel_stats[connection.id] = 0
        write_channel(self.chunk.bio, self.channels[-1], self.schemas)

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Add a message; the same bytes as rosbags writes, in a quarter of the time."""
        chunk, channel = self.chunk, connection.id
        head = self._MESSAGE.pack(5, 22 + len(data), channel, 0, timestamp, timestamp)
        chunk.message_start_time = min(timestamp, chunk.message_start_time)
        chunk.message_end_time = max(timestamp, chunk.message_end_time)
        chunk.msgs[channel].append((timestamp, chunk.bio.tell()))
        chunk.bio.write(head)
        chunk.bio.write(data)
        self.channel_stats[channel] += 1
        if chunk.bio.tell() > _CHUNK:
            self.close_chunk()

    def close_chunk(self) -> None:
        """Write the messages since the last chunk, with the checksum that rosbags leaves at 0."""
        self.message_start_time = min(self.chunk.message_start_time, self.message_start_time)
        self.message_end_time = max(self.chunk.message_end_time, self.message_end_time)
        start, checksum = self.bio.tell(), zlib.crc32(self.chunk.bio.getbuffer())
        super().close_chunk()
        self.bio.seek(start + self._BEFORE_CRC.size)
        self.bio.write(struct.pack('<I', checksum))
        self.bio.seek(0, os.SEEK_END)

    def close(self, version: int, metadata: str) -> None:
        """Write index and metadata."""
        super().close(version, metadata)
        write_index_checksum(self.path)

    def abort(self) -> None:
        """Close without index."""
        for file in (self.bio, self.chunks):
            with suppress(OSError):
                file.close()


class _Writer(Writer):
    """Writes `_Storage`."""

    STORAGE_PLUGINS: Mapping[StoragePlugin, Any] = {StoragePlugin.MCAP: _Storage}


class _Sync:
    """Has the disk take what a file holds, in a thread of its own: a slow one takes seconds."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1)
        self._last: Future[None] | None = None

    def begin(self, file: int) -> None:
        """Go on, if the last time has ended; raise what came of that."""
        if self._last is None or self._last.done():
            self.end()
            self._last = self._pool.submit(os.fsync, file)

    def end(self) -> None:
        """Wait for the last time, and raise what came of it."""
        last, self._last = self._last, None
        if last is not None:
            last.result()


class Recording:
    """
    A bag being written.

    When the disk takes no more, `write`, `flush` or `close` raises an `OSError`, once; the bag is
    closed then, with what was written before, and later calls do nothing.

    Parameters
    ----------
    path : Path
        Directory to create.

    Attributes
    ----------
    file : Path
        Where the messages go.
    counts : dict
        Number of messages by topic.

    Raises
    ------
    CtcError
        If it exists or cannot be made.

    """

    def __init__(self, path: Path) -> None:
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Any] = {}
        self._open = True
        self.counts: dict[str, int] = {}
        self.path = path
        try:
            self._writer = _Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
            self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            self._writer.open()
        except WriterError:
            raise CtcError(f'{path}: exists already, not overwritten') from None
        except OSError as error:
            raise CtcError(f'{path}: {error.strerror or error}') from None
        storage: Any = self._writer.storage  # It does not say what types it has.
        self._storage: _Storage = storage
        self.file = storage.path
        self._sync = _Sync()

    def write(self, topic: str, kind: str, t: int, data: bytes, qos: Sequence[Qos]) -> None:
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
        qos : sequence of Qos
            What the publishers offer; used for the first message of a topic.

        """
        if not self._open:
            return
        connection = self._connections.get(topic)
        if connection is None:
            connection = self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=self._typestore, offered_qos_profiles=list(qos))
            self.counts[topic] = 0
        try:
            self._writer.write(connection, t, data)
        except OSError:
            self.abandon()
            raise
        self.counts[topic] += 1

    def note(self, key: str, value: str) -> None:
        """Have the bag's metadata say something about the recording."""
        self._writer.set_custom_data(key, value)

    def flush(self) -> None:
        """
        Write all out, so that it can be read even if this process is killed.

        The disk is asked to keep it, too. What comes of that is raised by a later call, as
        `OSError`; as long as the disk takes, no more is asked of it, while writing goes on.
        """
        if not self._open:
            return
        try:
            if self._storage.chunk.bio.tell():
                self._storage.close_chunk()
            self._storage.bio.flush()
            self._sync.begin(self._storage.bio.fileno())
        except OSError:
            self.abandon()
            raise

    def abandon(self) -> None:
        """Close without index and metadata: the disk takes no more."""
        self._open = False
        with suppress(OSError):
            self._sync.end()
        self._storage.abort()
        with suppress(OSError):  # As much of it as there was room for.
            (self.path / 'metadata.yaml.tmp').unlink(missing_ok=True)

    def close(self) -> None:
        """Write index and metadata; without them, tools cannot open the bag."""
        if not self._open:
            return
        try:
            self._sync.end()
            self._writer.close()
        except OSError:
            self.abandon()
            raise
        self._open = False
        self._storage.chunks.close()
