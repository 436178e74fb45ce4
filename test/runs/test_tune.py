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

"""A search for gains: candidates over draws, the front, the best point; tables, files and page."""

from __future__ import annotations

import dataclasses
from itertools import product
import json
from math import inf, log
from pathlib import Path
import random
import sys

from ctc_chattering.configuration import parameter_file
from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.output_folder import LIST
from ctc_chattering.runs import tune_page as report
from ctc_chattering.runs.points import row_of, Runs
from ctc_chattering.runs.pool import processes
from ctc_chattering.runs.recommended import recommended_setup
from ctc_chattering.runs.score import of_results, Score
from ctc_chattering.runs.spec import Failure
from ctc_chattering.runs.tune import (
    Candidate,
    front,
    Numbers,
    over_draws,
    OverDraws,
    percentile_of,
    recommended_of,
    search,
    searched,
    Trial,
    Tuning,
)
from ctc_chattering.runs.tune_page import (
    front_figure,
    write_tuning,
)
from ctc_chattering.runs.tune_spec import Limits, Range
from figure_layout import overlaps
from map_specs import evaluate
import optuna
import pandas  # type: ignore[import-untyped]
import pyarrow
import pytest
from tunings import short_spec, short_tuning


@pytest.fixture(scope='module')
def tuning() -> Tuning:
    return short_tuning()


def over(runs: list[Score], limits: Limits, percentile: float) -> OverDraws:
    """Return what made-up runs come to, from their rows."""
    n = len(limits.torque)
    columns = pyarrow.schema([(name, kind) for name, (kind, _) in of_results(n).items()])
    table = pyarrow.Table.from_pylist([row_of(x, n, Failure()) for x in runs], columns)
    return over_draws(table.to_pandas(), limits, percentile)


def trial(*torques: float, rate: float = 0.0, diverged: int = 0) -> Trial:
    runs = [run(torque=(x,), rate=(rate,)) for x in torques]
    return Trial({}, over(runs + [GONE] * diverged, Limits((10.0,), (100.0,)), 100.0))


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
    assert {x.name for x in tmp_path.iterdir()} == {
        LIST, 'tune.json', 'tune.parquet', 'figures', 'index.html'}
    assert tuning.best is None
    (note,) = report.notes(tuning)
    assert note.startswith('no trial keeps the limits; trial ')
    assert ' comes closest: torque +' in note
    assert note in report.text(tuning)


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
    point, name, spec = tuning.points[-1], f'trial {tuning.front[-1]}', tuning.spec
    rows = [x for x in tuning.table.to_pylist() if x['variant'] == name]
    assert [x['friction'] for x in rows] == [
        *tuning.drawn.draws[:, 0], *tuning.fresh.draws[:, 0]]
    for row in rows:
        friction = row['friction']
        loaded = parameter_file.load(out / 'front' / f'{point.name}.yaml', {'plant': {
            'coulomb_friction': [friction, friction], 'duration': 0.5,
            'noise_seed': row['seed']}})
        found = evaluate(loaded, spec.window, spec.failure)
        assert {key: row[key] for key in found} == found


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


@pytest.mark.slow
def test_the_result_does_not_depend_on_the_number_of_processes(tuning: Tuning) -> None:
    with processes(2) as each:
        again = searched(tuning.spec, 12, 100.0, 1, each)
    assert (again.trials, again.points, again.others, again.best) == (
        tuning.trials, tuning.points, tuning.others, tuning.best)
    assert again.table.equals(tuning.table)


def test_the_points_are_validated_on_all_fresh_draws(tuning: Tuning) -> None:
    assert len(tuning.fresh) == 8
    assert tuning.points
    seeds = tuning.table.to_pandas().groupby('variant')['seed']
    for name in (*(f'trial {k}' for k in tuning.front), *(x.name for x in tuning.others)):
        assert list(seeds.get_group(name)) == [*range(2), *range(2, 10)]
    assert tuning.table['run'].to_pylist() == list(range(len(tuning.table)))
    for k, x in zip(tuning.front, tuning.points):
        assert x.drawn == tuning.trials[k].score
    errors = [x.drawn.error for x in tuning.points]
    assert errors == sorted(errors, reverse=True)


