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

"""The terms of an arm with elastic joints, by hand."""

from __future__ import annotations

from math import inf

from ctc_chattering.dynamics.elastic_model import Elastic
from ctc_chattering.dynamics.two_link import TwoLink
import numpy as np
from oracles import Masses, paper_c, paper_g, paper_m
import pytest


def test_only_the_second_joint_has_a_spring() -> None:
    """Check M, C and G of (q1, q2, θ2)."""
    model = Elastic(TwoLink(), (inf, 300.0), (0.0, 4.0), (0.0, 0.1))
    q, dq = [0.3, -0.4, -0.2], [1.0, 2.0, -1.0]
    M, C, G = (np.array(x) for x in (
        model.mass_matrix(q), model.coriolis_matrix(q, dq), model.gravity_torque(q)))
    links = q[:2]
    np.testing.assert_allclose(M[:2, :2], paper_m(links), atol=1e-14)
    assert (M[2, 2], *M[2, :2]) == (0.1, 0.0, 0.0)
    damping = 4.0 * np.array([[0.0, 0.0, 0.0], [0.0, 1.0, -1.0], [0.0, -1.0, 1.0]])
    coriolis = np.zeros((3, 3))
    coriolis[:2, :2] = paper_c(links, dq[:2])
    np.testing.assert_allclose(C, coriolis + damping, atol=1e-13)
    spring = 300.0 * (q[2] - q[1])
    np.testing.assert_allclose(G, [*(paper_g(links) - [0.0, spring]), spring], atol=1e-12)
    assert model.motors == [0, 2]


def test_at_the_start_the_springs_carry_the_weight() -> None:
    model = Elastic(TwoLink(), (500.0, 300.0), (0.0, 0.0), (0.1, 0.1))
    q, dq = model.start([0.5, -0.2], [1.0, 2.0])
    assert q[2:] == pytest.approx(np.array([0.5, -0.2]) + paper_g([0.5, -0.2]) / [500.0, 300.0])
    assert dq == [1.0, 2.0, 1.0, 2.0]
    assert model.gravity_torque(q)[:2] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_the_rate_is_above_that_of_two_masses_and_a_spring() -> None:
    model = Elastic(Masses([[2.0]]), (800.0,), (0.0,), (0.4,))
    assert model.rate([0.0]) == pytest.approx(np.sqrt(800.0 * (1 / 0.4 + 1 / 2.0)))
