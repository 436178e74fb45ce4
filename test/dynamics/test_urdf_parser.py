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

"""What a URDF says of joints, and what is refused, by name."""

from __future__ import annotations

from math import inf

from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.dynamics.urdf_parser import Mimic, Tree
from ctc_chattering.errors import CtcError
from ctc_chattering.trajectory.joint_limits import read_limits
import pytest
from urdfs import grip, joint, link, PANDA, panda, two_links, UR5, ur5, urdf


def test_real_robots() -> None:
    """Check order, limits of the text, and that fingers that follow or lead are left out."""
    assert Tree(panda()).movable == PANDA
    assert Tree(ur5()).movable == UR5
    joints = Tree(panda()).joints
    assert joints['panda_joint4'].position == (-3.0718, -0.0698)
    assert [joints[name].effort for name in PANDA] == [87.0] * 4 + [12.0] * 3
    assert joints['panda_joint1'].velocity == 2.175
    assert joints['panda_finger_joint2'].mimic == Mimic('panda_finger_joint1', 1.0, 0.0)


def test_limits_that_are_absent_or_zero() -> None:
    """Check inf for no limit, 0, and a continuous joint."""
    joints = Tree(two_links()).joints
    assert (joints['a'].position, joints['a'].velocity, joints['a'].effort) == (
        (-2.0, 3.0), inf, 40.0)
    assert (joints['b'].position, joints['b'].velocity, joints['b'].effort) == (
        (-inf, inf), 1.5, inf)
    assert Tree(two_links('continuous')).joints['a'].position == (-inf, inf)
    bare = urdf([link('x'), link('y'), joint('j', 'prismatic', 'x', 'y', more='')])
    assert Tree(bare).joints['j'].effort == inf
    endless = bare.replace('</joint>', '<limit lower="0" upper="inf" effort="inf"/></joint>')
    assert Tree(endless).joints['j'].position == (0.0, inf)


LIMITED = two_links().replace('<limit effort="0" velocity="1.5"/>', '<limit {}/>{}')


@pytest.mark.parametrize(('limit', 'words'), [
    ('effort="-1" velocity="1"', ['effort is -1', 'Gazebo', 'ros2_control', 'write 0']),
    ('effort="10" velocity="-1"', ['velocity is -1', 'write 0']),
    ('effort="10" velocity="1" acceleration="-2"', ['acceleration is -2', 'negative']),
    ('effort="10" velocity="1" deceleration="-2"', ['deceleration is -2', 'negative']),
    ('lower="1" upper="-1" effort="10" velocity="1"', ['lower is 1', 'upper -1']),
    ('lower="0.5" upper="0.5" effort="10" velocity="1"', ['lower is 0.5', 'upper 0.5']),
    ('lower="0.5" effort="10" velocity="1"', ['lower is 0.5', 'upper 0']),
    ('lower="inf" upper="inf" effort="10" velocity="1"', ['lower is inf', 'upper inf'])])
def test_limits_that_contradict_themselves_are_refused_where_the_joint_is_used(
        limit: str, words: list[str]) -> None:
    """Programs read them in different ways; those of a joint that is locked do not matter."""
    text = LIMITED.format(limit, '')
    for use in (lambda: UrdfModel(text, ['a', 'b']), lambda: read_limits(text, ['b'])):
        with pytest.raises(CtcError) as error:
            use()
        assert [word for word in ['joint b', *words] if word not in str(error.value)] == []
        assert '\n' not in str(error.value)
    assert UrdfModel(text, ['a']).effort_limits == (40.0,)


@pytest.mark.parametrize('name', ['friction', 'damping'])
def test_negative_friction_is_refused_where_the_joint_is_used(name: str) -> None:
    text = LIMITED.format('effort="10" velocity="1"', f'<dynamics {name}="-0.1"/>')
    with pytest.raises(CtcError, match=rf'joint b: {name} is -0\.1'):
        UrdfModel(text, ['a', 'b'])


@pytest.mark.parametrize('limit', ['effort', 'velocity', 'lower', 'upper', 'acceleration'])
def test_a_limit_that_is_no_number_is_refused(limit: str) -> None:
    with pytest.raises(CtcError, match=f"joint b: {limit} is 'nan', not a number"):
        Tree(LIMITED.format(f'{limit}="nan"', ''))


def test_a_bound_that_is_missing_is_0() -> None:
    """URDF says so of lower and upper; without both there is no limit."""
    assert Tree(LIMITED.format('lower="-1"', '')).joints['b'].position == (-1.0, 0.0)
    assert Tree(LIMITED.format('upper="2"', '')).joints['b'].position == (0.0, 2.0)
    assert Tree(LIMITED.format('', '')).joints['b'].position == (-inf, inf)


def test_friction_and_damping() -> None:
    text = LIMITED.format('', '<dynamics friction="0.7" damping="1.5"/>')
    joints = Tree(text).joints
    assert (joints['b'].friction, joints['b'].damping) == (0.7, 1.5)
    assert (joints['a'].friction, joints['a'].damping) == (0.0, 0.0)


def test_a_joint_that_mimics_a_joint_that_mimics_goes_with_both() -> None:
    third = joint('f3', 'prismatic', 'right', 'thumb', more='<mimic joint="f2" multiplier="3"/>')
    tree = Tree(grip().replace('</robot>', f'{link("thumb")}{third}</robot>'))
    assert tree.movable == ('turn',)
    assert tree.locked(['turn'], {'f1': 0.03}) == {
        'f1': 0.03, 'f2': pytest.approx(-0.05), 'f3': pytest.approx(-0.15)}
    with pytest.raises(CtcError, match='f2 mimics f1, which is a joint of the model'):
        tree.locked(['turn', 'f1'], {})


