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

"""ADRC with friction fed forward: poles, the drives it inverts, what it knows of friction."""

from __future__ import annotations

from math import exp
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from laws import error, run
import numpy as np
from oracles import Array, Masses
import pytest

MASS, FORCE, H = np.array([[2.0, 0.7], [0.7, 0.5]]), np.array([3.0, -2.0]), 1e-3
RATE = [5e3, 1e3]


def on_masses(samples: int, lag: float, delay: int, frequency: float = 0.0, **values: Any
              ) -> tuple[Array, Array]:
    """
    Return error and torque of masses under a force and drives with a lag, sample by sample.

    Position and velocity are those of the exact solution over every period; the reference is
    0.1 cos(w t).
    """
    law = Controller(ControllerConfig.from_mapping({
        'law': 'extended_state_observer', 'kp': [3600.0] * 2, 'kv': [120.0] * 2,
        'ka': [50.0] * 2, 'estimator_bandwidth': 200.0, 'actuator_lag': [lag] * 2,
        'input_delay': delay, **values}), Masses(MASS.tolist()))

    def point(k: int) -> tuple[list[float], list[float], list[float]]:
        w = frequency
        x, dx = 0.1 * np.cos(w * H * k), -0.1 * w * np.sin(w * H * k)
        return [x, x], [dx, dx], [-w * w * x] * 2

    q, dq, tau = np.array([0.1, 0.1]), np.zeros(2), np.zeros(2)
    transit, errors, torques = [np.zeros(2)] * delay, [], []
    for k in range(samples):
        ahead = [point(k + 1 + j) for j in range(delay)]
        q_d, dq_d, ddq_d = point(k)
        sample = law.step(q.tolist(), dq.tolist(), q_d, dq_d, ddq_d, ahead)
        errors.append(np.array(q_d) - q)
        transit = [*transit, np.array(sample.tau)]
        command, transit = transit[0], transit[1:]
        E, T = (exp(-H / lag), lag) if lag else (0.0, 0.0)
        first = command * H + (tau - command) * T * (1.0 - E)
        second = command * H * H / 2 + (tau - command) * T * (H - T * (1.0 - E))
        a, b = np.linalg.solve(MASS, np.stack((first - H * FORCE, second - H * H / 2 * FORCE)).T).T
        q, dq, tau = q + H * dq + b, dq + a, command + E * (tau - command)
        torques.append(tau)
    return np.array(errors), np.array(torques)


@pytest.mark.parametrize(('lag', 'delay'), [(0.0, 0), (2e-3, 0), (2e-3, 2)])
def test_a_constant_force_leaves_no_error(lag: float, delay: int) -> None:
    """Check error and torque of the drives at rest."""
    errors, torques = on_masses(400, lag, delay)
    assert np.abs(errors).max() > 1e-5
    np.testing.assert_allclose(errors[-1], 0.0, atol=1e-9)
    np.testing.assert_allclose(torques[-1], FORCE, atol=1e-5)


def test_a_lag_that_is_known_costs_little() -> None:
    """Check 5 Hz behind lag and delay: 0.05 % of the way; not told, it is ten times that."""
    lag = 4e-3
    told, not_told = (on_masses(600, lag, 1, 31.4, actuator_lag=[x] * 2)[0][400:]
                      for x in (lag, 0.0))
    assert np.abs(told).max() < 5e-5
    assert np.abs(not_told).max() > 10.0 * np.abs(told).max()


def test_the_poles_are_those_of_feedback_and_observer() -> None:
    """Check that with an exact model the error decays as (1 + p t) exp(-p t), p = 60 rad/s."""
    errors = on_masses(400, 0.0, 0)[0][300:]
    ratio = np.abs(errors[80:] / errors[:-80]).max(axis=1)
    assert 0.5 * exp(-60.0 * 0.08) < ratio[0] < 3.0 * exp(-60.0 * 0.08)


def test_friction_that_is_known_costs_less() -> None:
    """Check the arm with drives as they are: nothing, all, and all ahead of the reversal."""
    values: dict[str, Any] = {
        'plant': {'torque_rate_limit': RATE, 'actuator_lag': [2e-3] * 2},
        'torque_rate_limit': RATE, 'actuator_lag': [2e-3] * 2, 'kp': [1600.0] * 2,
        'kv': [80.0] * 2, 'ka': [60.0, 30.0], 'friction_velocity': 0.1}
    none, known, ahead = (
        error(run('extended_state_observer', 2.0, friction_level=[f] * 2, friction_lead=t,
                  **values)) for f, t in ((0.0, 0.0), (9.9, 0.0), (9.9, 4e-3)))
    assert (known < 0.5 * none).all()
    assert ahead[1] < 0.5 * known[1]
