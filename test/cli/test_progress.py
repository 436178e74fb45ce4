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

"""Progress: a bar in a terminal, and nothing elsewhere."""

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

SCRIPT = """
from ctc_chattering.cli.presentation import progress
with progress('map', unit='run') as moved:
    for k in range(4): moved(k, 3)
"""


def test_without_a_terminal_it_is_silent(capfd: pytest.CaptureFixture[str]) -> None:
    with progress('friction', 2.0) as moved:
        moved(1.0)
        moved(2.0)
    assert capfd.readouterr() == ('', '')


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
