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

"""Intervals against scipy's and by their coverage; values that pass by their definition."""

from __future__ import annotations

from ctc_chattering.runs.map_data import passing_ranges, pooled, share, wilson
import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import binomtest, bootstrap, norm  # type: ignore[import-untyped]


def test_the_interval_is_that_of_scipy() -> None:
    k, n = np.array([(k, n) for n in (1, 2, 3, 4, 16, 100) for k in range(n + 1)]).T
    for i, (low, high) in enumerate(zip(*wilson(k, n))):
        expected = binomtest(int(k[i]), int(n[i])).proportion_ci(0.95, 'wilson')
        assert (low, high) == pytest.approx((expected.low, expected.high), abs=1e-12)
        assert 0.0 <= low <= k[i] / n[i] <= high <= 1.0


def test_without_a_run_nothing_is_known() -> None:
    assert [float(x) for x in wilson(0, 0)] == [0.0, 1.0]
    assert np.isnan(share(0, 0))
    assert share([1, 0], [4, 2]).tolist() == [0.25, 0.0]


POINTS = 60


def shared(kind: str, size: float, draws: int, random: np.random.Generator
           ) -> tuple[npt.NDArray[np.int_], float]:
    """Return failures of each draw over 60 points of one axis, and the true probability."""
    if kind == 'draw decides':
        return POINTS * (random.random(draws) < size).astype(int), size
    x = (np.arange(POINTS) + 0.5) / POINTS
    moved = size * random.standard_normal((draws, 1))
    return (x + moved > 0.7).sum(axis=1), float(norm.sf((0.7 - x) / size).mean())


@pytest.mark.parametrize(('kind', 'size'), [
    ('draw decides', 0.5), ('draw decides', 0.1), ('draw decides', 0.02), ('boundary moves', 0.2),
    ('boundary moves', 0.5)])
@pytest.mark.parametrize('draws', [8, 16, 64])
def test_95_percent_are_95_percent_where_points_share_draws(kind: str, size: float, draws: int
                                                            ) -> None:
    """Check the coverage of 400 made-up maps; as if all runs were independent it is below 50 %."""
    random, repeats = np.random.default_rng(0), 400
    covered = np.zeros(2)
    for _ in range(repeats):
        failures, true = shared(kind, size, draws, random)
        low, high = pooled(failures, [POINTS] * draws)
        covered[0] += low <= true <= high
        wrong = wilson(failures.sum(), POINTS * draws)
        covered[1] += wrong[0] <= true <= wrong[1]
    assert 0.9 <= covered[0] / repeats <= 1.0
    assert covered[1] / repeats < 0.5


def test_it_is_as_wide_as_a_bootstrap_over_draws() -> None:
    """Compare where that is good: many draws, no rare failures."""
    failures, _ = shared('boundary moves', 0.3, 200, np.random.default_rng(1))
    expected = bootstrap((failures / POINTS,), np.mean, method='percentile', n_resamples=2000,
                         rng=np.random.default_rng(2)).confidence_interval
    low, high = pooled(failures, [POINTS] * 200)
    assert high - low == pytest.approx(expected.high - expected.low, rel=0.1)
    assert 0.5 * (high + low) == pytest.approx(0.5 * (expected.high + expected.low), abs=0.01)


def test_draws_of_one_run_are_independent_and_one_draw_says_nothing() -> None:
    expected = binomtest(3, 8).proportion_ci(method='wilson')
    assert pooled([1, 0, 0, 1, 1, 0, 0, 0], [1] * 8) == pytest.approx(
        (expected.low, expected.high))
    assert np.isnan(pooled([7], [9])).all()
    assert np.isnan(pooled([7, 0], [9, 0])).all()


def test_a_failure_that_no_draw_shows_is_not_excluded() -> None:
    """Check that 16 draws without a failure exclude no less than 16 runs would."""
    low, high = pooled([0] * 16, [100] * 16)
    assert low == 0.0
    assert high == pytest.approx(0.221, abs=1e-3)
    assert pooled([100] * 16, [100] * 16) == pytest.approx((1.0 - high, 1.0))
    assert high > binomtest(0, 16).proportion_ci(method='wilson').high


@pytest.mark.parametrize(('probability', 'expected'), [
    ([0.0, 0.1, 0.2], '1 to 3'), ([0.5, 0.6, 1.0], 'none'), ([0.0, 0.5, 0.4], '1, 3'),
    ([np.nan, 0.0, 0.0], '2 to 3')])
def test_ranges_are_the_values_that_pass(probability: list[float], expected: str) -> None:
    assert passing_ranges([1.0, 2.0, 3.0], probability) == expected


def test_ranges_have_every_value_that_passes_and_no_other() -> None:
    random, values = np.random.default_rng(1), np.arange(9)
    for _ in range(50):
        p = random.random(9)
        found = [[float(x) for x in word.split(' to ')] for word in
                 passing_ranges(values, p).split(', ') if word != 'none']
        inside = [any(ends[0] <= x <= ends[-1] for ends in found) for x in values]
        assert inside == [x < 0.5 for x in p]
        assert len(found) == sum(a and not b for a, b in zip(inside, [False, *inside]))
