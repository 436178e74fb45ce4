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

from collections.abc import Iterator
import math

from ctc_chattering.control.step import Applied, error_filter, State
from ctc_chattering.control.switching import ImplicitObserver, Perturbation
import numpy as np
from oracles import Array, box_by_enumeration, random_spd
import pytest

H, B = 2e-3, 1.3


def estimates(bandwidth: float, bound: Array, mass: Array, force: Array, rng: np.random.Generator
              ) -> Iterator[Array]:
    """Yield P̂ sample by sample: v⁺ = y - b h M⁻¹ (N - τ + P), with y and N - τ at random."""
    made = ImplicitObserver(bound, error_filter(5.0, B, H), 1.0 - math.exp(-bandwidth * H))
    zero, square = np.zeros(3), np.zeros((3, 3))
    memory = Perturbation(zero, square, zero, zero, 0.0)
    while True:
        nominal, residual = rng.normal(size=3), rng.normal(size=3) * 20.0
        now = State(*(zero,) * 7, v=nominal / made.filter.decay, M=mass, C=mass, G=zero, bias=zero,
                    N=residual, zero=zero)
        memory = made.advanced(memory, now, Applied(0.3 * residual, zero, -0.3 * residual, zero))
        memory = made.updated(memory, now._replace(
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
