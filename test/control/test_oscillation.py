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

"""The guard of the bandwidth, on feedbacks of which the answer is known."""

from __future__ import annotations

import math

from ctc_chattering.control.adaptation import LEAST, Oscillation, oscillation_guard
import numpy as np
from oracles import Array
import pytest

H, KA, RATE, POLE = 1e-3, np.array([60.0, 30.0]), np.array([5e3, 1e3]), np.full(2, 100.0)


def quiet(ln_s: float = 0.0, strained: float = 0.0) -> Oscillation:
    """Return the memory of a loop without feedback so far."""
    zero = np.zeros(2)
    return Oscillation(zero, zero, zero, zero, ln_s, strained)


def part(feedback: list[Array], start: float = 0.0, rate: Array = RATE, missing: float = 0.0
         ) -> float:
    """Return s after the samples of a feedback of which a part is missing [N·m]."""
    guard, state = oscillation_guard(KA, rate, POLE, H), quiet(start)
    for f in feedback:
        state = guard.noticed(state, f, np.full(2, missing))
    return math.exp(state.retreat)


def sine(amplitude: float, frequency: float, duration: float) -> list[Array]:
    """Return a feedback of joint 2 [N·m], at a frequency [Hz]."""
    return [np.array([0.0, amplitude * math.sin(2.0 * math.pi * frequency * k * H)])
            for k in range(round(duration / H))]


@pytest.mark.parametrize('frequency', [8.0, 15.0, 40.0])
def test_an_oscillation_costs_bandwidth_down_to_a_tenth(frequency: float) -> None:
    assert part(sine(60.0, frequency, 0.4)) < 0.35
    assert part(sine(200.0, frequency, 2.0)) == pytest.approx(LEAST, rel=0.2)


def test_what_drives_follow_at_the_pole_is_the_scale_of_an_oscillation_that_goes_on() -> None:
    """Check both sides of half of R / √Kp, 5 N·m, and that less than half of Ka + R / √Kp is."""
    assert part(sine(4.9, 15.0, 2.0)) == 1.0 > part(sine(12.0, 15.0, 2.0))
    assert part(sine(12.0, 15.0, 2.0), rate=np.full(2, np.inf)) == 1.0


def test_a_feedback_beyond_what_drives_and_bound_are_for_costs_bandwidth_at_once() -> None:
    """Check both sides of half of Ka + R / √Kp, 20 N·m, and of half of Ka where R is not known."""
    for size, rate in ((20.0, RATE), (15.0, np.full(2, np.inf))):
        assert part([np.array([0.0, 0.95 * size])] * 50, rate=rate) == 1.0
        assert part([np.array([0.0, 3.0 * size])] * 20, rate=rate) < 0.7


def test_what_the_law_knows_to_be_missing_costs_nothing() -> None:
    """Check a motion that is too hard: the drives lag behind for 50 ms, known to the law."""
    hard = [np.array([300.0, 100.0])] * 50
    assert part(hard, missing=290.0) == 1.0 > part(hard)


def test_what_is_normal_costs_nothing() -> None:
    """Check 40 % of Ka, a torque that Ka lacks and that comes slowly, and a slow motion."""
    assert part([np.array([0.4, 0.4]) * KA] * 1000) == 1.0
    assert part([k / 1000 * 10.0 * KA for k in range(1000)]) == 1.0
    assert part(sine(100.0, 0.5, 4.0)) == 1.0


def test_a_reversal_of_friction_costs_a_quarter_at_most() -> None:
    pulse = [np.array([0.0, 30.0])] * 10 + [np.zeros(2)] * 100
    assert part(pulse) > 0.75


def test_the_bandwidth_returns_within_two_seconds_to_what_is_left_of_it() -> None:
    assert part([np.zeros(2)] * 2000, math.log(LEAST)) == pytest.approx(
        LEAST ** math.exp(-1.0), rel=1e-9)


def test_a_bound_of_zero_and_what_is_not_finite() -> None:
    guard, state = oscillation_guard(np.zeros(2), RATE, POLE, H), quiet()
    for f in (1e250, -1e250, 1e250):
        state = guard.noticed(state, np.array([f, 0.0]), np.zeros(2))
    assert state.retreat == pytest.approx(math.log(LEAST))


def test_how_long_a_strong_feedback_was_not_helped() -> None:
    """Check that it counts from s = 0.2 on, and again from 0 after a weak one."""
    guard, state = oscillation_guard(KA, RATE, POLE, H), quiet(math.log(0.15))
    for _ in range(100):
        state = guard.noticed(state, np.array([0.0, 91.0]), np.zeros(2))
    assert state.strained == pytest.approx(0.1)
    assert guard.noticed(state, np.array([0.0, 89.0]), np.zeros(2)).strained == 0.0
