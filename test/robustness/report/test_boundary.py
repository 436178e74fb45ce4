"""Wilson's interval against scipy's, and the values that pass against their definition."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest  # type: ignore[import-untyped]

from ctc_chattering.robustness.report.boundary import passing_ranges, share, side, wilson


@pytest.mark.parametrize('confidence', [0.9, 0.95])
def test_the_interval_is_that_of_scipy(confidence: float) -> None:
    k, n = np.array([(k, n) for n in (1, 2, 3, 4, 16, 100) for k in range(n + 1)]).T
    for i, (low, high) in enumerate(zip(*wilson(k, n, confidence))):
        expected = binomtest(int(k[i]), int(n[i])).proportion_ci(confidence, 'wilson')
        assert (low, high) == pytest.approx((expected.low, expected.high), abs=1e-12)
        assert 0.0 <= low <= k[i] / n[i] <= high <= 1.0


def test_without_a_run_nothing_is_known() -> None:
    assert [float(x) for x in wilson(0, 0)] == [0.0, 1.0]
    assert np.isnan(share(0, 0))
    assert side(0, 0) == 0
    assert share([1, 0], [4, 2]).tolist() == [0.25, 0.0]


def test_a_side_is_known_when_the_interval_is_on_it() -> None:
    for n in (1, 3, 4, 16):
        for k in range(n + 1):
            interval = binomtest(k, n).proportion_ci(method='wilson')
            assert side(k, n) == (1 if interval.low > 0.5 else -1 if interval.high < 0.5 else 0)
    assert side([0, 0, 4], [3, 4, 4]).tolist() == [0, -1, 1]


@pytest.mark.parametrize(('probability', 'expected'), [
    ([0.0, 0.1, 0.2], [(1.0, 3.0)]), ([0.5, 0.6, 1.0], []),
    ([0.0, 0.5, 0.4], [(1.0, 1.0), (3.0, 3.0)]),
    ([np.nan, 0.0, 0.0], [(2.0, 3.0)])])
def test_ranges_are_the_values_that_pass(probability: list[float],
                                         expected: list[tuple[float, float]]) -> None:
    assert passing_ranges([1.0, 2.0, 3.0], probability) == expected


def test_ranges_have_every_value_that_passes_and_no_other() -> None:
    random = np.random.default_rng(1)
    for _ in range(50):
        values, p = np.sort(random.random(9)), random.random(9)
        found = passing_ranges(values, p)
        inside = [any(low <= x <= high for low, high in found) for x in values]
        assert inside == [x < 0.5 for x in p]
        assert len(found) == sum(a and not b for a, b in zip(inside, [False, *inside]))
