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

"""Reading the messages of a bag, as rosbag2 writes it: MCAP or sqlite3, compressed or not."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import ExitStack
from pathlib import Path, PurePath
import tempfile
from typing import Any

from ctc_chattering.bags.cdr_message import decoded
from ctc_chattering.bags.compression import decompress_file, decompressed
from ctc_chattering.bags.definitions import Definitions, definitions
from ctc_chattering.bags.mcap_storage import McapStorage
from ctc_chattering.bags.qos import profiles
from ctc_chattering.bags.sqlite_storage import SqliteStorage
from ctc_chattering.bags.storage import Connection, Storage
from ctc_chattering.errors import CtcError
import yaml

_STORAGES: dict[str, type[Storage]] = {'mcap': McapStorage, 'sqlite3': SqliteStorage}
_ENDINGS = {'.mcap': 'mcap', '.db3': 'sqlite3'}
_LATEST_VERSION = 9


class BagReader:
    """
    An open bag; close it after use.

    Parameters
    ----------
    path : Path
        What errors say.
    place : Path
        Directory or file to read.

    Attributes
    ----------
    connections : list of Connection
        The topics, with the numbers of messages that the metadata count.
    start_time, end_time : int
        Log time of the first and of the last message [ns].
    message_count : int
        Number of all messages.

    Raises
    ------
    CtcError
        If what decompresses it is not installed.
    Exception
        Of any kind, if it is damaged.

    """

    def __init__(self, path: Path, place: Path) -> None:
        self._bag = path
        self._files: list[Storage] = []
        self._is_compressed = False
        self._types: dict[str, Definitions] = {}
        with ExitStack() as stack:
            if place.is_dir():
                self._open_directory(place, stack)
            else:
                kind = _ENDINGS.get(place.suffix, '')
                self._open(place, _storage(kind or place.suffix), stack)
                (file,) = self._files
                self.connections = file.connections
                self.start_time, self.end_time = file.span or (0, 0)
                self.message_count = sum(x.msgcount for x in file.connections)
            self._stack = stack.pop_all()

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    def _open(self, file: Path, storage: type[Storage], stack: ExitStack) -> None:
        try:
            found = storage(file)
        except ValueError as error:
            raise ValueError(f'{file.name} {error}') from None
        stack.callback(found.close)
        self._files.append(found)

    def _open_directory(self, place: Path, stack: ExitStack) -> None:
        """Open the files that the metadata of a bag name."""
        file = place / 'metadata.yaml'
        try:
            info = yaml.safe_load(file.read_text(encoding='utf-8'))['rosbag2_bagfile_information']
            if info['version'] > _LATEST_VERSION:
                raise ValueError(f'version {info["version"]}; known: 1 to {_LATEST_VERSION}')
            self.message_count = int(info['message_count'])
            self.start_time = int(info['starting_time']['nanoseconds_since_epoch'])
            self.end_time = self.start_time + int(info['duration']['nanoseconds'])
            storage = _storage(info['storage_identifier'])
            mode = (info.get('compression_mode') or 'none').lower()
            files = [place / PurePath(x).name for x in info['relative_file_paths']]
            topics = [_connection(x) for x in info['topics_with_message_count']]
        except (yaml.YAMLError, LookupError, TypeError, AttributeError) as error:
            raise ValueError(f'{file.name}: {type(error).__name__}: {error}') from None
        if mode not in ('none', 'file', 'message'):
            raise ValueError(f'unknown compression_mode {mode}')
        self._is_compressed = mode == 'message'
        if mode == 'file':
            scratch = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            for file in files:
                decompress_file(file, scratch / file.stem)
            files = [scratch / file.stem for file in files]
        for file in files:
            self._open(file, storage, stack)
        known = {x.msgtype: x for file in self._files for x in file.connections if x.encoding}
        self.connections = [
            x._replace(encoding=known[x.msgtype].encoding, definition=known[x.msgtype].definition)
            if x.msgtype in known else x for x in topics]
        foreign = {x.serialization for x in self.connections} - {'cdr'}
        if foreign:
            raise ValueError(f'messages are not serialized by cdr: {", ".join(sorted(foreign))}')

    def messages(self, connections: Collection[Connection] = ()
                 ) -> Iterator[tuple[Connection, int, bytes]]:
        """
        Yield connection, log time [ns] and data of some topics, or of all.

        Raises
        ------
        CtcError
            Where the bag is damaged, and if it has not as many messages as its metadata count.

        """
        wanted = {x.key: x for x in connections or self.connections}
        found, counted = 0, sum(x.msgcount for x in wanted.values())
        try:
            for file in self._files:
                for key, t, data in file.messages(wanted):
                    found += 1
                    yield wanted[key], t, decompressed(
                        data, 'zstd') if self._is_compressed else data
        except CtcError as error:
            raise CtcError(f'{self._bag}: {error}') from None
        except Exception as error:  # Damaged chunks may raise any exception.
            raise damaged(self._bag, error) from None
        if found != counted:
            topics = ', '.join(x.topic for x in connections) or 'all topics'
            raise damaged(self._bag, ValueError(
                f'{found} messages of {topics}, {counted} according to its metadata'))

    def definitions(self, connection: Connection) -> Definitions:
        """
        Return what the messages of a topic consist of.

        Raises
        ------
        CtcError
            If neither the bag nor the machine has a definition of the type.

        """
        kind = connection.msgtype
        if kind not in self._types:
            found = definitions(kind, connection.encoding, connection.definition)
            if kind not in found:
                raise CtcError(
                    f'{self._bag}: the bag has no definition of {kind}, which {connection.topic} '
                    'is of, and it is not installed: sqlite3 of ROS 2 Humble and before stores '
                    'none; record with MCAP (--storage mcap), or convert it where the package is '
                    'installed (ros2 bag convert)')
            self._types[kind] = found
        return self._types[kind]

    def deserialize(self, data: bytes, kind: str) -> Any:
        """Return a message of a type in the bag."""
        types = self._types.get(kind) or self.definitions(next(
            x for x in self.connections if x.msgtype == kind))
        return decoded(data, kind, types)


def _storage(name: str) -> type[Storage]:
    """Return what reads a kind of files."""
    if name not in _STORAGES:
        raise ValueError(f'unknown storage {name!r}; known: {", ".join(_STORAGES)}')
    return _STORAGES[name]


def _connection(topic: Any) -> Connection:
    """Return what the metadata of a bag say of a topic."""
    what = topic['topic_metadata']
    return Connection(what['name'], what['type'], int(topic['message_count']),
                      qos=profiles(what.get('offered_qos_profiles', '')),
                      serialization=what['serialization_format'])


def damaged(path: Path, error: Exception) -> CtcError:
    """Return an error that names the bag and what to do."""
    advice = (f'; "ctc repair {path}" recovers the rest' if any(path.glob('*.mcap')) else
              f'; "ros2 bag reindex {path}" may help')
    return CtcError(f'{path}: damaged: {" ".join(str(error).split()).rstrip(".")}{advice}')
