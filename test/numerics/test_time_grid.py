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

"""The control grid in whole nanoseconds."""

from fractions import Fraction
import math

from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.time_grid import period_ns, samples, seconds
import pytest


@pytest.mark.parametrize(('period', 'ns'), [
    (1e-3, 1_000_000), (1e-9, 1), (0.1, 100_000_000), (3e-3, 3_000_000), (0.007, 7_000_000),
    (1e4, 10 ** 13)])
def test_period_is_whole_nanoseconds(period: float, ns: int) -> None:
    assert period_ns(period) == ns


@pytest.mark.parametrize('period', [
    0.0, -1e-3, 0.4e-9, 1.5e-9, 1 / 1024, 1e-3 * (1 + 1e-8), math.nan, math.inf, 1e300])
def test_period_off_the_grid_is_refused(period: float) -> None:
    with pytest.raises(ParameterError, match=r'control_period: .* nanoseconds'):
        period_ns(period)


@pytest.mark.parametrize(('duration', 'period', 'last'), [
    (10.0, 1_000_000, 10_000), (10.0, 10_000, 1_000_000), (0.3, 100_000_000, 3),
    (0.7, 100_000_000, 7), (2.1, 700_000_000, 3), (0.0, 1_000_000, 0), (1.0, 300_000_000, 3),
    (0.9999e-3, 1_000_000, 0)])
def test_samples_count_whole_periods(duration: float, period: int, last: int) -> None:
    """Check the last index where floating-point division would be one off (0.3 / 0.1 = 2.99)."""
    assert samples(duration, period) == last


def test_seconds_is_the_nearest_float() -> None:
    """Check k h against exact rational arithmetic: no error accumulates over a run."""
    for ns in [0, 1, 999, *range(0, 10 ** 10, 12_345_678_9), 10 ** 15 + 1]:
        assert seconds(ns) == float(Fraction(ns, 10 ** 9))
    assert seconds(3 * 100_000_000) == 0.3 != 3 * 0.1
