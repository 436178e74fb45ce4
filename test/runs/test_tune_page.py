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

"""A search for gains in words, tables, figures and files."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

from ctc_chattering.configuration import parameter_file
from ctc_chattering.runs import tune_page as report
from ctc_chattering.runs.score import Score
from ctc_chattering.runs.tune import over_draws, scores_of, Trial, Tuning
from ctc_chattering.runs.tune_page import (
    front_figure,
    NAMES,
    write_tuning,
)
from ctc_chattering.runs.tune_spec import Limits
from figure_layout import overlaps
import pytest
from tunings import short_tuning

GONE = Score(failure='no torque at t = 1 s')


def trial(*torques: float, rate: float = 0.0, diverged: int = 0) -> Trial:
    runs = [Score((1.0,), variation=(1.0,), peak=(x,), peak_rate=(rate,)) for x in torques]
    return Trial({}, over_draws(runs + [GONE] * diverged, Limits((10.0,), (100.0,)), 100.0))


def test_trials_are_counted_under_each_limit_that_they_violate() -> None:
    trials = [trial(1.0), trial(20.0, 1.0), trial(20.0, rate=200.0), trial(1.0, diverged=1)]
    for mine, text in ((trials, 'diverged: 1, torque: 2, torque rate: 1'),
                       (trials[:1], 'none')):
        found = dataclasses.replace(short_tuning(), trials=tuple(mine))
        assert dict(report.facts(found))['trials that violate'] == text
    assert report.violated(trials[1].score) == 'torque +100.0%'
    assert report.violated(trials[0].score) == ''


def test_the_closest_trial_is_that_with_the_least_excess() -> None:
    trials = [trial(20.0), trial(13.0), trial(1.0, rate=150.0)]
    assert report.closest(trials) == (
        'trial 1 comes closest: torque +30.0%')
    assert report.closest([trials[2], trial(1.0, 1.0, 1.0, diverged=1)]) == (
        'trial 1 comes closest: diverged +25.0%')


def test_the_table_has_the_gains_of_all_candidates() -> None:
    tuning = short_tuning()
    head, *rows = report.table_of(tuning)
    assert {len(row) for row in rows} == {len(head)}
    assert head[:6] == ['gains', 'kp', 'kv', 'lambda', 'ka', 'observer_bandwidth']
    assert [row[0] for row in rows] == [
        *(x.name for x in tuning.others),
        *(f'{x.name}{" *" if x is tuning.best else ""}' for x in tuning.points)]
    assert rows[0][1:6] == ['100', '50', '10', '10', '']  # No observer under sign.
    assert rows[1][1:6] == ['100', '50', '10', '11.88', '200']  # 1.2 times the friction.
    assert (rows[2][3], rows[2][5]) == ('', '')  # Neither filter nor this observer.
    point = tuning.points[-1]
    assert rows[-1][6:8] == [f'{point.drawn.error:.3g}', f'{point.fresh.error:.3g}']
    assert float(rows[-1][1]) == point.values['kp'][0]


def test_a_search_without_a_point_says_so_and_has_no_parameter_file(tmp_path: Path) -> None:
    tuning = short_tuning(torque_limit=1.0)
    write_tuning(tuning, tmp_path)
    assert {x.name for x in tmp_path.iterdir()} == set(NAMES) - {'tuned.yaml', 'front'}
    assert tuning.best is None
    (note,) = report.notes(tuning)
    assert note.startswith('no trial keeps the limits; trial ')
    assert ' comes closest: torque +' in note
    assert note in report.text(tuning)


@pytest.fixture(scope='module')
def tuning() -> Tuning:
    return short_tuning()


@pytest.fixture(scope='module')
def out(tuning: Tuning, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('tuned')
    write_tuning(tuning, folder)
    return folder


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
        assert entry['excess'] == trial.score.excess
    assert [found['trials'][k]['error_rad'] for k in found['front']] == [
        x.drawn.error for x in tuning.points]
    assert [x['name'] for x in found['candidates']] == [
        x.name for x in (*tuning.others, *tuning.points)]


def test_the_page_shows_tables_and_figures(out: Path, tuning: Tuning) -> None:
    page = (out / 'index.html').read_text()
    assert 'figures/front.svg' in page
    assert (out / 'figures' / 'front.svg').is_file()
    for name in ('tuned.yaml', 'tune.json'):
        assert f'href="{name}"' in page
    assert page.count('<td>') >= len(tuning.points) + len(tuning.others)
    assert '4 fresh draws' not in page
    assert '8 fresh draws' in page


def test_nothing_is_over_a_legend_or_a_label() -> None:
    """Check names of gains that are long, and no front."""
    tuning = short_tuning()
    long = dataclasses.replace(tuning, others=tuple(
        x._replace(name=f'{x.name}, with settings of its own') for x in tuning.others))
    assert not overlaps(front_figure(long))
    assert not overlaps(front_figure(short_tuning(torque_limit=1.0)))
