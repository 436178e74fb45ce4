"""Opening bags, and recovering the messages of damaged ones."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterator, Sequence
from contextlib import closing
import dataclasses
from pathlib import Path
import shutil
import sys
import tempfile
from typing import Any
import weakref

from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import breakup_chunk, StreamReader
from rosbags.interfaces import (
    Connection,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
)
from rosbags.rosbag2 import Reader
from rosbags.typesys import get_typestore, Stores
import yaml

from ctc_chattering.bags.index_checksum import check_index
from ctc_chattering.bags.writer import Recording, Span, TopicType
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import seconds

#: Latest time that a bag can have [ns].
_LATEST = 2 ** 63 - 1
#: Policies of QoS that recorders before Jazzy write as numbers.
_POLICIES = {'history': QosHistory, 'reliability': QosReliability, 'durability': QosDurability,
             'liveliness': QosLiveliness}


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

    """

    span: Span = dataclasses.field(default_factory=Span)
    lost: int = 0

    def __str__(self) -> str:
        """Return a summary on one line."""
        duration = seconds(self.span.end - self.span.begin)
        return (f'{self.span.count} messages over {duration:.3f} s recovered, '
                f'{self.lost} bytes unreadable')


def is_damaged(bag: Path) -> bool:
    """Return whether `bag` is a directory with MCAP files and without metadata."""
    return bag.is_dir() and not (bag / 'metadata.yaml').exists() and any(bag.glob('*.mcap'))


class BagReader(Reader):
    """
    The reader of rosbags, with errors that name the bag and what to do; close it after use.

    Parameters
    ----------
    path : Path
        What errors say.
    place : Path
        Directory or file to read.

    """

    def __init__(self, path: Path, place: Path) -> None:
        super().__init__(place)
        self._bag = path
        self._typestore = get_typestore(Stores.ROS2_JAZZY)

    def messages(self, connections: Collection[Connection] = (), start: int | None = None,
                 stop: int | None = None) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield connection, log time [ns] and data; raise `CtcError` where the bag is damaged."""
        try:
            yield from super().messages(connections, start, stop)
        except Exception as error:  # Damaged chunks may raise any exception.
            raise _damaged(self._bag, error) from None

    def deserialize(self, data: bytes, kind: str) -> Any:
        """Return a message of one of the types that ROS 2 Jazzy brings along."""
        return self._typestore.deserialize_cdr(data, kind)


def open_bag(path: Path) -> BagReader:
    """
    Return an open reader of the bag at `path`.

    Raises
    ------
    CtcError
        If there is no bag, or it cannot be read.

    """
    if not path.exists():
        raise CtcError(f'{path}: no such bag')
    scratch = None
    place = path
    if is_damaged(path):
        scratch = tempfile.TemporaryDirectory()
        place = Path(scratch.name) / 'bag'
        print(f'{path}: not closed properly: {recover(path, place)}', file=sys.stderr)
    try:
        for file in place.glob('*.mcap'):
            check_index(file)
        reader = BagReader(path, place)
        reader.open()
    except Exception as error:  # Damaged YAML or MCAP may raise any exception.
        if any(place.glob('*.mcap')):
            raise _damaged(path, error) from None
        raise CtcError(f'{path}: not a bag: {" ".join(str(error).split())}') from None
    if scratch is not None:
        weakref.finalize(reader, scratch.cleanup)
    return reader


def _damaged(path: Path, error: Exception) -> CtcError:
    """Return an error that names the bag and what to do."""
    advice = f'; "ctc repair {path}" recovers the rest' if any(path.glob('*.mcap')) else ''
    return CtcError(f'{path}: damaged: {" ".join(str(error).split()).rstrip(".")}{advice}')


def is_whole(bag: Path) -> bool:
    """Return whether all messages that the metadata of a bag count can be read."""
    if is_damaged(bag):
        return False
    try:
        with closing(open_bag(bag)) as reader:
            return sum(1 for _ in reader.messages()) == reader.message_count
    except CtcError:
        return False


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
    found = Recovery()
    recording = Recording(target)
    try:
        for file in sorted(bag.glob('*.mcap'), key=lambda x: (len(x.name), x.name)):
            for topic, kind, message in _messages(file, found):
                if topic not in recording.counts:
                    recording.add_topic(topic, kind)
                recording.add_message(topic, message.log_time, message.data)
        recording.close()
    except OSError as error:
        raise CtcError(f'{target}: {error.strerror or error}') from None
    found.span = recording.span
    if not found.span.count:
        raise CtcError(f'{bag}: no message in it can be recovered')
    return found


def repair(bag: Path) -> tuple[Recovery, Path] | None:
    """
    Replace a damaged bag by one with all messages that can be read; keep the damaged one.

    Returns
    -------
    (Recovery, Path) or None
        What was recovered, and the new path of the damaged bag; None if the bag is not damaged.

    Raises
    ------
    CtcError
        If there is no bag, or nothing can be recovered.

    """
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


def _messages(file: Path, found: Recovery) -> Iterator[tuple[str, TopicType, Message]]:
    """Yield topic, type and message of one file, without damaged chunks."""
    schemas: dict[int, Schema] = {}
    topics: dict[int, tuple[str, TopicType]] = {}
    for record in _records(file, found):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.schema_id in schemas:
            schema = schemas[record.schema_id]
            profiles = _named_policies(record.metadata.get('offered_qos_profiles', ''))
            topics[record.id] = record.topic, TopicType(
                schema.name, schema.encoding, schema.data,
                {**record.metadata, 'offered_qos_profiles': profiles})
        elif isinstance(record, Message):
            if record.channel_id in topics and record.log_time <= _LATEST:
                yield *topics[record.channel_id], record
            else:
                found.lost += len(record.data)


def _records(file: Path, found: Recovery) -> Iterator[McapRecord]:
    """Yield the records of one file, in chunks or outside."""
    size, whole = file.stat().st_size, 0
    with file.open('rb') as stream:
        try:
            for record in StreamReader(stream, emit_chunks=True, record_size_limit=size).records:
                whole = stream.tell()
                yield from _unpacked(record, found)
        except Exception:  # A damaged record may raise any exception.
            found.lost += size - whole


def _unpacked(record: McapRecord, found: Recovery) -> Sequence[McapRecord]:
    """Return the records in a chunk, or the record itself if it is none."""
    if not isinstance(record, Chunk):
        return [record]
    try:
        return breakup_chunk(record, validate_crc=True)
    except Exception:  # A damaged chunk may raise any exception.
        found.lost += len(record.data)
        return []


def _named_policies(text: str) -> str:
    """Return QoS profiles with the names of their policies; nothing if they cannot be read."""
    try:
        profiles = yaml.safe_load(text) or []
        for profile in profiles:
            for key, kind in _POLICIES.items():
                if isinstance(profile[key], int):
                    profile[key] = kind(profile[key]).name.lower()
    except (yaml.YAMLError, LookupError, TypeError, ValueError):
        return ''
    return yaml.safe_dump(profiles)
