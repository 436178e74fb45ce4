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

"""The ways to evaluate the chattering term, and the estimate of the perturbation."""

from collections.abc import Iterator
import math
from typing import Any

from ctc_chattering.control.filter import design_filter
from ctc_chattering.control.sample import Applied, State
from ctc_chattering.control.switching import (
    BoundaryLayer,
    Implicit,
    ImplicitObserver,
    Perturbation,
    Sign,
)
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from oracles import Array, box_by_enumeration, inclusion_by_enumeration, random_spd
import pytest


def term(made: Any, v: Array, u: Array, mass: Array, compensation: Array,
         estimate: Array | None = None) -> tuple[Array, Array]:
    """Return z and its clipping error."""
    n = len(v)
    zero, square = np.zeros(n), np.zeros((n, n))
    P = zero if estimate is None else estimate
    memory = Perturbation(P, mass, zero, zero, 0.0)
    z, clipping = made.term(memory, State(
        zero, zero, zero, zero, zero, zero, u, v, mass, square, zero, zero, zero, zero),
        compensation)
    return z, clipping


@pytest.mark.parametrize(('made', 'cases'), [
    (Sign(np.array([7.0])), {
        2.0: 7.0, 1e-300: 7.0, 5e-324: 7.0, 0.0: 0.0, -5e-324: -7.0, -3.0: -7.0,
        float('inf'): 7.0}),
    (BoundaryLayer(np.array([7.0]), 0.05), {
        0.0: 0.0, 0.01: 1.4, -0.025: -3.5, 0.05: 7.0, -0.0501: -7.0, 1e9: 7.0,
        -float('inf'): -7.0})])
def test_every_case_of_one_joint(made: Any, cases: dict[float, float]) -> None:
    """Check sgn with sgn(0) = 0, no dead band, and sat(v / 0.05)."""
    for v, expected in cases.items():
        z, _ = term(made, np.array([v]), np.zeros(1), np.eye(1), np.zeros(1))
        assert z == pytest.approx([expected], rel=1e-12, abs=0.0)


def _implicit(mass: Array, wanted: Array, ka: Array) -> Array:
    """Return the term without errors, where C v is all that it has to undo."""
    zero = np.zeros(len(ka))
    z, clipping = term(
        Implicit(ka, design_filter(10.0, 1.0, 1e-3)), zero, zero, mass, -wanted)
    assert not clipping.any()
    return z


def _check_inclusion(mass: Array, wanted: Array, ka: Array, z: Array) -> None:
    """Assert for every joint: v⁺ = 0, or z at the bound of its sign; v⁺ up to rounding."""
    v = np.linalg.solve(mass, wanted - z)
    noise = 1e-11 * np.abs(np.linalg.inv(mass)) @ (np.abs(wanted) + ka) * np.linalg.cond(mass)
    assert (np.abs(z) <= ka).all()
    for x, zi, k, small in zip(v, z, ka, noise):
        if abs(zi) < k:
            assert abs(x) <= small
        elif k > 0.0:
            assert x * np.sign(zi) >= -small


@pytest.mark.parametrize('n', [1, 2, 3, 4])
def test_implicit_against_enumeration(n: int) -> None:
    """Check z and its inclusion joint by joint against all 3^n sets of signs; all kinds occur."""
    rng = np.random.default_rng(n)
    rests = slides = 0
    for _ in range(150):
        mass, wanted = random_spd(rng, n, rng.uniform(0.3, 3.0)), rng.normal(size=n) * 15.0
        ka = rng.uniform(0.0, 20.0, n) * (rng.random(n) < 0.85)
        z = _implicit(mass, wanted, ka)
        np.testing.assert_allclose(
            z, inclusion_by_enumeration(mass, wanted, ka), rtol=1e-8, atol=1e-8)
        _check_inclusion(mass, wanted, ka, z)
        rests += int((np.abs(z) < ka).sum())
        slides += int(((np.abs(z) == ka) & (ka > 0.0)).sum())
    assert rests > 50
    assert slides > 50


@settings(max_examples=300)
@given(st.integers(1, 6), st.integers(0, 2 ** 32 - 1), st.floats(0.0, 12.0),
       st.floats(-8.0, 8.0), st.floats(-10.0, 280.0))
