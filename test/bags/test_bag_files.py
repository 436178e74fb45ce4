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

"""Files of a directory are one recording, or they are refused, by their names and times."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.bags.bag_files import (
    check_one_recording,
    find_recording,
    Span,
    UnsupportedBag,
)
from ctc_chattering.errors import CtcError
import pytest

S = 10 ** 9


def folder_of(path: Path, *names: str) -> Path:
    """Make a directory with empty files."""
    folder = path / 'folder'
    folder.mkdir()
    for name in names:
        (folder / name).touch()
    return folder


@pytest.mark.parametrize('names', [
    ('any.mcap',), ('run.db3',), ('run_7.mcap',), ('run_0.mcap', 'run_1.mcap'),
    # Of a recorder that keeps the last files only, and in the order of numbers, not of letters.
    ('run_8.mcap', 'run_9.mcap', 'run_10.mcap'), ('run_0.mcap.zstd', 'run_1.mcap.zstd')])
def test_files_of_one_recording_are_found_in_their_order(
        tmp_path: Path, names: tuple[str, ...]) -> None:
    folder = folder_of(tmp_path, *names, 'notes.txt', 'old.mcap.damaged')
    assert [x.name for x in find_recording(folder)] == list(names)


@pytest.mark.parametrize('names', [
    ('monday.mcap', 'tuesday.mcap'), ('run.mcap', 'run_0.mcap'), ('a_0.mcap', 'b_1.mcap'),
    ('run_0.mcap', 'run_2.mcap'), ('run_0.mcap', 'run_1.db3'), ('run_0.mcap', 'run_00.mcap'),
    ('run_0.mcap', 'old.bag')])
def test_files_of_several_recordings_are_refused_by_their_names(
        tmp_path: Path, names: tuple[str, ...]) -> None:
    folder = folder_of(tmp_path, *names)
    with pytest.raises(UnsupportedBag) as error:
        find_recording(folder)
    assert str(error.value) == (
        f'{folder}: several recordings and no metadata.yaml: {", ".join(sorted(names))}. Name '
        'one of the files, or give each recording a directory of its own')


def test_a_directory_without_files_of_a_bag(tmp_path: Path) -> None:
    with pytest.raises(CtcError, match=r'no metadata\.yaml in it, and no file \.mcap or \.db3'):
        find_recording(folder_of(tmp_path, 'notes.txt'))


@pytest.mark.parametrize(('begin', 'reason'), [
    (9.1, ''), (10.0, ''), (20.0, ''),
    (8.9, ': run_1.mcap begins 1.1 s before the end of run_0.mcap'),
    (0.0, ': run_1.mcap begins 10 s before the end of run_0.mcap'),
    (20.1, ': run_1.mcap begins 10.1 s after the end of run_0.mcap')])
def test_numbered_files_that_do_not_follow_each_other_are_several_recordings(
        begin: float, reason: str) -> None:
    """A file without messages does not matter."""
    spans = {Path('run_0.mcap'): Span(3, 0, 10 * S),
             Path('run_1.mcap'): Span(3, round(begin * S), 40 * S),
             Path('run_2.mcap'): Span()}
    if not reason:
        check_one_recording(Path('folder'), spans)
        return
    with pytest.raises(UnsupportedBag, match=f'run_0.mcap, run_1.mcap, run_2.mcap{reason}'):
        check_one_recording(Path('folder'), spans)
