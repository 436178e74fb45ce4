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

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack
from functools import cache
from io import BytesIO
import mmap
from pathlib import Path, PurePath
import struct
import tempfile
from typing import Any
import zlib

from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.topics import PARAMETERS, ROBOT_DESCRIPTION
import lz4.frame  # type: ignore[import-untyped]
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.summary import Summary
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from tqdm import tqdm
import yaml
import zstandard

_LATEST_VERSION = 9
#: Time after which a terminal shows a bar [s].
_LONG = 2.0
_FILES = ('.mcap', '.db3')
_IN_URI = frozenset('%?#')
#: Name and type.
Topic = tuple[str, str]
MAGIC = b'\x89MCAP0\r\n'
#: What a record begins with: kind and length.
RECORD = struct.Struct('<BQ')
#: Footer, with the place and the checksum of the index, and the end of a file.
_END = struct.Struct('<BQQQI8s')
#: Bytes that are unpacked in any case, those for each packed one, and the most of all.
_ALWAYS, _RATIO, _MOST = 1 << 25, 100, 1 << 27


class UnknownDefinition(CtcError):
    """A file has the definition of a type that `rosbags` does not read."""


@cache
def is_readable(kind: str, encoding: str, definition: bytes) -> bool:
    """Return whether `rosbags` reads a definition; those of services are not of its kinds."""
    try:
        if encoding == 'ros2msg':
            get_types_from_msg(definition.decode(), kind)
    except Exception:  # Of arbitrary text, a parser raises arbitrary exceptions.
        return False
    return encoding in ('ros2msg', 'ros2idl', '')


def unpacked(data: bytes, compression: str, size: int | None = None) -> bytes:
    """
    Return what is packed; with a `size` [bytes] at most one byte more than that.

    Raises
    ------
    CtcError
        If it is more than is allowed for as much data, or the compression is not known.
        What unpacks raises errors of its own.

    """
    most = min(_MOST, _ALWAYS + _RATIO * len(data))
    wanted = most if size is None else size
    if wanted > most:
        raise CtcError(f'{len(data)} bytes would unpack to {size} bytes; allowed: up to {most}')
    if compression == 'zstd':
        with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True) as stream:
            found = stream.read(wanted + 1)
    elif compression == 'lz4':
        found = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=wanted + 1)
    elif compression:
        raise CtcError(f'unknown compression {compression!r}; allowed: zstd, lz4')
    else:
        found = data
    if len(found) > most:
        raise CtcError(f'{len(data)} bytes unpack to more than {most} bytes, which is allowed')
    return bytes(found)


def _unpacked_file(source: Path, target: Path) -> Path:
    """Unpack a file of zstd; return it. Raise `CtcError` if it is more than is allowed."""
    most = _ALWAYS + _RATIO * source.stat().st_size
    with source.open('rb') as packed, target.open('wb') as found, (
            zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)) as stream:
        while piece := stream.read(_ALWAYS):
            if found.write(piece) and found.tell() > most:
                raise CtcError(f'{source.name}: it unpacks to more than {most} bytes, which is '
                               'allowed for its size')
    return target


def mapped(path: Path) -> Any:
    """Return the bytes of a file, which are read where they are used."""
    with path.open('rb') as stream:
        return mmap.mmap(
            stream.fileno(), 0, access=mmap.ACCESS_READ) if path.stat().st_size else b''


