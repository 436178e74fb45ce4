"""The checksum of an MCAP file's index, which rosbags neither writes nor checks."""

from __future__ import annotations

import mmap
import os
from pathlib import Path
import struct
import zlib

#: The end of a file: start of the index, start of its own index, checksum, magic bytes.
_END = struct.Struct('<QQI8s')
#: How many bytes of it follow the last one that the checksum is of.
_AFTER = 12
_MAGIC = b'\x89MCAP0\r\n'


def write_index_checksum(file: Path) -> None:
    """Write the checksum of the index of a file that is complete."""
    _, computed = _checksums(file)
    with file.open('r+b') as stream:
        stream.seek(-_AFTER, os.SEEK_END)
        stream.write(struct.pack('<I', computed))


def check_index(file: Path) -> None:
    """
    Raise a `ValueError` if a file is cut off, or its index is not what was written.

    A checksum of 0 stands for none.
    """
    written, computed = _checksums(file)
    if written not in (0, computed):
        raise ValueError(f'wrong checksum of the index of {file.name}')


def _checksums(file: Path) -> tuple[int, int]:
    """Return the checksum that a file has for its index, and the right one."""
    with file.open('rb') as stream, mmap.mmap(
            stream.fileno(), 0, access=mmap.ACCESS_READ) as data, memoryview(data) as view:
        if not data[-_END.size:].endswith(_MAGIC):
            raise ValueError(f'{file.name} is cut off')
        start, _, written, _ = _END.unpack_from(view, len(view) - _END.size)
        with view[start:-_AFTER] as index:
            return written, zlib.crc32(index)
