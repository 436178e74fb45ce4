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

"""MCAP files of other recorders, read as the mcap library reads them."""

from __future__ import annotations

from contextlib import closing
import itertools
from operator import itemgetter
from pathlib import Path
import random
from typing import Any

from ctc_chattering.bags.mcap_storage import McapStorage
from ctc_chattering.errors import CtcError
from mcap.reader import make_reader, NonSeekingReader
from mcap.records import Footer
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer
import pytest

TOPICS = ('/a', '/b')
WAYS: list[dict[str, Any]] = [
    {}, {'use_chunking': False}, {'index_types': IndexType.NONE}, {'use_statistics': False},
    {'repeat_schemas': False, 'repeat_channels': False}, {'index_types': IndexType.CHUNK},
    {'compression': CompressionType.LZ4}, {'compression': CompressionType.NONE},
    {'enable_crcs': False, 'use_summary_offsets': False},
    {'use_chunking': False, 'use_statistics': False, 'repeat_schemas': False,
     'repeat_channels': False, 'index_types': IndexType.NONE, 'use_summary_offsets': False}]


def write(file: Path, times: list[int], **how: Any) -> Path:
    """Return a file of the mcap library, with messages of two topics in turn."""
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


def footer(file: Path) -> Footer:
    with file.open('rb') as stream:
        *_, last = StreamReader(stream).records
    assert isinstance(last, Footer)
    return last


@pytest.mark.parametrize('how', WAYS, ids=str)
def test_what_the_library_reads(tmp_path: Path, how: dict[str, Any]) -> None:
    """Check files with and without chunks, index and checksums; times are not in order."""
    times = random.Random(1).sample(range(1000), 60)
    file = write(tmp_path / 'file.mcap', times, **how)
    for topics in (TOPICS, TOPICS[1:]):
        with file.open('rb') as stream, closing(McapStorage(file)) as storage:
            expected = [(channel.topic, message.log_time, message.data) for _, channel, message
                        in NonSeekingReader(stream).iter_messages(topics)]
            found = [(key[0], t, data) for key, t, data in storage.messages(
                [x.key for x in storage.connections if x.topic in topics])]
            assert [(x.topic, x.msgtype, x.msgcount, x.encoding, x.definition)
                    for x in storage.connections] == [
                (topic, f'my_msgs/msg/{topic[1].upper()}', 30, 'ros2msg', 'string data')
                for topic in TOPICS]
            assert storage.span == (min(times), max(times))
        # Without chunks, messages come in the order of the file.
        assert (found if how.get('use_chunking', True) else sorted(found, key=itemgetter(1))
                ) == expected
        assert len(found) == 30 * len(topics)


def test_the_checksum_is_the_one_of_the_library(file: Path) -> None:
    data = file.read_bytes()
    assert footer(file).summary_crc != 0
    McapStorage(file).close()
    file.write_bytes(data[:-12] + bytes(4) + data[-8:])
    assert footer(file).summary_crc == 0
    McapStorage(file).close()


def test_a_wrong_byte_anywhere_in_the_index_is_found(file: Path) -> None:
    data = file.read_bytes()
    with file.open('rb') as stream:
        assert make_reader(stream).get_summary() is not None
    for place in range(footer(file).summary_start, len(data) - 8, 23):
        file.write_bytes(data[:place] + bytes([data[place] ^ 1]) + data[place + 1:])
        with pytest.raises(ValueError, match=r'has a wrong checksum of its index|is cut off'):
            McapStorage(file)
    file.write_bytes(data[:-1])
    with pytest.raises(ValueError, match='is cut off'):
        McapStorage(file)


def test_an_unknown_compression_is_named(file: Path) -> None:
    file.write_bytes(file.read_bytes().replace(b'zstd', b'mine'))
    data = file.read_bytes()
    file.write_bytes(data[:-12] + bytes(4) + data[-8:])
    with closing(McapStorage(file)) as storage, pytest.raises(
            CtcError, match="unknown compression 'mine'; allowed: zstd, lz4"):
        list(storage.messages([x.key for x in storage.connections]))
