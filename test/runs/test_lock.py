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

"""One process at a time in a directory, with real processes."""

from __future__ import annotations

import os
from pathlib import Path
import socket

from ctc_chattering.errors import CtcError
from ctc_chattering.runs.store import locked
from ctc_commands import python
import pytest

TAKE = ('from pathlib import Path; from ctc_chattering.runs.store import locked; import os\n'
        'with locked(Path({0!r})): os.kill(os.getpid(), {1})')


def test_the_second_is_refused_and_told_by_whom(tmp_path: Path) -> None:
    out = tmp_path / 'new' / 'map'
    with locked(out):
        result = python('-c', TAKE.format(str(out), 0))
        assert result.returncode
        assert (f'{out}: process {os.getpid()} on {socket.gethostname()} is writing there; wait'
                in result.stderr)
    with locked(out), pytest.raises(CtcError, match=f'{out}: process {os.getpid()} on '), locked(
            out):
        pass


def test_a_killed_process_leaves_no_lock(tmp_path: Path) -> None:
    assert python('-c', TAKE.format(str(tmp_path), 9)).returncode == -9
    assert (tmp_path / '.lock').read_text().startswith('process ')
    with locked(tmp_path):
        assert (tmp_path / '.lock').read_text() == (
            f'process {os.getpid()} on {socket.gethostname()}')


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / 'file').touch()
    with pytest.raises(CtcError, match=r'cannot write .*file'), locked(tmp_path / 'file'):
        pass
