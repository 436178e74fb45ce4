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

"""The integrated equation of motion, against closed forms and quadrature, and its rows."""

from __future__ import annotations

import tracemalloc

from ctc_chattering.bags.recording import Stretch
from ctc_chattering.dynamics.registry import make_model
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.identification.drives import driven, weak_torque
from ctc_chattering.identification.model_errors import ErrorColumns
from ctc_chattering.identification.weak_form import (
    Dynamics,
    position_noise,
    smooth,
    TestFunction,
    velocity_deviation,
)
from ctc_chattering.identification.windows import Rows
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp  # type: ignore[import-untyped]
from urdfs import TWO_LINKS, two_links

H = 1e-3
PHI = TestFunction(H)
T = H * np.arange(3000)


def test_phi_is_a_mean_with_a_derivative() -> None:
    half = PHI.half * H

    def phi(t: float) -> float:
        return 315.0 / 256.0 / half * (1.0 - (t / half) ** 2) ** 4
    assert PHI.at.sum() == pytest.approx(1.0, abs=1e-9)
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
    wanted = PHI.sums(exact, PHI.at, centres)
    assert found == pytest.approx(wanted, abs=2e-4)
    weight = np.array([model.gravity_torque(x) for x in q.tolist()])
    assert dynamics.weight(PHI, centres) == pytest.approx(
        PHI.sums(weight, PHI.at, centres), abs=1e-5)


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


@pytest.mark.parametrize('lag', [0.0, 2e-4, 3e-3])
def test_the_mean_torque_of_a_lagging_drive_solves_its_equation(lag: float) -> None:
    commands = np.random.default_rng(4).normal(size=40)

    def right(t: float, x: Array) -> Array:
        rate = (commands[min(int(t / H), 39)] - x[0]) / lag
        return np.array([rate, x[0]])
    # At rest before.
    found = driven(np.append(0.0, commands)[:, None], np.array([lag]), np.inf, H)[1:, 0]
    if not lag:
        assert np.array_equal(found, commands)
        return
    state, means = np.zeros(2), []
    for k in range(40):
        before = state[1]
        state = solve_ivp(right, (k * H, (k + 1) * H * (1.0 - 1e-12)), state, rtol=1e-10,
                          atol=1e-13).y[:, -1]
        means.append((state[1] - before) / H)
    assert found == pytest.approx(means, abs=1e-6)


def test_a_delay_shifts_the_torque_and_half_a_sample_is_the_mean() -> None:
    tau = np.random.default_rng(5).normal(size=(500, 1))
    centres = PHI.centres(500, 20)

    def weak(delay: float) -> Array:
        return weak_torque(tau, delay, np.zeros(1), H, PHI, centres)
    shifted = np.roll(tau, 3, axis=0)
    assert weak(3.0) == pytest.approx(
        weak_torque(shifted, 0.0, np.zeros(1), H, PHI, centres), abs=1e-12)
    assert weak(-0.5) == pytest.approx(0.5 * (weak(-1.0) + weak(0.0)), abs=1e-12)
    step = (np.arange(500)[:, None] >= 250).astype(float)
    total = weak_torque(step, 0.0, np.zeros(1), H, PHI, np.array([250]))
    assert total == pytest.approx(0.5)


def test_windows_are_evaluated_in_blocks() -> None:
    """All windows at once would need 70 MB for this, and more with every second."""
    count = 12_000
    t = H * np.arange(count)
    q = np.stack((np.sin(2.0 * t), np.cos(3.0 * t)), axis=1)
    model, phi = make_model('urdf', 9.81, TWO_LINKS, two_links()), TestFunction(H, H * count)
    tracemalloc.start()
    Rows.of(Stretch(0.0, H, q, None, q), model, phi, ErrorColumns.of(model))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 30e6
