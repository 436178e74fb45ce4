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

"""Models as compiled code has them, against Pinocchio, and with a payload at the end."""

from __future__ import annotations

from math import cos, pi, sin
from typing import Any

from ctc_chattering.compiled.records import packed, record_of
from ctc_chattering.dynamics.compiled_model import arm_of, set_mass_and_bias, set_terms, StateTerms
from ctc_chattering.dynamics.model import Model, Scaled
from ctc_chattering.dynamics.payload import tip_of, with_payload
from ctc_chattering.dynamics.tree import body_scratch
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.simulation.plant import make_plant
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
import pytest
from urdfs import joint, link, PANDA, panda, urdf


def branching() -> str:
    """Return a robot with two arms, a slide, skew axes, a fixed joint and one to be locked."""
    skew = '0.6 0 0.8'
    return urdf([
        link('base', 9.0, inertia=(1.0, 1.0, 1.0)),
        link('trunk', 4.0, (0.1, 0.2, 0.3), (0.3, 0.2, 0.4)),
        link('left', 2.0, (0.0, 0.1, 0.2), (0.05, 0.04, 0.03)),
        link('slide', 1.0, (0.1, 0.0, 0.3), (0.01, 0.02, 0.03)),
        link('right', 1.5, (0.2, -0.1, 0.1), (0.02, 0.03, 0.04)),
        link('tool', 0.7, (0.0, 0.0, 0.2), (0.01, 0.01, 0.02)),
        link('wrist', 0.5, (0.0, 0.05, 0.1), (0.004, 0.005, 0.006)),
        joint('turn', 'continuous', 'base', 'trunk', skew, '0.1 0 0.5', rpy='0.3 0.2 -0.4'),
        joint('shoulder', 'revolute', 'trunk', 'left', '0 1 0', '0 0.2 0.4', rpy='1 0 0.5'),
        joint('lift', 'prismatic', 'left', 'slide', '-0.6 0.8 0', '0 0 0.3', rpy='0 0.7 0',
              more='<dynamics damping="0" rotor_inertia="0.4"/>'),
        joint('other', 'revolute', 'trunk', 'right', '1 0 0', '0 -0.2 0.4', rpy='0.2 0.1 0',
              more='<dynamics damping="0" rotor_inertia="0.2"/>'),
        joint('bent', 'revolute', 'right', 'wrist', '0 0 1', '0 0 0.2', rpy='0.4 0 0'),
        joint('held', 'fixed', 'wrist', 'tool', xyz='0 0 0.1', more='', rpy='0 0.3 0')])


def place_of(n: int) -> Any:
    row, square = np.zeros(n), np.zeros((n, n))
    return packed(StateTerms(0, 0, row, row, square, square, row))


def robots() -> dict[str, Model]:
    return {
        'two links': TwoLink(9.81), 'panda': UrdfModel(panda(), PANDA),
        'branching': UrdfModel(branching(), ('lift', 'other', 'turn', 'shoulder'), 3.7,
                               {'bent': 0.6})}


@pytest.mark.parametrize('name', list(robots()))
@pytest.mark.parametrize('scales', [(1.0, 1.0), (0.8, 1.3)])
def test_the_terms_of_the_model(name: str, scales: tuple[float, float]) -> None:
    model = robots()[name]
    scaled = model if scales == (1.0, 1.0) else Scaled(model, *scales)
    n, rng = model.n, np.random.default_rng(5)
    arm = record_of(arm_of(model, *scales))
    body, place = record_of(body_scratch(n)), place_of(n)
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


def test_an_arm_with_branches_takes_the_place_of_one_without() -> None:
    """Joints that do not carry each other have 0 in M and C, whatever the last arm had."""
    serial = UrdfModel(panda(), PANDA[:4])
    model = robots()['branching']
    n = model.n
    body, place = record_of(body_scratch(n)), place_of(n)
    q, dq = np.random.default_rng(6).uniform(-2.0, 2.0, (2, n))
    for arm in (arm_of(serial), arm_of(model)):
        place.q, place.dq = body.q, body.dq = q, dq
        set_terms(record_of(arm), body, place)
        set_mass_and_bias(record_of(arm), body)
    M, C, _ = model.evaluate(q, dq)
    np.testing.assert_allclose(place.M, M, rtol=0, atol=1e-12 * np.abs(M).max())
    np.testing.assert_allclose(place.C, C, rtol=0, atol=1e-12 * np.abs(C).max())
    np.testing.assert_allclose(body.M, M, rtol=0, atol=1e-12 * np.abs(M).max())


G = 9.81
#: A pendulum of 2 kg whose tool is a metre from the axis, over two fixed joints.
ROD = """
<robot name="rod">
  <link name="base"/>
  <link name="rod"><inertial><origin xyz="0 0 -0.4"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="flange"/><link name="tool"/>
  <joint name="swing" type="continuous"><parent link="base"/><child link="rod"/>
    <axis xyz="0 1 0"/></joint>
  <joint name="a" type="fixed"><origin xyz="0 0 -0.9"/><parent link="rod"/>
    <child link="flange"/></joint>
  <joint name="b" type="fixed"><origin xyz="0 0 -0.1"/><parent link="flange"/>
    <child link="tool"/></joint>
</robot>"""


def test_it_is_a_mass_at_the_tool() -> None:
    plain = UrdfModel(ROD, ['swing'], G)
    loaded = UrdfModel(with_payload(ROD, ['swing'], 3.0), ['swing'], G)
    assert tip_of(Tree(ROD), ['swing']) == 'tool'
    for q in (0.0, 0.7, -2.0):
        more = loaded.mass_matrix([q])[0][0] - plain.mass_matrix([q])[0][0]
        assert more == pytest.approx(3.0 * 1.0 ** 2 + 0.4 * 3.0 * 0.05 ** 2)
        assert loaded.gravity_torque([q])[0] - plain.gravity_torque([q])[0] == pytest.approx(
            3.0 * G * sin(q))


def test_the_plant_moves_with_it() -> None:
    """Check the acceleration from rest at 90 degrees, by the angle after 10 ms."""
    inertia = 2.0 * 0.4 ** 2 + 0.1 + 3.0 + 0.4 * 3.0 * 0.05 ** 2
    weight = G * (2.0 * 0.4 + 3.0)
    robot = make_plant(PlantConfig(
        joint_names=('swing',), model='urdf', payload=3.0, coulomb_friction=(0.0,),
        initial_position=(0.5 * pi,)), ROD)
    for _ in range(10):
        robot.step((0.0,))
    assert robot.dq[0] == pytest.approx(-weight / inertia * 0.01, rel=1e-3)
    assert cos(robot.q[0]) == pytest.approx(0.5 * weight / inertia * 0.01 ** 2, rel=1e-2)
    assert np.isfinite(robot.q).all()


def test_what_cannot_have_one_is_refused() -> None:
    with pytest.raises(ParameterError, match='payload'):
        PlantConfig(payload=1.0)
    with pytest.raises(CtcError, match='<mujoco>, not <robot>'):
        with_payload('<mujoco/>', ['swing'], 1.0)
    with pytest.raises(ParameterError, match='joints of the description'):
        with_payload(ROD, ['elbow'], 1.0)
