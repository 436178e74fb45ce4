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

"""The state as the laws evaluate it, and its prediction, against the paper's arm."""

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.control.sample import evaluate_state, predict_state
from ctc_chattering.control.settings import ControlSettings
from ctc_chattering.dynamics.two_link import TwoLink
import numpy as np
from oracles import Array, paper_c, paper_m
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]

ARM = TwoLink()
SETTINGS = ControlSettings.from_config(ControllerConfig(), ARM.effort_limits)
Q, DQ = np.array([0.4, -1.1]), np.array([2.0, -3.0])
POINTS = np.array([[0.5, -1.0], [2.2, -2.9], [4.0, 1.0]])


def test_the_nominal_torque_gives_the_desired_acceleration() -> None:
    """Check M⁻¹ (N - C dq - G) = ddq_d + Kv de + Kp e with M and C of the paper."""
    state = evaluate_state(SETTINGS, ARM, Q, DQ, POINTS, 0, np.zeros(2))
    u = 50.0 * (POINTS[1] - DQ) + 100.0 * (POINTS[0] - Q)
    np.testing.assert_allclose(state.u, u, rtol=1e-14)
    coriolis = np.array(paper_c(Q.tolist(), DQ.tolist())) @ DQ
    np.testing.assert_allclose(state.bias, coriolis + state.G, rtol=1e-12)
    acceleration = np.linalg.solve(np.array(paper_m(Q.tolist())), state.N - state.bias)
    np.testing.assert_allclose(acceleration, POINTS[2] + u, rtol=1e-12)
    np.testing.assert_array_equal(state.v, -(POINTS[1] - DQ))


def test_the_prediction_is_of_third_order() -> None:
    """Check q and dq against scipy: half the period leaves an eighth of the error."""
    state = evaluate_state(SETTINGS, ARM, Q, DQ, POINTS, 0, np.zeros(2))
    torque = np.array([30.0, -8.0])

    def field(t: float, x: Array) -> Array:
        del t
        return np.concatenate([x[2:], ARM.forward(x[:2], x[2:], torque)])

    errors = []
    for h in (2e-3, 1e-3):
        exact = solve_ivp(field, (0.0, h), np.concatenate([Q, DQ]), rtol=1e-12, atol=1e-14)
        predicted = np.concatenate(predict_state(ARM, state, torque, h))
        errors.append(np.abs(predicted - exact.y[:, -1]).max())
    assert errors[0] / errors[1] == pytest.approx(8.0, rel=0.1)
