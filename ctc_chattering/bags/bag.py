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

Messages in the order of time, parameters of nodes, and the description of the robot.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path, PurePath
import tempfile
from typing import Any

from ctc_chattering.bags.mcap_file import check, unpacked, unpacked_file
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.topics import PARAMETERS, ROBOT_DESCRIPTION
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import get_typestore, Stores
from tqdm import tqdm
import yaml

_LATEST_VERSION = 9
#: Messages between two moves of the bar, which a terminal shows after so long [s].
_SHOWN, _LONG = 10_000, 2.0
_FILES = ('.mcap', '.db3')
_IN_URI = frozenset('%?#')
#: Name and type.
Topic = tuple[str, str]


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
        self._path, self._counts, self._is_packed = path, Counter[Topic](), False
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
        return [unpacked_file(x, scratch / x.stem) for x in files]

    def messages(self, connections: Collection[Connection] = ()
                 ) -> Iterator[tuple[Connection, int, bytes]]:
        """
        Yield connection, log time [ns] and data of some topics, or of all, in the order of time.

        Raises
        ------
        CtcError
            Where the bag is damaged, and if it has not as many messages as its metadata count.

        """
        found, topics = 0, {(x.topic, x.msgtype) for x in connections}
        counted = sum(self._counts[x] for x in topics) if topics else self.message_count
        bar = tqdm(total=counted, desc=f'reading {self._path.name}', unit=' messages',
                   disable=None, delay=_LONG, leave=False)
        try:
            for connection, t, data in self._reader.messages(connections):
                found += 1
                if found % _SHOWN == 0:
                    bar.update(_SHOWN)
                yield connection, t, unpacked(data, 'zstd') if self._is_packed else data
        except Exception as error:  # Damaged files may raise any exception.
            raise damaged(self._path, error) from None
        finally:
            bar.close()
        if found != counted:
            names = ', '.join(sorted(x for x, _ in topics)) or 'all topics'
            raise damaged(self._path, ValueError(
                f'{found} messages of {names}, {counted} according to its metadata'))

    def check_type(self, connection: Connection) -> None:
        """Raise `CtcError` if the messages of a topic cannot be read."""
        serialization = getattr(connection.ext, 'serialization_format', 'cdr')
        if serialization != 'cdr':
            raise CtcError(f'{self._path}: {connection.topic} is serialized by {serialization}; '
                           'allowed: cdr')
        if connection.msgtype not in self._reader.typestore.fielddefs:
            raise CtcError(
                f'{self._path}: the bag has no definition of {connection.msgtype}, which '
                f'{connection.topic} is of: sqlite3 of ROS 2 Humble and before stores none; '
                'record with MCAP (--storage mcap), or convert it where the package is installed '
                '(ros2 bag convert)')

    def deserialize(self, data: bytes, kind: str) -> Any:
        """Return a message of a type in the bag."""
        return self._reader.deserialize(data, kind)


def damaged(path: Path, error: Exception) -> CtcError:
    """Return an error that names the bag and what to do."""
    bag = path if path.is_dir() else path.parent
    advice = (f'; "ctc repair {bag}" recovers the rest' if any(bag.glob('*.mcap')) else
              f'; "ros2 bag reindex {bag}" may help')
    return CtcError(f'{path}: damaged: {" ".join(str(error).split()).rstrip(".")}{advice}')


#: Field of a ParameterValue that holds the value, by its type.
_FIELDS = {1: 'bool_value', 2: 'integer_value', 3: 'double_value', 4: 'string_value',
           8: 'double_array_value', 9: 'string_array_value'}


class BagTopics:
    """
    The topics of an open bag; without a slash in front, a name stands for it in any namespace.

    Parameters
    ----------
    reader : Bag
        Open.
    path : Path
        What errors say.

    """

    def __init__(self, reader: Bag, path: Path) -> None:
        self._reader, self.path = reader, path

    def messages(self, name: str, option: str = '') -> Iterator[tuple[int, Any]]:
        """
        Yield log time [ns] and message of a topic, without those that cannot be decoded.

        With the `option` that names the topic, it must be one only; else `CtcError` is raised.
        """
        connections = [x for x in self._reader.connections if x.topic == name or (
            not name.startswith('/') and x.topic.endswith('/' + name))]
        topics = {x.topic for x in connections}
        if len(topics) > 1 and option:
            raise CtcError(f'{self.path}: several topics: {", ".join(sorted(topics))}; name one: '
                           f'{option}')
        for connection in connections:
            self._reader.check_type(connection)
        for connection, t, data in self._reader.messages(connections) if connections else ():
            try:
                message = self._reader.deserialize(data, connection.msgtype)
            except Exception:  # Of arbitrary bytes, decoders raise arbitrary exceptions.
                continue
            yield t, message

    def parameters(self, node: str, kind: Any, own: Mapping[str, object]
                   ) -> list[tuple[int, Any]]:
        """
        Return the configurations of a node, each with the time [ns] from which it applies.

        `own` stands in the place of classes that the bag names: `Config.received`.
        """
        known = kind.parameters()
        values: dict[str, Any] = {}
        history: list[tuple[int, Any]] = []
        for _, message in self.messages(f'{node}/{PARAMETERS}'):
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
        texts = [str(message.data) for _, message in self.messages(name)]
        return texts[-1] if texts else ''


def nanoseconds(time: Any) -> int:
    """Return the time of a message [ns]."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)