def records(data: Any, begin: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield kind, begin of the content, and end of the records in a part of an MCAP file."""
    while begin + RECORD.size <= end:
        kind, length = RECORD.unpack_from(data, begin)
        begin += RECORD.size
        if begin + length > end:
            break
        yield kind, begin, begin + length
        begin += length


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
    if stream.count != len(content):
        raise CtcError('a chunk has another length than it states')
    found = unpacked(chunk.data, chunk.compression, chunk.uncompressed_size)
    if len(found) != chunk.uncompressed_size:
        raise CtcError(f'a chunk of {chunk.uncompressed_size} bytes has another size')
    if chunk.uncompressed_crc not in (0, zlib.crc32(found)):
        raise CtcError('a chunk has a wrong checksum')
    return chunk, found


def index_of(path: Path, data: Any) -> Summary | None:
    """Return the index of a file, None without one; raise `CtcError` if it is not what it was."""
    if len(data) < _END.size or bytes(data[-len(MAGIC):]) != MAGIC:
        raise CtcError('the file is cut off')
    footer = len(data) - _END.size
    _, _, start, _, checksum, _ = _END.unpack_from(data, footer)
    if checksum not in (0, zlib.crc32(data[start or footer:-12])):
        raise CtcError('the index has a wrong checksum')
    with path.open('rb') as stream:
        return make_reader(stream).get_summary()


def check(path: Path) -> None:
    """
    Check that the chunks of a file unpack to what they state, and that its index is of them.

    Raises
    ------
    CtcError
        Otherwise, or if the file is cut off. Where it is damaged, errors of any kind.
    UnknownDefinition
        If all is well but for a definition.

    """
    data = mapped(path)
    try:
        summary, chunks = index_of(path, data), set()
        for kind, start, end in records(data, len(MAGIC), len(data)):
            if kind == Opcode.CHUNK:
                chunk, _ = unpacked_chunk(data[start:end])
                chunks.add((start - RECORD.size, len(chunk.data), chunk.compression,
                            chunk.uncompressed_size))
    except CtcError as error:
        raise CtcError(f'{path.name}: {error}') from None
    if summary is None:
        return
    if not chunks >= {
            (x.chunk_start_offset, x.compressed_size, x.compression, x.uncompressed_size)
            for x in summary.chunk_indexes}:
        raise CtcError(f'{path.name}: the index has chunks that are not there')
    for x in summary.schemas.values():
        if not is_readable(x.name, x.encoding, x.data):
            raise UnknownDefinition(f'the definition of {x.name} is not one of a message')


#: Field of a ParameterValue that holds the value, by its type.
_FIELDS = {1: 'bool_value', 2: 'integer_value', 3: 'double_value', 4: 'string_value',
           8: 'double_array_value', 9: 'string_array_value'}


class Bag:
    """
    An open bag; close it after use.

    Parameters
    ----------
    path : Path
        What errors name.
    place : Path
        Directory or file to read.

    Attributes
    ----------
    path : Path
        As given.
    connections : list of Connection
        The topics of each file, as `rosbags` has them.
    start_time, end_time : int
        Log time of the first and of the last message [ns].
    message_count : int
        Number of all messages, as the metadata count them.

    Raises
    ------
    Exception
        Of any kind, if it is damaged.

    """

    def __init__(self, path: Path, place: Path) -> None:
        self.path, self._counts, self._is_packed = path, Counter[Topic](), False
        with ExitStack() as stack:
            files = self._listed(place, stack) if place.is_dir() else [place]
            for number, file in enumerate(files):
                if file.suffix not in _FILES:
                    raise ValueError(
                        f'unknown storage {file.suffix!r}; known: {", ".join(_FILES)}')
                if file.suffix == '.mcap':
                    check(file)
                elif not _IN_URI.isdisjoint(str(file.absolute())):  # sqlite3 takes it for a URI.
                    link = Path(stack.enter_context(tempfile.TemporaryDirectory())) / 'bag.db3'
                    link.symlink_to(file.absolute())
                    files[number] = link
            known = get_typestore(Stores.ROS2_JAZZY)
            self._reader = stack.enter_context(AnyReader(files, default_typestore=known))
            self._reader.typestore.register({  # What the definitions in the bag lack.
                name: fields for name, fields in known.fielddefs.items()
                if name not in self._reader.typestore.fielddefs})
            self._stack = stack.pop_all()
        self.deserialize: Callable[[bytes, str], Any] = self._reader.deserialize
        self.connections: list[Connection] = list(self._reader.connections)
        for x in () if self._counts else self.connections:
            self._counts[x.topic, x.msgtype] += x.msgcount
        self.start_time: int = self._reader.start_time
        self.end_time: int = self._reader.end_time - 1
        self.message_count = self._counts.total()

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    def _listed(self, place: Path, stack: ExitStack) -> list[Path]:
        """Return the files that the metadata of a bag name."""
        file = place / 'metadata.yaml'
        try:
            info = yaml.safe_load(file.read_text(encoding='utf-8'))['rosbag2_bagfile_information']
            if info['version'] > _LATEST_VERSION:
                raise ValueError(f'version {info["version"]}; known: 1 to {_LATEST_VERSION}')
            mode = (info.get('compression_mode') or 'none').lower()
            files = [place / PurePath(x).name for x in info['relative_file_paths']]
            for topic in info['topics_with_message_count']:
                what = topic['topic_metadata']
                self._counts[what['name'], what['type']] += topic['message_count']
        except (yaml.YAMLError, LookupError, TypeError, AttributeError) as error:
            raise ValueError(f'{file.name}: {type(error).__name__}: {error}') from None
        if mode not in ('none', 'file', 'message'):
            raise ValueError(f'unknown compression_mode {mode}')
        self._is_packed = mode == 'message'
        if mode != 'file':
            return files
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        return [_unpacked_file(x, scratch / x.stem) for x in files]

    def messages(self, connections: Collection[Connection] = ()
                 ) -> Iterator[tuple[Connection, int, bytes]]:
        """
        Yield connection, log time [ns] and data of some topics, or of all, in the order of time.

        Raises
        ------
        CtcError
            Where the bag is damaged, and if it has not as many messages as its metadata count.

        """
        topics = {(x.topic, x.msgtype) for x in connections}
        found, counted = 0, sum(self._counts[x] for x in topics or self._counts)
        try:
            for connection, t, data in tqdm(
                    self._reader.messages(connections), f'reading {self.path.name}', counted,
                    unit=' messages', disable=None, delay=_LONG, leave=False):
                found += 1
                yield connection, t, unpacked(data, 'zstd') if self._is_packed else data
        except Exception as error:  # Damaged files may raise any exception.
            raise damaged(self.path, error) from None
        if found != counted:
            names = ', '.join(sorted(x for x, _ in topics)) or 'all topics'
            raise damaged(self.path, ValueError(
                f'{found} messages of {names}, {counted} according to its metadata'))

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
            If the messages of a topic cannot be read; as `messages`.

        """
        for x in connections:
            self._check_type(x)
        for x, t, data in self.messages(connections) if connections else ():
            try:
                message = self.deserialize(data, x.msgtype)
            except Exception:  # Of arbitrary bytes, decoders raise arbitrary exceptions.
                continue
            yield t, message

    def _check_type(self, connection: Connection) -> None:
        """Raise `CtcError` if the messages of a topic cannot be read."""
        serialization = getattr(connection.ext, 'serialization_format', 'cdr')
        if serialization != 'cdr':
            raise CtcError(f'{self.path}: {connection.topic} is serialized by {serialization}; '
                           'allowed: cdr')
        if connection.msgtype not in self._reader.typestore.fielddefs:
            raise CtcError(
                f'{self.path}: the bag has no definition of {connection.msgtype}, which '
                f'{connection.topic} is of: sqlite3 of ROS 2 Humble and before stores none; '
                'record with MCAP (--storage mcap), or convert it where the package is installed '
                '(ros2 bag convert)')

    def parameters(self, node: str, kind: Any, own: Mapping[str, object]
                   ) -> list[tuple[int, Any]]:
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
    advice = (f'; "ctc repair {bag}" recovers the rest' if any(bag.glob('*.mcap')) else
              f'; "ros2 bag reindex {bag}" may help')
    return CtcError(f'{path}: damaged: {" ".join(str(error).split()).rstrip(".")}{advice}')


def nanoseconds(time: Any) -> int:
    """Return the time of a message [ns]."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)
