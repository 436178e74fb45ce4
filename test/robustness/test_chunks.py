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

"""Chunks: size and keys depend on the spec and nothing else; their rows are complete."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ctc_chattering.errors import CtcError
from ctc_chattering.robustness import chunks
from ctc_chattering.robustness.evaluation import evaluate
from ctc_chattering.robustness.runs import Runs
from map_specs import runs, SMALL
import pytest


def sizes(made: Runs) -> list[int]:
    found = chunks.chunks(made)
    assert [run for chunk in found for run in chunk] == list(range(len(made)))
    return [len(chunk) for chunk in found]


def test_a_chunk_has_so_many_control_steps() -> None:
    """Check 4e6 / n² steps of two laws, and that one run is the least."""
    long = {'duration': 100.0, 'axes': None, 'uncertain': None, 'repeats': 1000}
    assert sizes(runs(**long)) == [10] * 200
    assert sizes(runs(**{**long, 'duration': 1000.0}, laws=['compensation'])) == [1] * 1000


@pytest.mark.parametrize(('count', 'expected'), [
    (1, [1]), (24, [1] * 24), (64, [1] * 64), (100, [2] * 50), (160, [3] * 53 + [1])])
def test_few_runs_give_work_to_many_workers(count: int, expected: list[int]) -> None:
    """Check 64 chunks at most, and no less than half as many where there are as many runs."""
    few = {'axes': None, 'uncertain': None, 'repeats': count, 'laws': ['compensation']}
    assert sizes(runs(**few)) == expected


def test_rows_are_those_of_their_runs() -> None:
    made = runs()
    table = chunks.compute(made, chunks.version(), range(5, 9))
    assert table.schema == chunks.schema(made.spec)
    for run, row in zip(range(5, 9), table.to_pylist()):
        assert row == {**made.columns(run), **evaluate(
            made.setup(run), made.spec.window, made.spec.failure)}


def test_a_refused_run_is_a_row() -> None:
    far = {'far': {'parameter': 'plant.viscous_friction', 'normal': [0.0, 1.0]}}
    made = runs(axes=None, laws=['compensation'], uncertain=far, repeats=4)
    rows = chunks.compute(made, chunks.version(), range(4)).to_pylist()
    assert [row['failure'] for row in rows] == [
        'refused' if x < 0.0 else '' for x in made.draws[:, 0]]
    reason = next(row['reason'] for row in rows if row['failure'])
    assert reason.startswith('plant: viscous_friction: ')


def test_another_version_does_not_compute() -> None:
    with pytest.raises(CtcError, match=r'a worker has version .* not 0\.0\.0; install'):
        chunks.compute(runs(), '0.0.0', range(1))


CHANGES: list[dict[str, Any]] = [
    {'params_file': 'disturbance'}, {'duration': 0.2}, {'window': [0.02, 0.1]},
    {'overrides': {}}, {'laws': ['compensation', 'chattering sign']}, {'seed': 8},
    {'laws': ['compensation', {'law': 'chattering', 'switching': 'implicit', 'ka': [1.0, 1.0]}]},
    {'axes': {**SMALL['axes'], 'rate': {'parameter': 'control_period', 'values': [1e-3]}}},
    {'axes': dict(reversed(SMALL['axes'].items()))}, {'sampling': 'random'}, {'repeats': 3},
    {'failure': {'error_above': 1.0}},
    {'uncertain': {'model': {**SMALL['uncertain']['model'], 'uniform': [0.8, 1.1]}}},
    {'uncertain': {'other': SMALL['uncertain']['model']}}]


def test_keys_change_with_everything_that_matters() -> None:
    keys = [chunks.map_key(runs(**change)) for change in [{}, *CHANGES]]
    keys += [chunks.chunk_key(keys[0], chunk) for chunk in (range(2), range(3), range(1, 3))]
    assert len(set(keys)) == len(keys)
    assert chunks.map_key(runs()) == keys[0]


def test_files_matter_by_what_they_contain(tmp_path: Path) -> None:
    """Check waypoints under the same path."""
    keys = set()
    for end in (3.0, 3.1):
        path = tmp_path / 'motion.yaml'
        path.write_text(f'joint_names: [joint1, joint2]\npoints:\n'
                        f'- {{positions: [{end}, 1.5], time_from_start: 1.0}}\n')
        made = runs(overrides={'reference': {'trajectory_file': str(path)}})
        keys.add(chunks.map_key(made))
    assert len(keys) == 2
    panda = runs(params_file='panda', overrides={}, axes=None, laws=['compensation'])
    assert set(chunks.contents(panda)['descriptions']) == {'plant', 'controller', 'reference'}
