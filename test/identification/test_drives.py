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

"""Torque that drives give for commands, against their equations."""

from __future__ import annotations

from ctc_chattering.dynamics.drive_response import response
from ctc_chattering.identification.drives import (
    Drive,
    known_torque,
    mean_drive_torque,
    weak_torque,
)
from ctc_chattering.identification.stretches import COMMAND, Stretch
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]

H = 1e-3
PHI = TestFunction(H)


@pytest.mark.parametrize('lag', [0.0, 2e-4, 3e-3])
def test_the_mean_torque_of_a_lagging_drive_solves_its_equation(lag: float) -> None:
    commands = np.random.default_rng(4).normal(size=40)

    def right(t: float, x: Array) -> Array:
        rate = (commands[min(int(t / H), 39)] - x[0]) / lag
        return np.array([rate, x[0]])
    # At rest before.
    found = mean_drive_torque(np.append(0.0, commands)[:, None], np.array([lag]), np.inf, H)[1:, 0]
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
        return weak_torque(tau, Drive.ideal(1, delay), H, PHI, centres)
    shifted = np.roll(tau, 3, axis=0)
    assert weak(3.0) == pytest.approx(
        weak_torque(shifted, Drive.ideal(1), H, PHI, centres), abs=1e-12)
    assert weak(-0.5) == pytest.approx(0.5 * (weak(-1.0) + weak(0.0)), abs=1e-12)
    step = (np.arange(500)[:, None] >= 250).astype(float)
    total = weak_torque(step, Drive.ideal(1), H, PHI, np.array([250]))
    assert total == pytest.approx(0.5)


@pytest.mark.parametrize(('lag', 'rate'), [(1e-3, 150.0), (0.0, 600.0), (4e-3, 50.0)])
def test_a_rate_limit_is_that_of_the_simulated_drives(lag: float, rate: float) -> None:
    commands = 0.1 * np.random.default_rng(6).normal(size=900).cumsum()
    torque, expected = commands[:1], []
    limits = np.array([lag]), np.array([rate])
    for command in commands:
        with np.errstate(invalid='ignore'):  # Of a drive that has arrived.
            end, area = response(command - torque, *limits, H)
        expected.append(command + area[0] / H)
        torque = command + end
    found = mean_drive_torque(commands[:, None], *limits, H)
    assert found[:, 0] == pytest.approx(expected, abs=1e-9)


def test_windows_that_a_missing_command_reaches_have_no_torque() -> None:
    """Also those that it reaches by the delay alone."""
    values = np.ones((1000, 2))
    values[500, 1] = np.nan
    part = Stretch(0.0, H, np.zeros((1000, 2)), None, values)
    centres = np.arange(200, 800)
    for delay in (0, 7):
        torque = known_torque(part, centres, COMMAND, PHI, Drive.ideal(2, float(delay)))
        assert np.isfinite(torque[:, 0]).all()
        unknown = centres[np.isnan(torque[:, 1])]
        assert unknown[0] <= 500 + delay - PHI.half and unknown[-1] >= 500 + delay + PHI.half
        assert len(unknown) < 2 * PHI.half + 20
