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

"""MCAP files of another library, wrong bytes in their index, and what unpacks to too much."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
import itertools
from operator import itemgetter
from pathlib import Path
import random
import re
import sqlite3
import subprocess
import sys
from typing import Any

from ctc_chattering.bags.bag import check
from ctc_chattering.bags.repair import open_bag, repair
from ctc_chattering.errors import CtcError
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader, NonSeekingReader
from mcap.records import Attachment, Channel, Chunk, ChunkIndex, DataEnd, Footer, Header, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer
from motion_bags import joint_state
from motion_bags import write as write_bag
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin
import zstandard

TOPICS = ('/a', '/b')
WAYS: list[dict[str, Any]] = [
    {}, {'use_statistics': False}, {'repeat_schemas': False, 'repeat_channels': False},
    {'compression': CompressionType.LZ4}, {'compression': CompressionType.NONE},
    {'enable_crcs': False, 'use_summary_offsets': False}, {'use_chunking': False},
    {'index_types': IndexType.NONE},
    {'use_chunking': False, 'use_statistics': False, 'repeat_schemas': False,
     'repeat_channels': False, 'index_types': IndexType.NONE, 'use_summary_offsets': False}]
#: How many of these have an index that `rosbags` needs to put messages in the order of time.
INDEXED = 6
MAGIC = b'\x89MCAP0\r\n'
#: What a bomb unpacks to [bytes], and the most memory that it may cost beside the libraries [kB].
BOMB, MEMORY = 1 << 31, 250_000
#: Reads a bag, and repairs it; prints what it costs, and the errors.
READ = """
import sys
from ctc_chattering.bags.motion import read_motion
from ctc_chattering.bags.repair import repair
from ctc_chattering.errors import CtcError

def memory():
    return next(int(x.split()[1]) for x in open('/proc/self/status') if x.startswith('VmHWM'))

before = memory()
for action in (read_motion, repair):
    try:
        action(sys.argv[1])
    except CtcError as error:
        print(error)
