"""The regularity of a loop, against numpy on the times it was given."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from ctc_chattering.monitoring.loop_statistics import LoopStatistics

MS = 1_000_000


def _loop(begins: list[int], ends: list[int]) -> LoopStatistics:
    pace = LoopStatistics()
    for begin, end in zip(begins, ends):
        pace.sample(begin, end)
    return pace


@given(st.lists(st.tuples(st.integers(1000, 800 * MS), st.integers(1000, 800 * MS)),
                min_size=2, max_size=100), st.integers(0, 10 ** 15))
def test_periods_and_computing_times(steps: list[tuple[int, int]], start: int) -> None:
    """Check means, quantiles and largest of random loops."""
    begins = (start + np.cumsum([step for step, _ in steps])).tolist()
    spent = [x for _, x in steps]
    values = _loop(begins, [b + x for b, x in zip(begins, spent)]).values()
    assert values['samples'] == len(steps)
    assert values['deadline misses'] == 0
    for name, exact in (('period', np.diff(begins)), ('computing time', np.array(spent))):
        assert values[f'{name}, mean [ms]'] == pytest.approx(exact.mean() / MS)
        assert values[f'{name}, max [ms]'] == pytest.approx(exact.max() / MS)
        for key, share in (('p50', 0.5), ('p99', 0.99), ('p99.9', 0.999)):
            assert values[f'{name}, {key} [ms]'] == pytest.approx(
                np.quantile(exact / MS, share, method='inverted_cdf'), rel=0.011, abs=1e-3)
    assert 'answer time, mean [ms]' not in values


def test_a_pause_is_no_period() -> None:
    """Check that the time over a pause is left out, and only that; without it, it counts."""
    begins = [k * MS for k in range(10)] + [(900 + k) * MS for k in range(10)]
    for paused in (True, False):
        pace = LoopStatistics()
        for k, begin in enumerate(begins):
            if paused and k == 10:
                pace.pause()
            pace.sample(begin, begin + 1000)
        assert pace.periods.count == (18 if paused else 19)
        assert pace.computing.count == pace.samples == 20
        assert pace.periods.mean() == pytest.approx(1e-3 if paused else 909e-3 / 19)


def test_rate_is_that_of_the_last_window() -> None:
    """Check samples per second between two rotations; none before the second one."""
    pace, t = LoopStatistics(), 5 * MS
    for period, count in ((1 * MS, 400), (2 * MS, 300), (10 * MS, 50)):
        assert pace.values()['rate [Hz]'] == pace.rate
        for _ in range(count):
            t += period
            pace.sample(t, t + 1000)
        first = pace.rate == 0.0 and pace.samples == 400
        pace.rotate(t)
        assert pace.rate == (0.0 if first else pytest.approx(1e9 / period))
    pace.rotate(t)
    assert pace.rate == pytest.approx(100.0)
    pace.rotate(t + 1000 * MS)
    assert pace.rate == 0.0
    assert pace.samples == 750


def test_old_windows_are_forgotten_and_totals_are_not() -> None:
    """Check that ten windows on, a slow one has left the mean but not the count."""
    pace = LoopStatistics()
    for k in range(5):
        pace.sample(100 * k * MS, 100 * k * MS + 50 * MS)
    pace.misses += 3
    pace.pause()
    for window in range(12):
        pace.rotate((1000 + window) * MS)
        slow = pace.computing.largest() > 0.04
        assert slow == (window < 9)
        pace.sample((1000 + window) * MS, (1000 + window) * MS + 2000)
    assert pace.values()['samples'] == 17
    assert pace.values()['deadline misses'] == 3
    assert pace.values()['computing time, mean [ms]'] == pytest.approx(2e-3)


def test_answers_and_the_histogram() -> None:
    """Check the numbers shown for answers of known times."""
    pace = LoopStatistics()
    for k in range(1000):
        pace.answer(k * MS, k * MS + (300_000 if k < 998 else 3 * MS))
    values = pace.values()
    assert values['answer time, max [ms]'] == pytest.approx(3.0)
    assert values['answer time, p99 [ms]'] == pytest.approx(0.3, rel=0.011)
    assert values['answer time, p99.9 [ms]'] == pytest.approx(3.0, rel=0.011)
    assert values['answer time, histogram [ms]'] == '<0.35: 998, <5.7: 2'
