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

"""The checksum of an MCAP file's index, which neither rosbags nor mcap check."""

from __future__ import annotations

import mmap
from pathlib import Path
import struct
import zlib

#: The end of a file: start of the index, start of its own index, checksum, magic bytes.
_END = struct.Struct('<QQI8s')
#: How many bytes of it follow the last one that the checksum is of.
_AFTER = 12
_MAGIC = b'\x89MCAP0\r\n'


def check_index(file: Path) -> None:
    """
    Raise a `ValueError` if a file is cut off, or its index is not what was written.

    A checksum of 0 stands for none.
    """
    with file.open('rb') as stream, mmap.mmap(
            stream.fileno(), 0, access=mmap.ACCESS_READ) as data, memoryview(data) as view:
        if not data[-_END.size:].endswith(_MAGIC):
            raise ValueError(f'{file.name} is truncated')
        start, _, written, _ = _END.unpack_from(view, len(view) - _END.size)
        with view[start:-_AFTER] as index:
            if written not in (0, zlib.crc32(index)):
                raise ValueError(f'wrong checksum of the index of {file.name}')
