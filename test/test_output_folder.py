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

"""Folders that commands write: their lists, the user's files in them, and kills."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import ctypes
import itertools
import json
import os
from pathlib import Path
import signal
import sys
import types

from ctc_chattering.errors import CtcError
from ctc_chattering.output_folder import (
    check_folder,
    claim,
    held,
    LIST,
    new_folder,
    OutputFolder,
    read_contents,
)
from ctc_commands import python, ROOT
from output_trees import contents, fill, victim
import pytest

#: The command that writes here.
PLOT = 'ctc plot'
OLD = {'index.html': 'old', 'figures/a.svg': 'old a', 'figures/b.svg': 'old b'}
NEW = {'index.html': 'new', 'figures/a.svg': 'new a', 'samples/a.js': 'new'}
#: What the user has put into the folder.
MINE = {'notes.txt': 'mine', 'figures/photo.png': 'mine', 'bags/one/metadata.yaml': 'mine'}


def write(path: Path, files: dict[str, str], overwrite: bool = False) -> None:
    with new_folder(path, PLOT, overwrite) as folder:
        fill(folder, files)


@pytest.fixture
def plots(tmp_path: Path) -> Path:
    """Return a folder that a command has written, with files of the user."""
    path = tmp_path / 'work' / 'plots'
    write(path, OLD)
    fill(path, MINE)
    (path / 'empty').mkdir()
    (path / 'link').symlink_to('/nowhere')
    return path


def test_a_new_or_empty_folder_is_written_with_a_list_of_its_files(tmp_path: Path) -> None:
    (tmp_path / 'empty').mkdir()
    for path in (tmp_path / 'empty', tmp_path / 'a' / 'b'):
        write(path, OLD)
        assert contents(path) == OLD
        entries = [json.loads(line) for line in (path / LIST).read_text().split('\n') if line]
        assert entries[0] == {'command': PLOT}
        assert {x['file'] for x in entries[1:]} == set(OLD)
        assert [x for x in path.parent.iterdir() if x.name.endswith('.part')] == []


def test_overwrite_replaces_what_the_command_wrote_and_nothing_else(plots: Path) -> None:
    node = (plots / 'notes.txt').stat().st_ino
    write(plots, NEW, overwrite=True)
    assert contents(plots) == {**NEW, **MINE, 'link': '-> /nowhere'}
    assert (plots / 'empty').is_dir()
    assert (plots / 'notes.txt').stat().st_ino == node, 'the file, and no copy of it'
    assert list(plots.parent.iterdir()) == [plots]
    write(plots, OLD, overwrite=True)
    assert contents(plots) == {**OLD, **MINE, 'link': '-> /nowhere'}


def test_without_overwrite_nothing_is_replaced(plots: Path) -> None:
    before = contents(plots)
    with pytest.raises(CtcError, match=r'exists already; choose another --out, or --overwrite'):
        write(plots, NEW)
    assert contents(plots) == before


def test_a_copy_of_a_folder_is_known_by_the_digests(plots: Path) -> None:
    """Copy it with other times, as `git clone` does."""
    copy = plots.with_name('copy')
    for name, text in contents(plots).items():
        if name != 'link':
            fill(copy, {name: text})
    (copy / LIST).write_bytes((plots / LIST).read_bytes())
    write(copy, NEW, overwrite=True)
    assert contents(copy) == {**NEW, **MINE}


def test_a_file_that_the_user_changed_stays(plots: Path) -> None:
    (plots / 'figures' / 'a.svg').write_text('edited')
    before = contents(plots)
    with pytest.raises(CtcError, match=r'a\.svg: was changed since ctc plot wrote it; move it'):
        write(plots, NEW, overwrite=True)
    assert contents(plots) == before


@pytest.mark.parametrize('name', ['samples', 'samples/a.js'])
def test_a_file_of_the_user_that_has_the_name_of_a_new_one_stays(plots: Path, name: str) -> None:
    fill(plots, {name: 'mine'})
    before = contents(plots)
    with pytest.raises(CtcError, match=r'has the name of a file that ctc plot writes; move it'):
        write(plots, NEW, overwrite=True)
    assert contents(plots) == before
    assert list(plots.parent.iterdir()) == [plots]


def test_an_error_leaves_the_old_output_and_nothing_beside_it(plots: Path) -> None:
    before = contents(plots)
    with pytest.raises(ZeroDivisionError), new_folder(plots, PLOT, overwrite=True) as folder:
        fill(folder, NEW)
        assert contents(plots) == before
        raise ZeroDivisionError
    assert contents(plots) == before
    assert list(plots.parent.iterdir()) == [plots]


def replace_all(path: Path) -> None:
    with new_folder(path, PLOT, overwrite=True) as folder:
        fill(folder, NEW)


def replace_files(path: Path) -> None:
    with held(path, PLOT) as folder, folder.replacing_files() as scratch:
        fill(scratch, NEW)


def print_kills(path: Path, replace: Callable[[Path], None]) -> None:
    """
    Kill a process that replaces files at one step of the file system after the other.

    Print each time what is there, and the changed files; give the folder its old files again.
    """
    before = contents(path)
    for count in itertools.count(1):
        process = os.fork()
        if not process:
            steps = itertools.count(1)

            def step(event: str, _: object, steps: Iterator[int] = steps, count: int = count
                     ) -> None:
                if event.startswith(('os.', 'open', 'shutil.', 'fcntl.')) and next(steps) == count:
                    os.kill(os.getpid(), signal.SIGKILL)
            sys.addaudithook(step)
            replace(path)
            os._exit(0)
        _, status = os.waitpid(process, 0)
        print(json.dumps([contents(path), read_contents(path).changed]))
        if status == 0:
            return
        if contents(path) != before:
            write(path, OLD, overwrite=True)


def kills(path: Path, replace: Callable[[Path], None]) -> list[dict[str, str]]:
    """Return what `print_kills` prints in a process of its own; no file counts as changed."""
    script = (f'import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n'
              'from pathlib import Path; import test_output_folder as t\n'
              f't.print_kills(Path({str(path)!r}), t.{replace.__name__})')
    result = python('-c', script, path=ROOT / 'test' / 'support')
    assert result.returncode == 0, result.stderr
    states = [json.loads(line) for line in result.stdout.splitlines()]
    assert not any(changed for _, changed in states)
    assert len(states) > 30
    return [files for files, _ in states]


def test_a_kill_at_any_step_leaves_the_old_or_the_new_output(plots: Path) -> None:
    """What is left of the one that was killed, the next one clears up."""
    *killed, last = kills(plots, replace_all)
    old, new = ({**files, **MINE, 'link': '-> /nowhere'} for files in (OLD, NEW))
    assert [x for x in killed if x not in (old, new)] == []
    assert old in killed and new in killed and last == new
    assert list(plots.parent.iterdir()) == [plots]


def test_a_kill_at_any_step_leaves_each_file_in_a_folder_that_is_held_whole(plots: Path) -> None:
    *killed, last = kills(plots, replace_files)
    mine = {**MINE, 'link': '-> /nowhere'}
    for files in killed:
        for name, text in files.items():
            assert '.files.part' in name or text in (
                OLD.get(name), NEW.get(name), mine.get(name)), name
        assert files.keys() >= {**OLD, **mine}.keys()
    assert last == {**OLD, **NEW, **mine}


def test_an_empty_folder_with_a_list_is_for_any_command(plots: Path) -> None:
    with new_folder(plots.with_name('other'), 'ctc map') as folder:
        fill(folder, {'map.parquet': 'rows'})
    (plots.with_name('other') / 'map.parquet').unlink()
    write(plots.with_name('other'), NEW)
    assert contents(plots.with_name('other')) == NEW
    write(plots.with_name('other'), OLD, overwrite=True)
    assert contents(plots.with_name('other')) == OLD


def test_where_two_folders_cannot_be_exchanged_they_are_renamed(
        plots: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on NFS: the call returns an error; or the C library has no such call."""
    def refuse(*_: object) -> int:
        ctypes.set_errno(22)
        return -1

    for library in (types.SimpleNamespace(), types.SimpleNamespace(renameat2=refuse)):
        monkeypatch.setattr(ctypes, 'CDLL', lambda *_, library=library, **__: library)
        write(plots, NEW, overwrite=True)
        assert contents(plots) == {**NEW, **MINE, 'link': '-> /nowhere'}
        assert list(plots.parent.iterdir()) == [plots]


