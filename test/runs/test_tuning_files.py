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

"""What `ctc tune` writes: files that are taken as they are, and numbers that agree."""

from __future__ import annotations

import csv
import json
from pathlib import Path

from ctc_chattering.configuration import parameter_file
from ctc_chattering.runs.tune import scores_of, Tuning
from ctc_chattering.runs.tune_page import as_mapping, NAMES, write_tuning
import pytest
from tunings import short_tuning


@pytest.fixture(scope='module')
def tuning() -> Tuning:
    return short_tuning()


@pytest.fixture(scope='module')
def out(tuning: Tuning, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('tuned')
    write_tuning(tuning, folder)
    return folder


def test_all_names_are_there(out: Path) -> None:
    assert {x.name for x in out.iterdir()} == set(NAMES)


def test_a_parameter_file_has_the_gains_of_its_point(out: Path, tuning: Tuning) -> None:
    assert tuning.best in tuning.points
    best = (out / 'front' / f'{tuning.best.name}.yaml').read_bytes()
    assert (out / 'tuned.yaml').read_bytes() == best
    for point in tuning.points:
        setup = parameter_file.load(out / 'front' / f'{point.name}.yaml')
        assert setup.controller == tuning.spec.setup.controller.changed(point.values)
        assert setup.reference == tuning.spec.setup.reference
        assert setup.plant == tuning.spec.setup.plant.changed({'duration': 10.0})
        assert not setup.events


def test_a_parameter_file_run_on_a_draw_gives_the_numbers_of_its_point(
        out: Path, tuning: Tuning) -> None:
    point, draws = tuning.points[-1], tuning.drawn
    for run, (friction,), setup in zip(point.drawn.runs, draws.draws.tolist(), draws.setups):
        loaded = parameter_file.load(out / 'front' / f'{point.name}.yaml', {'plant': {
            'coulomb_friction': [friction, friction], 'duration': 0.5,
            'noise_seed': setup.plant.noise_seed}})
        assert scores_of(tuning.spec.window, [loaded]) == [run]


def test_the_numbers_are_strict_json(out: Path, tuning: Tuning) -> None:
    def refuse(name: str) -> None:
        raise AssertionError(name)
    found = json.loads((out / 'tune.json').read_text(), parse_constant=refuse)
    assert len(found['trials']) == len(tuning.trials)
    assert found['limits'] == {'torque_nm': [5e3, 5e3], 'torque_rate_nm_per_s': [None, None]}
    assert found['recommended'] == (tuning.best and tuning.best.name)
    for entry, trial in zip(found['trials'], tuning.trials):
        assert entry['numbers'] == trial.numbers
        assert entry['violating_runs'] == {k: n for k, n in trial.score.violating.items() if n}
    assert [found['trials'][x['trial']]['error_rad'] for x in found['front']] == [
        x.drawn.error for x in tuning.points]


def test_the_table_has_a_line_a_point(out: Path, tuning: Tuning) -> None:
    rows = list(csv.DictReader((out / 'front.csv').read_text().splitlines()))
    assert [x['point'] for x in rows] == [x.name for x in tuning.points]
    assert tuning.best is not None
    assert [x['point'] for x in rows if x['recommended'] == '1'] == [tuning.best.name]
    for row, point in zip(rows, tuning.points):
        assert float(row['fresh_error_rad']) == point.fresh.error
        assert [float(row[f'ka_{i}']) for i in (1, 2)] == point.values['ka']


def test_the_page_shows_tables_and_figures(out: Path, tuning: Tuning) -> None:
    page = (out / 'index.html').read_text()
    for name in ('front', 'numbers', 'draws'):
        assert f'figures/{name}.svg' in page
        assert (out / 'figures' / f'{name}.svg').is_file()
    for name in ('tuned.yaml', 'front.csv', 'tune.json'):
        assert f'href="{name}"' in page
    assert page.count('<td>') >= len(tuning.points) + len(tuning.others)
    assert '4 fresh draws' not in page
    assert '8 fresh draws' in page


def test_without_a_point_there_is_no_parameter_file_but_all_else(tmp_path: Path) -> None:
    tuning = short_tuning(torque_limit=1.0)
    write_tuning(tuning, tmp_path)
    assert {x.name for x in tmp_path.iterdir()} == set(NAMES) - {'tuned.yaml', 'front'}
    assert (tmp_path / 'front.csv').read_text() == 'point\n'
    page = (tmp_path / 'index.html').read_text()
    assert 'No trial keeps the limits' in page
    assert 'tuned.yaml' not in page
    assert as_mapping(tuning)['recommended'] is None
