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

"""Sets of delay, lag and rate limit contain the truth; what is said of them."""

from __future__ import annotations

import dataclasses

from ctc_chattering.bags.recording import Stretch
from ctc_chattering.identification.drives import DriveProfile, DriveSet, LAGS
from ctc_chattering.identification.findings import Severity
from ctc_chattering.identification.least_squares import Data
from ctc_chattering.identification.timing import (
    drives_in_words,
    lag_in_words,
    rate_limits,
    Timing,
    timing_findings,
)
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.drive import response
import numpy as np
import pytest

H, COUNT = 1e-3, 8000
PHI = TestFunction(H)


def driven_torque(command: Array, lag: float, rate: float) -> Array:
    """Return the mean over each period by the closed form of the simulated drives."""
    now, found = command[:1], np.empty_like(command)
    drive = np.array([lag]), np.array([rate])
    for k, c in enumerate(command):
        end, area = response(c - now, *drive, H)
        found[k], now = c + area[0] / H, c + end
    return found


def commands(seed: int, jump: float, slow: float = 1.0) -> Array:
    """Return commands of 8 s that swing, and jump now and then."""
    rng = np.random.default_rng(seed)
    t = H * np.arange(COUNT)
    swing = sum(rng.normal(0.0, 8.0) * np.sin(slow * (k + 1) * t + rng.uniform(0.0, 6.0))
                for k in range(5))
    return np.asarray(swing + jump * np.cumsum(
        rng.choice([-1.0, 1.0], COUNT) * (rng.random(COUNT) < 3e-3)))


def searched(command: Array, torque: Array, noise: float, seed: int,
             rates: bool = False) -> DriveSet:
    """Return the set for a torque that the motion shows with noise."""
    centres = PHI.centres(COUNT, 200)
    rng = np.random.default_rng(seed)
    base = PHI.sums(torque[:, None], PHI.over, centres)
    base += rng.normal(0.0, noise, base.shape)
    one = np.ones((len(centres), 1))
    weak = PHI.sums(command[:, None], PHI.over, centres)
    data = dataclasses.replace(Data.at(one, one, weak, np.empty((*one.shape, 0))),
                               t=np.asarray(H * centres, float), centres=centres, base=base)
    part = Stretch(0.0, H, np.zeros((COUNT, 1)), None, command[:, None])
    profile = DriveProfile([part], [data], data, lambda torque, _: torque, PHI, range(-1, 6),
                           np.array([True]))
    return profile.found(np.abs(np.diff(command)).max(keepdims=True) / H if rates else None)


def late(torque: Array, delay: int) -> Array:
    return np.concatenate((np.full(delay, torque[0]), torque[:len(torque) - delay]))


@pytest.mark.parametrize('robots, most', [
    (range(6), 1), pytest.param(range(30), 2, marks=pytest.mark.slow)])
def test_sets_contain_the_truth(robots: range, most: int) -> None:
    """Of 30 robots, at most two may have a lag outside, and none a delay that is wrong."""
    outside = 0
    for seed in robots:
        rng = np.random.default_rng((seed, 1))
        delay, lag = int(rng.integers(0, 4)), float(rng.choice([0.0, rng.uniform(3e-4, 5e-3)]))
        command = commands(seed, rng.uniform(0.0, 5.0))
        torque = late(driven_torque(command, lag, np.inf), delay)
        found = searched(command, torque, 10.0 ** rng.uniform(-3.0, -1.0), seed)
        assert delay in found.delays, f'{seed}: {delay}, {lag}: {found.delays}'
        low, _, high = found.delays[delay][:, 0]
        outside += not low - 1e-6 <= lag <= high + 1e-6
    assert outside <= most


def test_where_two_fit_both_are_in_the_set() -> None:
    """Slow commands show the sum of delay and lag, not each."""
    command = commands(1, 0.0, 0.5)
    found = searched(command, late(driven_torque(command, 2e-3, np.inf), 1), 0.03, 1)
    assert {1, 2, 3} <= set(found.delays)
    for delay, lags in found.delays.items():
        assert lags[0, 0] <= max(3e-3 - delay * H, 0.0) <= lags[2, 0]


@pytest.mark.parametrize('rate', [
    150.0, pytest.param(600.0, marks=pytest.mark.slow), np.inf])
def test_the_rate_limit(rate: float) -> None:
    command = commands(3, 6.0)
    found = searched(command, late(driven_torque(command, 1e-3, rate), 1), 0.01, 3, True)
    low, best, high = found.rate[:, 0]
    if np.isinf(rate):
        assert low > 600.0 and np.isinf(high)
    else:
        assert low <= rate <= high < 1.1 * rate
        assert low > 0.9 * rate and low <= best <= high
    assert found.delays[1][0, 0] <= 1e-3 <= found.delays[1][2, 0]


def test_a_rate_limit_that_never_bites_has_a_lower_bound() -> None:
    command = commands(5, 0.0)
    fastest = float(np.abs(np.diff(command)).max()) / H
    found = searched(command, driven_torque(command, 0.0, 10.0 * fastest), 0.01, 5, True)
    low, best, high = found.rate[:, 0]
    assert 0.0 < low <= fastest
    assert np.isinf(best) and np.isinf(high)


JOINTS = ('a', 'b')
NONE = np.zeros((3, 2))


def timing(delays: dict[int, np.ndarray], rate: np.ndarray | None = None) -> Timing:
    rates = np.tile(np.array([[50.0], [np.inf], [np.inf]]), 2) if rate is None else rate
    best = min(delays)
    return Timing('command', float(best), delays[best][1], delays, rates, np.ones(2, bool))


def ms(*rows: tuple[float, float]) -> np.ndarray:
    return 1e-3 * np.array(rows)


def test_a_set_in_words() -> None:
    found = timing({1: ms((3.1, 3.1), (3.5, 3.5), (4.4, 4.4)),
                    2: ms((0.0, 0.1), (0.0, 0.2), (0.5, 0.6))})
    assert drives_in_words(found) == (
        'delay 1 with lag 3.1 to 4.4 ms, or delay 2 with lag 0 to 0.6 ms')
    assert lag_in_words(found, 0) == '3.1 to 4.4 ms with delay 1'
    (one,) = timing_findings(found)
    assert one.severity == Severity.NOTE and 'delay 2' in one.reason
    assert lag_in_words(timing({0: ms((0, 0), (0, 0), (0.1, 0.1))}), 1) == 'none, at most 0.1 ms'


def test_a_lag_at_the_end_is_refused_with_its_cause() -> None:
    end = 1e3 * LAGS[-1]
    (one, other) = timing_findings(timing({0: ms((30.0, 0.0), (38.0, 0.0), (end, end))}))
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


def test_many_delays_are_said() -> None:
    (many,) = timing_findings(timing(dict.fromkeys(range(4), NONE)))
    assert many.severity == Severity.CARE and many.cure
