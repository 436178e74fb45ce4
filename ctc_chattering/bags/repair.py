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
Opening bags, and repairing damaged ones.

Every reader of a bag calls `open_bag`, and `ctc repair` calls `repair`. Each file is repaired by
itself, from its whole chunks. The damaged version stays beside it as ``NAME.mcap.damaged``. Other
files of the directory, whether of the bag or not, are left as they are.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import closing, suppress
import dataclasses
from itertools import islice
import os
from pathlib import Path
import re
import tempfile
from typing import Any, NamedTuple

from ctc_chattering.bags.bag import Bag, damaged, DamagedBag, is_cdr
from ctc_chattering.bags.bag_files import (
    BagFiles,
    check_one_recording,
    find_recording,
    list_files,
    METADATA,
    Span,
    UnsupportedBag,
)
from ctc_chattering.bags.compression import ZSTD
from ctc_chattering.bags.mcap_file import (
    map_file,
    McapFile,
    NO_SCHEMA,
    QOS,
    read_qos,
    read_summary,
    RECORD,
    unpack_chunk,
)
from ctc_chattering.bags.writer import (
    CHUNK_SIZE_BYTES,
    NOT_COMPRESSED,
    RecordedTopic,
    write_metadata,
)
from ctc_chattering.errors import CtcError
from ctc_chattering.input_files import check_regular
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import breakup_chunk
from mcap.writer import Writer
from rosbags.rosbag2.metadata import dump_qos_v9
import yaml

#: Beginning of a chunk: opcode, length, times, size, checksum and compression.
_CHUNK_START = re.compile(
    rb'\x06(?=.{5}\0{3}.{28}(?:\0{4}|\x04\0{3}zstd|\x03\0{3}lz4))', re.DOTALL)
#: Ending of a damaged file that is kept.
_KEPT_ENDING = '.damaged'


class Repaired(NamedTuple):
    """
    Result of a repair.

    Attributes
    ----------
    recovered : int
        Number of messages in the files that were written anew.
    replaced : tuple of Path
        Where the damaged versions of replaced files are now.

    """

    recovered: int
    replaced: tuple[Path, ...]


def open_bag(path: Path) -> Bag:
    """
    Return the open bag at `path`.

    Raises
    ------
    UnsupportedBag
        If it is of a kind that is not read.
    DamagedBag
        If it is damaged.
    CtcError
        If there is no bag.

    """
    check_regular(path)
    if not path.exists():
        raise CtcError(f'{path}: no such bag')
    try:
        return Bag(path)
    except UnsupportedBag:
        raise
    except Exception as error:  # Damaged YAML or MCAP may raise any exception.
        raise damaged(path, error) from None


def repair(path: str | Path) -> Repaired | None:
    """
    Replace damaged files by the messages in whole chunks.

    Parameters
    ----------
    path : str or Path
        Directory of the bag, or one of its files, which is repaired alone.

    Returns
    -------
    Repaired or None
        None if nothing is damaged.

    Raises
    ------
    UnsupportedBag
        If a directory has several recordings.
    CtcError
        If there is no bag, or a file cannot be repaired. Then nothing is changed.

    """
    path = Path(path).absolute()
    damage = _find_damage(path)
    has_mcap = path.suffix == '.mcap' or any(path.glob('*.mcap'))
    lacks_metadata = path.is_dir() and not (path / METADATA).exists()
    if damage is None and not (has_mcap and lacks_metadata):
        return None
    if damage is not None and not has_mcap:
        raise damage
    files = _list_damaged_files(path)
    if damage is not None and {file.suffix for file in files.paths} != {'.mcap'}:
        raise damage
    folder = path if path.is_dir() else path.parent
    try:
        with tempfile.TemporaryDirectory(prefix='.repair', dir=folder) as scratch:
            return _replace_damaged(path, files, Path(scratch))
    except OSError as error:
        raise CtcError(f'{error.filename or path}: {error.strerror or error}') from None


def _replace_damaged(path: Path, files: BagFiles, scratch: Path) -> Repaired:
    """Replace damaged files and metadata by way of `scratch`."""
    new = {file: scratch / file.name for file in files.paths if _find_damage(file)}
    recovered = sum(recover(file, version) for file, version in new.items())
    if len(new) == len(files.paths) and not recovered:
        raise CtcError(f'{path}: no message in a whole chunk')
    if path.is_dir():
        versions = {file: new.get(file, file) for file in files.paths}
        new[path / METADATA] = scratch / METADATA
        _write_metadata_of(versions, files.metadata, new[path / METADATA], recovered)
    return Repaired(recovered, _put_in_place(new))


def recover(file: Path, target: Path) -> int:
    """
    Copy the messages in whole chunks and return their number.

    Every message, channel and definition is the same to the byte, whatever its format.
    """
    count = 0
    with target.open('xb') as stream:
        writer: Any = Writer(stream, chunk_size=CHUNK_SIZE_BYTES)
        writer.start(_read_profile(file), 'ctc_chattering')
        numbers: dict[tuple[object, ...], int] = {}
        for schema, channel, message in _recover_messages(file):
            definition = schema and (schema.name, schema.encoding, schema.data)
            metadata = channel.metadata
            key = definition, channel.topic, channel.message_encoding, *metadata.items()
            if key not in numbers:
                numbers[key] = writer.register_channel(
                    channel.topic,
                    channel.message_encoding,
                    writer.register_schema(*definition) if definition else 0,
                    metadata)
            writer.add_message(
                numbers[key],
                message.log_time,
                message.data,
                message.publish_time,
                message.sequence)
            count += 1
        writer.finish()
    return count


