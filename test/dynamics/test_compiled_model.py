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

"""The terms of compiled models, against Pinocchio and the two-link arm."""

from __future__ import annotations

from typing import Any

from ctc_chattering.compiled.records import packed, record_of
from ctc_chattering.dynamics.compiled_model import ARM_FUNCTIONS, arm_of, StateTerms
from ctc_chattering.dynamics.model import Model, Scaled
from ctc_chattering.dynamics.tree import BodyScratch
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
import numpy as np
import pytest
from urdfs import branching_arm, PANDA, panda


def place_of(n: int) -> Any:
    row, square = np.zeros(n), np.zeros((n, n))
    return packed(StateTerms(0, 0, row, row, square, square, row))


def robots() -> dict[str, Model]:
    return {
        'two links': TwoLink(9.81), 'panda': UrdfModel(panda(), PANDA),
        'branching': UrdfModel(branching_arm(), ('lift', 'other', 'turn', 'shoulder'), 3.7,
                               {'bent': 0.6})}


@pytest.mark.parametrize('name', list(robots()))
@pytest.mark.parametrize('scales', [(1.0, 1.0), (0.8, 1.3)])
def test_the_terms_of_the_model(name: str, scales: tuple[float, float]) -> None:
    model = robots()[name]
    scaled = model if scales == (1.0, 1.0) else Scaled(model, *scales)
    n, rng = model.n, np.random.default_rng(5)
    numbers = arm_of(model, *scales)
    set_terms, set_mass_and_bias = ARM_FUNCTIONS[type(numbers)]
    arm = record_of(numbers)
    body, place = record_of(BodyScratch(n)), place_of(n)
    for _ in range(5):
        q, dq = rng.uniform(-2.0, 2.0, (2, n))
        place.q, place.dq = body.q, body.dq = q, dq
        set_terms(arm, body, place)
        right = scaled.evaluate(q, dq)
        for x, y in zip((place.M, place.C, place.G), right):
            np.testing.assert_allclose(x, y, rtol=0, atol=1e-12 * np.abs(y).max())
        set_mass_and_bias(arm, body)
        for x, y in zip((body.M, body.bias), scaled.mass_and_bias(q, dq)):
            np.testing.assert_allclose(x, y, rtol=0, atol=1e-10 * (1.0 + np.abs(y).max()))
