"""Writing a rosbag2 bag: MCAP, compressed, with message definitions and QoS in it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from io import BytesIO
import os
from pathlib import Path
import struct
import tempfile
from typing import Any

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.typesys import get_typestore, Stores

from ctc_chattering.errors import CtcError

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

    def __iter__(self) -> Iterator[BytesIO]:
        self._file.seek(0)
        for _ in range(self._count):
            record = BytesIO()
            (length,) = self._LENGTH.unpack(self._file.read(self._LENGTH.size))
            record.write(self._file.read(length))
            yield record


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

    Parameters
    ----------
    path : Path
        Directory to create.

    Raises
    ------
    CtcError
        If it exists or cannot be made.

    """

    def __init__(self, path: Path) -> None:
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Any] = {}
        self.counts: dict[str, int] = {}
        self.path = path
        try:
            self._writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
            self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            self._writer.open()
            storage: Any = self._writer.storage  # It does not say what types it has.
            self._storage = storage
            self._storage.chunks = _Spool(path)
            self._sync = _Sync()
        except WriterError:
            raise CtcError(f'{path}: exists already, not overwritten') from None
        except OSError as error:
            raise CtcError(f'{path}: {error.strerror or error}') from None

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
        connection = self._connections.get(topic)
        if connection is None:
            connection = self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=self._typestore, offered_qos_profiles=list(qos))
            self.counts[topic] = 0
        self._writer.write(connection, t, data)
        self.counts[topic] += 1
        if self._storage.chunk.bio.tell() > _CHUNK:
            self._storage.close_chunk()

    def note(self, key: str, value: str) -> None:
        """Have the bag's metadata say something about the recording."""
        self._writer.set_custom_data(key, value)

    def flush(self) -> None:
        """
        Write all out, so that it can be read even if this process is killed.

        The disk is asked to keep it, too. What comes of that is raised by a later call, as
        `OSError`; as long as the disk takes, no more is asked of it, while writing goes on.
        """
        if self._storage.chunk.bio.tell():
            self._storage.close_chunk()
        self._storage.bio.flush()
        self._sync.begin(self._storage.bio.fileno())

    def abandon(self) -> None:
        """Close without index and metadata: the disk takes no more."""
        with suppress(OSError):
            self._sync.end()
        with suppress(OSError):
            self._storage.abort()

    def close(self) -> None:
        """Write index and metadata; without them, tools cannot open the bag."""
        self._sync.end()
        self._writer.close()
