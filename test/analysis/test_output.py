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

"""Directories that are written into, and how numbers are shown."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.analysis import tables
from ctc_chattering.analysis.markup import in_html
from ctc_chattering.analysis.output import prepare
from ctc_chattering.errors import CtcError
import pytest

NAMES = ('metrics.json', 'figures')


@pytest.fixture
def full(tmp_path: Path) -> Path:
    """Return a directory with a run's output and two foreign things."""
    (tmp_path / 'figures' / 'deep').mkdir(parents=True)
    (tmp_path / 'figures' / 'deep' / 'a.png').write_text('old')
    (tmp_path / 'metrics.json').write_text('old')
    (tmp_path / 'notes.txt').write_text('mine')
    (tmp_path / 'photos').mkdir()
    (tmp_path / 'photos' / 'b.png').write_text('mine')
    return tmp_path


def contents(path: Path) -> dict[str, str]:
    return {str(x.relative_to(path)): x.read_text() for x in path.rglob('*') if x.is_file()}


def test_new_and_empty_directories(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / 'a' / 'b'):
        assert prepare(path, NAMES) == path
        assert path.is_dir()
        prepare(path, NAMES, overwrite=True)


@pytest.mark.parametrize('names', [('metrics.json',), ('figures',), ('new', 'figures')])
def test_refuses_what_is_there_and_foreign_files_stay(full: Path, names: tuple[str, ...]) -> None:
    before = contents(full)
    prepare(full, ('trajectory.npz', 'page'), overwrite=True)
    with pytest.raises(CtcError, match=rf'^[^\n]*{names[-1]}[^\n]*--overwrite[^\n]*$'):
        prepare(full, names)
    assert contents(full) == before


def test_overwrite_removes_what_is_named(full: Path) -> None:
    prepare(full, NAMES, overwrite=True)
    assert contents(full) == {'notes.txt': 'mine', 'photos/b.png': 'mine'}


def test_overwrite_does_not_follow_links(full: Path, tmp_path_factory: pytest.TempPathFactory
                                         ) -> None:
    """Check that a link goes, and what it points to stays."""
    other = tmp_path_factory.mktemp('other')
    (other / 'c').write_text('mine')
    (full / 'linked').symlink_to(other)
    prepare(full, ('linked',), overwrite=True)
    assert not (full / 'linked').is_symlink()
    assert contents(other) == {'c': 'mine'}


def test_a_directory_that_cannot_be_made(tmp_path: Path) -> None:
    """Check a file system that refuses even root, too."""
    (tmp_path / 'file').write_text('')
    for path in (tmp_path / 'file', tmp_path / 'file/below', tmp_path / ('x' * 300),
                 Path('/proc/self/nothing')):
        with pytest.raises(CtcError, match=rf'^[^\n]*{path.name}[^\n]*$'):
            prepare(path, NAMES)


@pytest.mark.parametrize(('text', 'wanted'), [
    (tables.measured(None), '-'), (tables.measured([1.23456e-5, 1234.5]), '1.23e-05 1234'),
    (tables.shown([0.5, 12.34567]), '[0.5, 12.35]'), (tables.shown(True), 'True'),
    (tables.number_text((8.0, 8.0)), '8'), (tables.number_text([8.0, 9.5]), '8/9.5'),
    (tables.in_field([0.1 + 0.2, 1]), '0.3, 1'), (tables.in_field('sign'), 'sign'),
    (tables.with_interval(1.23456, 0.0, 'N*m'), '1.235 N*m'),
    (tables.with_interval(1.23456, 0.0123, 'N*m'), '1.235 ± 0.01 N*m'),
    (tables.with_interval(1.23456, 9.0), '1.23 ± 9'),
    (in_html(None), '<span class="none" title="none">–</span>'),
    (in_html(-1234.5), '<data value="-1234.5">−1234</data>'),
    (in_html(1e-9), '<data value="1e-09">1.00e−09</data>'),
    (tables.number_text([3.0, 1.0, 2.0, 4.0], 3), '1 to 4'),
    (tables.number_text([3.0, 1.0], 3), '3/1'),
    (tables.number_text((2.0,) * 7, 3), '2'), (tables.number_text(0.5, 3), '0.5'),
    (tables.counted(1, 'run'), '1 run'),
    (tables.counted(1200, 'run'), '1\N{NARROW NO-BREAK SPACE}200 runs'),
    (str(tables.rounded(123456.0)), '123000.0'), (str(tables.rounded(1.23456789, 6)), '1.23457')])
def test_text(text: str, wanted: str) -> None:
    assert text == wanted
