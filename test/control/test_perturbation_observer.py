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

"""The estimate of the perturbation, against the sampled dynamics written out in numpy."""

import math

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.control.laws.chattering import Chattering
from ctc_chattering.control.step import Applied, error_filter, State
from ctc_chattering.control.switching import ImplicitObserver, Perturbation
import numpy as np
from oracles import Array, box_by_enumeration, estimate_of, Masses, random_spd
import pytest

H, B = 2e-3, 1.3
REST = [0.0, 0.0, 0.0]
WIDE = [1e6, 1e6, 1e6]


class Running:
    """A switching with its memory."""

    def __init__(self, bandwidth: float, bound: list[float] | None = None) -> None:
        self.switching = ImplicitObserver(
            np.array(bound or WIDE), error_filter(5.0, B, H), 1.0 - math.exp(-bandwidth * H))
        self.memory = Perturbation(np.zeros(3), np.zeros((3, 3)), np.zeros(3), np.zeros(3), 0.0)

    @property
    def estimate(self) -> Array:
        """P̂."""
        return self.memory.perturbation

    def predict(self, mass: Array, nominal: Array, residual: Array, clipping: Array) -> None:
        """Predict the next v, with y = nominal, and N - τ, a part of which is the excess."""
        zero, v = np.zeros(3), nominal / self.switching.filter.decay
        now = State(*(zero,) * 7, v=v, M=mass, C=mass, G=zero, bias=zero, N=residual, zero=zero)
        self.memory = self.switching.advanced(
            self.memory, now, Applied(0.3 * residual, zero, -0.3 * residual, clipping))

    def update(self, v: Array) -> None:
        """Improve P̂."""
        zero = np.zeros(3)
        self.memory = self.switching.updated(self.memory, State(
            *(zero,) * 7, v=v, M=np.eye(3), C=np.eye(3), G=zero, bias=zero, N=zero, zero=zero))


def _sample(made: Running, mass: Array, force: Array, rng: np.random.Generator,
            clipped: list[float] | None = None) -> None:
    """Let one period pass: v⁺ = y - b h M⁻¹ (N - τ + P), with y and N - τ at random."""
    nominal, residual = rng.normal(size=3), rng.normal(size=3) * 20.0
    made.predict(mass, nominal, residual, np.array(clipped or REST))
    made.update(nominal - B * H * np.linalg.solve(mass, residual + force))


@pytest.mark.parametrize('bandwidth', [math.inf, 3000.0, 200.0, 1.0])
def test_constant_perturbation(bandwidth: float) -> None:
    """Check the error exp(-ω h)^k after k samples, which for ω = ∞ is 0 after the first."""
    rng = np.random.default_rng(1)
    mass, force = random_spd(rng, 3), np.array([5.0, -7.0, 0.3])
    made = Running(bandwidth)
    for k in range(1, 30):
        _sample(made, mass, force, rng)
        left = math.exp(-bandwidth * H) ** k
        np.testing.assert_allclose(force - made.estimate, left * force, atol=1e-9)


def test_bound_bites_in_the_metric_of_the_inverse_inertia() -> None:
    """Check min (P̂ - P)ᵀ M⁻¹ (P̂ - P) within ±Ka by enumeration, and that clipping is worse."""
    rng = np.random.default_rng(3)
    bitten = shared = 0
    for _ in range(60):
        mass, force = random_spd(rng, 3), rng.normal(size=3) * 8.0
        bound = rng.uniform(1.0, 15.0, 3)
        made = Running(math.inf, bound.tolist())
        _sample(made, mass, force, rng)
        inverse = np.linalg.inv(mass).astype(np.float64)
        best = box_by_enumeration(inverse, -inverse @ force, bound)
        np.testing.assert_allclose(made.estimate, best, atol=1e-8)
        assert (np.abs(made.estimate) <= bound).all()
        outside = bool((np.abs(force) > bound).any())
        bitten += outside
        miss, clipped = best - force, np.clip(force, -bound, bound) - force
        assert miss @ inverse @ miss <= clipped @ inverse @ clipped + 1e-9
        shared += bool(miss @ inverse @ miss < 0.9 * (clipped @ inverse @ clipped))
        if not outside:
            np.testing.assert_allclose(made.estimate, force, atol=1e-9)
    assert 10 < bitten < 60
    assert shared > 5


