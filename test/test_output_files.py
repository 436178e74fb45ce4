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

"""Single files that commands write: complete or not there, and never through a link."""

from __future__ import annotations

import os
from pathlib import Path

from ctc_chattering.errors import CtcError
from ctc_chattering.output_files import check_file, replacing, write_text
from ctc_commands import python
from output_trees import contents, fill, victim
import pytest


def test_a_file_is_replaced_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / 'a' / 'robot.yaml'
    write_text(path, 'one')
    with pytest.raises(ZeroDivisionError), replacing(path) as stream:
        stream.write(b'two')
        stream.flush()
        assert path.read_text() == 'one'
        raise ZeroDivisionError
    assert contents(tmp_path) == {'a/robot.yaml': 'one'}
    write_text(path, 'two')
    assert contents(tmp_path) == {'a/robot.yaml': 'two'}


@pytest.mark.parametrize('kind', ['folder', 'link', 'pipe', 'device'])
def test_what_is_no_file_is_not_replaced(kind: str, tmp_path: Path) -> None:
    with victim(tmp_path) as file:
        path = Path('/dev/null') if kind == 'device' else tmp_path / 'out'
        if kind == 'folder':
            fill(path, {'notes.txt': 'mine'})
        elif kind == 'link':
            path.symlink_to(file)
        elif kind == 'pipe':
            os.mkfifo(path)
        for overwrite in (False, True):
            with pytest.raises(CtcError, match=rf'out: is a {kind}|null: is a device'):
                check_file(path, overwrite)
        with pytest.raises(CtcError, match=f'is a {kind}, which is not replaced'):
            write_text(path, 'new')


def test_a_link_in_the_place_of_a_file_that_is_not_complete_is_not_followed(tmp_path: Path
                                                                            ) -> None:
    with victim(tmp_path) as file:
        (tmp_path / '.out.yaml.part').symlink_to(file)
        write_text(tmp_path / 'out.yaml', 'new')
        assert contents(tmp_path) == {'victim': 'secret', 'out.yaml': 'new'}


def test_a_full_disk_is_a_line_and_the_old_file_stays(tmp_path: Path) -> None:
    path = tmp_path / 'out.yaml'
    write_text(path, 'old')
    code = ('import resource, signal, sys\nfrom pathlib import Path\n'
            'from ctc_chattering.output_files import write_text\n'
            'signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n'
            'resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))\n'
            'write_text(Path(sys.argv[1]), "x" * 1000)')
    result = python('-c', code, path)
    assert result.stderr.splitlines()[-1].endswith(f'cannot write {path}: File too large')
    assert contents(tmp_path) == {'out.yaml': 'old'}
