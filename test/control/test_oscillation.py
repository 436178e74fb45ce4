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

from ctc_chattering.control.oscillation import LEAST, Oscillation, oscillation_guard
import numpy as np
from oracles import Array
import pytest

H, KA = 1e-3, np.array([60.0, 30.0])


def part(feedback: list[Array], start: float = 0.0) -> float:
    """Return s after the samples of a feedback [N·m]."""
    guard, state = oscillation_guard(KA, H), Oscillation(np.zeros(2), start, 0.0)
    for f in feedback:
        state = guard.noticed(state, f)
    return math.exp(state.retreat)


def sine(amplitude: float, frequency: float, duration: float) -> list[Array]:
    """Return a feedback of joint 2 [N·m], at a frequency [Hz]."""
    return [np.array([0.0, amplitude * math.sin(2.0 * math.pi * frequency * k * H)])
            for k in range(round(duration / H))]


@pytest.mark.parametrize('frequency', [8.0, 15.0, 40.0])
def test_an_oscillation_costs_bandwidth_down_to_a_tenth(frequency: float) -> None:
    assert part(sine(60.0, frequency, 0.25)) < 0.35
    assert part(sine(200.0, frequency, 2.0)) == pytest.approx(LEAST, rel=0.2)


def test_what_is_normal_costs_nothing() -> None:
    """Check 40 % of Ka, a torque that Ka lacks, and the motion's own frequency."""
    assert part(sine(12.0, 15.0, 2.0)) == 1.0
    assert part(sine(100.0, 0.5, 4.0)) == 1.0
    assert part([np.array([0.4, 0.4]) * KA] * 1000) == 1.0


def test_a_reversal_of_friction_costs_a_quarter_at_most() -> None:
    pulse = [np.array([0.0, 30.0])] * 10 + [np.zeros(2)] * 100
    assert part(pulse) > 0.75


def test_the_bandwidth_returns_within_two_seconds_to_what_is_left_of_it() -> None:
    quiet = [np.zeros(2)] * 2000
    assert part(quiet, math.log(LEAST)) == pytest.approx(LEAST ** math.exp(-1.0), rel=1e-9)


def test_a_bound_of_zero_and_what_is_not_finite() -> None:
    guard = oscillation_guard(np.zeros(2), H)
    state = guard.noticed(Oscillation(np.zeros(2), 0.0, 0.0), np.array([1e250, 0.0]))
    assert state.retreat == pytest.approx(math.log(LEAST))


def test_how_long_a_strong_feedback_was_not_helped() -> None:
    """Check that it counts from s = 0.2 on, and again from 0 after a weak one."""
    guard, state = oscillation_guard(KA, H), Oscillation(np.zeros(2), math.log(0.15), 0.0)
    for _ in range(100):
        state = guard.noticed(state, np.array([0.0, 91.0]))
    assert state.strained == pytest.approx(0.1)
    assert guard.noticed(state, np.array([0.0, 89.0])).strained == 0.0
    calm = Oscillation(np.array([0.0, 500.0]), 0.0, 0.0)
    assert guard.noticed(calm, np.array([0.0, 500.0])).strained == 0.0
