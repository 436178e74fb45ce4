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

import json
from pathlib import Path
from typing import Any

from ctc_chattering.errors import CtcError
from ctc_chattering.runs import store
from ctc_chattering.runs.points import Runs
from ctc_chattering.runs.store import Directory, locked, write_table
from ctc_commands import python
from map_specs import evaluate, runs, SMALL
import numpy as np
import pyarrow
from pyarrow import parquet
import pytest

SCHEMA = pyarrow.schema([('run', 'int64'), ('error', 'float64')])
ABOUT = {'key': 'one', 'spec': {'a': 1}, 'versions': {'ctc_chattering': '1'}}


def sizes(made: Runs) -> list[int]:
    found = store.chunks(made, range(len(made)))
    assert [run for chunk in found for run in chunk] == list(range(len(made)))
    return [len(chunk) for chunk in found]


def test_a_chunk_has_so_many_control_steps() -> None:
    """Check 4e6 / n² steps of two laws, and that one run is the least."""
    long = {'duration': 100.0, 'axes': None, 'uncertain': None, 'repeats': 1000}
    assert sizes(runs(**long)) == [10] * 200
    assert sizes(runs(**{**long, 'duration': 1000.0}, laws=['compensation'])) == [1] * 1000


def test_rows_are_those_of_their_runs() -> None:
    made = runs()
    table = store.compute(made, store.version(), range(5, 9))
    assert table.schema == store.schema(made)
    for run, row in zip(range(5, 9), table.to_pylist()):
        assert row == {**made.columns(run), **evaluate(
            made.setup(run), made.spec.window, made.spec.failure)}


def test_a_refused_run_is_a_row() -> None:
    far = {'far': {'parameter': 'plant.viscous_friction', 'normal': [0.0, 1.0]}}
    made = runs(axes=None, laws=['compensation'], uncertain=far, repeats=4)
    rows = store.compute(made, store.version(), range(4)).to_pylist()
    assert [row['failure'] for row in rows] == [
        'refused' if x < 0.0 else '' for x in made.draws[:, 0]]
    reason = next(row['reason'] for row in rows if row['failure'])
    assert reason.startswith('plant: viscous_friction: ')


def test_another_version_does_not_compute() -> None:
    with pytest.raises(CtcError, match=r'a worker has version .* not 0\.0\.0; install'):
        store.compute(runs(), '0.0.0', range(1))


def test_every_module_of_the_package_is_in_the_version(monkeypatch: pytest.MonkeyPatch) -> None:
    """Change one byte of any of the modules that were once left out."""
    whole = store.version.__wrapped__()
    for name in ('controller/trips.py', 'parameters.py', 'analysis/compilation.py'):
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


def test_keys_change_with_everything_that_matters(tmp_path: Path) -> None:
    keys = [store.about(runs(**change))['key'] for change in [{}, *CHANGES]]
    made = Directory(tmp_path, ABOUT, SCHEMA)
    keys += [made.file(chunk).name for chunk in (range(2), range(3), range(1, 3))]
    assert len(set(keys)) == len(keys)
    assert store.about(runs())['key'] == keys[0]


def test_files_matter_by_what_they_contain(tmp_path: Path) -> None:
    """Check waypoints under the same path."""
    keys = set()
    for end in (3.0, 3.1):
        path = tmp_path / 'motion.yaml'
        path.write_text(f'joint_names: [joint1, joint2]\npoints:\n'
                        f'- {{positions: [{end}, 1.5], time_from_start: 1.0}}\n')
        made = runs(overrides={'reference': {'trajectory_file': str(path)}})
        keys.add(store.about(made)['key'])
    assert len(keys) == 2
    panda = runs(params_file='panda', overrides={}, axes=None, laws=['compensation'])
    assert set(store.about(panda)['spec']['descriptions']) == {'plant', 'controller', 'reference'}


def rows(*runs: int) -> Any:
    return pyarrow.Table.from_pylist([{'run': k, 'error': k or None} for k in runs], SCHEMA)


def only(made: Directory) -> Path:
    (path,) = (made.path / 'shards').glob('*.parquet')
    return path


def test_a_chunk_that_is_damaged_is_computed_again(tmp_path: Path) -> None:
    """Flip bits of pages and of the footer, and cut the file; the file as it was is read."""
    made, lines = Directory(tmp_path, ABOUT, SCHEMA), list[str]()
    values = np.random.default_rng(0).random(500)
    write_table(pyarrow.table({'run': np.arange(500), 'error': values}, SCHEMA),
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
        assert lines.pop().startswith(f'{path}: damaged, ')
    path.write_bytes(content[:-9])
    assert made.rows(range(500), lines.append) is None
    path.write_bytes(content)
    assert made.rows(range(500), print) is not None


@pytest.mark.parametrize('there', [(0, 1, 3), (0, 1)])
def test_rows_are_those_of_the_chunk(tmp_path: Path, there: tuple[int, ...]) -> None:
    """Check whole files with other runs, and with other columns, than they must have."""
    made, lines = Directory(tmp_path, ABOUT, SCHEMA), list[str]()
    for table in (rows(*there), rows(0, 1, 2).append_column('more', pyarrow.array((0, 1, 2)))):
        write_table(table, made.file(range(3)))
        assert made.rows(range(3), lines.append) is None
        assert 'it has other rows or columns' in lines.pop()
    assert made.rows(range(1), print) is None


def test_a_map_goes_on_and_another_is_refused(tmp_path: Path) -> None:
    write_table(rows(0), Directory(tmp_path, ABOUT, SCHEMA).file(range(1)))
    assert Directory(tmp_path, ABOUT, SCHEMA).rows(range(1), print) is not None
    with pytest.raises(CtcError, match=r'of another spec or version.* --overwrite'):
        Directory(tmp_path, {**ABOUT, 'key': 'two'}, SCHEMA)
    (tmp_path / 'mine.txt').touch()
    made = Directory(tmp_path, {**ABOUT, 'key': 'two'}, SCHEMA, overwrite=True)
    assert made.rows(range(1), print) is None
    assert json.loads((tmp_path / 'map.json').read_text())['key'] == 'two'
    assert (tmp_path / 'mine.txt').exists()


TAKE = ('from pathlib import Path; from ctc_chattering.runs.store import locked; import os\n'
        'with locked(Path({0!r})): os.kill(os.getpid(), {1})')


def test_the_second_is_refused(tmp_path: Path) -> None:
    out = tmp_path / 'new' / 'map'
    with locked(out):
        result = python('-c', TAKE.format(str(out), 0))
        assert result.returncode
        assert f'{out}: another process is writing there; wait' in result.stderr


def test_a_killed_process_leaves_no_lock(tmp_path: Path) -> None:
    assert python('-c', TAKE.format(str(tmp_path), 9)).returncode == -9
    with locked(tmp_path):
        assert (tmp_path / '.lock').exists()
