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

"""Progress without a terminal: lines, and few of them."""

from __future__ import annotations

from contextlib import suppress
import fcntl
import os
import struct
import subprocess
import sys
import termios

from ctc_chattering.cli.presentation import progress
import pytest
from tqdm import tqdm

SCRIPT = """
from ctc_chattering.cli.presentation import progress
with progress('map', unit='run') as moved:
    for k in range(4): moved(k, 3)
"""


def test_a_run_prints_its_begin_and_its_end(capfd: pytest.CaptureFixture[str]) -> None:
    with progress('friction', 2.0) as moved:
        for k in range(201):
            moved(0.01 * k)
            if k == 100:
                tqdm.write('1 s: law compensation')
    said = capfd.readouterr()
    assert '\r' not in said.err and said.err.endswith('\n')
    lines = said.err.splitlines()
    assert 1 <= len(lines) <= 3
    assert lines[-1].startswith('friction 2.0 of 2 s [')
    assert said.out == '1 s: law compensation\n'


def test_a_bar_prints_its_begin_and_its_end(capfd: pytest.CaptureFixture[str]) -> None:
    with progress('map', unit='run') as moved:
        for k in range(4):
            moved(k, 3)
    with progress('tune', unit='run') as moved:
        moved(0, 5)
        moved(5, 5)
    said = capfd.readouterr().err
    assert '\r' not in said
    assert [x.partition(' [')[0] for x in said.splitlines()] == [
        'map: 0/3 run', 'map: 3/3 run', 'tune: 0/5 run', 'tune: 5/5 run']


def test_a_terminal_has_a_bar() -> None:
    ours, theirs = os.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack('4H', 24, 80, 0, 0))
    with subprocess.Popen([sys.executable, '-c', SCRIPT], stderr=theirs) as process:
        os.close(theirs)
        said = b''
        with suppress(OSError):  # What reads of a terminal without a writer say.
            while part := os.read(ours, 4096):
                said += part
    os.close(ours)
    assert process.returncode == 0
    assert said.startswith(b'\rmap: ') and b'3/3' in said
