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

"""Unpacking of what bags have compressed, and no more than is allowed: a few bytes may be many."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.errors import CtcError
import lz4.frame  # type: ignore[import-untyped]
import zstandard

#: Beginning of what zstd has compressed; no CDR begins so.
ZSTD = b'\x28\xb5\x2f\xfd'
#: Largest chunk or message after unpacking [bytes].
MOST_UNPACKED = 1 << 27
#: Bytes for each packed byte that a file may unpack to, beyond `MOST_UNPACKED`.
_UNPACKED_PER_BYTE = 100


def unpack(data: bytes, compression: str) -> bytes:
    """
    Return the content of a chunk or message.

    Raises
    ------
    CtcError
        If it is more than is allowed, or the compression is not known. What unpacks raises
        errors of its own.

    """
    if compression == 'zstd':
        with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True) as stream:
            content = stream.read(MOST_UNPACKED + 1)
    elif compression == 'lz4':
        content = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=MOST_UNPACKED + 1)
    elif compression:
        raise CtcError(f'unknown compression {compression!r}; allowed: zstd, lz4')
    else:
        content = data
    if len(content) > MOST_UNPACKED:
        raise CtcError(
            f'{len(data)} bytes unpack to more than {MOST_UNPACKED} bytes, which is allowed')
    return bytes(content)


def unpack_file(source: Path, target: Path) -> Path:
    """Unpack a file of zstd; return it. Raise `CtcError` if it is more than is allowed."""
    limit = MOST_UNPACKED + _UNPACKED_PER_BYTE * source.stat().st_size
    with source.open('rb') as packed, target.open('wb') as content, (
            zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)) as stream:
        while piece := stream.read(1 << 20):
            if content.write(piece) and content.tell() > limit:
                raise CtcError(f'{source.name} unpacks to more than {limit} bytes')
    return target
