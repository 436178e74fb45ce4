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

"""The state after a known delay, against scipy."""

from ctc_chattering.control.evaluation import predict, State
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.two_link import TwoLink
import numpy as np
from oracles import Array, Masses, paper_field, states
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]

TORQUES = ([0.0, 0.0], [150.0, -20.0], [-60.0, 35.0])


def _exact(q: list[float], dq: list[float], tau: list[float], h: float) -> Array:
    end: Array = solve_ivp(paper_field(tau), (0, h), [*q, *dq], method='DOP853', rtol=1e-13,
                           atol=1e-13).y[:, -1]
    return end


def _predicted(model: Model, q: Array, dq: Array, u: Array, h: float) -> tuple[Array, Array]:
    M, C, G = model.evaluate(q, dq)
    zero = np.zeros(2)
    return predict(model, State(
        q, dq, zero, zero, zero, zero, zero, zero, M, C, G, C.dot(dq) + G, zero, zero), u, h)


def _error(q: list[float], dq: list[float], tau: list[float], h: float) -> float:
    made = _predicted(TwoLink(), np.array(q), np.array(dq), np.array(tau), h)
    return float(np.linalg.norm(np.concatenate(made) - _exact(q, dq, tau, h)))


@pytest.mark.parametrize('tau', TORQUES)
def test_one_period_against_scipy(tau: list[float]) -> None:
    """Check random states at 1 kHz: far nearer to the exact state than standing still is."""
    for q, dq in states(10):
        made = np.concatenate(_predicted(
            TwoLink(), np.array(q), np.array(dq), np.array(tau), 1e-3))
        exact = _exact(q, dq, tau, 1e-3)
        np.testing.assert_allclose(made, exact, atol=1e-5)
        assert np.abs(exact - [*q, *dq]).max() > 1e-3


def test_third_order_of_one_period() -> None:
    """Check that the error of one period falls 8-fold when h is halved."""
    ratios = []
    for (q, dq), tau in zip(states(12, seed=3), TORQUES * 4):
        errors = [_error(q, dq, tau, h) for h in (4e-3, 2e-3, 1e-3)]
        ratios += [errors[0] / errors[1], errors[1] / errors[2]]
    assert np.median(ratios) == pytest.approx(8.0, rel=0.03)
    assert min(ratios) > 6.0
    assert max(ratios) < 10.0


def test_constant_acceleration_is_exact() -> None:
    """Check the closed form for two coupled masses, however long the period."""
    mass = np.array([[2.0, 0.7], [0.7, 0.5]])
    q, dq, u = np.array([1.0, -2.0]), np.array([0.3, 0.4]), np.array([3.0, -5.0])
    a = np.linalg.solve(mass, u)
    for h in (1e-3, 2.0):
        made_q, made_dq = _predicted(Masses(mass.tolist()), q, dq, u, h)
        np.testing.assert_allclose(made_q, q + h * dq + h * h / 2 * a, rtol=1e-13)
        np.testing.assert_allclose(made_dq, dq + h * a, rtol=1e-13)
