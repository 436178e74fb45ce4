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

"""Bags that are truncated or have wrong bytes, and what is recovered of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import closing
import functools
import os
from pathlib import Path
import random
import resource
import shutil
import struct
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from ctc_chattering.bags.bag_files import UnsupportedBag
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.bags.repair import open_bag, recover, repair
from ctc_chattering.bags.writer import BagWriter
from ctc_chattering.cli.ctc import main
from ctc_chattering.errors import CtcError
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from motion_bags import string
from motion_bags import write as write_bag
import pytest
from recorded_runs import metadata
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin
import yaml

#: Topic, log time [ns] and data.
Row = tuple[str, int, bytes]
CHUNKS, TOPICS = 10, 3
NOISE = 4096


class Original(NamedTuple):
    """
    A bag before it is damaged.

    Attributes
    ----------
    data, metadata : bytes
        Its file, and its ``metadata.yaml``.
    size : int
        What a recorder that is killed leaves of the file.
    chunks : list of (begin, end, messages)
        What stands where.

    """

    data: bytes
    metadata: bytes
    size: int
    chunks: list[tuple[int, int, list[Row]]]

    @property
    def rows(self) -> list[Row]:
        return [row for _, _, rows in self.chunks for row in rows]

    def untouched(self, begin: int, end: int) -> list[Row]:
        """Return the messages of chunks that a range of bytes does not touch."""
        return [row for a, b, rows in self.chunks if b <= begin or end <= a for row in rows]

    def bag(self, path: Path, data: bytes, is_closed: bool = False) -> Path:
        """Write a bag of one file, with the metadata if the recorder has closed it."""
        path.mkdir()
        (path / 'bag_0.mcap').write_bytes(data)
        if is_closed:
            (path / 'metadata.yaml').write_bytes(self.metadata)
        return path

    def recovered(self, data: bytes, is_closed: bool = False) -> list[Row]:
        """Return what is recovered of such a bag, as the mcap library reads it."""
        with TemporaryDirectory() as scratch:
            new = Path(scratch) / 'new.mcap'
            count = recover(self.bag(Path(scratch) / 'bag', data, is_closed) / 'bag_0.mcap', new)
            rows = rows_of(new)
        assert len(rows) == count
        return rows


def rows_of(file: Path) -> list[Row]:
    with file.open('rb') as stream:
        return [(channel.topic, message.log_time, message.data) for _, channel, message
                in make_reader(stream).iter_messages(log_time_order=False)]


@pytest.fixture(scope='module')
def original(tmp_path_factory: pytest.TempPathFactory) -> Original:
    dice, t = random.Random(1), 0
    recording = BagWriter(tmp_path_factory.mktemp('original') / 'bag')
    parts: list[list[Row]] = []
    for part in range(CHUNKS):
        parts.append([])
        for k in range(12):
            t += 1
            # The last topic begins late.
            row = (f'/{"abc"[k % (TOPICS if part > 2 else TOPICS - 1)]}', t, b'\0\1\0\0'
                   + struct.pack('<I', 401) + dice.randbytes(400) + b'\0')
            recording.write(row[0], 'std_msgs/msg/String', *row[1:], '')
            parts[-1].append(row)
        recording.flush()
    size = recording.file.stat().st_size
    recording.close()
    ends = []
    with recording.file.open('rb') as stream:
        for record in StreamReader(stream, emit_chunks=True).records:
            if isinstance(record, Chunk) and record.message_end_time:
                length = 49 + len(record.compression) + len(record.data)
                ends.append((stream.tell() - length, stream.tell()))
    assert len(ends) == CHUNKS
    return Original(recording.file.read_bytes(),
                    (recording.path / 'metadata.yaml').read_bytes(), size,
                    [(*place, rows) for place, rows in zip(ends, parts)])


def test_what_was_flushed_before_a_cut_is_recovered(original: Original) -> None:
    """Check cuts within and between chunks, and that one flush ends with the chunk."""
    dice, (_, first, _) = random.Random(4), original.chunks[0]
    for size in [first, original.size, *dice.sample(range(first, original.size), 12)]:
        assert original.recovered(original.data[:size]) == [
            row for _, end, rows in original.chunks if end <= size for row in rows]


def damages(original: Original) -> Iterator[tuple[bool, int, int, bytes]]:
    """Yield whether the bag is closed, first and last wrong byte, and the file."""
    dice = random.Random(1)
    places = [(dice.randrange(original.size - NOISE), k % 2 and NOISE) for k in range(32)]
    # The header, schemas and channels outside chunks, and the first chunk with both.
    places += [(place, 0) for place in range(0, original.chunks[1][0], 307)]
    for k, (place, length) in enumerate(places):
        data = bytearray(original.data if k % 4 > 1 else original.data[:original.size])
        if length:
            data[place:place + length] = dice.randbytes(length)
        else:
            data[place] ^= 1 << dice.randrange(8)
        yield k % 4 > 1, place, place + length + 1, bytes(data)


def test_wrong_bytes_anywhere_are_found_and_cost_their_chunks_only(
        original: Original, tmp_path: Path) -> None:
    """None of the messages is wrong, none is there twice; a bag that is whole has all."""
    for k, (is_closed, begin, end, data) in enumerate(damages(original)):
        rows = original.recovered(data, is_closed)
        assert not Counter(rows) - Counter(original.rows)
        assert not set(original.untouched(begin, end)) - set(rows)
        if is_closed and set(original.rows) - set(rows):
            with pytest.raises(CtcError, match='damaged, '):
                open_bag(original.bag(tmp_path / f'{k}', data, is_closed))


@pytest.mark.parametrize('options', [
    {}, {'compression': CompressionType.NONE}, {'compression': CompressionType.LZ4},
    {'enable_crcs': False}, {'use_chunking': False}])
def test_files_of_other_recorders(
        original: Original, options: dict[str, Any], tmp_path: Path) -> None:
    """
    The index has the types of a damaged first chunk; without chunks nothing has a checksum.

    The last message is a chunk itself, which is none of the file.
    """
    file, rows = tmp_path / 'file.mcap', [*original.rows]
    if 'use_chunking' not in options:
        rows.append(('/a', 10 ** 6, original.data[slice(*original.chunks[1][:2])]))
    with file.open('wb') as stream:
        writer: Any = McapWriter(stream, **options)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        register = functools.cache(lambda topic: writer.register_channel(topic, 'cdr', schema, {}))
        for i, (topic, t, data) in enumerate(rows):
            writer.add_message(register(topic), t, data, t)
            if i % 12 == 11:
                writer.flush()
        writer.finish()
    whole = bytearray(file.read_bytes())
    whole[60:60 + NOISE] = random.Random(5).randbytes(NOISE)
    if 'use_chunking' in options:
        assert not original.recovered(bytes(whole))
    else:
        assert original.recovered(bytes(whole)) == rows[12:]


def contents(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Return the inode and the bytes of every file below a directory."""
    return {str(x.relative_to(folder)): (x.stat().st_ino, x.read_bytes())
            for x in sorted(folder.rglob('*')) if x.is_file()}


