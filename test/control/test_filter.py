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

"""The filter (3) against its continuous equation."""

from ctc_chattering.control.filter import design_filter
import numpy as np
from oracles import Array, random_spd
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]


def _signals(t: float) -> tuple[Array, Array, Array]:
    """Return e and its two derivatives for three joints."""
    w = np.array([2.0, 5.0, 9.0])
    phase = np.array([0.3, 1.0, -2.0])
    x = w * t + phase
    return np.sin(x) / w, np.cos(x), -w * np.sin(x)


def test_three_joints_with_full_gains_against_the_continuous_equation() -> None:
    """
    Check v against p/(p+λ) with the acceleration, which the filter itself never sees.

    dv/dt + λ v = -b [dde + Kv de + Kp e] is equation (4) times b. The hold makes an error of the
    order of h: it must be small and halve with h.
    """
    rng = np.random.default_rng(1)
    kv, kp, lambda_, b = random_spd(rng, 3) * 5.0, random_spd(rng, 3) * 10.0, 3.0, 0.4

    def field(t: float, v: Array) -> Array:
        e, de, dde = _signals(t)
        return -lambda_ * v - b * (dde + kv @ de + kp @ e)

    exact = solve_ivp(field, (0.0, 2.0), -b * _signals(0.0)[1], method='DOP853', rtol=1e-11,
                      atol=1e-12).y[:, -1]
    errors = []
    for h in (2e-3, 1e-3):
        error_filter, xi = design_filter(lambda_, b, h), np.zeros(3)
        for k in range(round(2.0 / h)):
            e, de, _ = _signals(k * h)
            xi = error_filter.next_state(xi, de, kv @ de + kp @ e)
        errors.append(np.abs(error_filter.output(_signals(2.0)[1], xi) - exact).max())
    assert errors[0] < 0.05 * np.abs(exact).max()
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)
