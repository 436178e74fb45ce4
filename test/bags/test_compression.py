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

"""What unpacks to too much is refused, and costs no memory."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
import sqlite3
import tracemalloc
from typing import Any

from ctc_chattering.bags import compression
from ctc_chattering.bags.mcap_file import MAGIC
from ctc_chattering.bags.repair import open_bag, repair
from ctc_chattering.errors import CtcError
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk, DataEnd, Footer, Header
from motion_bags import string, write
import pytest
from rosbags.rosbag2 import StoragePlugin
import zstandard


def bag_of_one_message(path: Path, ending: str, compression: str = '') -> Path:
    plugin = StoragePlugin.MCAP if ending == 'mcap' else StoragePlugin.SQLITE3
    return write(path / 'bag', [('/news', 1, string('hello'))], plugin, compression)


def chunk(size: int) -> Callable[[Path, bytes], None]:
    """Return what makes a bag with a chunk that states to unpack to a size."""
    def make(bag: Path, bomb: bytes) -> None:
        builder: Any = RecordBuilder()
        for record in (Header('ros2', 'test'), Chunk('zstd', bomb, 1, 0, 0, size), DataEnd(0),
                       Footer(0, 0, 0)):
            record.write(builder)
        (bag_of_one_message(bag.parent, 'mcap') / 'bag.mcap').write_bytes(
            MAGIC + builder.end() + MAGIC)
    return make


def packed_message(bag: Path, bomb: bytes) -> None:
    with sqlite3.connect(bag_of_one_message(bag.parent, 'db3', 'message') / 'bag.db3') as database:
        database.execute('UPDATE messages SET data = ?', (bomb,))


def packed_file(bag: Path, bomb: bytes) -> None:
    (bag_of_one_message(bag.parent, 'db3', 'file') / 'bag.db3.zstd').write_bytes(bomb)


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
