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

"""PID on a Kalman velocity: gains against brute force and closed forms, the lead, the torque."""

from __future__ import annotations

from math import sqrt
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.control.laws.pid_kalman import kalman_gains
from ctc_chattering.errors import CtcError
from laws import error, run
import numpy as np
import pytest

A = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
G, C = np.array([1.0 / 6.0, 0.5, 1.0]), np.array([1.0, 0.0, 0.0])
W = 150.0


@pytest.mark.parametrize('bandwidth', [0.1, 0.5, 2.0])
def test_the_gains_are_those_of_the_filter_after_many_samples(bandwidth: float) -> None:
    """Check against the covariance, sample by sample, from a large one on."""
    variance = 1e3 * np.eye(3)
    for _ in range(400):
        gain = variance @ C / (C @ variance @ C + 1.0)
        variance = A @ (variance - np.outer(gain, C @ variance)) @ A.T + (
            bandwidth ** 6 * np.outer(G, G))
    np.testing.assert_allclose(kalman_gains(bandwidth), gain, rtol=1e-8)


def test_for_fast_sampling_it_is_a_butterworth_filter() -> None:
    """Check the poles of the error: -ω and ω exp(±2πi/3)."""
    x = 0.01
    poles = np.linalg.eigvals(A - np.outer(A @ kalman_gains(x), C))
    right = np.array([-1.0, complex(-0.5, -0.5 * sqrt(3.0)), complex(-0.5, 0.5 * sqrt(3.0))])
    np.testing.assert_allclose(
        np.sort_complex(np.log(poles) / x), np.sort_complex(right), atol=0.01)


def test_the_velocity_of_a_constant_acceleration_has_no_lag() -> None:
    """Check dq̂ from rest at a wrong velocity, by the torque of the damping."""
    law = Controller(ControllerConfig(law='pid_kalman', kp=(1e-6,) * 2, estimator_bandwidth=W,
                                      ki=(0.0,) * 2))
    rest = [0.0, 0.0]
    for k in range(300):
        t = 1e-3 * k
        sample = law.step([1.5 * t * t, 0.0], rest, rest, rest, rest)
    assert law.memories.law.dq[0] == pytest.approx(3.0 * (t + 1e-3), rel=1e-6)
    assert np.isfinite(sample.tau).all()


def test_behind_a_lag_the_lead_keeps_stable_what_diverges_without() -> None:
    """Check drives of 0.1 s: s² (1 + a T s) + Kv s + Kp is stable for a T < Kv / Kp = 40 ms."""
    lag = [0.1] * 2
    values: dict[str, Any] = {
        'plant': {'actuator_lag': lag}, 'actuator_lag': lag, 'kp': [2500.0] * 2,
        'kv': [100.0] * 2, 'estimator_bandwidth': 600.0, 'ki': [0.0] * 2}
    assert (error(run('pid_kalman', 1.5, 0.0, lead_ratio=0.1, **values), 0.2) < 1e-3).all()
    try:
        plain = error(run('pid_kalman', 1.5, 0.0, lead_ratio=1.0, **values), 0.2)
    except CtcError:
        return
    assert (plain > 0.1).any()


def test_the_integral_does_not_wind_up() -> None:
    """Check the error after a second at the limit: without anti-windup it is far larger."""
    values: dict[str, Any] = {
        'kv': [60.0] * 2, 'kp': [1200.0] * 2, 'ki': [8000.0] * 2, 'effort_limit': [60.0, 10.0],
        'estimator_bandwidth': 300.0}
    good, bad = (error(run('pid_kalman', 3.0, 0.0, 0.5, 0.0, anti_windup=on, **values))
                 for on in (True, False))
    assert (good < 0.05 * bad).all()