@pytest.mark.parametrize(('clipped', 'missed'), [
    ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]), ([1.0, -2.0, 0.5], [0.5, -1.0, 0.25]),
    ([9.999, 0.0, -3.999], [4.9995, 0.0, -1.9995]), ([10.0, -20.0, 1e9], [0.0, 0.0, 0.0]),
    ([10.001, 1.0, 4.0], [0.0, 0.5, 0.0])])
def test_small_clipping_errors_count_half(clipped: list[float], missed: list[float]) -> None:
    """Check what P̂ is short of P for errors below the bounds 10, 20 and 4, at and above them."""
    rng = np.random.default_rng(4)
    mass, force = random_spd(rng, 3), np.array([2.0, -3.0, 1.0])
    made = Running(math.inf, [10.0, 20.0, 4.0])
    _sample(made, mass, force, rng, clipped)
    np.testing.assert_allclose(force - made.estimate, missed, atol=1e-9)
    slow = Running(100.0, [10.0, 20.0, 4.0])
    _sample(slow, mass, force, rng, clipped)
    np.testing.assert_allclose(slow.estimate, (1 - math.exp(-0.2)) * (force - missed), atol=1e-9)


def test_without_a_prediction_nothing_is_updated() -> None:
    """Check that v then says nothing: at the start, after an update, after other gains."""
    rng = np.random.default_rng(5)
    mass, made = random_spd(rng, 3), Running(500.0)
    made.update(np.full(3, 9.0))
    assert list(made.estimate) == REST
    _sample(made, mass, np.array([1.0, 2.0, 3.0]), rng)
    before = list(made.estimate)
    assert min(before) > 0.5
    made.update(np.full(3, 9.0))
    assert list(made.estimate) == before
    law = Chattering.made(ControllerConfig(switching='implicit_observer'), H)
    made.predict(mass, np.ones(3), np.zeros(3), np.zeros(3))
    made.memory = law.reconfigured(made.memory)
    made.update(np.full(3, 9.0))
    assert list(made.estimate) == before


def _loop(limit: float, bandwidth: float, anti_windup: bool = True
          ) -> tuple[list[Array], list[Array], Array]:
    """
    Run the law on two coupled masses under a constant force, in closed form.

    The desired motion has a constant acceleration, so that nothing but the force perturbs.
    """
    mass, force = np.array([[2.0, 0.7], [0.7, 0.5]]), np.array([3.0, -4.0])
    law = Controller(ControllerConfig(
        switching='implicit_observer', control_period=H, b=B, ka=(10.0, 10.0),
        observer_bandwidth=bandwidth, effort_limit=(limit, limit),
        anti_windup=anti_windup), Masses(mass.tolist()))
    q, dq = np.array([0.01, -0.02]), np.array([0.02, 0.0])
    a_d, v, estimate = np.array([1.0, -2.0]), [], []
    for k in range(400):
        t = k * H
        s = law.step(q.tolist(), dq.tolist(), (a_d * t * t / 2).tolist(), (a_d * t).tolist(),
                     a_d.tolist())
        v.append(np.array(s.v))
        estimate.append(np.array(estimate_of(law)))
        a = np.linalg.solve(mass, np.array(s.tau) - force)
        q, dq = q + H * dq + H * H / 2 * a, dq + H * a
    return v, estimate, force


def test_in_the_loop_v_returns_to_zero_after_one_sample() -> None:
    """Check the docstring's dynamics in a loop: P̂ = P at once, and v = 0 a sample later."""
    v, estimate, force = _loop(math.inf, math.inf)
    assert np.abs(v[0]).max() > 0.01
    assert np.abs(v[1]).max() > 1e-4
    first = next(k for k, x in enumerate(v) if np.abs(x).max() < 1e-9)
    assert first <= 12  # v(0) and Ka allow that many; then nothing disturbs it again
    assert max(np.abs(x).max() for x in v[first:]) < 1e-9
    np.testing.assert_allclose(estimate[first:], [force] * (400 - first), atol=1e-7)
    slow, _, _ = _loop(math.inf, 20.0)
    assert np.abs(slow[first]).max() > 1e-3
    assert np.abs(slow[-1]).max() < 1e-7


@pytest.mark.parametrize('anti_windup', [False, True])
def test_a_limited_torque_does_not_wind_the_estimate_up(anti_windup: bool) -> None:
    """Check P̂ = P, with either v, while the effort limit bites at every sample."""
    v, estimate, force = _loop(1.5, math.inf, anti_windup)
    assert np.abs(np.array(estimate[-100:]) - force).max() < 1e-6
    if anti_windup:
        assert np.abs(np.array(v[-100:])).max() < 1e-9
    else:
        assert np.abs(v[-1]).max() > 0.05
