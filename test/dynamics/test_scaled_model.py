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

"""A model with wrong inertia and gravity, against numpy with the matrices scaled."""

from typing import Any

from ctc_chattering.dynamics.model import Model, Scaled
from ctc_chattering.dynamics.two_link import TwoLink
import numpy as np
from oracles import Generic, paper_c, paper_g, paper_m, states
import pytest

FACTORS = [(0.9, 0.9), (1.3, 0.7), (0.5, 0.0), (1.0, 1.2), (1.1, 1.0)]


@pytest.mark.parametrize(('inertia', 'gravity'), FACTORS)
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


def test_factor_one_is_the_model() -> None:
    """Check the products bit for bit, and the acceleration up to rounding."""
    plain = TwoLink()
    model = Scaled(plain, 1.0, 1.0)
    for (q, dq), (x, _) in zip(states(20), states(20, seed=2)):
        assert [list(row) for row in model.mass_matrix(q)] == [
            list(row) for row in plain.mass_matrix(q)]
        assert list(model.gravity_torque(q)) == list(plain.gravity_torque(q))
        assert list(model.inverse_dynamics(q, dq, x)) == pytest.approx(
            list(plain.inverse_dynamics(q, dq, x)), rel=1e-14)
        np.testing.assert_allclose(
            model.forward(*map(np.array, (q, dq, x))),
            plain.forward(*map(np.array, (q, dq, x))), rtol=1e-9, atol=1e-9)
