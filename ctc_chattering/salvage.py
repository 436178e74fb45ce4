"""Opening bags; what is left of those that are damaged, and a whole bag made of it."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterator
from contextlib import closing
import dataclasses
import functools
from pathlib import Path
import shutil
import sys
import tempfile
from typing import NamedTuple
import weakref

from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import breakup_chunk, StreamReader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat, Qos
from rosbags.rosbag2 import storage_mcap
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import get_typestore, Stores

from ctc_chattering.core.grid import seconds
from ctc_chattering.errors import CtcError
from ctc_chattering.index_checksum import check_index
from ctc_chattering.recording import Recording

#: How rosbags finds the definition of a type.
_get_msgdef = storage_mcap.get_msgdef


def _definition(schema: storage_mcap.Schema | None) -> MessageDefinition:
    """Return the definition of a message; none of a service's event, which rosbags cannot read."""
    if schema is not None and '/srv/' in schema.name:
        return MessageDefinition(MessageDefinitionFormat.NONE, '')
    return _get_msgdef(schema)


# Otherwise it refuses the whole bag; `ros2 bag record -a` has such events in it.
storage_mcap.get_msgdef = _definition


class Entry(NamedTuple):
    """A message as it stands in the file."""

    topic: str
    kind: str
    t: int
    data: bytes
    qos: str


@dataclasses.dataclass
class Salvage:
    """
    What was found in a damaged bag.

    Attributes
    ----------
    messages : int
        Number of messages recovered.
    begin, end : int
        Log times of the first and the last of them [ns].
    lost : int
        Bytes that could not be read: damaged chunks, the ends of files that are cut off, and
        messages that no bag can hold.

    """

    messages: int = 0
    begin: int = 0
    end: int = 0
    lost: int = 0

    def __str__(self) -> str:
        """Return the finding on one line."""
        span = seconds(self.end - self.begin)
        return (f'{self.messages} messages over {span:.3f} s recovered, '
                f'{self.lost} bytes unreadable')


def is_damaged(bag: Path) -> bool:
    """Return whether `bag` is a directory with MCAP files and without metadata."""
    return bag.is_dir() and not (bag / 'metadata.yaml').exists() and any(bag.glob('*.mcap'))


class BagReader(AnyReader):
    """
    Reads a bag at `path`, which stands in errors, from the directory `place`.

    Attributes
    ----------
    path : Path
        Where the bag is for the user.

    """

    def __init__(self, path: Path, place: Path) -> None:
        super().__init__([place], default_typestore=get_typestore(Stores.ROS2_JAZZY))
        self.path = path

    def messages(self, connections: Collection[Connection] = (), start: int | None = None,
                 stop: int | None = None) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield messages; raise `CtcError` where the bag is damaged."""
        try:
            yield from super().messages(connections, start, stop)
        except Exception as error:  # Whatever a reader makes of bytes that are no chunk.
            raise _damaged(self.path, error) from None


def open_bag(path: Path) -> BagReader:
    """
    Return an open reader of the bag at `path`; close it after use.

    Raises
    ------
    CtcError
        If there is no bag, or it cannot be read.

    """
    if not path.exists():
        raise CtcError(f'{path}: no such bag')
    scratch = None
    place = path
    if path.is_dir() and (path.suffix == '.bag' or is_damaged(path)):
        scratch = tempfile.TemporaryDirectory()
        place = Path(scratch.name) / 'bag'
        if is_damaged(path):
            print(f'{path}: not closed properly: {rewrite(path, place)}', file=sys.stderr)
        else:  # AnyReader takes what is called .bag for a bag of ROS 1.
            place.symlink_to(path.resolve())
    try:
        for file in place.glob('*.mcap'):
            check_index(file)
        reader = BagReader(path, place)
        reader.open()
    except Exception as error:
        if any(place.glob('*.mcap')):
            raise _damaged(path, error) from None
        raise CtcError(f'{path}: not a bag: {" ".join(str(error).split())}') from None
    if scratch is not None:
        weakref.finalize(reader, scratch.cleanup)
    return reader


def _damaged(path: Path, error: Exception) -> CtcError:
    """Return an error that names the bag and says what to do."""
    advice = f'; "ctc repair {path}" recovers what is whole' if any(path.glob('*.mcap')) else ''
    return CtcError(f'{path}: damaged: {" ".join(str(error).split()).rstrip(".")}{advice}')


def is_whole(bag: Path) -> bool:
    """Return whether all the messages that a bag says it has can be read."""
    if is_damaged(bag):
        return False
    try:
        with closing(open_bag(bag)) as reader:
            return sum(1 for _ in reader.messages()) == reader.message_count
    except CtcError:
        return False


def rewrite(bag: Path, target: Path) -> Salvage:
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
    found = Salvage()
    recording = Recording(target)
    try:
        for file in sorted(bag.glob('*.mcap')):
            for entry in _entries(file, found):
                try:
                    recording.write(entry.topic, entry.kind, entry.t, entry.data, _qos(entry.qos))
                except OSError:
                    raise
                except Exception:  # Of a type that there is not, at a time that no clock shows, …
                    found.lost += len(entry.data)
                    continue
                found.begin = min(found.begin, entry.t) if found.messages else entry.t
                found.end = max(found.end, entry.t)
                found.messages += 1
        recording.close()
    except OSError as error:
        raise CtcError(f'{target}: {error.strerror or error}') from None
    if not found.messages:
        raise CtcError(f'{bag}: no message in it can be recovered')
    return found


def repair(bag: Path) -> tuple[Salvage, Path] | None:
    """
    Put a whole bag in the place of a damaged one, which is kept beside it.

    Returns
    -------
    (Salvage, Path) or None
        What was recovered, and where the damaged bag is now; None if the bag is not damaged.

    Raises
    ------
    CtcError
        If there is no damaged bag, or nothing can be recovered.

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
        found = rewrite(bag, whole)
        bag.rename(aside)
        shutil.move(whole, bag)
    return found, aside


def _entries(file: Path, found: Salvage) -> Iterator[Entry]:
    """Yield the messages of one file, without chunks that are damaged, up to where it is cut."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    for record in _records(file, found):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message):
            channel = channels.get(record.channel_id)
            schema = schemas.get(channel.schema_id) if channel else None
            if channel is None or schema is None:
                found.lost += len(record.data)
                continue
            yield Entry(channel.topic, schema.name, record.log_time, bytes(record.data),
                        str(channel.metadata.get('offered_qos_profiles', '')))


def _records(file: Path, found: Salvage) -> Iterator[McapRecord]:
    """Yield what stands in one file, in chunks or outside."""
    size = file.stat().st_size
    with file.open('rb') as stream:
        records = StreamReader(stream, emit_chunks=True, record_size_limit=size).records
        whole = 0
        while True:
            try:
                record = next(records)
                whole = stream.tell()
            except StopIteration:
                return
            except Exception:  # Whatever a decoder makes of bytes that are no record.
                found.lost += size - whole
                return
            if not isinstance(record, Chunk):
                yield record
                continue
            try:
                inside = breakup_chunk(record, validate_crc=True)
            except Exception:  # The same, of a decompressor.
                found.lost += len(record.data)
                continue
            yield from inside


@functools.cache
def _qos(text: str) -> tuple[Qos, ...]:
    """Return what publishers offered; nothing if it cannot be read."""
    try:
        return tuple(parse_qos(text))
    except Exception:  # A parser of YAML, on bytes that are none.
        return ()
