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

"""What is recovered of damaged bags, against the messages that were written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
import dataclasses
import functools
from pathlib import Path
import random
import struct
from tempfile import TemporaryDirectory
from typing import Any

from ctc_chattering.bags.repair import open_bag, recover, repair
from ctc_chattering.bags.writer import BagWriter
from ctc_chattering.errors import CtcError
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

#: Topic, log time [ns] and data.
Row = tuple[str, int, bytes]
CHUNKS, TOPICS = 10, 3
NOISE = 4096


@dataclasses.dataclass
class Original:
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


def text(dice: random.Random, length: int) -> bytes:
    """Return a serialized string of random characters."""
    return b'\0\1\0\0' + struct.pack('<I', length + 1) + dice.randbytes(length) + b'\0'


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
            row = (f'/{"abc"[k % (TOPICS if part > 2 else TOPICS - 1)]}', t, text(dice, 400))
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


def recovered(data: bytes, metadata: bytes = b'') -> list[Row]:
    """Return what is recovered of a bag of one file, as the mcap library reads it."""
    with TemporaryDirectory() as scratch:
        bag = Path(scratch) / 'bag'
        bag.mkdir()
        (bag / 'bag_0.mcap').write_bytes(data)
        if metadata:
            (bag / 'metadata.yaml').write_bytes(metadata)
        count = recover(bag, Path(scratch) / 'new')
        with (Path(scratch) / 'new' / 'new_0.mcap').open('rb') as stream:
            rows = [(channel.topic, message.log_time, message.data) for _, channel, message
                    in make_reader(stream).iter_messages(log_time_order=False)]
    assert len(rows) == count
    return rows


def check(original: Original, data: bytes, intact: list[Row], *, is_closed: bool) -> None:
    """Check what is recovered; `intact` are the messages of chunks that are."""
    rows = recovered(data, original.metadata if is_closed else b'')
    assert not Counter(rows) - Counter(original.rows)  # None is wrong, none is there twice.
    assert not set(intact) - set(rows)


def untouched(original: Original, begin: int, end: int) -> list[Row]:
    """Return the messages of chunks that a range of bytes does not touch."""
    return [row for a, b, rows in original.chunks if b <= begin or end <= a for row in rows]


def damages(original: Original, seed: int, count: int, length: int
            ) -> Iterator[tuple[bool, int, bytes]]:
    """Yield whether the bag is closed, the place, and the file with random bytes there."""
    dice = random.Random(seed)
    for k in range(count):
        is_closed = k % 2 == 0
        data = bytearray(original.data if is_closed else original.data[:original.size])
        place = dice.randrange(len(data) if length == 1 else len(data) - length)
        if length == 1:
            data[place] ^= 1 << dice.randrange(8)
        else:
            data[place:place + length] = dice.randbytes(length)
        yield is_closed, place, bytes(data)


def test_what_was_flushed_before_a_cut_is_recovered(original: Original) -> None:
    """Check cuts within and between chunks, and that one flush ends with the chunk."""
    dice, (_, first, _) = random.Random(4), original.chunks[0]
    for size in [first, original.size, *dice.sample(range(first, original.size), 12)]:
        assert recovered(original.data[:size]) == [
            row for _, end, rows in original.chunks if end <= size for row in rows]


@pytest.mark.parametrize('length', [1, NOISE])
def test_wrong_bytes_anywhere_cost_their_chunks_only(original: Original, length: int) -> None:
    for is_closed, place, data in damages(original, length, 24, length):
        check(original, data, untouched(original, place, place + length), is_closed=is_closed)


def test_a_wrong_bit_anywhere_before_the_second_chunk(original: Original) -> None:
    """Check the header, schemas and channels outside chunks, and the first chunk with both."""
    dice = random.Random(3)
    for place in [*range(0, original.chunks[0][0] + 60, 101), *dice.sample(
            range(original.chunks[0][0], original.chunks[1][0]), 10)]:
        data = bytearray(original.data[:original.size])
        data[place] ^= 1 << dice.randrange(8)
        check(original, bytes(data), untouched(original, place, place + 1), is_closed=False)


@pytest.mark.parametrize('is_closed', [True, False])
def test_a_chunk_that_is_cut_out_costs_no_other(original: Original, is_closed: bool) -> None:
    data = original.data if is_closed else original.data[:original.size]
    begin, end, _ = original.chunks[5]
    check(original, data[:begin] + data[end:], untouched(original, begin, end),
          is_closed=is_closed)


def older(rows: list[Row], **options: Any) -> bytes:
    """Return a file as the mcap library writes it: types in chunks and index only."""
    with TemporaryDirectory() as scratch:
        file = Path(scratch) / 'file.mcap'
        with file.open('wb') as stream:
            writer: Any = McapWriter(stream, **options)
            writer.start('ros2')
            schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
            register = functools.cache(lambda topic: writer.register_channel(
                topic, 'cdr', schema, {}))
            for i, (topic, t, data) in enumerate(rows):
                writer.add_message(register(topic), t, data, t)
                if i % 12 == 11:
                    writer.flush()
            writer.finish()
        return file.read_bytes()


@pytest.mark.parametrize('options', [
    {}, {'compression': CompressionType.NONE}, {'compression': CompressionType.LZ4},
    {'enable_crcs': False}])
def test_the_index_has_the_types_of_a_damaged_first_chunk(
        original: Original, options: dict[str, Any]) -> None:
    """Check files of other recorders, and of earlier versions of this one."""
    data = bytearray(older(original.rows, **options))
    data[60:60 + NOISE] = random.Random(5).randbytes(NOISE)
    assert recovered(bytes(data)) == original.rows[12:]


def test_messages_that_no_checksum_covers_are_refused(original: Original) -> None:
    whole = older(original.rows, use_chunking=False)
    with pytest.raises(CtcError, match='no message in a whole chunk'):
        recovered(whole[:-1])


def test_a_repaired_bag_says_so(original: Original, tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    bag.mkdir()
    begin, end, _ = original.chunks[5]
    (bag / 'bag_0.mcap').write_bytes(original.data[:begin] + original.data[end:])
    (bag / 'metadata.yaml').write_bytes(original.metadata)
    done = repair(bag)
    assert done is not None
    assert 'repaired: ' in (bag / 'metadata.yaml').read_text(encoding='utf-8')
    assert repair(bag) is None


@pytest.mark.parametrize('plugin', list(StoragePlugin))
def test_a_bag_with_fewer_messages_than_it_counts_is_refused(
        tmp_path: Path, plugin: StoragePlugin) -> None:
    """Check both kinds of storage, by a count that is too large."""
    bag = tmp_path / 'bag'
    with Writer(bag, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection(
            '/a', 'std_msgs/msg/String', typestore=get_typestore(Stores.ROS2_JAZZY))
        for t in range(3):
            writer.write(connection, t, b'\0\1\0\0\1\0\0\0\0')
    file = bag / 'metadata.yaml'
    file.write_text(file.read_text().replace('message_count: 3', 'message_count: 4'))
    with pytest.raises(CtcError, match=r'damaged, .*: 3 messages, 4 according to its metadata'):
        open_bag(bag)
