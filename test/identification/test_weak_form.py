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

"""The integrated equation of motion, against closed forms and quadrature."""

from __future__ import annotations

from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.identification.weak_form import (
    Dynamics,
    position_noise,
    smooth,
    TestFunction,
    velocity_deviation,
)
import numpy as np
import pytest
from scipy.integrate import quad  # type: ignore[import-untyped]

H = 1e-3
PHI = TestFunction(H)
T = H * np.arange(3000)


def test_phi_is_a_mean_with_a_derivative() -> None:
    half = PHI.half * H

    def phi(t: float) -> float:
        return 315.0 / 256.0 / half * (1.0 - (t / half) ** 2) ** 4
    assert PHI.values.sum() == pytest.approx(1.0, abs=1e-9)
    assert PHI.over.sum() == pytest.approx(1.0, abs=1e-12)
    t = H * np.arange(-PHI.half, PHI.half + 1)
    assert PHI.slope / H == pytest.approx(
        [(phi(x + 1e-6) - phi(x - 1e-6)) / 2e-6 for x in t], rel=1e-5, abs=1e-5)
    assert PHI.over[10] == pytest.approx(quad(phi, t[10], t[11])[0], rel=1e-10)


def test_the_weak_form_is_the_mean_of_the_inverse_dynamics() -> None:
    """On a smooth motion; the velocity is that of differences of positions."""
    model = TwoLink()
    q = np.stack((np.sin(3.0 * T), 0.7 * np.cos(2.0 * T + 1.0)), axis=1)
    dq = np.stack((3.0 * np.cos(3.0 * T), -1.4 * np.sin(2.0 * T + 1.0)), axis=1)
    ddq = np.stack((-9.0 * np.sin(3.0 * T), -2.8 * np.cos(2.0 * T + 1.0)), axis=1)
    moved = np.gradient(q, H, axis=0)
    centres = PHI.centres(len(T), 30)
    dynamics = Dynamics.along(q, dq, H, model)
    found = dynamics.weak(moved, PHI, centres)
    exact = np.array([model.inverse_dynamics(*rows) for rows in zip(q, dq, ddq)])
    wanted = PHI.sums(exact, PHI.values, centres)
    assert found == pytest.approx(wanted, abs=2e-4)
    weight = np.array([model.gravity_torque(x) for x in q.tolist()])
    assert dynamics.weight() == pytest.approx(weight, abs=1e-5)
    assert dynamics.torque(ddq) == pytest.approx(exact, abs=1e-3)


def test_smoothed_is_exact_for_cubics() -> None:
    t = T[:200, None] - 0.1
    q = np.hstack((t ** 3 - t, 2.0 * t ** 2 + 1.0))
    wanted = (q, np.hstack((3.0 * t ** 2 - 1.0, 4.0 * t)), np.hstack((6.0 * t, 0.0 * t + 4.0)))
    for order, exact in enumerate(wanted):
        assert smooth(q, H, order) == pytest.approx(exact, abs=1e-7)


def test_noise_of_positions_and_what_it_makes_of_velocities() -> None:
    rng = np.random.default_rng(3)
    noise = rng.normal(0.0, (1e-5, 3e-4), (20_000, 2))
    t = H * np.arange(len(noise))[:, None]
    assert position_noise(np.sin(2.0 * t) + noise, H) == pytest.approx([1e-5, 3e-4], rel=0.03)
    assert smooth(noise, H, 1).std(axis=0) == pytest.approx(
        velocity_deviation(H) * np.array([1e-5, 3e-4]), rel=0.03)


def test_a_long_recording_has_no_more_windows() -> None:
    long = TestFunction(H, 600.0)
    assert len(long.centres(600_000, 10)) <= 3100
    assert TestFunction(H, 60.0).step == PHI.step
