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

from collections import Counter
from collections.abc import Iterator
from contextlib import closing, suppress
import dataclasses
from io import BytesIO
from pathlib import Path
import re
import shutil
import sys
import tempfile
from typing import Any
import weakref
import zlib

from ctc_chattering.bags.bag import (
    Bag,
    damaged,
    index_of,
    MAGIC,
    mapped,
    RECORD,
    records,
    UnknownDefinition,
    unpacked,
    unpacked_chunk,
)
from ctc_chattering.bags.writer import BagWriter, DESCRIPTIONS, Span, TopicType
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import seconds
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Message, Schema
from mcap.stream_reader import breakup_chunk
import yaml

#: What a message that is compressed by itself begins with; no other one does.
_ZSTD = b'\x28\xb5\x2f\xfd'
#: A chunk: its length, times, size, checksum, and what it is packed with.
_CHUNK_START = re.compile(
    rb'\x06(?=.{5}\0{3}.{28}(?:\0{4}|\x04\0{3}zstd|\x03\0{3}lz4))', re.DOTALL)
#: An attachment with descriptions: its length, no times, and its name.
_DESCRIPTIONS_START = re.compile(
    rb'\x09(?=.{5}\0{19}%c\0{3}%s)' % (len(DESCRIPTIONS), DESCRIPTIONS.encode()), re.DOTALL)
#: Latest time that a bag can have [ns].
_LATEST = 2 ** 63 - 1


@dataclasses.dataclass
class Recovery:
    """
    What was found in a damaged bag.

    Attributes
    ----------
    span : Span
        Of the messages recovered.
    lost : int
        Bytes that could not be read: damaged chunks, the ends of truncated files, and messages
        without a type or a valid time.
    missing : dict
        Number of messages by topic that were written and not recovered.
    is_counted : bool
        Whether metadata or index tell how many messages were written. Otherwise more may be
        missing at the end.

    """

    span: Span = dataclasses.field(default_factory=Span)
    lost: int = 0
    missing: dict[str, int] = dataclasses.field(default_factory=dict)
    is_counted: bool = False

    def __str__(self) -> str:
        """Return a summary on one line."""
        count, missing = self.span.count, sum(self.missing.values())
        duration = seconds(self.span.end - self.span.begin) if count else 0.0
        topics = ', '.join(f'{topic} {number}' for topic, number in sorted(self.missing.items()))
        return (f'{count} messages over {duration:.3f} s recovered, {missing} of '
                f'{"" if self.is_counted else "at least "}{count + missing} missing'
                + (f' ({topics})' if topics else '') + f', {self.lost} bytes unreadable')


