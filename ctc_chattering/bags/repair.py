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

"""Opening bags, and recovering the messages of damaged ones."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, suppress
import dataclasses
from pathlib import Path
import re
import tempfile
from typing import Any

from ctc_chattering.bags.bag import Bag, damaged, index_of, mapped, RECORD, unpacked_chunk
from ctc_chattering.bags.writer import BagWriter, QOS
from ctc_chattering.errors import CtcError
from ctc_chattering.input_files import check_regular
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import breakup_chunk
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos
from rosbags.typesys import get_types_from_msg
import yaml

#: A chunk: its length, times, size, checksum, and what it is packed with.
_CHUNK_START = re.compile(
    rb'\x06(?=.{5}\0{3}.{28}(?:\0{4}|\x04\0{3}zstd|\x03\0{3}lz4))', re.DOTALL)


def open_bag(path: Path) -> Bag:
    """
    Return the open bag at `path`.

    Raises
    ------
    CtcError
        If there is no bag, or it cannot be read.

    """
    check_regular(path)
    if not path.exists():
        raise CtcError(f'{path}: no such bag')
    try:
        return Bag(path)
    except Exception as error:  # Damaged YAML or MCAP may raise any exception.
        raise damaged(path, error) from None


def _messages(path: Path) -> Iterator[tuple[Schema, Channel, Message]]:
    """Yield the messages in the whole chunks of a file, which are looked for byte by byte."""
    data, end = mapped(path), 0
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    with suppress(Exception):  # A damaged index may raise any exception; there may be none.
        summary: Any = index_of(data)
        schemas, channels = summary.schemas, summary.channels
    for match in _CHUNK_START.finditer(data):
        begin = match.start() + RECORD.size
        stop = begin + RECORD.unpack_from(data, match.start())[1]
        if match.start() < end or stop > len(data):
            continue
        try:
            chunk, found = unpacked_chunk(data[begin:stop])
            records: list[Any] = breakup_chunk(
                dataclasses.replace(chunk, compression='', data=found))
        except Exception:  # A damaged chunk may raise any exception.
            continue
        end = stop
        for x in records:
            if isinstance(x, Schema):
                schemas[x.id] = x
            elif isinstance(x, Channel):
                channels[x.id] = x
            elif x.channel_id in channels and channels[x.channel_id].schema_id in schemas:
                channel = channels[x.channel_id]
                yield schemas[channel.schema_id], channel, x


def _readable(schema: Schema, channel: Channel) -> tuple[Schema, Channel]:
    """Return the description of a topic as `rosbags` reads it, and QoS as of ROS 2 Jazzy."""
    try:
        if schema.encoding != 'ros2idl':
            get_types_from_msg({'ros2msg': schema.data}[schema.encoding].decode(), schema.name)
    except Exception:  # As of services; of arbitrary text, any.
        schema = dataclasses.replace(schema, encoding='', data=b'')
    profiles = ''
    with suppress(Exception):  # Of arbitrary text, any.
        profiles = yaml.safe_dump(dump_qos_v9(parse_qos(channel.metadata[QOS])))
    return schema, dataclasses.replace(channel, metadata={**channel.metadata, QOS: profiles})


def recover(bag: Path, target: Path) -> int:
    """
    Write the messages in whole chunks of a damaged bag as a new bag; return how many there are.

    Parameters
    ----------
    bag : Path
        Directory with MCAP files.
    target : Path
        Directory to create.

    Raises
    ------
    CtcError
        If there is no message left, or the new bag cannot be written.

    """
    recording = BagWriter(target)
    try:
        for path in sorted(bag.glob('*.mcap'), key=lambda x: (len(x.name), x.name)):
            for schema, channel, message in _messages(path):
                if message.data.startswith(b'\x28\xb5\x2f\xfd'):  # As of zstd; no CDR does.
                    raise CtcError(f'{bag}: messages compressed one by one cannot be recovered')
                if channel.topic not in recording.topics:
                    recording.topics[channel.topic] = _readable(schema, channel)
                recording.add_message(channel.topic, message.log_time, message.data)
        count = recording.counts.total()
        recording.notes['repaired'] = f'{count} messages recovered'
        recording.close()
    except OSError as error:
        raise CtcError(f'{error.filename or target}: {error.strerror or error}') from None
    if not count:
        raise CtcError(f'{bag}: no message in a whole chunk')
    return count


def repair(bag: str | Path) -> tuple[int, Path] | None:
    """
    Replace a damaged bag by one with all messages of whole chunks; keep the damaged one.

    Parameters
    ----------
    bag : str or Path
        Directory of the bag.

    Returns
    -------
    (int, Path) or None
        How many messages were recovered, and the new path of the damaged bag; None if the bag is
        not damaged.

    Raises
    ------
    CtcError
        If there is no bag, or nothing can be recovered.

    """
    bag = Path(bag).absolute()
    try:
        with closing(open_bag(bag)) as reader:
            for _ in reader.messages():
                pass
        return None
    except CtcError:
        if not any(bag.glob('*.mcap')):
            raise
    aside = bag.with_name(bag.name + '.damaged')
    if aside.exists():
        raise CtcError(f'{aside}: exists already, not overwritten')
    with tempfile.TemporaryDirectory(dir=bag.parent) as scratch:
        count = recover(bag, Path(scratch) / bag.name)
        bag.rename(aside)
        (Path(scratch) / bag.name).rename(bag)
    return count, aside
