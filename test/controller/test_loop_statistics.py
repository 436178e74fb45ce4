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

"""The regularity of a loop, against numpy on the times it was given."""

from collections.abc import Sequence
import re

from ctc_chattering.controller.health import Durations, LoopStatistics
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

MS = 1_000_000
#: From a nanosecond to a day, or 0 [s].
DURATION = st.floats(1e-9, 86_400.0) | st.just(0.0)
QUANTILES = (('p50 [ms]', 0.5), ('p99 [ms]', 0.99), ('p99.9 [ms]', 0.999))


def _filled(windows: Sequence[Sequence[float]], size: int = 10) -> Durations:
    made = Durations(size)
    for k, window in enumerate(windows):
        if k:
            made.rotate()
        for duration in window:
            made.add(duration)
    return made


@given(st.lists(st.lists(DURATION, max_size=30), min_size=1, max_size=15), st.integers(1, 6))
def test_only_the_last_windows_count(windows: list[list[float]], size: int) -> None:
    """Check against a sorted list of the durations of the last windows."""
    kept = sorted(1e3 * x for window in windows[-size:] for x in window)
    found = _filled(windows, size).summary()
    if not kept:
        assert found == {}
        return
    assert found['mean [ms]'] == pytest.approx(sum(kept) / len(kept), rel=1e-12)
    assert found['max [ms]'] == kept[-1]
    for name, share in QUANTILES:
        assert found[name] == next(
            x for k, x in enumerate(kept, 1) if k >= share * len(kept) - 1e-9)
    below = 0
    for end, count in re.findall(r'<([\d.e+-]+): (\d+)', str(found['histogram [ms]'])):
        least, most = (float(end) * (1.0 + rounding) for rounding in (-0.06, 0.06))
        assert all(x <= most for x in kept[below:below + int(count)])
        assert all(x >= least / 2.0 for x in kept[below:below + int(count)] if x > 1e-3)
        below += int(count)
    assert below == len(kept)


def test_the_octaves_of_the_histogram() -> None:
    """Check which octave each duration is in, by hand: about 1 ms times powers of two."""
    found = _filled([[0.9e-3, 1.1e-3, 1.3e-3, 1.5e-3, 2.7e-3, 0.6e-3, 0.1]]).summary()
    assert found['histogram [ms]'] == '<0.71: 1, <1.4: 3, <2.8: 2, <1.8e+02: 1'
    assert _filled([[0.0, 1e-9, 1e-6]]).summary()['histogram [ms]'] == '<0.0014: 3'


def test_nothing_yet() -> None:
    """Check that there is nothing to say without a duration, also after a rotation."""
    made = Durations()
    for _ in range(20):
        assert made.summary() == {}
        made.rotate()


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
        for key, share in QUANTILES:
            assert values[f'{name}, {key}'] == pytest.approx(
                np.quantile(exact / MS, share, method='inverted_cdf'))
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
        values = pace.values()
        assert values['samples'] == 20
        assert values['period, mean [ms]'] == pytest.approx(1.0 if paused else 909 / 19)
        assert values['period, histogram [ms]'] == (
            '<1.4: 18' if paused else '<1.4: 18, <1.4e+03: 1')


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
        slow = pace.values().get('computing time, max [ms]') == pytest.approx(50.0)
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
    assert values['answer time, p99 [ms]'] == pytest.approx(0.3)
    assert values['answer time, p99.9 [ms]'] == pytest.approx(3.0)
    assert values['answer time, histogram [ms]'] == '<0.35: 998, <5.7: 2'


def test_a_step_that_takes_too_much_of_the_period_is_named() -> None:
    """Check that the time of most samples counts."""
    statistics = LoopStatistics()
    assert statistics.too_slow(MS) == ''
    for k in range(1000):
        statistics.sample(k * MS, k * MS + (5 * MS if k % 20 == 0 else 400_000))
    assert statistics.too_slow(MS) == ''
    for k in range(2000):
        statistics.sample(k * MS, k * MS + 600_000)
    assert statistics.too_slow(MS) == (
        'the step takes 0.6 ms (p50) at a period of 1 ms: too slow for the sample rate')
    assert statistics.too_slow(2 * MS) == ''