def _find_damage(path: Path) -> DamagedBag | None:
    """
    Read a bag to its end and return its damage.

    Raises
    ------
    CtcError
        If there is no bag, or one that no repair makes readable.

    """
    try:
        with closing(open_bag(path)) as reader:
            for _ in reader.messages():
                pass
    except DamagedBag as damage:
        return damage
    return None


def _list_damaged_files(path: Path) -> BagFiles:
    """Return the files of a damaged bag."""
    with suppress(Exception):  # Damaged metadata may raise any exception.
        files = list_files(path)
        existing = tuple(x for x in files.paths if x.is_file())
        if existing:
            return files._replace(paths=existing)
    return BagFiles(find_recording(path))


def _put_in_place(new: Mapping[Path, Path]) -> tuple[Path, ...]:
    """Move new files into place and return the kept old ones."""
    aside = {x: x.with_name(x.name + _KEPT_ENDING) for x in new if x.exists()}
    for kept in aside.values():
        if kept.exists():
            raise CtcError(f'{kept}: exists already, not overwritten')
    for version in new.values():
        with version.open('rb') as stream:
            os.fsync(stream.fileno())
    for file, version in new.items():
        if file in aside:
            file.rename(aside[file])
        version.rename(file)
    return tuple(aside.values())


def _write_metadata_of(
        versions: Mapping[Path, Path],
        metadata: dict[str, Any] | None,
        target: Path,
        recovered: int) -> None:
    """
    Write the metadata of a bag.

    Parameters
    ----------
    versions : mapping of Path to Path
        The files of the bag, and where they are now.
    metadata : dict or None
        Content of the old metadata; None without any.
    target : Path
        File to write.
    recovered : int
        Messages in files that were written anew.

    Raises
    ------
    UnsupportedBag
        If there are no old metadata, and files of several recordings.

    """
    is_packed = False
    spans: dict[Path, Span] = {}
    counts: Counter[tuple[str, str]] = Counter()
    topics: dict[tuple[str, str], RecordedTopic] = {}
    for file, version in versions.items():
        with closing(McapFile(version)) as content:
            spans[file] = content.span
            is_packed |= _is_packed_by_message(content)
            for number, channel in content.channels.items():
                schema = content.schemas.get(channel.schema_id, NO_SCHEMA)
                key = channel.topic, schema.name
                counts[key] += content.counts[number]
                topics[key] = RecordedTopic(schema, _with_current_qos(channel), counts[key])
    if metadata is None:
        check_one_recording(target.parent, spans)
        metadata = {}
    notes = dict(metadata.get('custom_data') or {})
    if recovered:
        notes['repaired'] = f'{recovered} messages recovered'
    compression = {key: metadata.get(key) or '' for key in NOT_COMPRESSED}
    if not metadata and is_packed:
        compression = {'compression_format': 'zstd', 'compression_mode': 'MESSAGE'}
    files = {file.name: span for file, span in spans.items()}
    write_metadata(target, files, tuple(topics.values()), notes, compression)


def _is_packed_by_message(content: McapFile) -> bool:
    """Return whether the first ROS 2 message is compressed."""
    connections = [x for x in content.connections if is_cdr(x)]
    first = islice(content.messages(connections), 1)
    return any(data.startswith(ZSTD) for _, _, data in first)


def _with_current_qos(channel: Channel) -> Channel:
    """
    Return a channel with QoS as ROS 2 Jazzy writes it.

    Text that is not QoS is left out.
    """
    profiles = yaml.safe_dump(dump_qos_v9(read_qos(channel)))
    return dataclasses.replace(channel, metadata={**channel.metadata, QOS: profiles})


def _read_profile(file: Path) -> str:
    """Return the profile in a file's header, else `ros2`."""
    with suppress(Exception), file.open('rb') as stream:  # A damaged header may raise any.
        return str(make_reader(stream).get_header().profile)
    return 'ros2'


def _recover_messages(path: Path) -> Iterator[tuple[Schema | None, Channel, Message]]:
    """Yield the messages in whole chunks, searched byte by byte."""
    data = map_file(path)
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    with suppress(Exception):  # A damaged summary may raise any exception.
        summary = read_summary(data)
        schemas, channels = summary.schemas, summary.channels
    chunk_end = 0
    for match in _CHUNK_START.finditer(data):
        begin = match.start() + RECORD.size
        end = begin + RECORD.unpack_from(data, match.start())[1]
        if match.start() < chunk_end or end > len(data):
            continue
        try:
            chunk, content = unpack_chunk(data[begin:end])
            records: list[Any] = breakup_chunk(
                dataclasses.replace(chunk, compression='', data=content))
        except Exception:  # A damaged chunk may raise any exception.
            continue
        chunk_end = end
        for record in records:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif record.channel_id in channels:
                channel = channels[record.channel_id]
                if not channel.schema_id or channel.schema_id in schemas:
                    yield schemas.get(channel.schema_id), channel, record
