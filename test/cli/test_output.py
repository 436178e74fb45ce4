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

"""Every command that writes: what is not its own stays, whatever it is told."""

from __future__ import annotations

from collections.abc import Iterator
import os
from pathlib import Path

from ctc_chattering.cli.ctc import COMMANDS
from ctc_chattering.output_folder import claim
from ctc_commands import ctc, refused
from map_specs import written
import pytest
from urdfs import two_links

#: Commands that write a folder, and those that write a file, each with its arguments.
FOLDERS = {
    'compare': 'compare friction --laws compensation --jobs 1 --out', 'excite': 'excite --out',
    'export': 'export bag --out', 'export-c': 'export-c friction --out',
    'identify': 'identify bag --model two_link --out', 'map': 'map map.yaml --jobs 1 --out',
    'plot': 'plot bag --out', 'reproduce': 'reproduce --out',
    'simulate': 'simulate --duration 0.01 --out', 'tune': 'tune friction --jobs 1 --out',
    'map --explain': 'map map.yaml --explain 0 --out'}
FILES = {'new-robot': 'new-robot --urdf arm.urdf --out', 'live': 'live bag --export',
         'learn': 'learn bag --out'}
#: Those that write nothing where they are told, or only what is new.
OTHERS = {'compile', 'replay', 'repair', 'check-model', 'stability', 'parameters'}
#: What is in the place of an output, and why it is refused.
PLACES = {
    '.': 'is the working directory', 'pipe': 'is a pipe, not a folder',
    'workspace': 'contains src/main.py, and no list of what ctc has written'}


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Path]:
    """Yield a directory with files of a user; assert that they are as they were."""
    path = tmp_path / 'here'
    (path / 'workspace' / 'src').mkdir(parents=True)
    (path / 'workspace' / 'src' / 'main.py').write_text('mine')
    (path / 'arm.urdf').write_text(two_links())
    written(path / 'map.yaml')
    os.mkfifo(path / 'pipe')
    (path / 'link').symlink_to('arm.urdf')
    before = state(tmp_path)
    yield path
    assert state(tmp_path) == before


def state(path: Path) -> dict[str, object]:
    """Return all that is in a directory, by its path and, of files, content."""
    return {str(x): x.read_bytes() if x.is_file() else x.is_symlink() for x in path.rglob('*')}


def test_every_command_is_here() -> None:
    assert {*FOLDERS, *FILES, *OTHERS} - {'map --explain'} == set(COMMANDS)


@pytest.mark.parametrize('place', PLACES)
@pytest.mark.parametrize('command', FOLDERS)
def test_what_a_command_has_not_written_is_not_replaced(command: str, place: str, here: Path
                                                        ) -> None:
    """The refusal is one line; it comes before anything is computed, and nothing is written."""
    result = ctc(*FOLDERS[command].split(), place, '--overwrite', cwd=here)
    refused(result, f'ctc {command.split()[0]}: {place}: {PLACES[place]}', 'choose')


@pytest.mark.parametrize('place', ['workspace', 'link', 'pipe'])
@pytest.mark.parametrize('command', FILES)
def test_a_file_takes_the_place_of_no_folder_link_or_pipe(command: str, place: str, here: Path
                                                          ) -> None:
    kind = 'folder' if place == 'workspace' else place
    result = ctc(*FILES[command].split(), place, '--overwrite', cwd=here)
    refused(result, f'ctc {command}: {place}: is a {kind}, which is not replaced; choose another')


def test_arguments_are_refused_before_output_is_replaced(tmp_path: Path) -> None:
    out = tmp_path / 'out'
    done = ctc('simulate', '--duration', '0.1', '--out', out)
    assert done.returncode == 0, done.stderr
    before = state(out)
    for words in ('--law chatering', '--control-period 0', '--gains recommended --law integral'):
        refused(ctc('simulate', *words.split(), '--out', out, '--overwrite'))
        assert state(out) == before


def test_the_output_of_one_command_is_not_replaced_by_another(tmp_path: Path) -> None:
    out = tmp_path / 'out'
    assert ctc('simulate', '--duration', '0.1', '--out', out).returncode == 0
    before = state(out)
    refused(ctc('excite', '--out', out, '--overwrite'),
            'has the output of ctc simulate, which ctc excite does not replace')
    assert state(out) == before


def test_files_of_a_user_stay_beside_new_output(tmp_path: Path) -> None:
    out = tmp_path / 'out'
    for law in ('compensation', 'chattering'):
        result = ctc('simulate', '--duration', '0.1', '--law', law, '--out', out, '--overwrite')
        assert result.returncode == 0, result.stderr
        assert f'"law": "{law}"' in (out / 'metrics.json').read_text()
        (out / 'notes').mkdir(exist_ok=True)
        (out / 'notes' / 'mine.txt').write_text('mine')
    assert (out / 'notes' / 'mine.txt').read_text() == 'mine'
    (out / 'metrics.json').write_text('{"note": "mine"}')
    refused(ctc('simulate', '--duration', '0.1', '--out', out, '--overwrite'),
            'metrics.json: was changed since ctc simulate wrote it; move it away')
    assert (out / 'metrics.json').read_text() == '{"note": "mine"}'


@pytest.mark.parametrize('name', [
    '.ctc_output', '.files.part', '.map.json.part', 'map.json', 'shards', 'figures', 'index.html',
    'map.parquet'])
def test_links_in_the_folder_of_a_map_are_not_followed(name: str, tmp_path: Path) -> None:
    """As in a folder that was cloned: nothing outside is written."""
    victim, folder, out = tmp_path / 'victim', tmp_path / 'other', tmp_path / 'out'
    victim.write_text('secret')
    folder.mkdir()
    claim(out, 'ctc map', 'explain')
    (out / name).unlink(missing_ok=True)
    (out / name).symlink_to(folder if name in ('.files.part', 'shards', 'figures') else victim)
    spec = written(tmp_path / 'map.yaml', laws=['compensation'], repeats=1)
    result = ctc('map', spec, '--jobs', 1, '--out', out)
    assert victim.read_text() == 'secret'
    assert list(folder.iterdir()) == []
    if name.endswith('.part'):
        assert result.returncode == 0 and not (out / name).exists()
    else:
        assert result.returncode == 1
        assert 'Traceback' not in result.stderr


def test_a_pipe_in_the_folder_of_a_map_is_not_waited_for(tmp_path: Path) -> None:
    out = tmp_path / 'out'
    claim(out, 'ctc map', 'explain')
    os.mkfifo(out / 'map.json')
    refused(ctc('map', written(tmp_path / 'map.yaml'), '--jobs', 1, '--out', out),
            'map.json', 'is a pipe')
