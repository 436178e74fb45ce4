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
"""Sets of delay, lag and rate limit contain the truth; how they are told."""

from __future__ import annotations

import dataclasses

from ctc_chattering.dynamics.drive_response import response
from ctc_chattering.identification.drive_search import LAGS
from ctc_chattering.identification.findings import Reason, Severity
from ctc_chattering.identification.stretches import COMMAND, EFFORT, Stretch
from ctc_chattering.identification.timing import (
    describe_drives,
    describe_lag,
    estimate_rate_limits,
    find_timing_doubts,
    identify_timing,
    LateCommands,
    Timing,
)
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.numerics.linear_algebra import Array
from made_up_windows import windows
import numpy as np
import pytest

H, COUNT = 1e-3, 8000
PHI = TestFunction(H)


def driven_torque(command: Array, lag: float, rate: float) -> Array:
    """Return the mean over each period by the closed form of the simulated drives."""
    now, found = command[:1], np.empty_like(command)
    drive = np.array([lag]), np.array([rate])
    for k, c in enumerate(command):
        with np.errstate(invalid='ignore'):  # Of a drive that has arrived.
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
             late: tuple[float, float] = (0.0, 0.0)) -> Timing:
    """Return the timing of commands for a torque that the motion shows with noise."""
    centres = PHI.centres(COUNT, 200)
    shown = PHI.sums(torque[:, None], PHI.over, centres)
    shown += np.random.default_rng(seed).normal(0.0, noise, shown.shape)
    rows = dataclasses.replace(windows(np.ones_like(shown), shown),
                               t=np.asarray(H * centres, float), centres=centres)
    part = Stretch(0.0, H, np.zeros((COUNT, 1)), None, command[:, None], late)
    return identify_timing([part], [rows], COMMAND, PHI)


def delayed(torque: Array, delay: int) -> Array:
    return np.concatenate((np.full(delay, torque[0]), torque[:len(torque) - delay]))


@pytest.mark.parametrize('robots, most', [
    (range(6), 1), pytest.param(range(30), 2, marks=pytest.mark.slow)])
def test_possible_delays_and_lags_contain_the_true_ones(robots: range, most: int) -> None:
    """Of 30 robots, at most two may have a lag outside, and none a delay that is wrong."""
    outside = 0
    for seed in robots:
        rng = np.random.default_rng((seed, 1))
        delay, lag = int(rng.integers(0, 4)), float(rng.choice([0.0, rng.uniform(3e-4, 5e-3)]))
        command = commands(seed, rng.uniform(0.0, 5.0))
        torque = delayed(driven_torque(command, lag, np.inf), delay)
        found = searched(command, torque, 10.0 ** rng.uniform(-3.0, -1.0), seed)
        assert delay in found.delays, f'{seed}: {delay}, {lag}: {found.delays}'
        low, _, high = found.delays[delay][:, 0]
        outside += not low - 1e-6 <= lag <= high + 1e-6
    assert outside <= most


def test_slow_commands_leave_several_delays_possible() -> None:
    """Slow commands show the sum of delay and lag, not each."""
    command = commands(1, 0.0, 0.5)
    found = searched(command, delayed(driven_torque(command, 2e-3, np.inf), 1), 0.03, 1)
    assert {1, 2, 3} <= set(found.delays)
    for delay, lags in found.delays.items():
        assert lags[0, 0] <= max(3e-3 - delay * H, 0.0) <= lags[2, 0]


@pytest.mark.parametrize('rate', [
    150.0, pytest.param(600.0, marks=pytest.mark.slow), np.inf])
def test_the_rate_limit(rate: float) -> None:
    command = commands(3, 6.0)
    found = searched(command, delayed(driven_torque(command, 1e-3, rate), 1), 0.01, 3)
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
    found = searched(command, driven_torque(command, 0.0, 10.0 * fastest), 0.01, 5)
    low, best, high = found.rate[:, 0]
    assert 0.0 < low <= fastest
    assert np.isinf(best) and np.isinf(high)


def test_late_commands_allow_more_delays_and_lags() -> None:
    """By the samples by which they may be later than the recording has them."""
    command = commands(2, 3.0)
    torque = delayed(driven_torque(command, 2e-3, np.inf), 2)
    sure, doubtful = (searched(command, torque, 0.001, 2, late)
                      for late in ((0.0, 0.0), (-1.0, 1.0)))
    assert set(sure.delays) == {2} and {1, 2, 3} <= set(doubtful.delays)
    assert np.isinf(doubtful.rate[1:]).all()
    for delay in (1, 2, 3):
        # The sum of delay and lag is known to a sample.
        low, _, high = doubtful.delays[delay][:, 0] + delay * H
        assert low <= 3e-3 + 1e-9 and high >= 5e-3 - 1e-9
    assert LateCommands(-0.01, 0.01).widen(sure.delays, H, sure.moving) is sure.delays


