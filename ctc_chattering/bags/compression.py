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

"""How bags are compressed; what compresses may be missing where ROS 2 is from apt."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.errors import CtcError

try:
    import zstandard
except ImportError:
    zstandard = None  # type: ignore[assignment]

#: Packages that decompress, of pip and apt.
_PACKAGES = {'zstd': ('zstandard', 'python3-zstandard'), 'lz4': ('lz4', 'python3-lz4')}


def _missing(name: str) -> CtcError:
    if name not in _PACKAGES:
        return CtcError(f'unknown compression {name!r}; allowed: {", ".join(_PACKAGES)}')
    pip, apt = _PACKAGES[name]
    return CtcError(
        f'it is compressed by {name}, and {pip} is not installed: "pip install {pip}" or "sudo '
        f'apt install {apt}"')


def compressed(data: bytes) -> tuple[str, bytes]:
    """Return the name of the compression, empty for none, and the data compressed."""
    return ('zstd', zstandard.compress(data)) if zstandard else ('', data)


def decompressed(data: bytes, name: str, size: int = 0) -> bytes:
    """
    Return data that were compressed.

    Parameters
    ----------
    data : bytes
        Compressed.
    name : {'', 'zstd', 'lz4'}
        How.
    size : int
        Their size [bytes], 0 if it is not known.

    Raises
    ------
    CtcError
        If what decompresses is not installed.

    """
    if not name:
        return data
    if name == 'zstd' and zstandard:
        decompressor = zstandard.ZstdDecompressor()
        return (decompressor.decompress(data, size) if size else
                decompressor.decompressobj().decompress(data))
    if name == 'lz4':
        try:
            import lz4.frame  # type: ignore[import-untyped]
            found: bytes = lz4.frame.decompress(data)
            return found
        except ImportError:
            pass
    raise _missing(name)


def decompress_file(source: Path, target: Path) -> None:
    """Decompress a file of zstd."""
    if not zstandard:
        raise _missing('zstd')
    with source.open('rb') as data, target.open('wb') as found:
        zstandard.ZstdDecompressor().copy_stream(data, found)
