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

"""MCAP files of the mcap library are read, and what is wrong with one is found."""

from __future__ import annotations

from contextlib import closing
import itertools
from operator import itemgetter
from pathlib import Path
import random
import struct
from typing import Any

from ctc_chattering.bags.mcap_file import McapFile
from ctc_chattering.bags.repair import open_bag, repair
from ctc_chattering.errors import CtcError
from mcap.reader import make_reader, NonSeekingReader
from mcap.records import Footer
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer
import pytest

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