def test_a_joint_that_rests_has_no_timing() -> None:
    command = commands(4, 1.0)
    centres = PHI.centres(COUNT, 200)
    rest = dataclasses.replace(windows(np.zeros((len(centres), 1))), centres=centres)
    part = Stretch(0.0, H, np.zeros((COUNT, 1)), None, command[:, None])
    found = identify_timing([part], [rest], COMMAND, PHI)
    assert found.delays == {} and not found.moving.any()
    assert describe_lag(found, 0) == '-'


def aligned(late: float, noise: float) -> float:
    """Return the alignment that is found of an effort that is so many samples late."""
    rng = np.random.default_rng(6)
    t = H * np.arange(COUNT)
    true = sum(5.0 * np.sin((k + 1) * t + rng.uniform(0.0, 6.0)) for k in range(5))
    centres = PHI.centres(COUNT, 200)
    shown = PHI.sums(true[:, None], PHI.over, centres)
    rows = dataclasses.replace(windows(np.ones_like(shown), shown),
                               t=np.asarray(H * centres, float), centres=centres)
    effort = np.interp(t - (0.5 + late) * H, t, true) + rng.normal(0.0, noise, COUNT)
    part = Stretch(0.0, H, np.zeros((COUNT, 1)), effort[:, None], None)
    return identify_timing([part], [rows], EFFORT, PHI).delay


def test_a_filtered_effort_is_aligned_only_if_its_lag_shows() -> None:
    """In noise that hides 8 ms it is that of its sample; a smaller noise shows them."""
    assert aligned(8.0, 0.01) == pytest.approx(-8.5, abs=1.0)
    assert aligned(8.0, 30.0) >= -1.0
    assert aligned(0.0, 30.0) >= -1.0


JOINTS = ('a', 'b')
NONE = np.zeros((3, 2))


def made(delays: dict[int, np.ndarray], rate: np.ndarray | None = None) -> Timing:
    rates = np.tile(np.array([[50.0], [np.inf], [np.inf]]), 2) if rate is None else rate
    best = min(delays)
    return Timing('command', float(best), delays[best][1], delays, rates, np.ones(2, bool))


def ms(*rows: tuple[float, float]) -> np.ndarray:
    return 1e-3 * np.array(rows)


def test_possible_delays_and_lags_in_words() -> None:
    found = made({1: ms((3.1, 3.1), (3.5, 3.5), (4.4, 4.4)),
                  2: ms((0.0, 0.1), (0.0, 0.2), (0.5, 0.6))})
    assert describe_drives(found) == (
        'delay 1 with lag 3.1 to 4.4 ms, or delay 2 with lag 0 to 0.6 ms')
    assert describe_lag(found, 0) == '3.1 to 4.4 ms with delay 1'
    (one,) = find_timing_doubts(found)
    assert (one.reason, one.severity) == (Reason.SEVERAL_DELAYS, Severity.NOTE)
    assert describe_lag(made({0: ms((0, 0), (0, 0), (0.1, 0.1))}), 1) == 'none, at most 0.1 ms'


def test_the_longest_lag_and_a_slow_drive_need_care() -> None:
    end = 1e3 * LAGS[-1]
    (one, other) = find_timing_doubts(made({0: ms((30.0, 0.0), (38.0, 0.0), (end, end))}))
    assert [(x.reason, x.severity, x.joint) for x in (one, other)] == [
        (Reason.UNBOUNDED_LAG, Severity.CARE, joint) for joint in range(2)]
    assert one.values['lag_ms'] == pytest.approx(30.0)
    (slow,) = find_timing_doubts(made({0: ms((11.0, 0.0), (12.0, 0.0), (13.0, 0.1))}))
    assert (slow.reason, slow.severity, slow.joint) == (Reason.LONG_LAG, Severity.CARE, 0)
    assert slow.values['lag_ms'] == pytest.approx(12.0)
    assert [x.value for x in estimate_rate_limits(made({0: ms((0, 0), (0, 0), (end, end))}))
            ] == [None, None]


def test_rate_limits_with_intervals_or_bounds() -> None:
    first, second = estimate_rate_limits(made({0: NONE}, np.array(
        [[900.0, 50.0], [1000.0, np.inf], [1100.0, np.inf]])))
    assert (first.value, first.half, first.unit) == (1000.0, 100.0, 'N*m/s')
    assert second.value is None and str(second) == 'at least 50 N*m/s'


def test_delays_far_apart_need_care() -> None:
    (many,) = find_timing_doubts(made(dict.fromkeys(range(4), NONE)))
    assert (many.reason, many.severity) == (Reason.FAR_DELAYS, Severity.CARE)
