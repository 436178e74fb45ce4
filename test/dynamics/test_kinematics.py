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

"""Poses of the links of a URDF, against Pinocchio and by hand."""

from __future__ import annotations

from ctc_chattering.dynamics.kinematics import ForwardKinematics
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError
import numpy as np
import pinocchio as pin
import pytest
from urdfs import grip, PANDA, panda, robot, UR5, ur5

SLIDE = """<robot name="slide"><link name="base"/><link name="car"/><link name="pole"/>
<joint name="rail" type="prismatic"><parent link="base"/><child link="car"/>
<origin xyz="0 0 1"/><axis xyz="0 2 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
</joint>
<joint name="pivot" type="continuous"><parent link="car"/><child link="pole"/>
<origin xyz="0.5 0 0" rpy="0 0 1.5707963267948966"/><axis xyz="1 0 0"/></joint></robot>"""
TIAGO = ('torso_lift_joint', 'arm_2_joint', 'arm_1_joint', 'head_1_joint')


@pytest.mark.parametrize(('text', 'names'), [
    (panda(), PANDA), (ur5(), UR5[::-1]), (robot('tiago'), TIAGO)])
def test_every_link_is_where_pinocchio_has_it(text: str, names: tuple[str, ...]) -> None:
    model = pin.buildModelFromXML(text)
    data = model.createData()
    kinematics = ForwardKinematics(Tree(text), names)
    rng = np.random.default_rng(1)
    for q in rng.uniform(-3.0, 3.0, (5, len(names))):
        positions = pin.neutral(model)
        for name, value in zip(names, q):
            joint = model.joints[model.getJointId(name)]
            # Pinocchio has a continuous joint as cosine and sine.
            values = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
            positions[joint.idx_q:joint.idx_q + joint.nq] = values
        pin.framesForwardKinematics(model, data, positions)
        for frame, pose in zip(kinematics.frames, kinematics.poses(q), strict=True):
            expected = data.oMf[model.getFrameId(frame.link, pin.BODY)]
            assert pose == pytest.approx(expected.homogeneous, abs=1e-12)


def test_links_are_on_the_bodies_of_pinocchio_s_reduced_model() -> None:
    text, locked = panda(), {'panda_joint4': -1.2}
    names = tuple(name for name in PANDA if name not in locked)
    full = pin.buildModelFromXML(text)
    q = pin.neutral(full)
    q[full.joints[full.getJointId('panda_joint4')].idx_q] = -1.2
    model = pin.buildReducedModel(
        full, [i for i in range(1, full.njoints) if full.names[i] not in names], q)
    bodies = ForwardKinematics(Tree(text), names, locked).rigid_bodies()
    for link in Tree(text).links:
        frame = model.frames[model.getFrameId(link, pin.BODY)]
        if frame.parentJoint:
            pose = bodies[names.index(model.names[frame.parentJoint])][link]
            assert pose == pytest.approx(frame.placement.homogeneous, abs=1e-12)
        assert sum(link in body for body in bodies) == (frame.parentJoint > 0)


def test_many_positions_at_once_give_the_poses_of_each() -> None:
    kinematics = ForwardKinematics(Tree(panda()), PANDA)
    q = np.random.default_rng(2).uniform(-2.0, 2.0, (4, 7))
    poses = kinematics.poses(q)
    assert poses.shape == (4, len(kinematics.frames), 4, 4)
    for row, expected in zip(poses, map(kinematics.poses, q)):
        np.testing.assert_allclose(row, expected, rtol=0, atol=1e-14)


def test_prismatic_joints_axes_and_locked_joints() -> None:
    car, pole = ForwardKinematics(Tree(SLIDE), ('rail', 'pivot')).poses((0.25, np.pi / 2))[1:]
    assert car[:3, 3] == pytest.approx([0.0, 0.25, 1.0])  # The axis has length 1.
    assert pole[:3, 3] == pytest.approx([0.5, 0.25, 1.0])
    assert pole[:3, 1] == pytest.approx([0.0, 0.0, 1.0])
    locked = ForwardKinematics(Tree(SLIDE), ('pivot',), {'rail': -0.5})
    assert locked.poses((0.0,))[1][:3, 3] == pytest.approx([0.0, -0.5, 1.0])
    assert [frame.joint_index for frame in locked.frames] == [-1, -1, 0]


def test_a_joint_that_mimics_follows_its_locked_leader() -> None:
    tree = Tree(grip())
    opened, closed = (
        ForwardKinematics(tree, ('turn',), {'f1': x}).poses((0.0,)) for x in (0.03, 0.0))
    moved = np.linalg.norm(opened[:, :3, 3] - closed[:, :3, 3], axis=1)
    assert sorted(moved)[-2:] == pytest.approx([0.03, 0.06])


def test_joints_that_are_not_there_are_refused() -> None:
    with pytest.raises(CtcError, match='movable joints of the URDF'):
        ForwardKinematics(Tree(SLIDE), ('elbow',))