def test_others_are_the_file_and_the_recommended_settings(tuning: Tuning) -> None:
    found = tuning.spec.references
    assert [x.name for x in tuning.others] == list(found) == [
        'file chattering sign', 'recommended chattering implicit_observer',
        'recommended observer_feedback']
    for name, file in zip(found, (tuning.spec.file, *(
            recommended_setup(tuning.spec.file, law)
            for law in ('chattering', 'observer_feedback')))):
        assert tuning.spec.setup.controller.changed(found[name]) == file.controller
        assert 'inertia_scale' not in found[name]  # A draw may have it.


def test_all_laws_that_run_are_compiled_first() -> None:
    """Check the law that is tuned, and those that it is compared with."""
    spec = short_spec()
    runs = Runs(spec.under({'tuned': {}, **spec.references}))
    assert [(x.controller.law, x.controller.switching_in_force)
            for x in runs.examples()] == [
        ('chattering', 'implicit_observer'), ('chattering', 'sign'),
        ('chattering', 'implicit_observer'), ('observer_feedback', '')]


def candidate(error: float, variation: float, torque: float) -> Candidate:
    found = over([run(error, variation, (torque,), (0.0,))], Limits((1.0,), (inf,)), 100.0)
    return Candidate('', {}, found, found)


def test_the_recommended_of_keeps_the_limits_on_fresh_draws() -> None:
    """Check the products 6, 4 and 5, of which the second is beyond a limit."""
    points = [candidate(3.0, 2.0, 0.5), candidate(2.0, 2.0, 1.5), candidate(1.0, 5.0, 0.5)]
    assert recommended_of(points) is points[2]
    assert recommended_of(points[:2]) is points[0]
    assert recommended_of([points[1]]) is points[1]
    assert recommended_of([]) is None


FREE = Limits((inf, inf), (inf, inf))
RANGES = {'x': Range(0.1, 1e3), 'y': Range(1e-3, 10.0)}


def run(error: float = 1.0, variation: float = 1.0, torque: tuple[float, ...] = (1.0, 2.0),
        rate: tuple[float, ...] = (3.0, 4.0)) -> Score:
    return Score((error,), variation=(variation,), peak=torque, peak_rate=rate, saturated=0.0,
                 slips=(0.0,))


GONE = Score(failure='diverged at t = 1 s')


def point(error: float, variation: float, allowed: bool = True) -> OverDraws:
    torque = 1.0 if allowed else 9.0
    return over([run(error, variation, (torque, torque))], Limits((5.0, 5.0), (inf, inf)), 100.0)


@pytest.mark.parametrize('n', [1, 3, 20, 32])
def test_a_percentile_is_the_least_value_that_so_many_do_not_exceed(n: int) -> None:
    values = random.Random(n).sample(range(100), n)
    for percentile in (1.0, 50.0, 90.0, 95.0, 96.875, 100.0):
        enough = [x for x in values if sum(y <= x for y in values) >= percentile / 100.0 * n]
        assert percentile_of(values, percentile) == min(enough)


def test_a_score_has_the_worst_of_what_is_limited_and_the_percentile_of_the_rest() -> None:
    runs = [run(1.0, 40.0), run(2.0, 30.0, (7.0, 1.0)), run(3.0, 20.0, (1.0, 1.0), (8.0, 2.0)),
            run(4.0, 10.0)]
    found = over(runs, Limits((10.0, 2.0), (4.0, 100.0)), 75.0)
    assert (found.error, found.variation) == (3.0, 30.0)
    assert (found.torque, found.rate) == ((7.0, 2.0), (8.0, 4.0))
    assert found.excess == pytest.approx(
        {'diverged': 0.0, 'torque': 0.0, 'torque rate': 1.0}, abs=1e-8)
    assert not found.allowed
    assert over(runs, FREE, 75.0).allowed
    assert over(runs, FREE, 100.0).error == 4.0


def test_runs_that_diverge_count_as_infinite_and_violate() -> None:
    found = over([run(1.0), GONE, run(2.0), run(3.0)], FREE, 75.0)
    assert (found.error, found.excess['diverged']) == (3.0, 0.25)
    assert not found.allowed
    assert over([run(1.0), GONE], FREE, 100.0).error == inf
    none = over([GONE, GONE], Limits((1.0, 1.0), (inf, inf)), 50.0)
    assert (none.error, none.torque, none.excess['diverged']) == (inf, (inf, inf), 1.0)


