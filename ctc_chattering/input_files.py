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
Files that a user names to be read.

They are regular files of a limited size, so that no command hangs.
"""

from __future__ import annotations

import io
import os
from pathlib import Path
import stat

from ctc_chattering.errors import as_file_error, CtcError

#: Largest description, parameter file or spec [bytes]. The largest of those seen have 5 MB.
LARGEST = 50_000_000


def read_bytes(path: Path, largest: int = LARGEST) -> bytes:
    """
    Return the content of a file.

    A pipe is not waited for, and a device that never ends is not read.

    Parameters
    ----------
    path : Path
        A regular file, or a link to one.
    largest : int
        Its largest size [bytes].

    Raises
    ------
    CtcError
        If it is no regular file, too large, or cannot be read.

    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:  # A null in a name is a ValueError.
        raise CtcError(f'{path}: {getattr(error, "strerror", None) or error}') from None
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        raise CtcError(f'{path}: is {kind_of(mode)}; a regular file is needed')
    with as_file_error(str(path)), os.fdopen(descriptor, 'rb') as stream:
        content = stream.read(largest + 1)
    if len(content) > largest:
        raise CtcError(f'{path}: is too large; at most {largest / 1e6:g} MB are read')
    return content


def read_text(path: Path) -> str:
    """Return the text of a file, or raise `CtcError`."""
    try:
        return io.StringIO(read_bytes(path).decode(), newline=None).read()
    except UnicodeDecodeError:
        raise CtcError(f'{path}: not a text file') from None


def check_regular(path: Path) -> None:
    """
    Raise unless a file can be read to its end.

    Parameters
    ----------
    path : Path
        A file, or a folder of files.

    Raises
    ------
    CtcError
        If it, or something in the folder, is a pipe, a socket or a device.

    """
    with as_file_error(str(path)):
        for file in (path, *(path.iterdir() if path.is_dir() else ())):
            mode = file.stat().st_mode if file.exists() else stat.S_IFREG
            if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                raise CtcError(f'{file}: is {kind_of(mode)}; a regular file is needed')


def kind_of(mode: int) -> str:
    """Return the kind of a file, with its article."""
    kinds = {
        stat.S_IFREG: 'a file',
        stat.S_IFDIR: 'a folder',
        stat.S_IFLNK: 'a link',
        stat.S_IFIFO: 'a pipe',
        stat.S_IFSOCK: 'a socket',
    }
    return kinds.get(stat.S_IFMT(mode), 'a device')
