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

"""The oscillation guard, on feedbacks written here."""

import math

from ctc_chattering.control.oscillation import design_guard, Oscillation
import numpy as np
import pytest


def test_how_long_a_strong_feedback_was_not_helped() -> None:
    """Check that it counts where f exceeds 3 Ka, from s = 0.2 on, and from 0 after a weak one."""
    zero, ka = np.zeros(2), np.array([60.0, 30.0])
    guard = design_guard(ka, np.array([5e3, 1e3]), np.full(2, 100.0), 1e-3)
    state = Oscillation(zero, zero, zero, zero, math.log(0.15), 0.0, zero, 0.0, 0.0)
    for _ in range(100):
        state = guard.update_oscillation(state, np.array([0.0, 91.0]), zero)
    assert state.strained == pytest.approx(0.1)
    assert guard.update_oscillation(state, np.array([0.0, 89.0]), zero).strained == 0.0


def limit_cycle(retreat: float, amplitude: float, frequency: float, duration: float
                ) -> Oscillation:
    """Return what a guard remembers of a feedback of joint b that oscillates at a bandwidth."""
    zero, ka = np.zeros(2), np.array([60.0, 30.0])
    guard = design_guard(ka, np.array([5e3, 1e9]), np.full(2, 100.0), 1e-3)
    state = Oscillation(zero, zero, zero, zero, retreat, 0.0, zero, 0.0, 0.0)
    for k in range(round(duration * 1e3)):
        f = amplitude * math.sin(2.0 * math.pi * frequency * 1e-3 * k)
        state = guard.update_oscillation(state, np.array([0.0, f]), zero)._replace(retreat=retreat)
    assert guard.find_cycling_joint(state) == 1
    return state


@pytest.mark.parametrize('frequency', [21.0, 60.0])
def test_a_limit_cycle_is_timed_and_its_frequency_measured(frequency: float) -> None:
    """A quarter of Ka, a wave after which a half-wave has faded; less, or more bandwidth, not."""
    least = 0.25 * 30.0 * math.exp(10.0 / frequency)
    state = limit_cycle(math.log(0.5), 1.3 * least, frequency, 2.0)
    assert state.cycling == pytest.approx(2.0, abs=0.4)
    assert state.frequency[1] == pytest.approx(frequency, rel=0.15)
    assert limit_cycle(math.log(0.5), 0.7 * least, frequency, 2.0).cycling == 0.0
    assert limit_cycle(math.log(0.8), 1.3 * least, frequency, 2.0).cycling == 0.0