def test_a_draw_that_is_not_allowed_ends_the_search() -> None:
    reason = 'plant: viscous_friction: not allowed'
    rows = [row_of(x, 1, Failure(), 'refused') for x in (run(), Score(failure=reason))]
    with pytest.raises(CtcError, match=reason):
        over_draws(pandas.DataFrame(rows), Limits((1.0,), (1.0,)), 95.0)


def test_the_rounding_of_a_rate_is_no_violation() -> None:
    limit = 1000.0
    limits = Limits((inf, inf), (limit, inf))
    assert over([run(rate=(limit * (1.0 + 1e-12), 1.0))], limits, 95.0).allowed
    assert not over([run(rate=(limit * 1.001, 1.0))], limits, 95.0).allowed


@pytest.mark.parametrize('seed', range(5))
def test_the_front_is_what_no_other_beats(seed: int) -> None:
    """Compare with all pairs; values coincide now and then."""
    draw = random.Random(seed)
    scores = [point(draw.randint(1, 8), draw.randint(1, 8), draw.random() < 0.8)
              for _ in range(30)]
    places = {(x.variation, x.error) for x in scores if x.allowed}
    best = sorted(x for x in places if not any(
        y != x and y[0] <= x[0] and y[1] <= x[1] for y in places))
    found = front(scores)
    assert [(scores[k].variation, scores[k].error) for k in found] == best
    assert all(scores[k].allowed for k in found)


class Robot:
    """
    Two numbers with a known front: error = x + d², variation = 1 / x + d², d = ln(y / 0.1).

    Without limit the front has y = 0.1 and error times variation = 1.
    """

    def __init__(self, most: float = inf) -> None:
        self.most = most
        self.asked: list[dict[str, float]] = []
        self.groups: list[int] = []

    def __call__(self, batch: list[Numbers]) -> list[tuple[tuple[float, ...], Numbers]]:
        self.asked += batch
        self.groups.append(len(batch))
        return [(x.objectives, x.excess) for x in map(self.score, batch)]

    def score(self, numbers: dict[str, float]) -> OverDraws:
        off = log(numbers['y'] / 0.1) ** 2
        x = numbers['x'] / 10.0
        found = run(x + off, 1.0 / x + off, (x, x))
        return over([found], Limits((self.most, self.most), (inf, inf)), 100.0)


def found_by(robot: Robot, trials: int = 60, seed: int = 0) -> list[Trial]:
    found = search(robot, RANGES, [{'x': 1.0, 'y': 1.0}], trials, seed)
    return [Trial(x, robot.score(x)) for x in found]


def test_the_same_seed_gives_the_same_trials_whatever_computes_them() -> None:
    first, again, other = Robot(), Robot(), Robot()
    trials = found_by(first, 25, 3)
    assert found_by(again, 25, 3) == trials
    found_by(other, 25, 4)
    assert [x.numbers for x in trials] == first.asked == again.asked
    assert first.asked[0] == {'x': 1.0, 'y': 1.0}
    assert first.asked[1:] != other.asked[1:]
    assert first.groups == [10, 10, 5]
    assert all(r.low <= x[name] <= r.high for x in first.asked for name, r in RANGES.items())


def test_numbers_that_are_given_stay(capsys: pytest.CaptureFixture[str]) -> None:
    ranges = {**RANGES, 'y': Range(0.2, 0.2)}
    found = search(Robot(), ranges, [], 12, 0)
    assert {x['y'] for x in found} == {0.2}
    assert len({x['x'] for x in found}) == 12
    assert capsys.readouterr() == ('', '')


def test_what_is_missing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as context:
        context.setattr(optuna, '__version__', '4.9.0')
        with pytest.raises(UsageError, match=r"Optuna 5 is needed, .* pip install 'optuna>=5'"):
            found_by(Robot())
    monkeypatch.setitem(sys.modules, 'optuna', None)
    with pytest.raises(ModuleNotFoundError, match='optuna'):
        found_by(Robot())


def test_ties_go_to_the_first() -> None:
    scores = [point(e, v) for e, v in product((1.0, 2.0), (1.0, 2.0))] * 2
    assert front(scores) == [0]
