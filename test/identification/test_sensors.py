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

"""Encoder step, velocity noise and stamps are those that were put in."""

from __future__ import annotations

from ctc_chattering.identification.findings import Gap, Reason, Severity
from ctc_chattering.identification.recording import Recording
from ctc_chattering.identification.sensors import (
    Clock,
    estimate_encoder_step,
    estimate_velocity_noise,
    Positions,
)
from ctc_chattering.identification.windows import moving_threshold
import numpy as np
import pytest
from scipy.signal import lfilter  # type: ignore[import-untyped]

H = 1e-3
T = np.asarray(H * np.arange(10_000), float)


@pytest.mark.parametrize('step', [1e-6, 2.0 * np.pi / 2 ** 17, 1e-3])
def test_the_step_of_an_encoder(step: float) -> None:
    q = step * np.round(np.sin(0.7 * T) / step)
    found = estimate_encoder_step(q)
    assert found.value == pytest.approx(step, rel=1e-6)


def test_a_position_without_steps_has_none() -> None:
    assert estimate_encoder_step(np.sin(0.7 * T)).value is None
    noisy = np.sin(0.7 * T) + np.random.default_rng(0).normal(0.0, 1e-5, len(T))
    assert estimate_encoder_step(noisy).gap == Gap.NO_STEP
    assert estimate_encoder_step(np.zeros(1000)).gap == Gap.HARDLY_MOVES


@pytest.mark.parametrize('lag', [0.0, 0.5e-3, 3e-3])
def test_the_noise_of_a_velocity_that_lags(lag: float) -> None:
    rng = np.random.default_rng(1)
    q = np.sin(3.0 * T)[:, None] + rng.normal(0.0, 1e-6, (len(T), 1))
    dq = 3.0 * np.cos(3.0 * (T - lag))[:, None] + rng.normal(0.0, 2e-3, (len(T), 1))
    (noise,), findings = estimate_velocity_noise(Recording('r', ('a',), T, q, dq), H)
    assert noise.value == pytest.approx(2e-3, rel=0.05)
    # A low-pass of 5 Hz leaves no noise of single samples.
    slow = lfilter([0.03], [1.0, -0.97], dq, axis=0)
    (noise,), more = estimate_velocity_noise(Recording('r', ('a',), T, q, slow), H)
    assert noise.gap == Gap.FILTERED
    assert not findings and not more


def test_a_joint_that_rests_neither_slides_nor_has_a_wrong_velocity() -> None:
    """Smoothing a constant position leaves rounding; an encoder flickers."""
    rng = np.random.default_rng(3)
    flicker = 0.5 + 1e-5 * rng.integers(0, 2, len(T))
    q = np.column_stack((np.sin(T), np.full(len(T), 0.123456789), flicker))
    dq = np.column_stack((np.cos(T), 0.0 * T, 0.0 * T)) + rng.normal(0.0, 1e-3, q.shape)
    _, findings = estimate_velocity_noise(Recording('r', ('a', 'b', 'c'), T, q, dq), H)
    assert findings == []
    slowest = moving_threshold(q, H)
    speed = np.abs(np.gradient(q, H, axis=0))
    assert (speed[:, 0] > slowest[0]).mean() > 0.9
    assert not (np.abs(np.diff(q[:, 1])) / H > slowest[1]).any()


def test_the_stamps() -> None:
    rng = np.random.default_rng(2)
    t = T + rng.normal(0.0, 2e-5, len(T))
    keep = np.r_[0:2000, 2002:5000, 6000:10_000]
    found = Clock.of(Recording('r', ('a',), t[keep], np.zeros((len(keep), 1))), H)
    assert found.period == pytest.approx(H, rel=1e-3)
    assert found.missing == 1002


@pytest.mark.parametrize('factor', [57.3, -1.0, 1.2])
def test_a_velocity_that_does_not_match_its_position_is_refused(factor: float) -> None:
    q = np.sin(3.0 * T)[:, None]
    dq = 3.0 * factor * np.cos(3.0 * T)[:, None]
    (noise,), (finding,) = estimate_velocity_noise(Recording('r', ('a',), T, q, dq), H)
    assert noise.gap == Gap.OTHER_VELOCITY
    assert (finding.reason, finding.severity) == (Reason.VELOCITY, Severity.REFUSED)
    assert finding.values['ratio'] == pytest.approx(factor, rel=0.01)


def test_the_summary_of_positions() -> None:
    q = np.sin(T)[:, None] + np.random.default_rng(1).normal(0.0, 1e-4, (len(T), 1))
    found = Positions.of([Recording('r', ('a',), T, q)], H)
    assert found.ends[:, 0] == pytest.approx([-1.0, 1.0], abs=0.02)
    assert found.noise[0] == pytest.approx(1e-4, rel=0.05)
    assert len(found.poses) >= 20 and found.poses[0, 0] == q[0, 0]