PLACES: dict[str, tuple[Callable[[Path], Path], str]] = {
    'the working directory': (lambda _: Path(), 'is the working directory'),
    'the one above': (lambda _: Path('..'), 'is the working directory, or above it'),
    'the root': (lambda _: Path('/'), 'is the working directory, or above it'),
    'home': (lambda path: path / 'home', 'is the home folder'),
    'a mount point': (lambda _: Path('/dev/shm'), 'is the top of a file system'),
    'a workspace': (lambda path: path / 'home/src', r'contains notes\.txt, and no list'),
    'of another command': (lambda path: path / 'map', 'has the output of ctc map, which ctc plot'),
    'a file': (lambda path: path / 'home/src/notes.txt', 'is a file, not a folder'),
    'a pipe': (lambda path: path / 'pipe', 'is a pipe, not a folder'),
    'a link to nothing': (lambda path: path / 'link', 'is a link to nothing'),
    'a link to a workspace': (lambda path: path / 'other', r'contains notes\.txt'),
    'below a file': (lambda path: path / 'pipe/x', 'Not a directory'),
    'a long name': (lambda path: path / ('x' * 300), 'File name too long'),
    'of the kernel': (lambda _: Path('/proc/self/x'), 'No such file')}


@pytest.mark.parametrize('name', PLACES)
def test_what_is_no_folder_of_a_command_is_refused_as_it_is(
        name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fill(tmp_path, {'home/src/notes.txt': 'mine', 'here/now/notes.txt': 'mine'})
    with new_folder(tmp_path / 'map', 'ctc map') as folder:
        fill(folder, {'map.parquet': 'rows'})
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'link').symlink_to('nowhere')
    (tmp_path / 'other').symlink_to('home/src')
    monkeypatch.setenv('HOME', str(tmp_path / 'home'))
    monkeypatch.chdir(tmp_path / 'here' / 'now')
    before, (place, reason) = contents(tmp_path), PLACES[name]
    for overwrite in (False, True):
        with pytest.raises(CtcError, match=reason):
            write(place(tmp_path), NEW, overwrite)
    assert contents(tmp_path) == before