print(memory() - before)
"""


def write(file: Path, times: list[int], **how: Any) -> Path:
    """Return a file of the mcap library, with messages of two topics in turn."""
    file.parent.mkdir(exist_ok=True)
    with file.open('wb') as stream:
        writer = Writer(stream, chunk_size=300, **how)
        writer.start('ros2', 'test')
        channels = [writer.register_channel(topic, 'cdr', writer.register_schema(
            f'my_msgs/msg/{topic[1].upper()}', 'ros2msg', b'string data')) for topic in TOPICS]
        for (i, t), channel in zip(enumerate(times), itertools.cycle(channels)):
            writer.add_message(channel, t, bytes(i), t)
        writer.finish()  # type: ignore[no-untyped-call]
    return file


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return write(tmp_path / 'file.mcap', list(range(100)))


@pytest.mark.parametrize('how', WAYS, ids=str)
def test_what_the_library_reads(tmp_path: Path, how: dict[str, Any]) -> None:
    """Check files whose times are not in order where an index has the chunks."""
    times = random.Random(1).sample(range(1000), 60)
    file = write(tmp_path / 'file.mcap', times if how in WAYS[:INDEXED] else sorted(times), **how)
    for topics in (TOPICS, TOPICS[1:]):
        with file.open('rb') as stream, closing(open_bag(file)) as bag:
            expected = [(channel.topic, message.log_time, message.data) for _, channel, message
                        in NonSeekingReader(stream).iter_messages(topics)]
            found = [(x.topic, t, data) for x, t, data in bag.messages(
                [x for x in bag.connections if x.topic in topics])]
            assert sorted((x.topic, x.msgtype, x.msgdef.data) for x in bag.connections) == [
                (topic, f'my_msgs/msg/{topic[1].upper()}', 'string data') for topic in TOPICS]
        assert found == sorted(expected, key=itemgetter(1))
        assert len(found) == 30 * len(topics)


def test_an_index_that_does_not_lead_to_all_messages_is_refused(tmp_path: Path) -> None:
    write(tmp_path / 'bag' / 'file.mcap', list(range(60)), index_types=IndexType.CHUNK)
    with closing(open_bag(tmp_path / 'bag' / 'file.mcap')) as bag, pytest.raises(
            CtcError, match='0 messages, 60 according to its index; "ctc repair'):
        list(bag.messages())
    assert repair(tmp_path / 'bag') is not None
    with closing(open_bag(tmp_path / 'bag')) as bag:
        assert [t for _, t, _ in bag.messages()] == list(range(60))


def test_a_wrong_byte_anywhere_in_the_index_is_found(file: Path) -> None:
    data = file.read_bytes()
    check(file)
    with file.open('rb') as stream:
        assert make_reader(stream).get_summary() is not None
        stream.seek(0)
        *_, footer = StreamReader(stream).records
    assert isinstance(footer, Footer)
    assert footer.summary_crc != 0
    for place in range(footer.summary_start, len(data) - 8, 23):
        file.write_bytes(data[:place] + bytes([data[place] ^ 1]) + data[place + 1:])
        with pytest.raises(CtcError, match=r'the index has a wrong checksum|cut off'):
            check(file)
    file.write_bytes(data[:-1])
    with pytest.raises(CtcError, match='the file is cut off'):
        check(file)
    file.write_bytes(data[:-12] + bytes(4) + data[-8:])  # A checksum of 0 stands for none.
    check(file)


def test_an_unknown_compression_is_named(file: Path) -> None:
    data = file.read_bytes().replace(b'zstd', b'mine')
    file.write_bytes(data[:-12] + bytes(4) + data[-8:])
    with pytest.raises(CtcError, match="unknown compression 'mine'; allowed: zstd, lz4"):
        open_bag(file)


def bomb(size: int = BOMB) -> bytes:
    """Return zstd of so many zeros, some ten thousand times smaller."""
    compressor = zstandard.ZstdCompressor().compressobj(size=size)
    piece = bytes(1 << 20)
    return b''.join([*(compressor.compress(piece) for _ in range(size >> 20)),
                     compressor.flush()])


def mcap_bag(bag: Path, records: list[Any], index: ChunkIndex | None = None) -> Path:
    """Return a bag of one MCAP file with some records, and a chunk in its index."""
    bag.mkdir()
    builder: Any = RecordBuilder()
    for record in (Header('ros2', 'test'), *records, DataEnd(0)):
        record.write(builder)
    summary = builder.count + len(MAGIC) if index else 0
    for record in (Schema(1, b'', '', 'none'), Channel(1, '/a', 'cdr', {}, 1), index or Footer(
            0, 0, 0), Footer(summary, 0, 0))[(0 if index else 3):]:
        record.write(builder)
    (bag / 'bag_0.mcap').write_bytes(MAGIC + builder.end() + MAGIC)
    (bag / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information: {version: 9, relative_file_paths: [bag_0.mcap], '
        'message_count: 0}')
    return bag


def honest(bag: Path) -> Path:
    """Return a bag with a chunk that states what it unpacks to."""
    return mcap_bag(bag, [Chunk('zstd', bomb(), 1, 0, 0, BOMB)])


def lying(bag: Path) -> Path:
    """Return a bag with a chunk that states 100 bytes."""
    return mcap_bag(bag, [Chunk('zstd', bomb(), 1, 0, 0, 100)])


def hidden(bag: Path) -> Path:
    """Return a bag whose index has a chunk in the middle of an attachment."""
    data = bomb()
    builder: Any = RecordBuilder()
    Chunk('zstd', data, 1, 0, 0, BOMB).write(builder)
    chunk = builder.end()
    attachment = Attachment(0, 0, 'a', 'b', chunk)
    mcap_bag(bag, [attachment])
    place = (bag / 'bag_0.mcap').read_bytes().index(chunk)
    (bag / 'bag_0.mcap').unlink()
    (bag / 'metadata.yaml').unlink()
    bag.rmdir()
    return mcap_bag(bag, [attachment], ChunkIndex(
        len(chunk), place, 'zstd', len(data), 1, 31, {1: place + len(chunk)}, 0, BOMB))


def packed_messages(bag: Path) -> Path:
    """Return a bag of sqlite3 in which a message is compressed by itself."""
    write_bag(bag, [('/joint_states', 1, joint_state(1, ('a',), np.ones(1), None, None))],
              StoragePlugin.SQLITE3, compression='message')
    with sqlite3.connect(bag / 'bag.db3') as database:
        database.execute('UPDATE messages SET data = ?', (bomb(),))
    return bag


def packed_file(bag: Path) -> Path:
    """Return a bag of sqlite3 whose file is compressed."""
    write_bag(bag, [('/joint_states', 1, joint_state(1, ('a',), np.ones(1), None, None))],
              StoragePlugin.SQLITE3, compression='file')
    (bag / 'bag.db3.zstd').write_bytes(bomb())
    return bag


@pytest.mark.parametrize(('make', 'message'), [
    (honest, r'\d+ bytes unpack to more than \d+ bytes, which is allowed'),
    (lying, r'\d+ bytes unpack to more than \d+ bytes, which is allowed'),
    (hidden, 'the index has chunks that are not there'),
    (packed_messages, r'\d+ bytes unpack to more than \d+ bytes, which is allowed'),
    (packed_file, r'bag.db3.zstd unpacks to more than \d+ bytes')])
def test_what_unpacks_to_too_much_is_refused_by_its_name_and_costs_no_memory(
        tmp_path: Path, make: Callable[[Path], Path], message: str) -> None:
    """Check by the memory of a process of its own, which reads the bag and repairs it."""
    bag = make(tmp_path / 'bag')
    assert max(x.stat().st_size for x in bag.iterdir()) < 400_000
    done = subprocess.run([sys.executable, '-c', READ, str(bag)], text=True, timeout=300,
                          capture_output=True, check=True)
    read, repaired, memory = done.stdout.splitlines()
    assert re.search(message, read), read
    assert str(bag) in read and str(bag) in repaired
    assert int(memory) < MEMORY
