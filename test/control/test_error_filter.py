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

"""The filter (3), the level of friction, and the limits of the torque."""

import math

from ctc_chattering.control.adaptation import friction_level, Learned
from ctc_chattering.control.step import error_filter
import numpy as np
from oracles import Array, random_spd
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]


class Running:
    """A filter with its state ξ."""

    def __init__(self, n: int, lambda_: float, b: float, h: float) -> None:
        self.filter, self.xi = error_filter(lambda_, b, h), np.zeros(n)

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
    acceleration, made = np.array([3.0, -40.0]), error_filter(5.0, b, h)
    xi, de, u = np.array([0.2, -0.1]), np.array([0.3, 0.2]), np.array([1.0, -2.0])
    corrected = made.next_state(xi, de, u) + b * h * acceleration
    np.testing.assert_allclose(
        made.output(de + h * acceleration, corrected),
        made.output(de, made.next_state(xi, de, u)), atol=1e-13)


@pytest.mark.parametrize('h', [1e-3, 0.02])
def test_nominal_response_is_the_next_output_without_an_error_acceleration(h: float) -> None:
    """Check v of the next sample where dde = -(Kv de + Kp e), by the filter's own recursion."""
    made = error_filter(5.0, 1.7, h)
    xi, de, u = np.array([0.2, -0.1]), np.array([0.3, 0.2]), np.array([1.0, -2.0])
    wanted = made.output(de - h * u, made.next_state(xi, de, u))
    np.testing.assert_allclose(made.nominal_response(made.output(de, xi), u), wanted, atol=1e-14)


H, BANDWIDTH, BOUND = 1e-3, 100.0, np.array([30.0, 30.0])


def learned(true: Array, start: Array, duration: float = 8.0, viscous: float = 0.0,
            gravity: float = 0.0, motion: float = 0.5, gain: float = 20.0) -> Array:
    """Return K̂ after a sinusoid of 1 Hz with the friction `true`, and disturbances beside it."""
    made, lags = friction_level(gain, BANDWIDTH, H, BOUND), [np.zeros(2)] * 3
    memory = Learned(start, *[np.zeros(2)] * 5)
    follow = 1.0 - math.exp(-BANDWIDTH * H)
    for k in range(round(duration / H)):
        angle = 2.0 * math.pi * k * H
        dq = 2.0 * math.pi * motion * math.cos(angle) * np.ones(2)
        x = (true - memory.level) * np.sign(dq) + viscous * dq + gravity * math.sin(angle)
        for i in range(3):
            lags[i] = lags[i] + follow * (x - lags[i])
            x = lags[i]
        memory = made.learn(memory, dq, x)
    return memory.level


@pytest.mark.parametrize('start', [[0.0, 0.0], [14.0, 1.0]])
def test_the_level_is_found(start: list[float]) -> None:
    true = np.array([9.9, 2.0])
    np.testing.assert_allclose(learned(true, np.array(start)), true, rtol=0.02)


def test_errors_of_the_model_and_viscous_friction_hardly_matter() -> None:
    true = np.array([9.9, 5.0])
    np.testing.assert_allclose(learned(true, np.zeros(2), viscous=0.5, gravity=20.0), true,
                               rtol=0.12)


def test_without_friction_or_motion_or_gain_nothing_is_learned() -> None:
    np.testing.assert_allclose(learned(np.zeros(2), np.zeros(2)), 0.0, atol=1e-9)
    np.testing.assert_array_equal(learned(np.array([9.0, 9.0]), np.ones(2), motion=0.0), 1.0)
    np.testing.assert_array_equal(learned(np.array([9.0, 9.0]), np.ones(2), gain=0.0), 1.0)


def test_the_level_is_bounded() -> None:
    made = friction_level(20.0, BANDWIDTH, H, np.array([3.0, 3.0]))
    memory = Learned(np.array([1.0, 1.0]), *[np.zeros(2)] * 5)
    for k in range(4000):
        sign = 1.0 if k // 500 % 2 else -1.0
        memory = made.learn(memory, np.full(2, sign), sign * np.array([50.0, -50.0]))
        assert (memory.level >= 0.0).all()
        assert (memory.level <= 3.0).all()
    np.testing.assert_allclose(memory.level, [3.0, 0.0])


def test_correction_is_what_the_saturation_error_does_to_v() -> None:
    """Check b h M⁻¹ times the error, and that there is none without it."""
    rng = np.random.default_rng(2)
    mass, error = random_spd(rng, 3), rng.normal(size=3)
    made = error_filter(5.0, 1.3, 1e-3)
    np.testing.assert_array_equal(made.correction(mass, np.zeros(3)), 0.0)
    np.testing.assert_allclose(mass @ made.correction(mass, error), 1.3e-3 * error, rtol=1e-9)
