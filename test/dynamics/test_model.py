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


def test_base_class_is_abstract() -> None:
    """Check that a model without M, C, G cannot be made."""
    with pytest.raises(TypeError):
        Model()  # type: ignore[abstract]
