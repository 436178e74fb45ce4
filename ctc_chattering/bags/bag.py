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
Reading a bag of any recorder: MCAP or sqlite3, compressed or not.

`rosbags` reads. What it lacks is here: it unpacks as much as a file states, and reads MCAP files
whose index is not what it was.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack
from io import BytesIO
import mmap
from pathlib import Path, PurePath
import struct
import tempfile
from typing import Any
import zlib

from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import nanoseconds
from ctc_chattering.ros.topics import PARAMETERS, ROBOT_DESCRIPTION
import lz4.frame  # type: ignore[import-untyped]
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Chunk
from mcap.summary import Summary
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import get_typestore, Stores
from tqdm import tqdm
import yaml
import zstandard

MAGIC = b'\x89MCAP0\r\n'
#: What a record begins with: kind and length.
RECORD = struct.Struct('<BQ')
#: Footer, with the place and the checksum of the index, and the end of a file.
_END = struct.Struct('<BQQQI8s')
#: Most that a chunk or message may unpack to, and a file besides what is allowed for its size
#: [bytes]; the latter for each packed byte.
_MOST, _RATIO = 1 << 27, 100


def unpacked(data: bytes, compression: str) -> bytes:
    """
    Return what a chunk or message is unpacked.

    Raises
    ------
    CtcError
        If it is more than is allowed, or the compression is not known. What unpacks raises
        errors of its own.

    """
    if compression == 'zstd':
        with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True) as stream:
            found = stream.read(_MOST + 1)
    elif compression == 'lz4':
        found = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=_MOST + 1)
    elif compression:
        raise CtcError(f'unknown compression {compression!r}; allowed: zstd, lz4')
    else:
        found = data
    if len(found) > _MOST:
        raise CtcError(f'{len(data)} bytes unpack to more than {_MOST} bytes, which is allowed')
    return bytes(found)


def _unpacked_file(source: Path, target: Path) -> Path:
    """Unpack a file of zstd; return it. Raise `CtcError` if it is more than is allowed."""
    most = _MOST + _RATIO * source.stat().st_size
    with source.open('rb') as packed, target.open('wb') as found, (
            zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)) as stream:
        while piece := stream.read(1 << 20):
            if found.write(piece) and found.tell() > most:
                raise CtcError(f'{source.name} unpacks to more than {most} bytes')
    return target


def mapped(path: Path) -> Any:
    """Return the bytes of a file, which are read where they are used."""
    with path.open('rb') as stream:
        return mmap.mmap(
            stream.fileno(), 0, access=mmap.ACCESS_READ) if path.stat().st_size else b''


def unpacked_chunk(content: bytes) -> tuple[Chunk, bytes]:
    """
    Return a chunk and the records in it, from the content of its own record.

    Raises
    ------
    CtcError
        If the records are not what it states; where it is damaged, errors of any kind.

    """
    stream = ReadDataStream(BytesIO(content))
    chunk: Chunk = Chunk.read(stream)
    found = unpacked(chunk.data, chunk.compression)
    if (stream.count, len(found)) != (len(content), chunk.uncompressed_size):
        raise CtcError(f'a chunk of {chunk.uncompressed_size} bytes has another size')
    if chunk.uncompressed_crc not in (0, zlib.crc32(found)):
        raise CtcError('a chunk has a wrong checksum')
    return chunk, found


def index_of(data: Any) -> Summary | None:
    """Return the index of a file, None without one; raise `CtcError` if it is not what it was."""
    if data[-len(MAGIC):] != MAGIC:
        raise CtcError('the file is cut off')
    footer = len(data) - _END.size
    _, _, start, _, checksum, _ = _END.unpack_from(data, footer)
    if checksum not in (0, zlib.crc32(data[start or footer:-12])):
        raise CtcError('the index has a wrong checksum')
    return SeekingReader(data).get_summary()


def check(path: Path) -> None:
    """
    Check that the chunks of a file unpack to what they state, and that its index is of them.

    Raises
    ------
    CtcError
        Otherwise, or if the file is cut off. Where it is damaged, errors of any kind.

    """
    data, chunks, begin = mapped(path), set(), len(MAGIC)
    summary = index_of(data)
    while begin + RECORD.size <= len(data) - len(MAGIC):
        kind, length = RECORD.unpack_from(data, begin)
        end = begin + RECORD.size + length
        if kind == Opcode.CHUNK:
            chunk, _ = unpacked_chunk(data[begin + RECORD.size:end])
            data.madvise(mmap.MADV_DONTNEED)  # It would stay in memory, else.
            chunks.add((begin, len(chunk.data), chunk.compression, chunk.uncompressed_size))
        begin = end
    if summary and not chunks >= {
            (x.chunk_start_offset, x.compressed_size, x.compression, x.uncompressed_size)
            for x in summary.chunk_indexes}:
        raise CtcError('the index has chunks that are not there')


#: Field of a ParameterValue that holds the value, by its type.
_FIELDS = {1: 'bool_value', 2: 'integer_value', 3: 'double_value', 4: 'string_value',
           8: 'double_array_value', 9: 'string_array_value'}


