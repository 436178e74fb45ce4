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

"""The dynamics of a tree of bodies in loops that compile, against numpy and Pinocchio."""

from __future__ import annotations

from ctc_chattering.dynamics import tree
from ctc_chattering.dynamics.compiled_model import arm_of, StateTerms
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest
from urdfs import branching_arm, PANDA, panda

BRANCHES = ('lift', 'other', 'turn', 'shoulder')


def terms_at(q: Array, dq: Array) -> StateTerms:
    n = len(q)
    return StateTerms(0, 0, q, dq, np.zeros((n, n)), np.zeros((n, n)), np.zeros(n))


def test_products_are_those_of_numpy() -> None:
    matrix = np.random.default_rng(1).normal(size=(3, 3))
    x, y, z = matrix
    assert tree.add_product(2.0, x, y) == pytest.approx(2.0 + x @ y)
    assert tree.add_cross(z, x, y) == pytest.approx(z + np.cross(x, y))
    assert tree.add_rows(z, matrix, x) == pytest.approx(z + x @ matrix)
    power = tree.motion_dot_force(tree.Spatial(x, y), tree.Spatial(y, z))
    assert power == pytest.approx(x @ y + y @ z)
    point = [tree.point_inertia(2.0, x, a) for a in range(3)]
    np.testing.assert_allclose(point, 2.0 * (x @ x * np.eye(3) - np.outer(x, x)), atol=1e-14)


def test_newton_and_euler_give_the_sum_of_coriolis_and_gravity() -> None:
    arm = arm_of(UrdfModel(panda(), PANDA))
    assert isinstance(arm, tree.Arm)
    s = tree.BodyScratch(7)
    terms = terms_at(*np.random.default_rng(2).uniform(-2.0, 2.0, (2, 7)))
    s.q, s.dq = terms.q, terms.dq
    tree.set_terms(arm, s, terms)
    tree.set_mass_and_bias(arm, s)
    np.testing.assert_allclose(s.bias, terms.C @ terms.dq + terms.G, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(s.M, terms.M)


def test_joints_that_do_not_carry_each_other_have_0_whatever_the_last_arm_had() -> None:
    s = tree.BodyScratch(4)
    branching = UrdfModel(branching_arm(), BRANCHES, 3.7, {'bent': 0.6})
    terms = terms_at(*np.random.default_rng(6).uniform(-2.0, 2.0, (2, 4)))
    s.q, s.dq = terms.q, terms.dq
    for model in (UrdfModel(panda(), PANDA[:4]), branching):
        arm = arm_of(model)
        assert isinstance(arm, tree.Arm)
        tree.set_terms(arm, s, terms)
        tree.set_mass_and_bias(arm, s)
    M, C, _ = branching.evaluate(terms.q, terms.dq)
    assert M[0, 1] == C[0, 1] == 0.0
    for matrix, expected in ((terms.M, M), (terms.C, C), (s.M, M)):
        np.testing.assert_allclose(matrix, expected, rtol=0, atol=1e-12 * np.abs(M).max())
