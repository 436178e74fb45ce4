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

"""The drives as the controller knows them, against scipy and a quadrature."""

import math

from ctc_chattering.control.observer import drive_model
import numpy as np
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]

H = 1e-3


@pytest.mark.parametrize('lag', [0.2e-3, 2e-3, 30e-3])
@pytest.mark.parametrize('rate', [800.0, 5e3, math.inf])
@pytest.mark.parametrize('command', [0.3, -2.0, 9.0, -400.0])
def test_a_period_against_scipy(lag: float, rate: float, command: float) -> None:
    """Check the end, and what a mass of 1 kg·m² has of velocity and position after a period."""
    def field(_: float, x: list[float]) -> list[float]:
        slope = min(max((command - x[0]) / lag, -rate), rate)
        return [slope, x[0], x[1]]
    start = 1.5
    end, velocity, position = solve_ivp(
        field, (0.0, H), [start, 0.0, 0.0], method='RK45', rtol=1e-10, atol=1e-15,
        max_step=H / 400).y[:, -1]
    with np.errstate(all='ignore'):
        last, mean, weighted = drive_model(np.array([lag]), np.array([rate]), H).response(
            np.array([start]), np.array([command]))
    assert last[0] == pytest.approx(end, rel=1e-6)
    assert mean[0] == pytest.approx(velocity / H, rel=1e-5)
    assert weighted[0] == pytest.approx(2.0 * position / H ** 2, rel=1e-5)


def test_a_drive_without_lag_and_limit_gives_the_command() -> None:
    with np.errstate(all='ignore'):
        drives = drive_model(np.zeros(2), np.full(2, math.inf), H)
        found = drives.response(np.array([1.0, -3.0]), np.array([5.0, 2.0]))
    for value in found:
        np.testing.assert_allclose(value, [5.0, 2.0], rtol=1e-8)
    np.testing.assert_array_equal(drives.command(np.array([1.0, 2.0]), np.array([9.0, 9.0])),
                                  [1.0, 2.0])


def test_a_drive_without_lag_rises_at_its_rate() -> None:
    """Check a ramp of half a period to 2 N·m: the means are 1.5, and 2 times 7/12."""
    found = drive_model(np.zeros(1), np.array([4e3]), H).response(np.zeros(1), np.array([2.0]))
    np.testing.assert_allclose([x[0] for x in found],
                               [2.0, 1.5, 2.0 * 7.0 / 12.0], rtol=1e-7)


def test_the_command_gives_the_wanted_torque() -> None:
    """Check that the torque ends at what is wanted, and that an error decays with the lag."""
    drives = drive_model(np.array([2e-3, 5e-3]), np.full(2, math.inf), H)
    now, after, error = np.array([3.0, -2.0]), np.array([3.4, -2.9]), np.array([0.7, -0.2])
    command = drives.command(now, after)
    with np.errstate(all='ignore'):
        np.testing.assert_allclose(drives.response(now, command)[0], after, rtol=1e-12)
        np.testing.assert_allclose(
            drives.response(now + error, command)[0],
            after + error * np.exp([-0.5, -0.2]), rtol=1e-12)


def test_a_command_beyond_the_reach_is_no_faster() -> None:
    drives = drive_model(np.array([2e-3]), np.array([1e3]), H)
    assert drives.reach[0] == pytest.approx(3.0)
    torque = np.array([4.0])
    within, at, beyond = (
        drives.response(torque, torque + x * drives.reach)[0][0] for x in (0.9, 1.0, 50.0))
    assert within < at - 0.01
    assert at == pytest.approx(5.0)
    assert beyond == pytest.approx(5.0)
