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
Reading bags of any recorder, MCAP or sqlite3.

`repair.py:open_bag` opens a `Bag`, from which all other modules read topics. `mcap_file.py` reads
MCAP, `rosbags` reads sqlite3 and decodes messages. Messages of other encodings, as of Protobuf or
JSON, are bytes.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import closing, ExitStack, suppress
from functools import cached_property, lru_cache
from heapq import merge
from operator import itemgetter
from pathlib import Path
import shlex
import tempfile
from typing import Any

from ctc_chattering.bags.bag_files import (
    check_one_recording,
    ENDINGS,
    list_files,
    Span,
    storage_of,
    UnsupportedBag,
)
from ctc_chattering.bags.compression import unpack, unpack_file, ZSTD
from ctc_chattering.bags.mcap_file import McapFile
from ctc_chattering.configuration.topics import PARAMETERS, ROBOT_DESCRIPTION
from ctc_chattering.errors import CtcError, shorten
from ctc_chattering.numerics.time_grid import nanoseconds
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import Reader
from rosbags.typesys import get_types_from_idl, get_types_from_msg, get_typestore, Stores
from tqdm import tqdm

#: Line between the sections of a definition in IDL.
_IDL_RULE = '=' * 80 + '\n'

#: Field of a ParameterValue with the value, by its type.
_VALUE_FIELDS = {
    1: 'bool_value',
    2: 'integer_value',
    3: 'double_value',
    4: 'string_value',
    8: 'double_array_value',
    9: 'string_array_value'}


