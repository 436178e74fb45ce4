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

from ctc_chattering.dynamics.model_check import check_dynamics
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.identification.model_errors import candidates, heavier_links
import numpy as np
import pytest
import urdfs

Q, DQ, DDQ = (0.3, -0.8), (1.1, 0.4), (-0.5, 2.0)


def test_the_links_of_the_papers_arm_make_up_its_weight_and_inertia() -> None:
    """All links heavier by a part are the whole arm heavier by it."""
    model = TwoLink()
    first, second, payload = candidates(model)
    for candidate in (first, second, payload):
        check_dynamics(candidate.model)
    base = np.array(model.inverse_dynamics(Q, DQ, DDQ))
    both = sum(np.array(x.model.inverse_dynamics(Q, DQ, DDQ)) - base for x in (first, second))
    assert both == pytest.approx(base, rel=1e-9)


def test_a_payload_is_a_point_mass_at_the_end() -> None:
    """Its torque is that of a pendulum by differences of the energies."""
    a, b = 0.51 / 0.63, 1.5 * 0.62 / 0.63
    model, heavy = TwoLink(), candidates(TwoLink())[2].model

    def height(q: np.ndarray) -> float:
        return float(-a * np.cos(q[0]) - b * np.cos(q[0] + q[1]))
    q = np.array(Q)
    slope = [(height(q + e) - height(q - e)) / 2e-6 for e in 1e-6 * np.eye(2)]
    weight = np.subtract(heavy.gravity_torque(Q), model.gravity_torque(Q))
    assert weight == pytest.approx(9.81 * np.array(slope), rel=1e-6)
    jacobian = np.array([
        [a * np.cos(Q[0]) + b * np.cos(sum(Q)), b * np.cos(sum(Q))],
        [a * np.sin(Q[0]) + b * np.sin(sum(Q)), b * np.sin(sum(Q))]])
    assert np.subtract(heavy.mass_matrix(Q), model.mass_matrix(Q)) == pytest.approx(
        jacobian.T @ jacobian, rel=1e-9)


@pytest.mark.parametrize(('joints', 'text'), [
    (urdfs.TWO_LINKS, urdfs.two_links()), (urdfs.UR5, urdfs.ur5()),
    (urdfs.PANDA, urdfs.panda())], ids=['two links', 'UR5', 'Panda'])
def test_heavier_links_of_a_urdf_add_up(joints: tuple[str, ...], text: str) -> None:
    model = UrdfModel(text, joints)
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.normal(size=(3, len(joints)))
    base = np.array(model.inverse_dynamics(q, dq, ddq))
    total = sum(np.array(UrdfModel(heavier, joints).inverse_dynamics(q, dq, ddq)) - base
                for _, heavier in heavier_links(text, joints))
    assert total == pytest.approx(base, rel=1e-6, abs=1e-9)


def test_bodies_are_named_after_their_heaviest_link() -> None:
    names = [name for name, _ in heavier_links(urdfs.panda(), urdfs.PANDA)]
    assert names[0] == 'panda_link1'
    assert len(names) == 7


@pytest.mark.parametrize('order', [(0, 1), (1, 0)])
def test_the_payload_of_a_urdf_is_at_the_tip(order: tuple[int, int]) -> None:
    joints = [urdfs.TWO_LINKS[i] for i in order]
    plain = UrdfModel(urdfs.two_links(), joints)
    payload = candidates(plain, urdfs.two_links())[-1]
    assert (payload.name, payload.unit) == ('payload', 'kg')
    q = np.array([0.4, 0.9])[list(order)].tolist()
    more = np.subtract(payload.model.gravity_torque(q), plain.gravity_torque(q))[list(order)]
    # The tool is on the second joint's axis.
    assert abs(more[0]) == pytest.approx(9.81 * urdfs.L1 * np.sin(0.4), rel=1e-6)
    assert more[1] == pytest.approx(0.0, abs=1e-9)