class _DamagedFile:
    """
    What can be read of an MCAP file: whole chunks, by their checksums, and the records in them.

    Chunks are looked for byte by byte. Without any, the records before the first wrong one are
    taken.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    counts : Counter or None
        Number of messages by topic, as the index has it; None without it.
    lost : int
        Bytes that could not be read; complete after `messages`.

    """

    def __init__(self, path: Path) -> None:
        self._data, self.lost = mapped(path), 0
        self._known: dict[tuple[type, int], Any] = {}
        self.counts: Counter[str] | None = None
        try:
            summary = index_of(path, self._data)
        except Exception:  # A damaged index may raise any exception.
            summary = None
        if summary:
            self._known.update({(Schema, x): schema for x, schema in summary.schemas.items()})
            self._known.update({(Channel, x): item for x, item in summary.channels.items()})
        for match in _DESCRIPTIONS_START.finditer(self._data):
            _, start, end = _record(self._data, match.start())
            content = self._data[start:end]
            if content[-4:] == zlib.crc32(content[:-4]).to_bytes(4, 'little'):
                with suppress(Exception):  # It may be of another program.
                    stream = ReadDataStream(BytesIO(content))
                    list(self._messages(_records(Attachment.read(stream).data)))
        if summary and summary.statistics:
            self.counts = Counter({
                summary.channels[x].topic: count for x, count in
                summary.statistics.channel_message_counts.items() if x in summary.channels})

    def messages(self) -> Iterator[tuple[Channel, Schema, Message]]:
        """Yield the messages in the order of the file."""
        place = len(MAGIC)
        for begin, end, content in self._parts():
            self._skip(place, begin)
            place = end
            yield from self._messages(content)
        end = len(self._data)
        self._skip(place, end - len(MAGIC) if self._data[-len(MAGIC):] == MAGIC else end)

    def _parts(self) -> Iterator[tuple[int, int, list[Any]]]:
        """Yield begin, end and records of the chunks, or else of the records, that are whole."""
        data, place = self._data, 0
        for match in _CHUNK_START.finditer(data):
            _, start, end = _record(data, match.start())
            if place <= match.start() < end:
                with suppress(Exception):  # A damaged chunk may raise any exception.
                    found = _records(unpacked_chunk(data[start:end])[1])
                    place = end
                    yield match.start(), end, found
        for _, start, end in () if place else records(data, len(MAGIC), len(data)):
            begin = start - RECORD.size
            if end < len(data) and not 0 < _record(data, end)[0] <= Opcode.DATA_END:
                break
            with suppress(Exception):
                yield begin, end, _records(data[begin:end])

    def _skip(self, begin: int, end: int) -> None:
        """Count the bytes between two parts that cannot be read."""
        for kind, start, stop in records(self._data, begin, end):
            self.lost += (stop - start) * (kind == Opcode.CHUNK)
            begin = stop
        self.lost += end - begin

    def _messages(self, found: list[Any]) -> Iterator[tuple[Channel, Schema, Message]]:
        """Yield the messages that have a type and a possible time, and take the descriptions."""
        for x in found:
            if not isinstance(x, Message):
                self._known[type(x), x.id] = x
                continue
            channel = self._known.get((Channel, x.channel_id))
            schema = channel and self._known.get((Schema, channel.schema_id))
            if channel is None or schema is None or x.log_time > _LATEST:
                self.lost += len(x.data)
            else:
                yield channel, schema, x


def _record(data: Any, begin: int) -> tuple[int, int, int]:
    """Return kind, begin of the content, and end of a record; three times 0 if it is cut off."""
    return next(records(data, begin, len(data)), (0, 0, 0))


def _records(content: bytes) -> list[Any]:
    """Return schemas, channels and messages; raise an exception of any kind if one is damaged."""
    if [0, *(end for _, _, end in records(content, 0, len(content)))][-1] != len(content):
        raise CtcError('a record is cut off')
    return breakup_chunk(Chunk('', content, 0, 0, 0, len(content)))