def test_order_is_from_the_root_whatever_the_text_s() -> None:
    parts = [joint('far', 'revolute', 'm', 'tip'), joint('side', 'revolute', 'root', 's'),
             joint('near', 'revolute', 'root', 'm'),
             *(link(x) for x in ('tip', 's', 'm', 'root'))]
    assert Tree(urdf(parts)).movable == ('side', 'near', 'far')


def test_locked_positions() -> None:
    """Check 0, given values, and that a joint that mimics goes with a leader that is locked."""
    tree = Tree(grip())
    assert tree.movable == ('turn',)
    assert tree.locked(['turn'], {}) == {'f1': 0.0, 'f2': 0.01}
    assert tree.locked(['turn'], {'f1': 0.03}) == {'f1': 0.03, 'f2': pytest.approx(-0.05)}
    assert Tree(two_links()).locked(['b', 'a'], {}) == {}


@pytest.mark.parametrize(('chosen', 'positions', 'words'), [
    (['turn', 'f2'], {}, ['f2', 'mimics f1']),
    (['turn', 'f1'], {}, ['f2 mimics f1', 'joint of the model']),
    (['elbow'], {}, ['joint_names', 'elbow', 'movable joints of the URDF: turn']),
    (['turn', 'held'], {}, ['held', 'movable joints of the URDF: turn']),
    (['turn'], {'f2': 0.1}, ['locked', 'f2', 'f1']),
    (['turn'], {'turn': 0.1}, ['locked', 'turn']),
    (['turn'], {'elbow': 0.1}, ['locked', 'elbow']),
    (['turn'], {'f1': inf}, ['locked', 'f1']),
    (['turn'], {'f1': float('nan')}, ['locked', 'f1'])])
def test_wrong_joints(chosen: list[str], positions: dict[str, float], words: list[str]) -> None:
    with pytest.raises(CtcError) as error:
        Tree(grip()).locked(chosen, positions)
    assert [word for word in words if word not in str(error.value)] == []
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(('mimic', 'words'), [
    ('<mimic joint="f2"/>', 'f2 mimics itself'),
    ('<mimic joint="nothing"/>', 'f2 mimics nothing, .* is not movable'),
    ('<mimic joint="f1" multiplier="two"/>', "joint f2: multiplier is 'two'")])
def test_bad_mimics(mimic: str, words: str) -> None:
    with pytest.raises(CtcError, match=words):
        Tree(grip(mimic=mimic)).locked(['turn'], {})


A, B = link('a'), link('b')


@pytest.mark.parametrize(('text', 'words'), [
    ('<robot', ['not XML']), ('', ['not XML']), ('<sdf/>', ['<sdf>', '<robot>']),
    ('<robot name="empty"/>', ['no link']),
    ('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arm/></robot>', ['xacro']),
    (urdf([A, B, joint('j', 'floating', 'a', 'b')]), ["joint j is 'floating'", 'revolute']),
    (urdf([A, B, joint('j', 'hinge', 'a', 'b')]), ['joint j', "'hinge'"]),
    (urdf([A, B, joint('j', 'fixed', 'a', 'b'), joint('k', 'revolute', 'a', 'b')]),
     ['j and k', 'link b', 'closed chain']),
    (urdf([A, B, link('c'), joint('j', 'fixed', 'a', 'b'), joint('k', 'revolute', 'b', 'a')]),
     ['j, k', 'closed chain']),
    (urdf([A, B, link('c'), joint('j', 'revolute', 'a', 'b')]), ['a, c', 'base']),
    (urdf([A, A]), ['two links are named a']),
    (urdf([A, '<link/>']), ['a link is not named']),
    (urdf([A, B, link('c'), joint('j', 'fixed', 'a', 'b'), joint('j', 'fixed', 'a', 'c')]),
     ['two joints are named j']),
    (urdf([A, B, joint('j', 'revolute', 'a', 'z')]), ['child of joint j', 'z', 'no link']),
    (urdf([A, B, '<joint name="j" type="fixed"><parent link="a"/></joint>']),
     ['child of joint j', 'missing']),
    (urdf([A, B, joint('j', 'revolute', 'a', 'b', more='<limit effort="much"/>')]),
     ['joint j: effort', "'much'", 'a number']),
    *((urdf([A, B, f'<joint name="j" type="{kind}"><parent link="a"/><child link="b"/>{more}'
                   '</joint>']), ['joint j', *words]) for kind, more, *words in (
        ('revolute', '<origin xyz="0 0"/>', 'origin xyz', "'0 0'", '3 numbers'),
        ('prismatic', '<axis xyz="up"/>', 'axis', "'up'"))),
    (two_links().replace('value="3.0"', 'value="heavy"'),
     ['inertial of link upper', 'mass value', "'heavy'"]),
    (two_links().replace('value="3.0"', 'value="-3.0"'),
     ['inertial of link upper', 'mass is -3 kg', 'negative']),
    (two_links().replace('ixy="0"', '', 1), ['inertial of link base', 'inertia ixy', "''"]),
    (two_links().replace('<mass value="3.0"/>', ''), ['inertial of link upper has no mass']),
    (two_links().replace('xyz="0 0 -0.3"', 'xyz="0 -0.3"'), ['link upper', 'xyz', '3 numbers'])])
def test_what_is_no_arm(text: str, words: list[str]) -> None:
    """Check one line that names what is wrong."""
    with pytest.raises(CtcError) as error:
        Tree(text)
    assert [word for word in words if word not in str(error.value)] == []
    assert '\n' not in str(error.value)