def test_implicit_never_exceeds_the_gain(n: int, seed: int, decades: float, size: float,
                                         load: float) -> None:
    """Check |z| <= Ka for inertias of any conditioning, and torques huge and tiny."""
    rng = np.random.default_rng(seed)
    mass = random_spd(rng, n, decades) * 10.0 ** size
    wanted = rng.normal(size=n) * 10.0 ** load
    ka = 10.0 ** rng.uniform(-8.0, 8.0, n) * (rng.random(n) < 0.8)
    z = _implicit(mass, wanted, ka)
    assert (np.abs(z) <= ka).all()
    if load < 10.0 and decades < 4.0:
        _check_inclusion(mass, wanted, ka, z)


@pytest.mark.parametrize('n', [1, 3])
def test_implicit_is_for_v_of_the_next_sample(n: int) -> None:
    """Check M y / (b h) - C v - P̂ - z = M v⁺ / (b h), with y from the filter run ahead."""
    rng, h = np.random.default_rng(n), 2e-3
    filter_, ka, clipped = design_filter(7.0, 1.3, h), np.full(n, 8.0), 0
    observing = ImplicitObserver(ka, filter_, 1.0)
    for _ in range(50):
        mass, v, u, product = (random_spd(rng, n), 0.02 * rng.normal(size=n),
                               rng.normal(size=n), rng.normal(size=n))
        for made, estimate in ((Implicit(ka, filter_), np.zeros(n)),
                               (observing, rng.uniform(-4.0, 4.0, n))):
            z, clipping = term(made, v, u, mass, product, estimate)
            decay = np.exp(-7.0 * h)
            y = decay * v + (1.3 * h - 1.3 * (1.0 - decay) / 7.0) * u
            wanted = mass @ y / (1.3 * h) - product - estimate
            np.testing.assert_allclose(
                z, inclusion_by_enumeration(mass, wanted, ka), rtol=1e-8, atol=1e-8)
            if made is observing:
                np.testing.assert_allclose(clipping, wanted - z, atol=1e-9)
                clipped += bool(clipping.any())
    assert 5 < clipped < 50


H, B = 2e-3, 1.3


def estimates(bandwidth: float, bound: Array, mass: Array, force: Array, rng: np.random.Generator
              ) -> Iterator[Array]:
    """Yield P̂ sample by sample: v⁺ = y - b h M⁻¹ (N - τ + P), with y and N - τ at random."""
    observer = ImplicitObserver(bound, design_filter(5.0, B, H), 1.0 - math.exp(-bandwidth * H))
    zero, square = np.zeros(3), np.zeros((3, 3))
    memory = Perturbation(zero, square, zero, zero, 0.0)
    while True:
        nominal, residual = rng.normal(size=3), rng.normal(size=3) * 20.0
        now = State(*(zero,) * 7, v=nominal / observer.filter.decay, M=mass, C=mass, G=zero,
                    bias=zero, N=residual, zero=zero)
        memory = observer.advanced(
            memory, now, Applied(0.3 * residual, zero, -0.3 * residual, zero))
        memory = observer.updated(memory, now._replace(
            v=nominal - B * H * np.linalg.solve(mass, residual + force)))
        yield memory.perturbation


@pytest.mark.parametrize('bandwidth', [math.inf, 3000.0, 1.0])
def test_constant_perturbation(bandwidth: float) -> None:
    """Check the error exp(-ω h)^k after k samples, which for ω = ∞ is 0 after the first."""
    rng = np.random.default_rng(1)
    mass, force = random_spd(rng, 3), np.array([5.0, -7.0, 0.3])
    for k, found in zip(range(1, 30), estimates(bandwidth, np.full(3, 1e6), mass, force, rng)):
        left = math.exp(-bandwidth * H) ** k
        np.testing.assert_allclose(force - found, left * force, atol=1e-9)


def test_bound_bites_in_the_metric_of_the_inverse_inertia() -> None:
    """Check min (P̂ - P)ᵀ M⁻¹ (P̂ - P) within ±Ka by enumeration, and that clipping is worse."""
    rng = np.random.default_rng(3)
    bitten = shared = 0
    for _ in range(60):
        mass, force = random_spd(rng, 3), rng.normal(size=3) * 8.0
        bound = rng.uniform(1.0, 15.0, 3)
        found = next(estimates(math.inf, bound, mass, force, rng))
        inverse = np.linalg.inv(mass).astype(np.float64)
        best = box_by_enumeration(inverse, -inverse @ force, bound)
        np.testing.assert_allclose(found, best, atol=1e-8)
        assert (np.abs(found) <= bound).all()
        bitten += bool((np.abs(force) > bound).any())
        miss, clipped = best - force, np.clip(force, -bound, bound) - force
        shared += bool(miss @ inverse @ miss < 0.9 * (clipped @ inverse @ clipped))
    assert 10 < bitten < 60
    assert shared > 5