class Bag:
    """
    Open bag, which must be closed after use.

    Parameters
    ----------
    path : Path
        Directory, or one of its files.

    Attributes
    ----------
    path : Path
    connections : list of Connection
        The topics of each file, as `rosbags` has them.
    start_time, end_time : int
        Log time of the first and of the last message [ns].
    message_count : int
        Number of all messages.

    Raises
    ------
    UnsupportedBag
        If it is no bag, or of a storage that is not read.
    Exception
        Of any kind, if it is damaged.

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        listed = list_files(path)
        with ExitStack() as stack:
            files = {file: _open_file(file, stack) for file in listed.paths}
            spans = {path: _span(file) for path, file in files.items()}
            self.message_count = sum(x.count for x in spans.values())
            if listed.metadata is None:
                check_one_recording(path, spans)
            elif listed.metadata['message_count'] != self.message_count:
                raise CtcError(f'{self.message_count} messages, '
                               f'{listed.metadata["message_count"]} according to its metadata')
            self.connections: list[Connection] = []
            for file in files.values():
                self.connections += file.connections
            self._types = _register_types(self.connections)
            self._stack = stack.pop_all()
        self.start_time = min((x.begin for x in spans.values()), default=Span.begin)
        self.end_time = max((x.end for x in spans.values()), default=Span.end)

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    def messages(self, connections: Collection[Connection] = ()
                 ) -> Iterator[tuple[Connection, int, bytes]]:
        """
        Yield messages of some topics, or of all, by time.

        Each comes with its connection and log time [ns].

        Raises
        ------
        DamagedBag
            Where the bag is damaged.

        """
        selected = connections or self.connections
        by_file: dict[Any, list[Connection]] = {}
        for x in selected:
            by_file.setdefault(x.owner, []).append(x)
        streams = [file.messages(topics) for file, topics in by_file.items()]
        progress = tqdm(
            merge(*streams, key=itemgetter(1)),
            f'reading {self.path.name}',
            sum(x.msgcount for x in selected),
            unit=' messages',
            disable=None,
            delay=2.0,
            leave=False)
        try:
            for connection, t, data in progress:
                is_packed = data.startswith(ZSTD) and is_cdr(connection)
                yield connection, t, unpack(data, 'zstd') if is_packed else data
        except Exception as error:  # Damaged files may raise any exception.
            raise damaged(self.path, error) from None

    @cached_property
    def namespaces(self) -> tuple[str, ...]:
        """Namespaces with a controller of this package, sorted."""
        name = f'/controller/{PARAMETERS}'
        return tuple(sorted({
            x.topic.removesuffix(name) for x in self.connections
            if x.topic.endswith(name) and is_cdr(x)}))

    def named(self, name: str) -> list[Connection]:
        """
        Return the connections of the topic `name`.

        A name without a slash in front is looked for beside the controllers of this package, then
        in any namespace.
        """
        if name.startswith('/'):
            return [x for x in self.connections if x.topic == name]
        beside = {f'{namespace}/{name}' for namespace in self.namespaces}
        return [x for x in self.connections if x.topic in beside] or [
            x for x in self.connections if x.topic.endswith('/' + name)]

    def only(self, name: str) -> list[Connection]:
        """
        Return the only topic `name`, as `named`.

        If several robots have it, `CtcError` is raised.
        """
        connections = self.named(name)
        topics = sorted({x.topic for x in connections})
        if len(topics) > 1:
            raise CtcError(f'{self.path}: the bag has several topics {name}, and it is not known '
                           f'which one belongs to the states: {shorten(topics)}')
        return connections

    def read(self, connections: Collection[Connection]) -> Iterator[tuple[int, Any]]:
        """
        Yield log time [ns] and message of topics, as `select_readable`.

        Messages that cannot be decoded are left out.
        """
        readable = self.select_readable(connections)
        for x, t, data in self.messages(readable) if readable else ():
            message = self.decode(data, x.msgtype)
            if message is not None:
                yield t, message

    def select_readable(self, connections: Collection[Connection]) -> list[Connection]:
        """
        Return the connections of a topic that are CDR.

        Raises
        ------
        CtcError
            If none of them is CDR, or the bag has no definition of a type.

        """
        readable = [x for x in connections if is_cdr(x)]
        if connections and not readable:
            first = next(iter(connections))
            raise CtcError(f'{self.path}: messages on {first.topic} are of format '
                           f'{serialization(first)!r}; allowed: cdr, as ROS 2 has it')
        for x in readable:
            if x.msgtype not in self._types.fielddefs:
                raise CtcError(
                    f'{self.path}: the bag does not define {x.msgtype}, the type of {x.topic}; '
                    'record with --storage mcap, or convert the bag where the type is installed')
        return readable

    def decode(self, data: Any, message_type: str) -> Any:
        """Return the message in serialized data, or None."""
        try:
            return self._types.deserialize_cdr(data, message_type)
        except Exception:  # Of arbitrary bytes, decoders raise arbitrary exceptions.
            return None

    def parameters(
            self,
            node: str,
            config_class: Any,
            replacements: Mapping[str, object]) -> list[tuple[int, Any]]:
        """
        Return the configurations of a node by time.

        Parameters
        ----------
        node : str
            Name of the node.
        config_class : class
            Class of the configuration.
        replacements : mapping
            Classes in the place of those that the bag names: `Config.received`.

        Returns
        -------
        list of (int, config)
            Configurations, each with the time from which it applies [ns].

        """
        declared = config_class.parameters()
        values: dict[str, Any] = {}
        history: list[tuple[int, Any]] = []
        topic = self.only(f'{node}/{PARAMETERS}')
        messages = [message for _, message in self.read(topic)]
        for message in sorted(messages, key=lambda x: nanoseconds(x.stamp)):
            for item in [*message.new_parameters, *message.changed_parameters]:
                field = _VALUE_FIELDS.get(item.value.type)
                if item.name in declared and field:
                    values[item.name] = getattr(item.value, field)
            try:
                config = config_class.received(values, replacements)
            except CtcError as error:
                raise CtcError(f'{self.path}: {error}') from None
            if not history or history[-1][1] != config:
                history.append((nanoseconds(message.stamp), config))
        return history

    def description(self, name: str = f'controller/{ROBOT_DESCRIPTION}') -> str:
        """Return the last robot description on a topic."""
        text = ''
        for _, message in self.read(self.only(name)):
            text = str(message.data)
        return text


def serialization(connection: Connection) -> str:
    """Return a topic's format: cdr, protobuf, json, ..."""
    return str(getattr(connection.ext, 'serialization_format', ''))


def is_cdr(connection: Connection) -> bool:
    """Return whether a topic's messages are those of ROS 2."""
    return serialization(connection) == 'cdr'