def test_a_repaired_bag_is_in_its_place_and_is_not_repaired_again(
        original: Original, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The damaged file is kept beside it; notes, and other files, are what they were."""
    bag = original.bag(tmp_path / 'bag', original.data[:original.chunks[6][0]])
    (bag / 'notes.txt').write_text('mine')
    before = contents(tmp_path)
    with pytest.raises(CtcError, match=f'cut off; "ctc repair {bag}" recovers the rest$'):
        read_bag(bag)
    assert main(['repair', str(bag)]) == 0
    assert capsys.readouterr().out == (
        f'{bag}: 72 messages were recovered\n'
        f'the damaged file is kept as {bag}/bag_0.mcap.damaged\n')
    assert rows_of(bag / 'bag_0.mcap') == original.rows[:72]
    assert metadata(bag)['custom_data'] == {'repaired': '72 messages recovered'}
    after = contents(tmp_path)
    assert after['bag/bag_0.mcap.damaged'] == before['bag/bag_0.mcap']
    assert after['bag/notes.txt'] == before['bag/notes.txt']
    assert set(after) == {*before, 'bag/bag_0.mcap.damaged', 'bag/metadata.yaml'}
    assert main(['repair', str(bag)]) == 0
    assert capsys.readouterr().out == f'{bag}: the bag is intact; nothing was changed\n'
    assert contents(tmp_path) == after
    (bag / 'bag_0.mcap').write_bytes(original.data[:original.chunks[6][0]])
    with pytest.raises(CtcError, match=r'bag_0\.mcap\.damaged: exists already'):
        repair(bag)


def two_recordings(original: Original, folder: Path) -> dict[str, tuple[int, bytes]]:
    """Make a directory with two recordings, the second one cut off, and notes."""
    folder.mkdir()
    (folder / 'monday.mcap').write_bytes(original.data)
    (folder / 'tuesday.mcap').write_bytes(original.data[:original.chunks[3][0]])
    (folder / 'notes.txt').write_text('mine')
    return contents(folder)


def test_a_directory_of_two_recordings_is_refused_and_left_alone(
        original: Original, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / 'trials'
    before = two_recordings(original, folder)
    for command in ('repair', 'export'):
        assert main([command, str(folder)]) == 1
        assert capsys.readouterr().err == (
            f'ctc {command}: {folder}: several recordings and no metadata.yaml: monday.mcap, '
            'tuesday.mcap. Name one of the files, or give each recording a directory of its own'
            '\n')
    assert contents(folder) == before
    assert [x.name for x in tmp_path.iterdir()] == ['trials']


def test_the_file_that_is_named_is_repaired_alone(
        original: Original, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The message that a damaged file causes names this file."""
    folder = tmp_path / 'all trials'
    before = two_recordings(original, folder)
    file = folder / 'tuesday.mcap'
    with pytest.raises(CtcError, match=f"cut off; \"ctc repair '{file}'\" recovers the rest$"):
        read_bag(file)
    assert repair(folder / 'monday.mcap') is None
    assert main(['repair', str(file)]) == 0
    assert capsys.readouterr().out == (
        f'{file}: 36 messages were recovered\nthe damaged file is kept as {file}.damaged\n')
    assert rows_of(file) == original.rows[:36]
    after = contents(folder)
    assert after.pop('tuesday.mcap.damaged') == before['tuesday.mcap']
    assert {**after, 'tuesday.mcap': before['tuesday.mcap']} == before


def test_two_healthy_files_are_not_damaged(original: Original, tmp_path: Path) -> None:
    """The second one is no part of the first; without metadata each is read by its name."""
    folder = tmp_path / 'trials'
    two_recordings(original, folder)
    (folder / 'tuesday.mcap').write_bytes(original.data)
    before = contents(folder)
    for name in ('monday.mcap', 'tuesday.mcap'):
        assert repair(folder / name) is None
    with pytest.raises(UnsupportedBag, match='several recordings'):
        repair(folder)
    assert contents(folder) == before


def test_of_a_split_recording_only_the_damaged_file_is_written_anew(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It stays a bag of several files, and has metadata, which a killed recorder did not write."""
    clock = 0.0
    monkeypatch.setattr('time.monotonic', lambda: clock)
    recording = BagWriter(tmp_path / 'bag')
    for t in range(1, 91):
        clock = 15.0 * t
        recording.write('/news', 'std_msgs/msg/String', t, b'\0\1\0\0\1\0\0\0\0', '')
        recording.flush()
    recording.abandon()
    monkeypatch.undo()
    bag = tmp_path / 'bag'
    before = contents(bag)
    assert set(before) == {'bag_0.mcap', 'bag_1.mcap', 'bag_2.mcap'}
    assert repair(bag) == (10, (bag / 'bag_2.mcap.damaged',))
    after = contents(bag)
    assert after['bag_0.mcap'] == before['bag_0.mcap']
    assert after['bag_1.mcap'] == before['bag_1.mcap']
    assert after['bag_2.mcap.damaged'] == before['bag_2.mcap']
    assert [x['message_count'] for x in metadata(bag)['files']] == [40, 40, 10]
    with closing(open_bag(bag)) as reader:
        assert [t for _, t, _ in reader.messages()] == list(range(1, 91))


def test_a_bag_that_lacks_its_metadata_only_gets_them(
        original: Original, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = original.bag(tmp_path / 'bag', original.data)
    file = contents(bag)['bag_0.mcap']
    assert main(['repair', str(bag)]) == 0
    assert capsys.readouterr().out == f'{bag}: no file is damaged; metadata.yaml was written\n'
    assert contents(bag)['bag_0.mcap'] == file
    assert metadata(bag)['message_count'] == len(original.rows)
    assert metadata(bag)['custom_data'] is None


def test_messages_that_are_compressed_one_by_one_are_recovered(tmp_path: Path) -> None:
    """`rosbags`, which unpacks messages only where the metadata say so, reads them, too."""
    bag = write_bag(tmp_path / 'bag', [('/a', t, string(f'{t}' * 99)) for t in range(3)],
                    compression='message')
    (bag / 'metadata.yaml').unlink()
    for _ in range(2):
        assert repair(bag) is not None
        with AnyReader([bag]) as reader:
            assert [reader.deserialize(data, x.msgtype).data  # type: ignore[attr-defined]
                    for x, _, data in reader.messages()] == [f'{t}' * 99 for t in range(3)]
        with closing(open_bag(bag)) as found:
            assert [x.data for _, x in found.read(found.named('/a'))] == [
                f'{t}' * 99 for t in range(3)]
        file = bag / 'bag.mcap'
        file.write_bytes(file.read_bytes()[:-9])
        (bag / 'metadata.yaml').unlink()


@pytest.mark.parametrize('limit', [1000, 20_000])
def test_a_full_disk_changes_nothing(original: Original, tmp_path: Path, limit: int) -> None:
    bag = original.bag(tmp_path / 'bag', original.data[:original.size])
    before = contents(tmp_path)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limits[1]))
    try:
        with pytest.raises(CtcError, match='File too large'):
            repair(bag)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert contents(tmp_path) == before


def test_what_is_no_bag_cannot_be_repaired(original: Original, tmp_path: Path) -> None:
    with pytest.raises(CtcError, match='no such bag'):
        repair(tmp_path / 'bag')
    os.mkfifo(tmp_path / 'bag')
    with pytest.raises(CtcError, match='is a pipe; a regular file is needed'):
        repair(tmp_path / 'bag')
    (tmp_path / 'bag').unlink()
    (tmp_path / 'bag').mkdir()
    with pytest.raises(CtcError, match=r'not a bag: .*metadata\.yaml'):
        repair(tmp_path / 'bag')
    (tmp_path / 'bag').rmdir()
    for size in (0, 8, 30):
        bag = original.bag(tmp_path / 'bag', original.data[:size])
        with pytest.raises(CtcError, match='no message in a whole chunk'):
            repair(bag)
        assert [path.name for path in tmp_path.iterdir()] == ['bag']
        shutil.rmtree(bag)


@pytest.mark.parametrize('plugin', list(StoragePlugin))
def test_a_bag_with_fewer_messages_than_it_counts_is_refused(
        tmp_path: Path, plugin: StoragePlugin) -> None:
    """Check both kinds of storage, a count that is too large, and the right one."""
    bag = write_bag(tmp_path / 'bag', [('/a', t, string('')) for t in range(3)], plugin)
    assert repair(bag) is None
    file = bag / 'metadata.yaml'
    file.write_text(file.read_text().replace('message_count: 3', 'message_count: 4'))
    with pytest.raises(CtcError, match=r'damaged, .*: 3 messages, 4 according to its metadata'):
        open_bag(bag)


def test_types_and_qos_of_other_recorders_are_recovered(tmp_path: Path) -> None:
    """Check a type that is not installed, and policies as numbers, as in bags of ROS 2 Humble."""
    bag = tmp_path / 'bag'
    bag.mkdir()
    forever = {'sec': 1, 'nsec': 2}
    profile = {'history': 1, 'depth': 5, 'reliability': 2, 'durability': 1, 'deadline': forever,
               'lifespan': forever, 'liveliness': 1, 'liveliness_lease_duration': forever,
               'avoid_ros_namespace_conventions': False}
    with (bag / 'bag_0.mcap').open('wb') as stream:
        writer: Any = McapWriter(stream)
        writer.start('ros2')
        schema = writer.register_schema('my_msgs/msg/Thing', 'ros2msg', b'float64 x')
        service = writer.register_schema('std_srvs/srv/Trigger_Event', 'unknown', b'what it is')
        for topic, text, kind in (('/a', yaml.safe_dump([profile]), schema), (
                '/b', 'a: [', schema), ('/c', '', service)):
            channel = writer.register_channel(topic, 'cdr', kind, {'offered_qos_profiles': text})
            writer.add_message(channel, 7, b'\0\1\0\0' + bytes(8), 7)
        writer.flush()
    assert repair(bag) == (3, (bag / 'bag_0.mcap.damaged',))
    open_bag(bag).close()
    with (bag / 'bag_0.mcap').open('rb') as stream:
        rows = [(channel.topic, schema and (schema.name, schema.data), message.data)
                for schema, channel, message in make_reader(stream).iter_messages()]
    thing = 'my_msgs/msg/Thing', b'float64 x'
    assert rows == [(topic, kind, b'\0\1\0\0' + bytes(8)) for topic, kind in (
        ('/a', thing), ('/b', thing), ('/c', ('std_srvs/srv/Trigger_Event', b'what it is')))]
    profiles = [x['topic_metadata']['offered_qos_profiles']
                for x in metadata(bag)['topics_with_message_count']]
    assert profiles == [[{
        **profile, 'history': 'keep_last', 'reliability': 'best_effort',
        'durability': 'transient_local', 'liveliness': 'automatic'}], [], []]
