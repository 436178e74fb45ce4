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

"""Drives with lag and rate limit, against scipy and the equation itself."""

from __future__ import annotations

from math import inf

from ctc_chattering.dynamics.drive_response import discretize_drives, middle_error, response
import numpy as np
from oracles import Array
import pytest
from scipy.integrate import quad, solve_ivp  # type: ignore[import-untyped]

H = 1e-3
DRIVES = [(2e-3, inf), (2e-3, 800.0), (1e-4, 800.0), (5e-3, 200.0), (0.0, 2e3), (0.0, inf)]


def exact(gap: float, lag: float, rate: float, times: Array) -> Array:
    """Return τ - c at times, by integration, or by hand without a lag."""
    if not lag:
        return np.asarray(-np.sign(gap) * np.maximum(abs(gap) - rate * times, 0.0))

    def field(t: float, x: Array) -> Array:
        del t
        return np.clip(-x / lag, -rate, rate)
    found: Array = solve_ivp(field, (0.0, times[-1]), [-gap], t_eval=times, rtol=1e-10, atol=1e-13,
                             max_step=times[-1] / 200.0).y[0]
    return found


@pytest.mark.parametrize(('lag', 'rate'), DRIVES)
@pytest.mark.parametrize('gap', [0.0, -0.4, 3.0])
def test_the_response_solves_the_equation(lag: float, rate: float, gap: float) -> None:
    times = np.linspace(1e-5, H, 2001)
    right = exact(gap, lag, rate, times)
    with np.errstate(all='raise', under='ignore'):
        found = [response(np.array([gap]), np.array([lag]), np.array([rate]), s) for s in times]
    errors, areas = (np.array(x)[:, 0] for x in zip(*found))
    np.testing.assert_allclose(errors, right, atol=2e-7)
    area = np.concatenate([[0.0], 0.5 * np.cumsum((right[1:] + right[:-1]) * np.diff(times))])
    np.testing.assert_allclose(areas - areas[0], area, atol=1e-8)


@pytest.mark.parametrize(('lag', 'rate'), DRIVES)
def test_the_model_of_a_period_has_the_end_and_the_means_of_the_response(
        lag: float, rate: float) -> None:
    """Check joints that are within the rate, and beyond it, side by side."""
    torque, command = np.array([5.0, -1.0, 2.0]), np.array([5.0, -0.8, -4.0])
    lags, rates = np.full(3, lag), np.full(3, rate)
    model = discretize_drives(lags, rates, H)
    found = model.follow(torque, command)
    end, area = response(command - torque, lags, rates, H)
    np.testing.assert_allclose(found.end, command + end, atol=1e-12)
    np.testing.assert_allclose(found.mean, command + area / H, atol=1e-9)
    for i in range(3):
        moment, _ = quad(lambda s: 2.0 / H ** 2 * (H - s) * response(
            command - torque, lags, rates, s)[0][i], 0.0, H, epsabs=1e-13, limit=200)
        assert found.weighted[i] == pytest.approx(command[i] + moment, abs=1e-6)


def test_simpson_s_rule_with_the_middle_has_the_exact_integral() -> None:
    gap, lag, rate = np.array([3.0]), np.array([3e-4]), np.array([5e3])
    start, middle, end = 1e-4, 4e-4, 7e-4
    (a, before), (b, after) = (response(gap, lag, rate, s) for s in (start, end))
    mean = (a + 4.0 * middle_error(gap, lag, rate, middle, 3e-4) + b) / 6.0
    assert mean * (end - start) == pytest.approx(after - before, rel=1e-12)


def test_the_command_gives_the_desired_torque_at_the_end() -> None:
    """And a drive without a lag gets the torque of now."""
    model = discretize_drives(np.array([2e-3, 0.0]), np.full(2, inf), H)
    now, after = np.array([1.0, 1.0]), np.array([1.5, 1.5])
    command = model.command_for(now, after)
    with np.errstate(invalid='ignore'):
        assert model.follow(now, command).end == pytest.approx([1.5, 1.0])
