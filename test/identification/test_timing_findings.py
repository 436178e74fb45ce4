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

"""What is said of delay, lag and rate limit of the drives."""

from __future__ import annotations

from ctc_chattering.identification.drives import LAGS
from ctc_chattering.identification.findings import Severity
from ctc_chattering.identification.timing import (
    drives_in_words,
    lag_in_words,
    rate_limits,
    Timing,
    timing_findings,
)
import numpy as np

JOINTS = ('a', 'b')
NONE = np.zeros((3, 2))


def timing(delays: dict[int, np.ndarray], rate: np.ndarray | None = None) -> Timing:
    rates = np.tile(np.array([[50.0], [np.inf], [np.inf]]), 2) if rate is None else rate
    best = min(delays)
    return Timing('command', float(best), delays[best][1], np.zeros(2), delays, np.ones(2), rates,
                  np.ones(2, bool))


def ms(*rows: tuple[float, float]) -> np.ndarray:
    return 1e-3 * np.array(rows)


def test_a_set_in_words() -> None:
    found = timing({1: ms((3.1, 3.1), (3.5, 3.5), (4.4, 4.4)),
                    2: ms((0.0, 0.1), (0.0, 0.2), (0.5, 0.6))})
    assert drives_in_words(found, JOINTS) == (
        'delay 1 with lag 3.1 to 4.4 ms, or delay 2 with lag 0 to 0.5 ms (a), 0.1 to 0.6 ms (b)')
    assert lag_in_words(found, 0) == '3.1 to 4.4 ms with delay 1'
    (one,) = timing_findings(found, JOINTS, (0.0, 0.0))
    assert one.severity == Severity.NOTE and 'delay 2' in one.reason
    assert lag_in_words(timing({0: ms((0, 0), (0, 0), (0.1, 0.1))}), 1) == 'none, at most 0.1 ms'


def test_of_many_delays_the_range_is_said() -> None:
    found = timing({1: ms((3.1, 3.0), (3.5, 3.5), (4.4, 4.4)), 2: ms((2, 2), (2, 2), (3, 3)),
                    3: ms((0.5, 1.5), (1, 2), (2, 3))})
    assert drives_in_words(found, JOINTS) == (
        'delays of 1 to 3 samples, with lags of 0.5 to 4.4 ms')


def test_a_lag_at_the_end_is_refused_with_its_cause() -> None:
    end = 1e3 * LAGS[-1]
    (one, other) = timing_findings(timing({0: ms((30.0, 0.0), (38.0, 0.0), (end, end))}), JOINTS,
                                   (0.0, 0.0))
    assert (one.severity, one.joint) == (Severity.REFUSED, 0)
    assert 'rotor' in one.reason
    assert (other.severity, other.joint) == (Severity.CARE, 1)
    assert [x.value for x in rate_limits(timing({0: ms((0, 0), (0, 0), (end, end))}), JOINTS)
            ] == [None, None]


def test_rate_limits_with_intervals_or_bounds() -> None:
    first, second = rate_limits(timing({0: NONE}, np.array(
        [[900.0, 50.0], [1000.0, np.inf], [1100.0, np.inf]])), JOINTS)
    assert (first.value, first.half, first.unit) == (1000.0, 100.0, 'N*m/s')
    assert second.value is None and 'at least 50 N*m/s' in second.reason


def test_jitter_and_many_delays_are_said() -> None:
    found = timing(dict.fromkeys(range(4), NONE))
    jitter, many = timing_findings(found, JOINTS, (-0.2, 0.1))
    assert '0.2 samples' in jitter.reason
    assert many.severity == Severity.CARE and many.cure
