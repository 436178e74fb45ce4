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

"""Which joints of a whole robot are its arm."""

from __future__ import annotations

from ctc_chattering.dynamics.serial_chain import chain_to, longest_chain
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import ParameterError
import pytest
from urdfs import grip, mobile_manipulator, PANDA, panda, robot, two_links, UR5, ur5


def test_arms_of_real_robots() -> None:
    """Without wheels, heads, second arms, grippers and hands; with the torso before the arm."""
    assert longest_chain(Tree(panda())) == PANDA
    assert longest_chain(Tree(ur5())) == UR5
    arm = tuple(f'arm_{i}_joint' for i in range(1, 8))
    assert longest_chain(Tree(robot('tiago'))) == ('torso_lift_joint', *arm)
    assert longest_chain(Tree(robot('baxter'))) == tuple(
        f'right_{name}' for name in ('s0', 's1', 'e0', 'e1', 'w0', 'w1', 'w2'))
    assert longest_chain(Tree(robot('icub_reduced')))[:4] == (
        'torso_pitch', 'torso_roll', 'torso_yaw', 'l_shoulder_pitch')


def test_the_arm_of_a_mobile_manipulator() -> None:
    tree = Tree(mobile_manipulator())
    assert longest_chain(tree) == ('lift', 'shoulder', 'elbow', 'wrist')
    assert len(tree.movable) == 10
    assert chain_to(tree, 'hand') == longest_chain(tree)
    assert chain_to(tree, 'finger_2') == (*longest_chain(tree), 'open_2')
    assert chain_to(tree, 'head') == ('lift', 'pan', 'tilt')
    assert chain_to(tree, 'wheel_1') == ('drive_1',)


def test_joints_that_no_model_has_are_left_out() -> None:
    """Those that mimic, their leaders, and those that move no mass."""
    assert longest_chain(Tree(grip())) == ('turn',)
    weightless = mobile_manipulator()
    for mass in ('0.25', '0.05'):  # Of the hand and of its fingers.
        weightless = weightless.replace(f'<mass value="{mass}"/>', '<mass value="0"/>')
    assert chain_to(Tree(weightless), 'hand') == ('lift', 'shoulder', 'elbow')
    assert longest_chain(Tree('<robot name="r"><link name="base"/></robot>')) == ()


@pytest.mark.parametrize(('tip', 'words'), [
    ('hnd', ['links of the URDF: base', 'did you mean hand?']),
    ('base', ['a joint of a model moves'])])
def test_what_is_no_tip(tip: str, words: list[str]) -> None:
    with pytest.raises(ParameterError) as error:
        chain_to(Tree(mobile_manipulator()), tip)
    assert [word for word in (f"tip: '{tip}'", *words) if word not in str(error.value)] == []
    assert chain_to(Tree(two_links()), 'tool') == ('a', 'b')
