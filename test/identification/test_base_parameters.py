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

"""Combinations of inertial parameters that have a torque, by hand and against the regressor."""

from __future__ import annotations

from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.identification.bodies import (
    base_parameters,
    BaseParameter,
    BodyEstimate,
    consistent,
)
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest
from urdfs import I1, I2, L1, M1, M2, PANDA, panda, R1, R2, TWO_LINKS, two_links


def made(urdf: str, joints: tuple[str, ...], information: Array | None = None
         ) -> tuple[list[BaseParameter], BodyEstimate]:
    """Return the base parameters of a URDF, all of which are known well."""
    model = UrdfModel(urdf, joints)
    n, prior = model.n, model.inertial_parameters().reshape(-1, 10)
    weight = 1e8 * np.eye(11 * n) if information is None else information
    estimate = BodyEstimate(tuple(f'link{i}' for i in range(n)), prior, prior, weight,
                            np.zeros(n), np.zeros(n))
    return base_parameters(consistent(estimate), model, joints), estimate


def test_two_links_by_hand() -> None:
    """Inertia about joint a, first moments, what joint b moves, and its rotor."""
    found, _ = made(two_links(), TWO_LINKS)
    values = {x.terms[0][0]: (x, x.found.value) for x in found}
    assert list(values) == ['Iyy link0', 'mx link0', 'mz link0', 'Iyy link1', 'mx link1',
                            'mz link1', 'rotor b']
    assert dict(values['Iyy link0'][0].terms) == pytest.approx(
        {'Iyy link0': 1.0, 'rotor a': 1.0, 'm link1': L1 ** 2})
    assert values['Iyy link0'][1] == pytest.approx(I1 + M1 * R1 ** 2 + M2 * L1 ** 2)
    assert values['mz link0'][1] == pytest.approx(-M1 * R1 - M2 * L1)
    assert values['Iyy link1'][1] == pytest.approx(I2 + M2 * R2 ** 2)
    assert values['mz link1'][1] == pytest.approx(-M2 * R2)
    assert 'Iyy link0 +0.49 m link1 +1 rotor a' in str(values['Iyy link0'][0])


def test_they_are_all_that_the_torque_has() -> None:
    """43 of the Panda and 5 rotors: with others at 0, they give the torque of any parameters."""
    found, estimate = made(panda(), PANDA)
    assert len(found) == 48
    labels = [f'{key} link{i}' for i in range(7) for key in (
        'm', 'mx', 'my', 'mz', 'Ixx', 'Ixy', 'Iyy', 'Ixz', 'Iyz', 'Izz')]
    model, rng = UrdfModel(panda(), PANDA), np.random.default_rng(3)
    x, base = rng.normal(size=70), np.zeros(70)
    for combination in found:
        terms = [(labels.index(name), factor) for name, factor in combination.terms
                 if not name.startswith('rotor')]
        if terms:
            base[labels.index(combination.terms[0][0])] = sum(f * x[k] for k, f in terms)
    down = np.array([0.0, 0.0, -9.81])
    for q, dq, ddq in rng.normal(size=(5, 3, 7)):
        Y = model.torque_regressor(q, dq, ddq, down)
        np.testing.assert_allclose(Y @ base, Y @ x, atol=1e-4)
    assert sum(x.known for x in found) == pytest.approx(sum(x.found.value or 0.0 for x in found))
    assert estimate.names[0] == 'link0'


def test_what_the_motion_does_not_show_has_no_number() -> None:
    """Information on the first moments of link 2 alone."""
    information = np.zeros((22, 22))
    information[[11, 13], [11, 13]] = 1e8
    found, _ = made(two_links(), TWO_LINKS, information)
    shown = [x for x in found if x.found.value is not None]
    assert [x.terms[0][0] for x in shown] == ['mx link1', 'mz link1']
    assert shown[1].found.half == pytest.approx(1.96e-4, rel=1e-2)
    assert 'this motion does not show it' in str(found[0].found)
    assert found[0].as_mapping()['value'] is None
