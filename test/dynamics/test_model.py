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

"""The base class of models."""

from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.two_link import TwoLink
import numpy as np
from oracles import (
    Array,
    Generic,
    kinetic_energy,
    paper_c,
    paper_g,
    paper_m,
    states,
)
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


def _energy(model: Model, q: Array, dq: Array) -> float:
    return (kinetic_energy(model, q.tolist(), dq.tolist())
            + model.potential_energy(q.tolist()))


def test_power_balance() -> None:
    """Check dE/dt = dqᵀ u along the dynamics by differences: M, C, G and the energies agree."""
    model, h = Generic(), 1e-5
    rng = np.random.default_rng(8)
    for q, dq in states(50, seed=3):
        u = rng.uniform(-50.0, 50.0, 2)
        a = model.forward(*map(np.array, (q, dq, u)))
        after, before = (_energy(model, q + t * np.array(dq) + 0.5 * t * t * a, dq + t * a)
                         for t in (h, -h))
        assert (after - before) / (2 * h) == pytest.approx(u @ dq, abs=1e-4)


def test_base_class_is_abstract() -> None:
    """Check that a model without M, C, G cannot be made."""
    with pytest.raises(TypeError):
        Model()  # type: ignore[abstract]