def test_a_link_to_a_folder_of_a_command_is_followed_and_stays(plots: Path) -> None:
    link = plots.with_name('link')
    link.symlink_to(plots)
    write(link, NEW, overwrite=True)
    assert link.is_symlink()
    assert contents(plots) == {**NEW, **MINE, 'link': '-> /nowhere'}


def test_links_in_a_folder_are_not_followed(plots: Path, tmp_path: Path) -> None:
    """Put links where files are made under another name, and where they get their own."""
    with victim(tmp_path) as file:
        for name in ('samples', 'samples/a.js', 'index.html'):
            (plots / name).unlink(missing_ok=True)
            (plots / name).parent.mkdir(exist_ok=True)
            (plots / name).symlink_to(file)
            with pytest.raises(CtcError):
                write(plots, NEW, overwrite=True)
            (plots / name).unlink()
        write(plots, NEW, overwrite=True)
        (plots / LIST).unlink()
        (plots / LIST).symlink_to(file)
        with pytest.raises(CtcError, match=rf'contains {LIST}|contains bags'):
            write(plots, NEW, overwrite=True)


def test_a_link_in_the_place_of_the_new_folder_is_not_followed(plots: Path, tmp_path: Path
                                                               ) -> None:
    other = tmp_path / 'other'
    fill(other, {'notes.txt': 'mine'})
    part = plots.with_name('.plots.part')
    part.symlink_to(other)
    with pytest.raises(CtcError):
        write(plots, NEW, overwrite=True)
    part.unlink()
    fill(part, {'notes.txt': 'mine'})
    with pytest.raises(CtcError, match=r'\.plots\.part: contains notes\.txt, and no list'):
        write(plots, NEW, overwrite=True)
    assert contents(other) == contents(part) == {'notes.txt': 'mine'}


@contextmanager
def holding(path: Path) -> Iterator[OutputFolder]:
    with held(path, PLOT) as folder:
        yield folder


def test_files_are_made_in_a_folder_that_is_held(plots: Path) -> None:
    """Write one and several; neither takes the place of a file of the user."""
    with holding(plots) as folder:
        with folder.replacing('index.html') as stream:
            stream.write(b'new')
        with folder.replacing_files() as scratch:
            fill(scratch, {'figures/a.svg': 'new', 'figures/c.svg': 'new'})
        expected = {**OLD, 'index.html': 'new', 'figures/a.svg': 'new', 'figures/c.svg': 'new'}
        assert contents(plots) == {**expected, **MINE, 'link': '-> /nowhere'}
        with pytest.raises(CtcError, match='is not as ctc plot wrote it'), folder.replacing(
                'notes.txt') as stream:
            stream.write(b'new')
        with pytest.raises(CtcError, match='is not as ctc plot wrote it'), (
                folder.replacing_files()) as scratch:
            fill(scratch, {'figures/photo.png': 'new'})
    assert contents(plots)['notes.txt'] == contents(plots)['figures/photo.png'] == 'mine'
    write(plots, NEW, overwrite=True)
    assert contents(plots) == {**NEW, **MINE, 'link': '-> /nowhere'}


