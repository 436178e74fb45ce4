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

"""A model with another mass differs from the model by what that mass alone does."""

from __future__ import annotations

from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.identification.model_errors import candidates, ModelError
import numpy as np
import pytest
import urdfs

Q, DQ, DDQ = np.array(((0.3, -0.8), (1.1, 0.4), (-0.5, 2.0)))


def torque(error: ModelError, still: bool = False) -> np.ndarray:
    """Return what an error changes the torque of the paper's arm by."""
    none = np.zeros(2)
    dq, ddq = (none, none) if still else (DQ, DDQ)
    down = np.array((0.0, 0.0, -9.81))
    return np.asarray(TwoLink().torque_regressor(Q, dq, ddq, down) @ error.change)


def test_the_links_of_the_papers_arm_make_up_its_weight_and_inertia() -> None:
    """All links heavier by a part are the whole arm heavier by it."""
    first, second, _ = candidates(TwoLink())
    base = TwoLink().inverse_dynamics(Q.tolist(), DQ.tolist(), DDQ.tolist())
    assert torque(first) + torque(second) == pytest.approx(np.array(base), rel=1e-9)
    assert torque(first)[1] == 0.0 and first.change[4] > 0.0


def test_a_payload_is_a_point_mass_at_the_end() -> None:
    """Its torque is that of a pendulum by differences of the energies."""
    a, b = 0.51 / 0.63, 1.5 * 0.62 / 0.63
    heavy = candidates(TwoLink())[2]

    def height(q: np.ndarray) -> float:
        return float(-a * np.cos(q[0]) - b * np.cos(q[0] + q[1]))
    slope = [(height(Q + e) - height(Q - e)) / 2e-6 for e in 1e-6 * np.eye(2)]
    weight = torque(heavy, still=True)
    assert weight == pytest.approx(9.81 * np.array(slope), rel=1e-6)
    jacobian = np.array([
        [a * np.cos(Q[0]) + b * np.cos(sum(Q)), b * np.cos(sum(Q))],
        [a * np.sin(Q[0]) + b * np.sin(sum(Q)), b * np.sin(sum(Q))]])
    none = np.zeros(2)
    for unit, column in zip(np.eye(2), (jacobian.T @ jacobian).T):
        mass = TwoLink().torque_regressor(Q, none, unit, np.zeros(3)) @ heavy.change
        assert mass == pytest.approx(column, rel=1e-9)


@pytest.mark.parametrize(('joints', 'text'), [
    (urdfs.TWO_LINKS, urdfs.two_links()), (urdfs.UR5, urdfs.ur5()),
    (urdfs.PANDA, urdfs.panda())], ids=['two links', 'UR5', 'Panda'])
def test_heavier_links_of_a_urdf_add_up(joints: tuple[str, ...], text: str) -> None:
    model = UrdfModel(text, joints)
    *links, payload = candidates(model, text)
    assert sum(x.change for x in links) == pytest.approx(model.inertial_parameters())
    assert (payload.name, payload.unit, payload.change[::10].sum()) == (
        'payload', 'kg', pytest.approx(1.0))


def test_bodies_are_named_after_their_heaviest_link() -> None:
    names = [x.name for x in candidates(UrdfModel(urdfs.panda(), urdfs.PANDA), urdfs.panda())]
    assert names[0] == 'panda_link1'
    assert len(names) == 8
