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

"""Where the bodies of an arm are, against Pinocchio and by hand."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

from ctc_chattering.configuration.package_share import read_description
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.live.page import drawn
from ctc_chattering.live.skeleton import quaternion, skeleton_of, two_link_urdf, urdf_skeleton
import numpy as np
import pinocchio as pin
import pytest

#: Of both links of the paper's arm [m].
LENGTH = 0.51 / 0.63
PANDA = 'package://example-robot-data/robots/panda_description/urdf/panda.urdf'
SLIDE = """<robot name="slide"><link name="base"/><link name="car"/><link name="pole"/>
<joint name="rail" type="prismatic"><parent link="base"/><child link="car"/>
<origin xyz="0 0 1"/><axis xyz="0 2 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
</joint>
<joint name="pivot" type="continuous"><parent link="car"/><child link="pole"/>
<origin xyz="0.5 0 0" rpy="0 0 1.5707963267948966"/><axis xyz="1 0 0"/></joint></robot>"""


def test_every_body_is_where_pinocchio_has_it() -> None:
    urdf = read_description(PANDA)
    model = pin.buildModelFromXML(urdf)
    data = model.createData()
    names = [x for x in model.names if x != 'universe' and 'finger' not in x]
    skeleton = urdf_skeleton(urdf, names)
    rng = np.random.default_rng(1)
    for _ in range(5):
        q = np.zeros(model.nq)
        q[:len(names)] = rng.uniform(-3.0, 3.0, len(names))
        pin.framesForwardKinematics(model, data, q)
        for body, pose in zip(skeleton.bodies, skeleton.poses(q)):
            frame = data.oMf[model.getFrameId(body.name, pin.BODY)]
            assert pose == pytest.approx(frame.homogeneous, abs=1e-12)
            w, x, y, z = quaternion(pose[:3, :3])
            assert pin.Quaternion(w, x, y, z).matrix() == pytest.approx(
                pose[:3, :3], abs=1e-12)


def test_two_links_stand_where_their_angles_say() -> None:
    """Check the model's: q = 0 hangs, both angles turn the same way, in the x-z plane."""
    skeleton = skeleton_of(ControllerConfig())
    assert skeleton is not None
    q1, q2 = 0.7, 0.4
    elbow = skeleton.tips((q1, q2))[2]
    assert elbow == pytest.approx([LENGTH * np.sin(q1), 0.0, -LENGTH * np.cos(q1)])
    end = skeleton.poses((q1, q2))[2] @ [0.0, 0.0, -LENGTH, 1.0]
    assert end[:3] - elbow == pytest.approx(
        [LENGTH * np.sin(q1 + q2), 0.0, -LENGTH * np.cos(q1 + q2)])


def test_prismatic_joints_axes_and_locked_joints() -> None:
    car, pole = urdf_skeleton(SLIDE, ('rail', 'pivot')).poses((0.25, np.pi / 2))[1:]
    assert car[:3, 3] == pytest.approx([0.0, 0.25, 1.0])  # the axis has length 1
    assert pole[:3, 3] == pytest.approx([0.5, 0.25, 1.0])
    assert pole[:3, 1] == pytest.approx([0.0, 0.0, 1.0])
    locked = urdf_skeleton(SLIDE, ('pivot',), {'rail': -0.5})
    assert locked.poses((0.0,))[1][:3, 3] == pytest.approx([0.0, -0.5, 1.0])
    assert locked.bodies[1].joint == -1


def test_a_model_without_description_has_no_shape() -> None:
    config = ControllerConfig(model='urdf')
    assert skeleton_of(config) is None
    assert skeleton_of(config, '<mujoco/>') is None
    with pytest.raises(CtcError):
        skeleton_of(config, '<robot/>')


def test_meshes_are_those_for_collisions_where_the_others_cannot_be_read() -> None:
    urdf = read_description(PANDA)
    names = [f'panda_joint{i}' for i in range(1, 8)]
    found = drawn(urdf_skeleton(urdf, names))
    assert sum(len(x.faces) for body in found for x in body) > 1000
    gone = drawn(urdf_skeleton(urdf.replace('package://example-robot-data', 'package://no-such'),
                               names))
    # Capsules stand for them: none is longer than the arm's longest link.
    corners = np.vstack([x.vertices for body in gone for x in body])
    assert 0 < np.abs(corners).max() < 0.5
    assert len([x for x in gone if x]) >= 7


def test_capsules_reach_from_joint_to_joint() -> None:
    """Check with an arm that has no shapes at all."""
    urdf = re.sub('<visual>.*?</visual>', '', two_link_urdf(), flags=re.DOTALL)
    skeleton = urdf_skeleton(urdf, ('joint1', 'joint2'))
    for (triangles,) in drawn(skeleton)[1:]:
        low, high = triangles.vertices.min(axis=0), triangles.vertices.max(axis=0)
        radius = 0.03 * skeleton.reach
        assert low == pytest.approx([-radius, -radius, -LENGTH - radius], abs=2e-3)
        assert high == pytest.approx([radius, radius, radius], abs=2e-3)


@pytest.mark.parametrize('origin', ['xyz', 'rpy', ''])
def test_a_shape_without_its_numbers_is_drawn_as_if_it_were_not_found(origin: str) -> None:
    """Check that the arm has its capsules then, and the page goes on."""
    urdf = re.sub('<visual>.*?</visual>', '', two_link_urdf(), flags=re.DOTALL)
    plain = drawn(urdf_skeleton(urdf, ('joint1', 'joint2')))
    for value in ('0 0', '', 'nan 0 0', 'inf 0 0', '1e308 0 0', 'x y z', '1 2 3 4'):
        shape = (f'<visual><origin {origin}="{value}"/><geometry><sphere radius="1"/></geometry>'
                 if origin else f'<visual><geometry><box size="{value}"/></geometry>')
        bad = drawn(urdf_skeleton(urdf.replace('<inertial>', f'{shape}</visual><inertial>'),
                                  ('joint1', 'joint2')))
        for one, other in zip(plain, bad, strict=True):
            assert [x.vertices.tolist() for x in one] == [x.vertices.tolist() for x in other]


def test_joints_of_the_paper_s_arm_may_have_any_name() -> None:
    names = ('"><x>', 'a & b\'\n"')
    robot = ET.fromstring(two_link_urdf(names))
    assert [x.get('name') for x in robot if x.tag == 'joint'] == [*names]
    assert {x.tag for x in robot} == {'link', 'joint'}
