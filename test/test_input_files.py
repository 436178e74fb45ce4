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

"""Files that are read: regular ones of a limited size, and nothing that hangs or never ends."""

from __future__ import annotations

import os
from pathlib import Path
import socket

from ctc_chattering import input_files
from ctc_chattering.errors import CtcError
from ctc_chattering.input_files import read_bytes, read_text
import pytest


def test_a_file_is_read_also_by_a_link(tmp_path: Path) -> None:
    file, link = tmp_path / 'a.urdf', tmp_path / 'b.urdf'
    file.write_bytes(b'one\r\ntwo\n')
    link.symlink_to(file)
    for path in (file, link):
        assert read_bytes(path) == b'one\r\ntwo\n'
        assert read_text(path) == 'one\ntwo\n'


def test_what_is_no_regular_file_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'link').symlink_to('pipe')
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / 'socket'))
        for path, reason in (
                (tmp_path / 'pipe', 'is a pipe; a regular file is needed'),
                (tmp_path / 'link', 'is a pipe; a regular file is needed'),
                (Path('/dev/zero'), 'is a device; a regular file is needed'),
                (tmp_path, 'is a folder; a regular file is needed'),
                (tmp_path / 'socket', 'No such device or address'),
                (tmp_path / 'none', 'No such file or directory')):
            with pytest.raises(CtcError, match=f'^{path}: {reason}$'):
                read_bytes(path)


def test_a_file_of_the_largest_size_is_read_and_no_larger_one(tmp_path: Path) -> None:
    """The limit of all files that a user names is that of `LARGEST`."""
    path = tmp_path / 'large'
    path.write_bytes(b'x' * 1000)
    assert len(read_bytes(path, 1000)) == 1000
    with pytest.raises(CtcError, match=r'large: is too large; at most 0\.000999 MB are read'):
        read_bytes(path, 999)
    with path.open('wb') as stream:
        stream.truncate(input_files.LARGEST + 1)
    with pytest.raises(CtcError, match='is too large; at most 50 MB are read'):
        read_text(path)


def test_what_is_no_text_is_said(tmp_path: Path) -> None:
    path = tmp_path / 'arm.urdf'
    path.write_bytes(b'\xff\xfe\x00')
    with pytest.raises(CtcError, match=r'arm\.urdf: not a text file'):
        read_text(path)
