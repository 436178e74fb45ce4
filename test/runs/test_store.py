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

"""The store of a map: chunks, keys and files of one map, one process at a time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import json
import os
from pathlib import Path
from typing import Any

from ctc_chattering.errors import CtcError
from ctc_chattering.runs import store
from ctc_chattering.runs.run_lists import MapRuns
from ctc_chattering.runs.store import Directory
from map_specs import evaluate, runs, SMALL
import numpy as np
import pyarrow
from pyarrow import parquet
import pytest

SCHEMA = pyarrow.schema([('run', 'int64'), ('error', 'float64')])
ABOUT = {'key': 'one', 'spec': {'a': 1}, 'versions': {'ctc_chattering': '1'}}


def sizes(made: MapRuns) -> list[int]:
    found = store.chunks(made, range(len(made)))
    assert [run for chunk in found for run in chunk] == list(range(len(made)))
    return [len(chunk) for chunk in found]


def test_the_size_of_a_chunk_follows_steps_and_joints() -> None:
    """Check 4e6 / n² steps of two laws, and that one run is the least."""
    long = {'duration': 100.0, 'axes': None, 'uncertain': None, 'repeats': 1000}
    assert sizes(runs(**long)) == [10] * 200
    assert sizes(runs(**{**long, 'duration': 1000.0}, laws=['compensation'])) == [1] * 1000


def test_rows_are_those_of_their_runs() -> None:
    made = runs()
    table = store.compute(made, store.version(), range(5, 9))
    assert table.schema == store.table_schema(made)
    for run, row in zip(range(5, 9), table.to_pylist()):
        assert row == {**made.columns(run), **evaluate(
            made.setup(run), made.spec.window, made.spec.failure)}


def test_a_refused_run_is_a_row() -> None:
    far = {'far': {'parameter': 'plant.viscous_friction', 'normal': [0.0, 1.0]}}
    made = runs(axes=None, laws=['compensation'], uncertain=far, repeats=4, failure={})
    rows = store.compute(made, store.version(), range(4)).to_pylist()
    assert [row['failure'] for row in rows] == [
        'refused' if x < 0.0 else '' for x in made.draws[:, 0]]
    reason = next(row['reason'] for row in rows if row['failure'])
    assert reason.startswith('plant: viscous_friction: ')


def test_a_worker_of_another_version_refuses() -> None:
    with pytest.raises(CtcError, match=r'a worker has version .* not 0\.0\.0; install'):
        store.compute(runs(), '0.0.0', range(1))


def test_every_module_of_the_package_is_in_the_version(monkeypatch: pytest.MonkeyPatch) -> None:
    """Change one byte of any of the modules that were once left out."""
    whole = store.version.__wrapped__()
    for name in ('controller/trips.py', 'parameters.py', 'configuration/compilation.py'):
        read = Path.read_bytes
        monkeypatch.setattr(Path, 'read_bytes', lambda path, name=name: read(path) + (
            b'#' if path.as_posix().endswith(name) else b''))
        assert store.version.__wrapped__() != whole
        monkeypatch.undo()


CHANGES: list[dict[str, Any]] = [
    {'params_file': 'disturbance'}, {'duration': 0.2}, {'window': [0.02, 0.1]},
    {'overrides': {}}, {'laws': ['compensation', 'chattering sign']}, {'seed': 8},
    {'laws': ['compensation', {'law': 'chattering', 'switching': 'implicit', 'ka': [1.0, 1.0]}]},
    {'axes': {**SMALL['axes'], 'rate': {'parameter': 'control_period', 'values': [1e-3]}}},
    {'axes': dict(reversed(SMALL['axes'].items()))}, {'sampling': 'random'}, {'repeats': 3},
    {'failure': {'error_above': 1.0}},
    {'uncertain': {'model': {**SMALL['uncertain']['model'], 'uniform': [0.8, 1.1]}}},
    {'uncertain': {'other': SMALL['uncertain']['model']}}]


def test_a_key_changes_with_every_input(tmp_path: Path) -> None:
    keys = [store.table_metadata(runs(**change))['key'] for change in [{}, *CHANGES]]
    with opened(tmp_path) as made:
        pass
    keys += [made.file(chunk) for chunk in (range(2), range(3), range(1, 3))]
    assert len(set(keys)) == len(keys)
    assert store.table_metadata(runs())['key'] == keys[0]


def test_a_key_depends_on_the_contents_of_files_only(tmp_path: Path) -> None:
    """Check waypoints under the same path."""
    keys = set()
    for end in (3.0, 3.1):
        path = tmp_path / 'motion.yaml'
        path.write_text(f'joint_names: [joint1, joint2]\npoints:\n'
                        f'- {{positions: [{end}, 1.5], time_from_start: 1.0}}\n')
        made = runs(overrides={'reference': {'trajectory_file': str(path)}})
        keys.add(store.table_metadata(made)['key'])
    assert len(keys) == 2
    panda = runs(params_file='panda', overrides={}, axes=None, laws=['compensation'])
    assert set(store.table_metadata(panda)['spec']['descriptions']) == {
        'plant', 'controller', 'reference'}


def rows(*runs: int) -> Any:
    return pyarrow.Table.from_pylist([{'run': k, 'error': k or None} for k in runs], SCHEMA)


@contextmanager
def opened(path: Path, key: str = 'one', overwrite: bool = False) -> Iterator[Directory]:
    with store.open_directory(path, {**ABOUT, 'key': key}, SCHEMA, overwrite) as directory:
        yield directory


def only(made: Directory) -> Path:
    (path,) = (made.path / 'shards').glob('*.parquet')
    return path


def test_a_chunk_that_is_damaged_is_computed_again(tmp_path: Path) -> None:
    """Flip bits of pages and of the footer, and cut the file; the file as it was is read."""
    lines = list[str]()
    values = np.random.default_rng(0).random(500)
    with opened(tmp_path) as made:
        made.write(pyarrow.table({'run': np.arange(500), 'error': values}, SCHEMA),
                   made.file(range(500)))
    path = only(made)
    content = path.read_bytes()
    column = parquet.ParquetFile(path).metadata.row_group(0).column(1)
    middle = (column.dictionary_page_offset or column.data_page_offset) + (
        column.total_compressed_size // 2)
    for place in (middle, middle + 100, len(content) - 1, len(content) - 6):
        changed = bytearray(content)
        changed[place] ^= 1
        path.write_bytes(changed)
        assert made.rows(range(500), lines.append) is None
        assert lines.pop().startswith(f'{path}: the file is damaged (')
    path.write_bytes(content[:-9])
    assert made.rows(range(500), lines.append) is None
    path.write_bytes(content)
    assert made.rows(range(500), print) is not None


@pytest.mark.parametrize('there', [(0, 1, 3), (0, 1)])
def test_rows_are_those_of_the_chunk(tmp_path: Path, there: tuple[int, ...]) -> None:
    """Check whole files with other runs, and with other columns, than they must have."""
    lines = list[str]()
    with opened(tmp_path) as made:
        for table in (rows(*there), rows(0, 1, 2).append_column('more', pyarrow.array((0, 1, 2)))):
            made.write(table, made.file(range(3)))
            assert made.rows(range(3), lines.append) is None
            assert 'it has other rows or columns' in lines.pop()
        assert made.rows(range(1), print) is None


def test_a_pipe_instead_of_a_chunk_does_not_block(tmp_path: Path) -> None:
    lines = list[str]()
    with opened(tmp_path) as made:
        made.write(rows(0), made.file(range(1)))
        only(made).unlink()
        os.mkfifo(tmp_path / made.file(range(1)))
        assert made.rows(range(1), lines.append) is None
        assert 'is a pipe' in lines.pop()
        made.write(rows(0), made.file(range(1)))
        assert made.rows(range(1), print) is not None


def test_the_same_map_continues_and_another_is_refused(tmp_path: Path) -> None:
    with opened(tmp_path) as made:
        made.write(rows(0), made.file(range(1)))
    with opened(tmp_path) as made:
        assert made.rows(range(1), print) is not None
    with (pytest.raises(CtcError, match=r'for another spec or version.* --overwrite'),
          opened(tmp_path, 'two')):
        pass


def key(path: Path) -> str:
    return str(json.loads((path / 'map.json').read_text())['key'])


def test_another_map_replaces_the_first_when_it_is_complete(tmp_path: Path) -> None:
    """Stop it in the middle: the old one is there, and the new one goes on where it was."""
    path = tmp_path / 'map'
    with opened(path) as made:
        made.write(rows(0), made.file(range(1)))
    old = only(made)
    (path / 'mine.txt').touch()
    with (pytest.raises(CtcError, match=r'^stopped$'),
          opened(path, 'two', overwrite=True) as made):
        made.write(rows(0), made.file(range(1)))
        raise CtcError('stopped')
    assert key(path) == 'one' and old.exists()
    with opened(path, 'two', overwrite=True) as made:
        assert made.rows(range(1), print) is not None
        made.write(rows(1), made.file(range(1, 2)))
        assert key(path) == 'one' and old.exists()
    assert key(path) == 'two' and not old.exists()
    assert len(list(path.glob('shards/*'))) == 2
    assert (path / 'mine.txt').exists()
    assert list(tmp_path.iterdir()) == [path]


def test_a_third_map_does_not_continue_the_second(tmp_path: Path) -> None:
    path = tmp_path / 'map'
    with opened(path) as made:
        made.write(rows(0), made.file(range(1)))
    with (pytest.raises(CtcError, match=r'^stopped$'),
          opened(path, 'two', overwrite=True) as made):
        made.write(rows(0), made.file(range(1)))
        raise CtcError('stopped')
    with opened(path, 'three', overwrite=True) as made:
        made.write(rows(1), made.file(range(1, 2)))
    assert key(path) == 'three'
    assert len(list(path.glob('shards/*'))) == 1


def test_a_map_that_was_changed_is_not_overwritten(tmp_path: Path) -> None:
    with opened(tmp_path) as made:
        made.write(rows(0), made.file(range(1)))
    (tmp_path / 'map.json').write_text('{"key": "one", "note": "mine"}')
    with (pytest.raises(CtcError, match=r'map\.json: was changed since ctc map wrote it'),
          opened(tmp_path, 'two', overwrite=True)):
        pass
