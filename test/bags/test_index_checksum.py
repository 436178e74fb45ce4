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

"""The checksum of an MCAP file's index against the one that the mcap library writes."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.bags.index_checksum import check_index
from mcap.reader import make_reader
from mcap.records import Footer
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
import pytest


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a file of the mcap library, with checksum."""
    file = tmp_path / 'file.mcap'
    with file.open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2', 'test')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        channel = writer.register_channel('/a', 'cdr', schema)
        for t in range(100):
            writer.add_message(channel, t, bytes(t), t)
        writer.finish()  # type: ignore[no-untyped-call]
    return file


def footer(file: Path) -> Footer:
    with file.open('rb') as stream:
        *_, last = StreamReader(stream).records
    assert isinstance(last, Footer)
    return last


def test_it_is_the_one_of_the_library(file: Path) -> None:
    data = file.read_bytes()
    assert footer(file).summary_crc != 0
    check_index(file)
    file.write_bytes(data[:-12] + bytes(4) + data[-8:])
    assert footer(file).summary_crc == 0
    check_index(file)


def test_a_wrong_byte_anywhere_in_the_index_is_found(file: Path) -> None:
    data = file.read_bytes()
    with file.open('rb') as stream:
        assert make_reader(stream).get_summary() is not None
    for place in range(footer(file).summary_start, len(data) - 8, 3):
        file.write_bytes(data[:place] + bytes([data[place] ^ 1]) + data[place + 1:])
        with pytest.raises(ValueError, match=r'wrong checksum of the index of file\.mcap'):
            check_index(file)
    file.write_bytes(data[:-1])
    with pytest.raises(ValueError, match=r'file\.mcap is truncated'):
        check_index(file)
