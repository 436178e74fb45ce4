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

"""The pseudo-inertia of a body, against masses at points."""

from __future__ import annotations

from ctc_chattering.dynamics.pseudo_inertia import (
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


def points(rng: np.random.Generator) -> tuple[Array, Array]:
    """Return masses [kg] and places [m] of a few points."""
    return rng.uniform(0.1, 1.0, 6), rng.normal(0.0, 0.2, (6, 3)) + rng.normal(0.0, 0.3, 3)


@pytest.mark.parametrize('seed', range(3))
def test_masses_at_points_are_a_body(seed: int) -> None:
    """Parameters are sums over the points, in Pinocchio's order, and J is positive definite."""
    masses, places = points(np.random.default_rng(seed))
    body = sum((pin.Inertia(m, r, np.zeros((3, 3))) for m, r in zip(masses, places)),
               start=pin.Inertia.Zero())
    parameters = body.toDynamicParameters()
    matrix = pseudo_inertia(parameters)
    ones = np.column_stack((places, np.ones(6)))
    np.testing.assert_allclose(matrix, np.einsum('k,ki,kj->ij', masses, ones, ones), atol=1e-14)
    np.testing.assert_allclose(parameters_of(matrix), parameters, atol=1e-14)
    np.testing.assert_allclose(symmetric(stacked(matrix)), matrix, atol=1e-14)
    root = unit(parameters, 1.0)
    more = root @ root.T - matrix  # What directions get that have little extent.
    assert np.linalg.eigvalsh(more)[0] > -1e-12 and np.abs(more).max() < 0.02
    assert stacked(matrix) @ stacked(matrix) == pytest.approx(np.square(matrix).sum())


def test_what_no_body_has_is_not_positive() -> None:
    """A moment of inertia above the sum of the others, and a negative mass."""
    assert np.linalg.eigvalsh(pseudo_inertia(np.array(
        [1.0, 0, 0, 0, 1.0, 0, 1.0, 0, 0, 2.1])))[0] < 0.0
    assert np.linalg.eigvalsh(pseudo_inertia(np.array(
        [-1.0, 0, 0, 0, 1.0, 0, 1.0, 0, 0, 1.0])))[0] < 0.0


@pytest.mark.parametrize('parameters', [
    np.zeros(10), np.array([1.0, *[0.0] * 9]), np.array([0.0, 0, 0, 0, 1.0, 0, 1.0, 0, 0, 1.0]),
    np.array([1.0, 0, 0, 0, 0.1, 0, 0.1, 0, 0, 5.0])])
def test_any_model_has_a_unit(parameters: Array) -> None:
    """Bodies without mass or extent, and those that no body can be."""
    root = unit(parameters, 3.0)
    assert np.isfinite(root).all()
    assert np.linalg.cond(root @ root.T) < 1e12
