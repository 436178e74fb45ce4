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

from ctc_chattering.controller.loop_statistics import LoopStatistics
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

MS = 1_000_000
QUANTILES = (('p50 [ms]', 0.5), ('p99 [ms]', 0.99), ('p99.9 [ms]', 0.999))


@given(st.lists(st.tuples(st.integers(1000, 800 * MS), st.integers(1000, 800 * MS)),
                min_size=2, max_size=100), st.integers(0, 10 ** 15))
def test_periods_and_computing_times(steps: list[tuple[int, int]], start: int) -> None:
    """Check quantiles and largest of random loops."""
    begins = (start + np.cumsum([step for step, _ in steps])).tolist()
    spent = [x for _, x in steps]
    loop = LoopStatistics()
    for begin, x in zip(begins, spent):
        loop.sample(begin, begin + x)
    values = loop.values()
    assert values['samples'] == len(steps)
    assert values['deadline misses'] == 0
    for name, exact in (('period', np.diff(begins)), ('computing time', np.array(spent))):
        assert values[f'{name}, max [ms]'] == pytest.approx(exact.max() / MS)
        for key, share in QUANTILES:
            assert values[f'{name}, {key}'] == pytest.approx(
                np.quantile(exact / MS, share, method='inverted_cdf'))
    assert 'answer time, max [ms]' not in values


def test_a_pause_is_no_period() -> None:
    """Check that the time over a pause is left out, and only that; without it, it counts."""
    begins = [k * MS for k in range(10)] + [(900 + k) * MS for k in range(10)]
    for paused in (True, False):
        loop = LoopStatistics()
        for k, begin in enumerate(begins):
            if paused and k == 10:
                loop.pause()
            loop.sample(begin, begin + 1000)
        values = loop.values()
        assert values['samples'] == 20
        assert values['period, max [ms]'] == pytest.approx(1.0 if paused else 891.0)


def test_rate_is_that_of_the_last_window() -> None:
    """Check samples per second between two rotations; none before the second one."""
    loop, t, rates = LoopStatistics(), 5 * MS, []
    for period, count in ((1 * MS, 400), (2 * MS, 300), (10 * MS, 50), (100 * MS, 0)):
        for _ in range(count):
            t += period
            loop.sample(t, t + 1000)
        loop.rotate(t)
        rates.append(loop.rate)
    assert rates == pytest.approx([0.0, 500.0, 100.0, 100.0])
    loop.rotate(t + 1000 * MS)
    assert (loop.rate, loop.values()['samples']) == (0.0, 750)


def test_old_durations_are_forgotten_and_totals_are_not() -> None:
    """Check that ten thousand samples later slow ones have left the quantiles, not the count."""
    loop = LoopStatistics()
    loop.misses += 3
    for k in range(10_005):
        loop.sample(k * MS, k * MS + (50 * MS if k < 5 else 2000))
        if k == 10_003:
            loop.rotate((k + 1) * MS)
            assert loop.values()['computing time, max [ms]'] == pytest.approx(50.0)
    loop.rotate(20_000 * MS)
    values = loop.values()
    assert values['computing time, max [ms]'] == pytest.approx(2e-3)
    assert (values['samples'], values['deadline misses']) == (10_005, 3)


def test_a_step_that_takes_too_much_of_the_period_is_named() -> None:
    """Check that the time of most samples counts."""
    loop = LoopStatistics()
    assert loop.too_slow(MS) == ''
    for k in range(1000):
        loop.sample(k * MS, k * MS + (5 * MS if k % 20 == 0 else 400_000))
    assert loop.too_slow(MS) == ''
    for k in range(2000):
        loop.sample(k * MS, k * MS + 600_000)
    assert loop.too_slow(MS) == (
        'half of the steps take more than 0.6 ms at a period of 1 ms, which is too slow for the '
        'sample rate')
    assert loop.too_slow(2 * MS) == ''
