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

"""The filter (3): exact for its pole, without acceleration, bumpless."""

from ctc_chattering.control.evaluation import error_filter
import numpy as np
from oracles import Array, random_spd
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]


class Running:
    """A filter with its state ξ."""

    def __init__(self, n: int, lambda_: float, b: float, h: float) -> None:
        self.filter, self.xi = error_filter(n, lambda_, b, h), np.zeros(n)

    def output(self, de: Array | list[float]) -> list[float]:
        """Return v."""
        listed: list[float] = self.filter.output(np.array(de), self.xi).tolist()
        return listed

    def update(self, de: Array | list[float], u: Array | list[float]) -> None:
        """Advance by one period."""
        self.xi = self.filter.next_state(self.xi, np.array(de), np.array(u))


def _signals(t: float) -> tuple[Array, Array, Array]:
    """Return e and its two derivatives for three joints."""
    w = np.array([2.0, 5.0, 9.0])
    phase = np.array([0.3, 1.0, -2.0])
    x = w * t + phase
    return np.sin(x) / w, np.cos(x), -w * np.sin(x)


@pytest.mark.parametrize('b', [1.0, 0.4])
def test_three_joints_with_full_gains_against_the_continuous_equation(b: float) -> None:
    """
    Check v against p/(p+λ) with the acceleration, which the filter itself never sees.

    dv/dt + λ v = -b [dde + Kv de + Kp e] is equation (4) times b. The hold makes an error of the
    order of h: it must be small and halve with h.
    """
    rng = np.random.default_rng(1)
    kv, kp, lambda_ = random_spd(rng, 3) * 5.0, random_spd(rng, 3) * 10.0, 3.0

    def field(t: float, v: Array) -> Array:
        e, de, dde = _signals(t)
        return -lambda_ * v - b * (dde + kv @ de + kp @ e)

    exact = solve_ivp(field, (0.0, 2.0), -b * _signals(0.0)[1], method='DOP853', rtol=1e-11,
                      atol=1e-12).y[:, -1]
    errors = []
    for h in (2e-3, 1e-3):
        made = Running(3, lambda_, b, h)
        for k in range(round(2.0 / h)):
            e, de, _ = _signals(k * h)
            made.update(de.tolist(), (kv @ de + kp @ e).tolist())
        errors.append(np.abs(np.array(made.output(_signals(2.0)[1].tolist())) - exact).max())
    assert errors[0] < 0.05 * np.abs(exact).max()
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)


def test_recursion_by_hand() -> None:
    """Check the sampled solution for random inputs against numpy's full-matrix form."""
    rng = np.random.default_rng(7)
    kv, kp = random_spd(rng, 3), random_spd(rng, 3)
    lambda_, b, h = 7.0, 1.3, 0.02
    made, xi = Running(3, lambda_, b, h), np.zeros(3)
    for _ in range(200):
        e, de = rng.normal(size=3), rng.normal(size=3)
        np.testing.assert_allclose(made.output(de.tolist()), xi - b * de, atol=1e-12)
        made.update(de.tolist(), (kv @ de + kp @ e).tolist())
        bracket = b * ((lambda_ * np.eye(3) - kv) @ de - kp @ e)
        xi = np.exp(-lambda_ * h) * xi + (1 - np.exp(-lambda_ * h)) / lambda_ * bracket


def test_slow_pole_keeps_its_digits() -> None:
    """Check (1 - exp(-λ h)) / λ where λ h is far below the float spacing at 1: it is h."""
    made = Running(1, 1e-12, 1.0, 1e-6)
    made.update([0.0], [1.0])
    assert made.output([0.0])[0] == pytest.approx(-1e-6, rel=1e-12)


@pytest.mark.parametrize(('b', 'h'), [(1.0, 1e-3), (2.5, 0.02)])
def test_a_correction_of_the_state(b: float, h: float) -> None:
    """Check that b h times an acceleration undoes in ξ what that does to v over a period."""
    acceleration, made = np.array([3.0, -40.0]), error_filter(2, 5.0, b, h)
    xi, de, u = np.array([0.2, -0.1]), np.array([0.3, 0.2]), np.array([1.0, -2.0])
    corrected = made.next_state(xi, de, u) + b * h * acceleration
    np.testing.assert_allclose(
        made.output(de + h * acceleration, corrected),
        made.output(de, made.next_state(xi, de, u)), atol=1e-13)


@pytest.mark.parametrize('h', [1e-3, 0.02])
def test_nominal_response_is_the_next_output_without_an_error_acceleration(h: float) -> None:
    """Check v of the next sample where dde = -(Kv de + Kp e), by the filter's own recursion."""
    made = error_filter(2, 5.0, 1.7, h)
    xi, de, u = np.array([0.2, -0.1]), np.array([0.3, 0.2]), np.array([1.0, -2.0])
    wanted = made.output(de - h * u, made.next_state(xi, de, u))
    np.testing.assert_allclose(made.nominal_response(made.output(de, xi), u), wanted, atol=1e-14)
