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

"""The base class of models, the two-link arm, scaled ones, and the check of any model."""

from __future__ import annotations

from typing import Any

from ctc_chattering.dynamics.model import Model, Scaled
from ctc_chattering.dynamics.two_link import TwoLink
import numpy as np
from oracles import Array, Generic, paper_c, paper_g, paper_m, states
import pytest


@pytest.mark.parametrize('model', [Generic(), TwoLink()])
def test_inverse_dynamics_is_equation_1(model: Model) -> None:
    """Check M a + C dq + G against the paper's matrices, and that forward dynamics undoes it."""
    rng = np.random.default_rng(1)
    for q, dq in states(50):
        a = rng.normal(size=2) * 5.0
        u = model.inverse_dynamics(q, dq, a.tolist())
        expected: Array = paper_m(q) @ a + paper_c(q, dq) @ dq + paper_g(q)
        np.testing.assert_allclose(u, expected, atol=1e-12)
        np.testing.assert_allclose(model.forward(*map(np.array, (q, dq, u))), a, atol=1e-11)


@pytest.mark.parametrize(('inertia', 'gravity'), [(1.3, 0.7), (1.0, 1.2)])
@pytest.mark.parametrize('base', [TwoLink, Generic])
def test_products(inertia: float, gravity: float, base: type[Model]) -> None:
    """Check every term at random states against the paper's matrices times the factors."""
    model = Scaled(base(), inertia, gravity)
    assert model.n == 2
    for (q, dq), (x, a) in zip(states(20), states(20, seed=2)):
        m, c, g = inertia * paper_m(q), inertia * paper_c(q, dq), gravity * paper_g(q)
        pairs: list[tuple[Any, Any]] = [
            (model.mass_matrix(q), m), (model.coriolis_matrix(q, dq), c),
            (model.gravity_torque(q), g),
            *zip(model.evaluate(np.array(q), np.array(dq)), (m, c, g)),
            (model.inverse_dynamics(q, dq, a), m @ a + c @ dq + g),
            (model.forward(*map(np.array, (q, dq, x))), np.linalg.solve(m, x - c @ dq - g))]
        for made, expected in pairs:
            np.testing.assert_allclose(made, expected, rtol=1e-11, atol=1e-10)