class Bag:
    """
    An open bag; close it after use.

    Parameters
    ----------
    path : Path
        Directory, or one of its files.

    Attributes
    ----------
    path : Path
        As given.
    connections : list of Connection
        The topics of each file, as `rosbags` has them.
    start_time, end_time : int
        Log time of the first and of the last message [ns].
    message_count : int
        Number of all messages.

    Raises
    ------
    Exception
        Of any kind, if it is damaged.

    """

    def __init__(self, path: Path) -> None:
        self.path, self._is_packed = path, False
        with ExitStack() as stack:
            files, counted = self._listed(stack) if path.is_dir() else ([path], None)
            for file in files:
                if file.suffix == '.mcap':
                    check(file)
                elif file.suffix != '.db3':
                    raise CtcError(f'unknown storage {file.suffix!r}; known: .mcap, .db3')
                elif not set('%?#').isdisjoint(str(file)):  # They mean something to sqlite3.
                    raise CtcError('its path has one of % ? #, not allowed with sqlite3')
            known = get_typestore(Stores.ROS2_JAZZY)
            self._reader = stack.enter_context(AnyReader(files, default_typestore=known))
            self._reader.typestore.register({  # What the definitions in the bag lack.
                name: fields for name, fields in known.fielddefs.items()
                if name not in self._reader.typestore.fielddefs})
            self.message_count = self._reader.message_count
            if counted not in (None, self.message_count):
                raise CtcError(
                    f'{self.message_count} messages, {counted} according to its metadata')
            self._stack = stack.pop_all()
        self.deserialize: Callable[[bytes, str], Any] = self._reader.deserialize
        self.connections: list[Connection] = list(self._reader.connections)
        self.start_time: int = self._reader.start_time
        self.end_time: int = self._reader.end_time - 1

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    def _listed(self, stack: ExitStack) -> tuple[list[Path], int]:
        """Return the files that the metadata of a bag name, and how many messages they count."""
        info = yaml.safe_load((self.path / 'metadata.yaml').read_text(encoding='utf-8')
                              )['rosbag2_bagfile_information']
        if info['version'] > 9:
            raise CtcError(f'version {info["version"]}; known: 1 to 9')
        files = [self.path / PurePath(x).name for x in info['relative_file_paths']]
        mode = (info.get('compression_mode') or 'none').lower()
        self._is_packed = {'none': False, 'file': False, 'message': True}[mode]
        if mode == 'file':
            scratch = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            files = [_unpacked_file(x, scratch / x.stem) for x in files]
        return files, info['message_count']

    def messages(self, connections: Collection[Connection] = ()
                 ) -> Iterator[tuple[Connection, int, bytes]]:
        """
        Yield connection, log time [ns] and data of some topics, or of all, in the order of time.

        Raises
        ------
        CtcError
            Where the bag is damaged, or its index has more messages.

        """
        found, count = 0, sum(x.msgcount for x in connections or self.connections)
        try:
            for connection, t, data in tqdm(
                    self._reader.messages(connections), f'reading {self.path.name}', count,
                    unit=' messages', disable=None, delay=2.0, leave=False):
                found += 1
                yield connection, t, unpacked(data, 'zstd') if self._is_packed else data
        except Exception as error:  # Damaged files may raise any exception.
            raise damaged(self.path, error) from None
        if found != count:
            raise damaged(self.path, CtcError(f'{found} messages, {count} according to its index'))

    def named(self, name: str) -> list[Connection]:
        """Return the topic `name`; without a slash in front, it stands for any namespace."""
        return [x for x in self.connections if x.topic == name or (
            not name.startswith('/') and x.topic.endswith('/' + name))]

    def read(self, connections: Collection[Connection]) -> Iterator[tuple[int, Any]]:
        """
        Yield log time [ns] and message of topics, without messages that cannot be decoded.

        Raises
        ------
        CtcError
            If the bag has no definition of their type; as `messages`.

        """
        for x in connections:
            if x.msgtype not in self._reader.typestore.fielddefs:
                raise CtcError(
                    f'{self.path}: the bag has no definition of {x.msgtype}, which {x.topic} is '
                    'of: record with --storage mcap, or convert it where that is installed')
        for x, t, data in self.messages(connections) if connections else ():
            try:
                message = self.deserialize(data, x.msgtype)
            except Exception:  # Of arbitrary bytes, decoders raise arbitrary exceptions.
                continue
            yield t, message

    def parameters(self, node: str, kind: Any, own: Mapping[str, object]) -> list[tuple[int, Any]]:
        """
        Return the configurations of a node, each with the time [ns] from which it applies.

        `own` stands in the place of classes that the bag names: `Config.received`.
        """
        known = kind.parameters()
        values: dict[str, Any] = {}
        history: list[tuple[int, Any]] = []
        for _, message in self.read(self.named(f'{node}/{PARAMETERS}')):
            for item in [*message.new_parameters, *message.changed_parameters]:
                if item.name in known and item.value.type in _FIELDS:
                    values[item.name] = getattr(item.value, _FIELDS[item.value.type])
            try:
                config = kind.received(values, own)
            except CtcError as error:
                raise CtcError(f'{self.path}: {error}') from None
            if not history or history[-1][1] != config:
                history.append((nanoseconds(message.stamp), config))
        return history

    def description(self, name: str = f'controller/{ROBOT_DESCRIPTION}') -> str:
        """Return the last robot description on a topic; empty for none."""
        texts = [str(message.data) for _, message in self.read(self.named(name))]
        return texts[-1] if texts else ''


def damaged(path: Path, error: Exception) -> CtcError:
    """Return an error that names the bag and what to do."""
    bag = path if path.is_dir() else path.parent
    name = '' if isinstance(error, CtcError) else f'{type(error).__name__}: '
    advice = f'; "ctc repair {bag}" recovers the rest' if any(bag.glob('*.mcap')) else ''
    return CtcError(f'{path}: damaged, or not a bag: {name}{" ".join(str(error).split())}{advice}')
