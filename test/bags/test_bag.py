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

"""Opening bags of all kinds and of other libraries, and what is wrong in one line."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
import itertools
from operator import itemgetter
from pathlib import Path
import random
import sqlite3
import struct
import tracemalloc
from typing import Any

from ctc_chattering.bags import compression
from ctc_chattering.bags.mcap_file import MAGIC, McapFile
from ctc_chattering.bags.repair import open_bag, repair
from ctc_chattering.errors import CtcError
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader, NonSeekingReader
from mcap.records import Chunk, DataEnd, Footer, Header
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer
from motion_bags import joint_state
from motion_bags import write as write_bag
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin
import zstandard

PLUGINS = {'mcap': StoragePlugin.MCAP, 'db3': StoragePlugin.SQLITE3}
#: Compressions that `rosbags` knows.
PACKED = ('message', 'file', 'storage')


def made(path: Path, ending: str, compression: str = '') -> Path:
    """Return a bag with 50 states, a millisecond apart."""
    messages = [('/joint_states', t, joint_state(t, ('a', 'b'), np.full(2, t), None, None))
                for t in range(0, 50_000_000, 1_000_000)]
    return write_bag(path / 'bag', messages, PLUGINS[ending], compression)


@pytest.mark.parametrize(('ending', 'compression'), [
    ('mcap', ''), ('db3', ''), *(('mcap', x) for x in PACKED), ('db3', 'file')])
def test_a_directory_and_a_single_file(tmp_path: Path, ending: str, compression: str) -> None:
    bag = made(tmp_path, ending, compression)
    for path in (bag, *([] if compression else [bag / f'bag.{ending}'])):
        with closing(open_bag(path)) as reader:
            found = [(t, message.position.tolist())
                     for t, message in reader.read(reader.named('joint_states'))]
            assert found == [(t, [t, t]) for t in range(0, 50_000_000, 1_000_000)]
            assert (reader.start_time, reader.end_time, reader.message_count) == (
                0, 49_000_000, 50)


@pytest.mark.parametrize(('ending', 'content', 'message'), [
    ('mcap', b'', 'not a bag: the file is cut off; "ctc repair'),
    ('mcap', b'hello' * 99, 'not a bag: the file is cut off; "ctc repair'),
    ('db3', b'', 'bag.db3 or database missing tables'),
    ('db3', b'hello' * 99, 'not a bag: ReaderError: Cannot open database'),
    ('yaml', b'rosbag2_bagfile_information: [1, 2', 'not a bag: ParserError: '),
    ('yaml', b'rosbag2_bagfile_information: {version: 10}', 'version 10; known: 1 to 9'),
    ('yaml', b'rosbag2_bagfile_information: {version: 9}', "KeyError: 'relative_file_paths'"),
    ('yaml', b'\xff\xfe\0', 'not a bag: '), ('yaml', b'a: !x 1', 'not a bag: '),
    ('yaml', b'7', 'not a bag: TypeError: ')])
def test_what_cannot_be_read_is_said_in_one_line(
        tmp_path: Path, ending: str, content: bytes, message: str) -> None:
    bag = made(tmp_path, 'db3' if ending == 'db3' else 'mcap')
    (bag / ('metadata.yaml' if ending == 'yaml' else f'bag.{ending}')).write_bytes(content)
    with pytest.raises(CtcError) as error:
        open_bag(bag)
    assert message in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_names_of_files_that_are_refused(tmp_path: Path) -> None:
    """Check names that sqlite3 would take for a URI, and another kind of file."""
    for name in ('we%41', 'what?', 'first#'):
        with pytest.raises(CtcError, match=r'has one of % \? #'):
            open_bag(made(tmp_path, 'db3').rename(tmp_path / name))
    (tmp_path / 'notes.txt').write_text('hi')
    with pytest.raises(CtcError, match=r"unknown storage '\.txt'; known: \.mcap, \.db3"):
        open_bag(tmp_path / 'notes.txt')


IDL = """module my_msgs { module msg { struct Thing {
  std_msgs::msg::Header header; sequence<double> x; }; }; };"""


@pytest.mark.parametrize(('encoding', 'definition'), [
    ('ros2msg', 'std_msgs/Header header\nfloat64[] x'),
    ('ros2idl', f'{"=" * 80}\nIDL: my_msgs/msg/Thing\n{IDL}')])
def test_a_type_that_only_the_bag_defines(
        tmp_path: Path, encoding: str, definition: str) -> None:
    """Check both kinds of definitions; what they lack is known of ROS 2 Jazzy."""
    data = struct.pack('<4siIIIIIdd', b'\0\1\0\0', 1, 2, 1, 0, 2, 0, 1.5, -2.5)
    with (tmp_path / 'file.mcap').open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2')
        schema = writer.register_schema('my_msgs/msg/Thing', encoding, definition.encode())
        channel = writer.register_channel('/thing', 'cdr', schema)
        writer.add_message(channel, 7, data, 7)
        writer.finish()  # type: ignore[no-untyped-call]
    with closing(open_bag(tmp_path / 'file.mcap')) as reader:
        ((t, found),) = reader.read(reader.named('thing'))
    assert (t, found.header.stamp.sec, found.x.tolist()) == (7, 1, [1.5, -2.5])


# MCAP files of the mcap library.

TOPICS = ('/a', '/b')
WAYS: list[dict[str, Any]] = [
    {}, {'use_statistics': False}, {'repeat_schemas': False, 'repeat_channels': False},
    {'compression': CompressionType.LZ4}, {'compression': CompressionType.NONE},
    {'enable_crcs': False, 'use_summary_offsets': False}, {'use_chunking': False},
    {'index_types': IndexType.NONE}]
#: How many of these have an index that `rosbags` needs to put messages in the order of time.
INDEXED = 6


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


def test_an_index_of_chunks_alone_leads_to_all_messages(tmp_path: Path) -> None:
    file = write(tmp_path / 'file.mcap', list(range(60)), index_types=IndexType.CHUNK)
    with closing(open_bag(file)) as bag:
        assert [t for _, t, _ in bag.messages()] == list(range(60))


def test_an_index_that_counts_other_messages_is_refused(tmp_path: Path) -> None:
    """Check one topic and the sum, where no checksum tells."""
    bag = tmp_path / 'bag'
    file = write(bag / 'file.mcap', list(range(60)), enable_crcs=False)
    data = file.read_bytes()
    with file.open('rb') as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and summary.statistics is not None
    counts = struct.pack('<HQ', 1, 30), struct.pack('<HQ', 1, 31)
    sums = struct.pack('<QH', 60, 2), struct.pack('<QH', 61, 2)
    place = data.rindex(counts[0])
    both = (data[:place] + data[place:].replace(*counts)).replace(*sums)
    for wrong, reason in (
            (both, '60 messages, 61 according to its index'),
            (data.replace(*sums), '60 messages, 61 according to its index'),
            (data[:place] + data[place:].replace(*counts), 'counts other messages of a topic')):
        file.write_bytes(wrong)
        with pytest.raises(CtcError, match=f'{reason}; "ctc repair {bag}"'):
            open_bag(bag)
    assert repair(bag) is not None
    with closing(open_bag(bag)) as reader:
        assert [t for _, t, _ in reader.messages()] == list(range(60))


def test_what_is_wrong_with_an_index_is_found(tmp_path: Path) -> None:
    """Check a wrong byte anywhere, a chunk that is not there, and an unknown compression."""
    file = write(tmp_path / 'file.mcap', list(range(100)))
    data = file.read_bytes()
    McapFile(file).close()
    with file.open('rb') as stream:
        summary = make_reader(stream).get_summary()
        stream.seek(0)
        *_, footer = StreamReader(stream).records
    assert isinstance(footer, Footer) and summary is not None
    assert footer.summary_crc != 0
    for place in range(footer.summary_start, len(data) - 8, 23):
        file.write_bytes(data[:place] + bytes([data[place] ^ 1]) + data[place + 1:])
        with pytest.raises(CtcError, match=r'the index has a wrong checksum|cut off'):
            McapFile(file)
    file.write_bytes(data[:-1])
    with pytest.raises(CtcError, match='the file is cut off'):
        McapFile(file)
    unchecked = data[:-12] + bytes(4) + data[-8:]  # A checksum of 0 stands for none.
    file.write_bytes(unchecked)
    McapFile(file).close()
    offset = struct.pack('<QQ', (x := summary.chunk_indexes[3]).chunk_start_offset, x.chunk_length)
    place = unchecked.rindex(offset)
    file.write_bytes(unchecked[:place] + bytes([unchecked[place] ^ 1]) + unchecked[place + 1:])
    with pytest.raises(CtcError, match='the index has chunks that are not there'):
        McapFile(file)
    file.write_bytes(unchecked.replace(b'zstd', b'mine'))
    with pytest.raises(CtcError, match="unknown compression 'mine'; allowed: zstd, lz4"):
        open_bag(file)


# What unpacks to too much.

def chunk(size: int) -> Callable[[Path, bytes], None]:
    """Return what makes a bag with a chunk that states to unpack to a size."""
    def make(bag: Path, bomb: bytes) -> None:
        builder: Any = RecordBuilder()
        for record in (Header('ros2', 'test'), Chunk('zstd', bomb, 1, 0, 0, size), DataEnd(0),
                       Footer(0, 0, 0)):
            record.write(builder)
        (made(bag.parent, 'mcap') / 'bag.mcap').write_bytes(
            MAGIC + builder.end() + MAGIC)
    return make


def packed_message(bag: Path, bomb: bytes) -> None:
    with sqlite3.connect(made(bag.parent, 'db3', 'message') / 'bag.db3') as database:
        database.execute('UPDATE messages SET data = ?', (bomb,))


def packed_file(bag: Path, bomb: bytes) -> None:
    (made(bag.parent, 'db3', 'file') / 'bag.db3.zstd').write_bytes(bomb)


@pytest.mark.parametrize(('make', 'message'), [
    (chunk(1 << 27), r'\d+ bytes unpack to more than \d+ bytes, which is allowed'),
    (chunk(100), r'\d+ bytes unpack to more than \d+ bytes, which is allowed'),
    (packed_message, r'\d+ bytes unpack to more than \d+ bytes, which is allowed'),
    (packed_file, r'bag.db3.zstd unpacks to more than \d+ bytes')])
def test_what_unpacks_to_too_much_is_refused_by_its_name_and_costs_no_memory(
        tmp_path: Path, make: Callable[[Path, bytes], None], message: str,
        monkeypatch: pytest.MonkeyPatch) -> None:
    """Check 128 MB where one is allowed, of a chunk that states its size, and of one that lies."""
    monkeypatch.setattr(compression, 'MAX_UNPACKED_BYTES', 1 << 20)
    bag = tmp_path / 'bag'
    make(bag, zstandard.ZstdCompressor().compress(bytes(1 << 27)))
    tracemalloc.start()
    with pytest.raises(CtcError, match=message) as error, closing(open_bag(bag)) as reader:
        list(reader.messages())
    assert str(bag) in str(error.value)
    with pytest.raises(CtcError, match=str(bag)):
        repair(bag)
    assert tracemalloc.get_traced_memory()[1] < 1 << 26
    tracemalloc.stop()
