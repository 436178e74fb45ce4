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

"""Payloads at the end of an arm, against a pendulum by hand."""

from __future__ import annotations

from math import cos, pi, sin

from ctc_chattering.dynamics.payload import tip_of, with_payload
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.simulation.plant import make_plant
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
import pytest

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
