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


"""The step from a pass to the next correction."""

from __future__ import annotations

from ctc_chattering.learning.learning_filter import LearningFilter
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest

CUTOFF = 8.0
PERIOD = 1e-3
COUNT = 1000
#: Fraction of an error that goes into the correction.
GAIN = 0.7


def plain(n: int = 1) -> LearningFilter:
    """Return a filter whose L is `GAIN`."""
    gain = np.full((2, n, n), GAIN * np.eye(n), np.complex128)
    return LearningFilter(np.array([0.1, 450.0]), gain, CUTOFF, 0.5)


def wave(frequency: float, phase: float = 0.3) -> Array:
    t = PERIOD * np.arange(COUNT)
    sinusoid: Array = np.sin(2.0 * np.pi * frequency * t + phase)[:, np.newaxis]
    return sinusoid


def test_a_symmetric_pulse_stays_symmetric_about_its_centre() -> None:
    t = PERIOD * np.arange(COUNT)
    pulse = np.exp(-((t - 0.4) / 0.01) ** 2)[:, np.newaxis]
    changed = plain().update(np.zeros_like(pulse), pulse, PERIOD)[:, 0]
    assert np.argmax(changed) == 400
    about_centre = np.roll(changed, -400)
    assert about_centre == pytest.approx(np.roll(about_centre[::-1], 1), abs=1e-12)
    assert np.abs(changed).max() > 0.1


@pytest.mark.parametrize('frequency, passed', [
    (1.0, 1.0), (8.0, 0.5), (16.0, 1.0 / 257.0), (23.0, 1.0 / (1.0 + (23.0 / 8.0) ** 8)),
    (24.0, 0.0), (100.0, 0.0)])
def test_errors_pass_without_a_delay_below_three_times_the_cutoff(frequency: float, passed: float
                                                                  ) -> None:
    nothing = np.zeros((COUNT, 1))
    of_error = plain().update(nothing, wave(frequency), PERIOD)
    of_correction = plain().update(wave(frequency), nothing, PERIOD)
    assert of_error == pytest.approx(GAIN * passed * wave(frequency), abs=1e-6)
    assert of_correction == pytest.approx(passed * wave(frequency), abs=1e-6)


def test_gain_turns_and_mixes_joints_by_frequency() -> None:
    """An L of i f at (0, 1) makes a derivative of the second joint's error the first's change."""
    frequencies = np.linspace(0.1, 450.0, 100)
    gain = np.zeros((100, 2, 2), complex)
    gain[:, 0, 1] = 1j * frequencies
    e = np.hstack([wave(2.0), wave(1.0)])
    changed = LearningFilter(frequencies, gain, CUTOFF, 0.5).update(np.zeros_like(e), e, PERIOD)
    assert changed[:, 0] == pytest.approx(wave(1.0, 0.3 + 0.5 * np.pi)[:, 0], abs=1e-6)
    assert changed[:, 1] == pytest.approx(np.zeros(COUNT), abs=1e-12)


def test_reordered_joints_have_their_own_gain() -> None:
    gain = np.arange(18.0).reshape(2, 3, 3).astype(complex)
    reordered = LearningFilter(np.array([1.0, 2.0]), gain, CUTOFF, 0.5).reordered([2, 0, 1])
    assert reordered.gain[1, 0, 1] == gain[1, 2, 0]
    assert reordered.gain[0, 2, 2] == gain[0, 1, 1]


def test_the_end_of_a_motion_passes_into_its_begin() -> None:
    """A ramp rings where it jumps from its end to its begin, and not with a lead-out."""
    ramp = np.linspace(0.0, 1.0, COUNT)[:, np.newaxis]
    gaps = []
    for lead_out in (0.0, 1.0):
        changed = plain().update(ramp, np.zeros_like(ramp), PERIOD, lead_out)
        assert len(changed) == COUNT
        gaps.append(np.abs(changed - ramp).max())
    assert gaps == pytest.approx([0.5, 0.0065], rel=0.1)
