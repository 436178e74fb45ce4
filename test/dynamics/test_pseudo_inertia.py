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

"""Pseudo-inertias, against sums over points and Pinocchio."""

from __future__ import annotations

from ctc_chattering.dynamics.pseudo_inertia import (
    is_possible,
    parameters_of,
    pseudo_inertia,
    stacked,
    symmetric,
    unit,
)
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pinocchio as pin
import pytest


def random_body(seed: int) -> Array:
    """Return the parameters of six points with mass."""
    rng = np.random.default_rng(seed)
    masses, points = rng.uniform(0.1, 1.0, 6), rng.normal(0.1, 0.3, (6, 3))
    body = sum((pin.Inertia(m, r, np.zeros((3, 3))) for m, r in zip(masses, points)),
               start=pin.Inertia.Zero())
    return np.asarray(body.toDynamicParameters(), float)


def test_masses_at_points_are_a_body() -> None:
    """Parameters are sums over the points, in Pinocchio's order, and J is positive definite."""
    rng = np.random.default_rng(0)
    masses, points = rng.uniform(0.1, 1.0, 6), rng.normal(0.1, 0.3, (6, 3))
    body = sum((pin.Inertia(m, r, np.zeros((3, 3))) for m, r in zip(masses, points)),
               start=pin.Inertia.Zero())
    parameters = body.toDynamicParameters()
    matrix = pseudo_inertia(parameters)
    ones = np.column_stack((points, np.ones(6)))
    np.testing.assert_allclose(matrix, np.einsum('k,ki,kj->ij', masses, ones, ones), atol=1e-14)
    np.testing.assert_allclose(parameters_of(matrix), parameters, atol=1e-14)


def test_a_body_is_possible_until_a_moment_exceeds_the_sum_of_the_others() -> None:
    about_center = np.array([2.0, 0.0, 0.0, 0.0, 0.3, 0.0, 0.4, 0.0, 0.0, 0.0])
    for zz, possible in ((0.1, True), (0.7, True), (0.71, False), (0.09, False)):
        parameters = about_center.copy()
        parameters[9] = zz
        assert is_possible(pseudo_inertia(parameters)) is possible
    assert not is_possible(pseudo_inertia(np.zeros(10)))
    assert not is_possible(pseudo_inertia(np.full(10, np.nan)))


def test_the_product_of_stacked_elements_is_that_of_the_matrices() -> None:
    first, second = (pseudo_inertia(random_body(seed)) for seed in (1, 2))
    assert stacked(first) @ stacked(second) == pytest.approx(np.trace(first @ second))
    np.testing.assert_allclose(symmetric(stacked(first)), first, rtol=0, atol=1e-15)


def test_a_body_is_the_unit_of_its_own_changes() -> None:
    body = random_body(3)
    root = unit(body, 10.0)
    np.testing.assert_allclose(root @ root.T, pseudo_inertia(body), rtol=0, atol=1e-12)