def _open_file(file: Path, stack: ExitStack) -> Any:
    """
    Return an open file of a bag, `McapFile` or `Reader`, which the stack closes.

    Raises
    ------
    UnsupportedBag
        If it is no file of a ROS 2 bag.
    Exception
        Of any kind, if it is damaged.

    """
    storage = storage_of(file)
    if storage == '.bag':
        target = file.with_suffix('')
        raise UnsupportedBag(
            f'{file}: a bag of ROS 1, which is not read; convert it: rosbags-convert --src '
            f'{shlex.quote(str(file))} --dst {shlex.quote(str(target))}_ros2 '
            '--dst-storage mcap --dst-typestore ros2_jazzy')
    if storage not in ENDINGS:
        raise UnsupportedBag(f'{file}: unknown storage {file.suffix!r}; known: '
                             f'{", ".join(ENDINGS)}, also with .zstd behind it')
    if storage == '.db3' and not set('%?#').isdisjoint(str(file)):  # It would be taken for a URI.
        raise UnsupportedBag(f'{file}: the path has one of % ? #, not allowed with sqlite3')
    if file.suffix == '.zstd':
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        file = unpack_file(file, scratch / file.stem)
    if storage == '.mcap':
        return stack.enter_context(closing(McapFile(file)))
    try:
        return stack.enter_context(Reader(file))
    except KeyError as error:
        raise UnsupportedBag(
            f'{file}: definitions of messages in the format {error}, not known in sqlite3; '
            'convert it to MCAP by ros2 bag convert') from None


def _span(file: Any) -> Span:
    """Return number and log times of the messages in an open file."""
    if isinstance(file, McapFile):
        return file.span
    return Span(file.message_count, file.start_time, file.end_time - 1)


def _register_types(connections: Collection[Connection]) -> Any:
    """
    Return the types that a bag defines, beside ROS 2 Jazzy's.

    Definitions without fields, or that cannot be read, are ignored.

    Raises
    ------
    CtcError
        If a definition does not have its hash.

    """
    store = _typestore(tuple(
        (x.msgtype, x.msgdef) for x in connections
        if is_cdr(x) and x.msgdef.format != MessageDefinitionFormat.NONE))
    for x in connections:
        if x.digest and x.msgdef.data and store.hash_rihs01(x.msgtype) != x.digest:
            raise CtcError(f'the definition of {x.msgtype} does not have its hash')
    return store


@lru_cache(maxsize=8)  # Its decoders take time to make, and bags of one recorder share them.
def _typestore(definitions: tuple[tuple[str, MessageDefinition], ...]) -> Any:
    """Return ROS 2 Jazzy's types, replaced and complemented by defined ones."""
    store = get_typestore(Stores.ROS2_JAZZY)
    jazzy = dict(store.fielddefs)
    types: dict[str, Any] = {}
    for message_type, definition in definitions:
        with suppress(Exception):  # Arbitrary text may raise any exception.
            for name, fields in _parse_definition(message_type, definition).items():
                has_fields = bool(fields[1])
                if has_fields or name not in jazzy:
                    types[name] = fields
    others = {name: fields for name, fields in types.items() if fields != jazzy.get(name)}
    for name in others.keys() & jazzy.keys():
        del store.fielddefs[name], store.types[name]
    store.register(others)
    return store


def _parse_definition(message_type: str, definition: MessageDefinition) -> dict[str, Any]:
    """
    Return the types in the definition of a topic's type.

    Arbitrary text raises an error of any kind.
    """
    text = definition.data
    if definition.format == MessageDefinitionFormat.MSG:
        return dict(get_types_from_msg(text, message_type))
    types: dict[str, Any] = {}
    for section in text.split(_IDL_RULE):
        idl = section.split('\n', 1)[1] if section.startswith('IDL: ') else section
        if idl.strip():
            types.update(get_types_from_idl(idl))
    return types


class DamagedBag(CtcError):
    """A bag of which something is missing or wrong."""


def damaged(path: Path, error: Exception) -> DamagedBag:
    """Return an error that names the bag and what to do."""
    reason = ' '.join(str(error).split())
    if not isinstance(error, CtcError):
        reason = f'{type(error).__name__}: {reason}'
    if path.suffix == '.mcap' or any(path.glob('*.mcap')):
        reason += f'; "ctc repair {shlex.quote(str(path))}" recovers the rest'
    return DamagedBag(f'{path}: damaged, or not a bag: {reason}')
