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

"""The search for gains: scores and front by definition, limits kept, seeds."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import inf, log
import random
import sys

from ctc_chattering.errors import UsageError
from ctc_chattering.runs.score import Score
from ctc_chattering.runs.tune import (
    front,
    Numbers,
    over_draws,
    OverDraws,
    percentile_of,
    search,
    Trial,
)
from ctc_chattering.runs.tune_spec import Limits, Range
import optuna
import pytest

FREE = Limits((inf, inf), (inf, inf))
RANGES = {'x': Range(0.1, 1e3), 'y': Range(1e-3, 10.0)}


def run(error: float = 1.0, variation: float = 1.0, torque: tuple[float, ...] = (1.0, 2.0),
        rate: tuple[float, ...] = (3.0, 4.0)) -> Score:
    return Score((error,), variation=(variation,), peak=torque, peak_rate=rate)


GONE = Score(failure='diverged at t = 1 s')


def point(error: float, variation: float, allowed: bool = True) -> OverDraws:
    torque = 1.0 if allowed else 9.0
    return over_draws(
        [run(error, variation, (torque, torque))], Limits((5.0, 5.0), (inf, inf)), 100.0)


@pytest.mark.parametrize('n', [1, 3, 20, 32])
def test_a_percentile_is_the_least_value_that_so_many_do_not_exceed(n: int) -> None:
    values = random.Random(n).sample(range(100), n)
    for percentile in (1.0, 50.0, 90.0, 95.0, 96.875, 100.0):
        enough = [x for x in values if sum(y <= x for y in values) >= percentile / 100.0 * n]
        assert percentile_of(values, percentile) == min(enough)


def test_a_score_has_the_worst_of_what_is_limited_and_the_percentile_of_the_rest() -> None:
    runs = [run(1.0, 40.0), run(2.0, 30.0, (7.0, 1.0)), run(3.0, 20.0, (1.0, 1.0), (8.0, 2.0)),
            run(4.0, 10.0)]
    found = over_draws(runs, Limits((10.0, 2.0), (4.0, 100.0)), 75.0)
    assert (found.error, found.variation) == (3.0, 30.0)
    assert (found.torque, found.rate) == ((7.0, 2.0), (8.0, 4.0))
    assert found.excess == pytest.approx(
        {'diverged': 0.0, 'torque': 0.0, 'torque rate': 1.0}, abs=1e-8)
    assert not found.allowed
    assert over_draws(runs, FREE, 75.0).allowed
    assert over_draws(runs, FREE, 100.0).error == 4.0


def test_runs_that_diverge_count_as_infinite_and_violate() -> None:
    found = over_draws([run(1.0), GONE, run(2.0), run(3.0)], FREE, 75.0)
    assert (found.error, found.excess['diverged']) == (3.0, 0.25)
    assert not found.allowed
    assert over_draws([run(1.0), GONE], FREE, 100.0).error == inf
    none = over_draws([GONE, GONE], Limits((1.0, 1.0), (inf, inf)), 50.0)
    assert (none.error, none.torque, none.excess['diverged']) == (inf, (inf, inf), 1.0)


def test_the_rounding_of_a_rate_is_no_violation() -> None:
    limit = 1000.0
    limits = Limits((inf, inf), (limit, inf))
    assert over_draws([run(rate=(limit * (1.0 + 1e-12), 1.0))], limits, 95.0).allowed
    assert not over_draws([run(rate=(limit * 1.001, 1.0))], limits, 95.0).allowed


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


def test_there_may_be_no_front() -> None:
    assert front([point(1.0, 1.0, False)]) == []


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
        return over_draws([found], Limits((self.most, self.most), (inf, inf)), 100.0)


def searched(robot: Robot, trials: int = 60, seed: int = 0) -> list[Trial]:
    found = search(robot, RANGES, [{'x': 1.0, 'y': 1.0}], trials, seed)
    return [Trial(x, robot.score(x)) for x in found]


def test_the_front_that_is_found_is_nearer_to_the_true_one_than_at_random() -> None:
    """Check the product of error and variation, which is at least 1."""
    draw = random.Random(0)

    def best(scores: Sequence[OverDraws]) -> float:
        return min(x.error * x.variation for x in scores)

    blind = sorted(best([Robot().score({name: r.low * (r.high / r.low) ** draw.random()
                                        for name, r in RANGES.items()}) for _ in range(60)])
                   for _ in range(101))
    found = best([x.score for x in searched(Robot())])
    assert 1.0 <= found < blind[25]


def test_the_same_seed_gives_the_same_trials_whatever_computes_them() -> None:
    first, again, other = Robot(), Robot(), Robot()
    trials = searched(first, 25, 3)
    assert searched(again, 25, 3) == trials
    searched(other, 25, 4)
    assert [x.numbers for x in trials] == first.asked == again.asked
    assert first.asked[0] == {'x': 1.0, 'y': 1.0}
    assert first.asked[1:] != other.asked[1:]
    assert first.groups == [10, 10, 5]
    assert all(r.low <= x[name] <= r.high for x in first.asked for name, r in RANGES.items())


def test_limits_lead_the_search() -> None:
    """With a limit that excludes most of the range, more trials keep it than at random."""
    most = 0.05
    free, bound = searched(Robot()), searched(Robot(most))
    kept = [sum(x.numbers['x'] / 10.0 <= most for x in trials[30:]) for trials in (free, bound)]
    assert kept[1] > kept[0]
    assert all(bound[k].numbers['x'] / 10.0 <= most for k in front([x.score for x in bound]))


def test_numbers_that_are_given_stay(capsys: pytest.CaptureFixture[str]) -> None:
    ranges = {**RANGES, 'y': Range(0.2, 0.2)}
    found = search(Robot(), ranges, [], 12, 0)
    assert {x['y'] for x in found} == {0.2}
    assert len({x['x'] for x in found}) == 12
    assert capsys.readouterr() == ('', '')


def test_what_is_missing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as context:
        context.setattr(optuna, '__version__', '4.9.0')
        with pytest.raises(UsageError, match=r"needs Optuna 5, .* pip install 'optuna>=5'"):
            searched(Robot())
    monkeypatch.setitem(sys.modules, 'optuna', None)
    with pytest.raises(UsageError, match='a search needs Optuna: pip install optuna'):
        searched(Robot())


def test_ties_go_to_the_first() -> None:
    scores = [point(e, v) for e, v in product((1.0, 2.0), (1.0, 2.0))] * 2
    assert front(scores) == [0]
