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

"""
Unpacking of chunks, messages and files, with a limit.

A few hostile bytes may unpack to more than the memory. `mcap_file.py` and `bag.py` unpack here.
"""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.errors import CtcError
import lz4.frame  # type: ignore[import-untyped]
import zstandard

#: First bytes of data compressed by zstd. No CDR begins with them.
ZSTD = b'\x28\xb5\x2f\xfd'
#: Largest chunk or message after unpacking.
MAX_UNPACKED_BYTES = 1 << 27
#: A file may unpack to this many times its size, beyond `MAX_UNPACKED_BYTES`.
_MAX_FILE_RATIO = 100


def unpack(data: bytes, compression: str) -> bytes:
    """
    Return the content of a chunk or message.

    Raises
    ------
    CtcError
        If it is more than is allowed, or the compression is not known.
    Exception
        Of any kind, if the data are damaged.

    """
    if compression == 'zstd':
        with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True) as stream:
            content = stream.read(MAX_UNPACKED_BYTES + 1)
    elif compression == 'lz4':
        content = lz4.frame.LZ4FrameDecompressor().decompress(
            data, max_length=MAX_UNPACKED_BYTES + 1)
    elif compression:
        raise CtcError(f'unknown compression {compression!r}; allowed: zstd, lz4')
    else:
        content = data
    if len(content) > MAX_UNPACKED_BYTES:
        raise CtcError(f'{len(data)} bytes unpack to more than {MAX_UNPACKED_BYTES} bytes, '
                       'which is allowed')
    return bytes(content)


def unpack_file(source: Path, target: Path) -> Path:
    """
    Unpack a file of zstd and return the target.

    More than is allowed raises `CtcError`.
    """
    limit = MAX_UNPACKED_BYTES + _MAX_FILE_RATIO * source.stat().st_size
    with source.open('rb') as packed, target.open('wb') as content, (
            zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)) as stream:
        while piece := stream.read(1 << 20):
            if content.write(piece) and content.tell() > limit:
                raise CtcError(f'{source.name} unpacks to more than {limit} bytes')
    return target