def test_links_in_a_folder_that_is_held_are_not_followed(plots: Path, tmp_path: Path) -> None:
    (tmp_path / 'other').mkdir()
    with victim(tmp_path) as file, holding(plots) as folder:
        for name in ('.new.txt.part', '.files.part'):
            (plots / name).symlink_to(file)
        with folder.replacing('new.txt') as stream:
            stream.write(b'new')
        with folder.replacing_files() as scratch:
            fill(scratch, {'another.txt': 'new'})
        (plots / 'to_file').symlink_to(file)
        (plots / 'to_folder').symlink_to(tmp_path / 'other')
        for name in ('to_file', 'to_folder/x', 'to_folder/deep/x'):
            with pytest.raises(CtcError, match='is a link, which is not followed'), (
                    folder.replacing(name)) as stream:
                stream.write(b'new')
            with pytest.raises(CtcError, match='is a link, which is not followed'), (
                    folder.replacing_files()) as scratch:
                fill(scratch, {name: 'new'})
    assert list((tmp_path / 'other').iterdir()) == []


def test_a_list_that_was_cut_off_goes_on(plots: Path) -> None:
    """The last file of the list, in the order of names, is then one of the user, and stays."""
    (plots / LIST).write_bytes((plots / LIST).read_bytes()[:-30])
    with holding(plots) as folder, folder.replacing('more.txt') as stream:
        stream.write(b'new')
    write(plots, {'another.txt': 'new'}, overwrite=True)
    assert contents(plots) == {
        'another.txt': 'new', 'figures/b.svg': 'old b', **MINE, 'link': '-> /nowhere'}


@pytest.mark.parametrize('line', ['[]', '3', '{"file": 3}', '{"file": [], "sha256": {}}', 'x'])
def test_a_list_of_nonsense_is_no_list(tmp_path: Path, line: str) -> None:
    fill(tmp_path, {'notes.txt': 'mine', LIST: line})
    with pytest.raises(CtcError, match=r'contains notes\.txt, and no list of what ctc'):
        write(tmp_path, NEW, overwrite=True)


TAKE = ('import os\nfrom pathlib import Path\nfrom ctc_chattering.output_folder import held\n'
        'with held(Path({0!r}), "ctc plot"): os.kill(os.getpid(), {1})')


def test_the_second_process_is_refused(tmp_path: Path) -> None:
    out = tmp_path / 'new' / 'map'
    with holding(out):
        result = python('-c', TAKE.format(str(out), 0))
        assert result.returncode
        assert f'{out}: another process is writing there; wait' in result.stderr
    with new_folder(out, PLOT), pytest.raises(CtcError, match='another process is writing'), (
            new_folder(out, PLOT)):
        pass


def test_a_killed_process_holds_nothing(tmp_path: Path) -> None:
    assert python('-c', TAKE.format(str(tmp_path), 9)).returncode == -9
    with holding(tmp_path):
        assert (tmp_path / LIST).exists()


def test_a_pipe_in_the_place_of_a_list_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / LIST)
    with pytest.raises(CtcError, match=r'is a pipe; remove it'), holding(tmp_path):
        pass
    with pytest.raises(CtcError, match=rf'contains {LIST}, and no list of what ctc has written'):
        write(tmp_path, NEW)


def test_files_of_a_user_have_a_folder_in_that_of_a_command(tmp_path: Path) -> None:
    path = tmp_path / 'map'
    fill(claim(path, 'ctc map', 'explain'), {'run_1.yaml': 'mine'})
    with new_folder(path, 'ctc map') as folder:
        fill(folder, {'map.parquet': 'rows'})
    assert contents(path) == {'explain/run_1.yaml': 'mine', 'map.parquet': 'rows'}
    (path / 'linked').symlink_to(tmp_path)
    with pytest.raises(CtcError, match='is a link'):
        claim(path, 'ctc map', 'linked')
    with pytest.raises(CtcError, match='has the output of ctc map'):
        claim(path, PLOT, 'explain')


def test_nothing_is_made_where_a_folder_is_only_checked(tmp_path: Path) -> None:
    check_folder(tmp_path / 'a' / 'b', PLOT)
    assert list(tmp_path.iterdir()) == []
