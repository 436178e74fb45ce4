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

"""The nearest point of a box against enumeration, scipy, and its optimality conditions."""

from ctc_chattering.numerics.box_qp import nearest
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from oracles import Array, box_by_enumeration, inclusion_by_enumeration, random_spd
import pytest


def _check_conditions(mass: Array, point: Array, bound: Array, z: Array) -> None:
    """Assert the module's conditions, x up to the rounding of its own computation."""
    scale = np.sqrt(mass.diagonal())
    scaled = mass / np.outer(scale, scale)
    x = np.linalg.solve(scaled, (point - z) / scale)
    tolerance = 1e-11 * np.linalg.cond(scaled) * ((np.abs(point) + bound) / scale).max() + 1e-300
    assert (np.abs(z) <= bound).all()
    inner, low, high = np.abs(z) < bound, z <= -bound, z >= bound
    assert (np.abs(x[inner]) <= tolerance).all()
    assert (x[low & ~high] <= tolerance).all()
    assert (x[high & ~low] >= -tolerance).all()


@pytest.mark.parametrize('n', [1, 2, 3, 4])
@pytest.mark.parametrize('decades', [0.5, 4.0])
def test_against_enumeration(n: int, decades: float) -> None:
    """Check all 3^n sets of active bounds, by the quadratic form and by the inclusion for x."""
    rng = np.random.default_rng(20 * n)
    inner = active = 0
    for _ in range(80):
        mass, point = random_spd(rng, n, decades), rng.normal(size=n) * 3.0
        bound = rng.uniform(0.0, 3.0, n) * rng.integers(0, 4, n).clip(0, 1)
        z = nearest(mass, point, bound)
        np.testing.assert_allclose(
            z, inclusion_by_enumeration(mass, point, bound), rtol=1e-8, atol=1e-9)
        inverse: Array = np.linalg.inv(mass).astype(np.float64)
        np.testing.assert_allclose(
            z, box_by_enumeration(inverse, -inverse @ point, bound), rtol=1e-7, atol=1e-9)
        inner += int((np.abs(z) < bound).sum())
        active += int(((np.abs(z) == bound) & (bound > 0)).sum())
    assert inner > 5
    assert active > 5


@settings(max_examples=150)
@given(st.integers(1, 6), st.integers(0, 2 ** 32 - 1), st.floats(0.0, 6.0),
       st.floats(-6.0, 6.0))
def test_optimality_conditions(n: int, seed: int, decades: float, size: float) -> None:
    """Check the conditions, which have one solution, for problems of every scale."""
    rng = np.random.default_rng(seed)
    mass = random_spd(rng, n, decades) * 10.0 ** size
    point = rng.normal(size=n) * 10.0 ** rng.uniform(-3.0, 3.0, n)
    bound = 10.0 ** rng.uniform(-3.0, 3.0, n) * rng.integers(0, 3, n).clip(0, 1)
    _check_conditions(mass, point, bound, nearest(mass, point, bound))


@settings(max_examples=100)
@given(st.lists(st.sampled_from([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0]), min_size=3, max_size=3),
       st.lists(st.sampled_from([0.0, 0.5, 1.0, 2.0]), min_size=3, max_size=3),
       st.sampled_from([-0.5, 0.0, 0.5, 0.9]))
def test_degenerate_problems(point: list[float], bound: list[float], c: float) -> None:
    """Check ties: x = 0 on a bound, bounds of 0, points on the bound."""
    mass = np.array([[2.0, c, 0.0], [c, 2.0, c], [0.0, c, 2.0]])
    z = nearest(mass, np.array(point), np.array(bound))
    _check_conditions(mass, np.array(point), np.array(bound), z)
    np.testing.assert_allclose(
        z, inclusion_by_enumeration(mass, np.array(point), np.array(bound)), atol=1e-12)


def test_a_point_at_the_end_of_the_numbers_gives_a_corner() -> None:
    """Check that what would overflow in M⁻¹ leaves the box as little as any other."""
    for point in ([1e308, -1e308], [np.inf, -1.0e300], [np.inf, -np.inf]):
        z = nearest(np.array([[9.79, 1.27], [1.27, 0.62]]), np.array(point), np.array([10.0, 4.0]))
        assert z.tolist() == [10.0, -4.0]