def recover(bag: Path, target: Path) -> Recovery:
    """
    Write all that can be read of a damaged bag as a new bag.

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
    found, recording = Recovery(), BagWriter(target)
    written, custom = _metadata(bag)
    numbers, indexed, is_indexed = Counter[str](), Counter[str](), True
    try:
        for path in sorted(bag.glob('*.mcap'), key=lambda x: (len(x.name), x.name)):
            file = _DamagedFile(path)
            for channel, schema, message in file.messages():
                topic, data = channel.topic, message.data
                if topic not in recording.counts:
                    recording.add_topic(topic, TopicType(
                        schema.name, schema.encoding, schema.data, channel.metadata))
                if data.startswith(_ZSTD):
                    with suppress(Exception):  # It may be anything, or unpack to too much.
                        data = unpacked(data, 'zstd')
                recording.add_message(topic, message.log_time, data)
                numbers[topic] = max(numbers[topic], message.sequence)
            found.lost += file.lost
            indexed += file.counts or Counter()
            is_indexed &= file.counts is not None
        found.is_counted = is_indexed or written is not None
        found.missing = dict(
            (numbers | indexed | (written or Counter())) - Counter(recording.counts))
        found.span = recording.span
        for key, value in {**custom, 'repaired': str(found)}.items():
            recording.note(key, value)
        recording.close()
    except OSError as error:
        raise CtcError(f'{error.filename or target}: {error.strerror or error}') from None
    if not found.span.count:
        raise CtcError(f'{bag}: no message in it can be recovered')
    return found


def _metadata(bag: Path) -> tuple[Counter[str] | None, dict[str, str]]:
    """Return number of messages by topic, None if not known, and custom data, of the metadata."""
    try:
        info: Any = yaml.safe_load((bag / 'metadata.yaml').read_text(encoding='utf-8')
                                   )['rosbag2_bagfile_information']
        counts = Counter[str]()
        for topic in info['topics_with_message_count']:
            counts[topic['topic_metadata']['name']] += topic['message_count']
        is_right = {counts.total(), sum(x['message_count'] for x in info['files'])} == {
            info['message_count']}
        return counts if is_right else None, dict(info.get('custom_data') or {})
    except Exception:  # Of damaged metadata, anything may be wrong.
        return None, {}


def is_damaged(bag: Path) -> bool:
    """Return whether `bag` is a directory with MCAP files and without metadata."""
    return bag.is_dir() and not (bag / 'metadata.yaml').exists() and any(bag.glob('*.mcap'))


def open_bag(path: Path) -> Bag:
    """
    Return the open bag at `path`.

    Raises
    ------
    CtcError
        If there is no bag, or it cannot be read.

    """
    if not path.exists():
        raise CtcError(f'{path}: no such bag')
    try:
        return _copied(path, 'not closed properly') if is_damaged(path) else Bag(path, path)
    except UnknownDefinition as error:
        return _copied(path, f'{error}, and is read without it')
    except Exception as error:  # Damaged YAML or MCAP may raise any exception.
        is_ours = isinstance(error, CtcError)
        if is_ours and str(path) in str(error):
            raise
        if is_ours or (path.is_dir() and any(path.glob('*.mcap'))):
            raise damaged(path, error) from None
        raise CtcError(f'{path}: not a bag: {" ".join(str(error).split())}') from None


def _copied(path: Path, reason: str) -> Bag:
    """Return what can be read of the MCAP files of a bag as an open bag."""
    scratch = tempfile.TemporaryDirectory()
    place = Path(scratch.name) / 'bag'
    print(f'{path}: {reason}: {recover(path, place)}', file=sys.stderr)
    bag = Bag(path, place)
    weakref.finalize(bag, scratch.cleanup)
    return bag


def is_whole(bag: Path) -> bool:
    """Return whether all messages that the metadata of a bag count can be read."""
    if is_damaged(bag):
        return False
    try:
        with closing(open_bag(bag)) as reader:
            return sum(1 for _ in reader.messages()) == reader.message_count
    except CtcError:
        return False


def repair(bag: str | Path) -> tuple[Recovery, Path] | None:
    """
    Replace a damaged bag by one with all messages that can be read; keep the damaged one.

    Parameters
    ----------
    bag : str or Path
        Directory of the bag.

    Returns
    -------
    (Recovery, Path) or None
        What was recovered, and the new path of the damaged bag; None if the bag is not damaged.

    Raises
    ------
    CtcError
        If there is no bag, or nothing can be recovered.

    """
    bag = Path(bag)
    if not bag.exists():
        raise CtcError(f'{bag}: no such bag')
    if is_whole(bag):
        return None
    if not any(bag.glob('*.mcap')):
        raise CtcError(f'{bag}: not a bag: it holds no MCAP file')
    aside = bag.with_name(bag.name + '.damaged')
    if aside.exists():
        raise CtcError(f'{aside}: exists already, not overwritten')
    with tempfile.TemporaryDirectory(dir=bag.resolve().parent) as scratch:
        whole = Path(scratch) / bag.resolve().name
        found = recover(bag, whole)
        bag.rename(aside)
        shutil.move(whole, bag)
    return found, aside
