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

"""Pinocchio's dynamics of a URDF, against closed forms and against MuJoCo."""

from __future__ import annotations

from math import cos, sin
import random
import re
import sys
import types

from ctc_chattering.dynamics.model import Scaled
from ctc_chattering.dynamics.model_check import check_dynamics
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.plant import make_plant
from ctc_chattering.simulation.plant_config import PlantConfig
from mujoco_plant import MujocoPlant
import numpy as np
from oracles import Array, states
import pytest
from urdfs import I1, I2, joint, L1, link, M1, M2, PANDA, panda, R1, R2, two_links, UR5, ur5, urdf

G = 9.81
K = M2 * L1 * R2


def mutated(text: str, seed: int) -> str:
    """Return a description with a few random changes: numbers, names, elements, characters."""
    dice = random.Random(seed)
    odd = ('', 'nan', 'inf', '1e308', '5e-324', '-1', '0', '0 0 0', '1 2', 'x', 'world',
           'universe', '\u00fc', 'fixed', 'floating', 'planar', 'prismatic', 'continuous')
    for _ in range(dice.choice((1, 1, 2, 4))):
        kind = dice.randrange(8)
        pattern = r'="([^"]*)"' if kind < 5 else r'<(joint|link|inertial)\b.*?</\1>|<\w+[^>]*/>'
        places = list(re.finditer(pattern, text, re.DOTALL))
        if kind == 7 or not places:
            i = dice.randrange(len(text))
            text = text[:i] + dice.choice(('', '<', '"', '&', '\0', '<a/>')) + text[i + 1:]
            continue
        place, other = dice.choice(places), dice.choice(places)
        if kind < 5:  # A value, in the place of which another's comes, or an odd one.
            new = dice.choice((other[1], other[1], dice.choice(odd)))
            text = text[:place.start(1)] + new + text[place.end(1):]
        else:  # An element, which is left out or comes twice.
            text = text[:place.start()] + dice.choice(('', 2 * place[0])) + text[place.end():]
    return text


def chain(count: int) -> str:
    """Return a chain of links; only the first joint moves."""
    return urdf([link('l0'), *(
        part for i in range(count) for part in (
            link(f'l{i + 1}', 1.0, (0, 0, -0.1), (0.1, 0.1, 0.1)),
            joint(f'j{i}', 'fixed' if i else 'revolute', f'l{i}', f'l{i + 1}', '0 1 0')))])


#: Descriptions that would cost a parser its memory, its stack, or minutes.
BOMBS = {
    'entities': '<!DOCTYPE robot [<!ENTITY a "aaaaaaaaaa">' + ''.join(
        f'<!ENTITY {y} "{10 * f"&{x};"}">' for x, y in zip('abcdefgh', 'bcdefghi'))
    + ']><robot name="&i;"/>',
    'size': two_links().replace('</robot>', 10_000_000 * ' ' + '</robot>'),
    'bodies': chain(600)}


def hand_m(q: list[float]) -> Array:
    """Return M of `two_links`, derived by hand."""
    m22 = M2 * R2 ** 2 + I2
    m12 = m22 + K * cos(q[1])
    return np.array([[M1 * R1 ** 2 + I1 + M2 * L1 ** 2 + m22 + 2 * K * cos(q[1]), m12],
                     [m12, m22]])


def hand_c(q: list[float], dq: list[float]) -> Array:
    """Return C of Christoffel's symbols; only M's dependence on q2 contributes."""
    h = -K * sin(q[1])
    return np.array([[h * dq[1], h * (dq[0] + dq[1])], [-h * dq[0], 0.0]])


def hand_g(q: list[float]) -> Array:
    second = M2 * R2 * sin(q[0] + q[1])
    return G * np.array([(M1 * R1 + M2 * L1) * sin(q[0]) + second, second])


def hand_energy(q: list[float]) -> float:
    """Return the potential energy, 0 at the height of the first joint."""
    return -G * ((M1 * R1 + M2 * L1) * cos(q[0]) + M2 * R2 * cos(q[0] + q[1]))


@pytest.mark.parametrize(('kind', 'order'), [
    ('revolute', ('a', 'b')), ('continuous', ('b', 'a'))])
def test_two_links_by_hand(kind: str, order: tuple[str, str]) -> None:
    """Check everything the interface has, in both orders, for both kinds of joint."""
    model = UrdfModel(two_links(kind), order)
    turn = [0, 1] if order == ('a', 'b') else [1, 0]
    rng = np.random.default_rng(1)
    for p, dp in states(50):
        q, dq = [p[i] for i in turn], [dp[i] for i in turn]  # as the model has them
        m, c, g = hand_m(p), hand_c(p, dp), hand_g(p)
        x = rng.normal(size=2)
        given = x[turn].tolist()
        pairs = [
            (np.array(model.mass_matrix(q))[np.ix_(turn, turn)], m),
            (np.array(model.coriolis_matrix(q, dq))[np.ix_(turn, turn)], c),
            (np.array(model.gravity_torque(q))[turn], g),
            (np.array(model.inverse_dynamics(q, dq, given))[turn], m @ x + c @ dp + g),
            (model.forward(*map(np.array, (q, dq, given)))[turn],
             np.linalg.solve(m, x - c @ dp - g)),
            (np.array([model.potential_energy(q)]), np.array([hand_energy(p)]))]
        for made, expected in pairs:
            np.testing.assert_allclose(made, expected, rtol=0, atol=1e-10)


def test_a_rotor_is_on_the_diagonal_of_the_mass_matrix() -> None:
    """Inverse and forward dynamics have it too, and MuJoCo's armature is the same."""
    limit, order = '<limit effort="0" velocity="1.5"/>', ('b', 'a')
    text = two_links().replace(limit, f'{limit}<dynamics damping="0" rotor_inertia="0.3"/>')
    plain, model = UrdfModel(two_links(), order), UrdfModel(text, order)
    rotor = np.diag([0.3 if name == 'b' else 0.0 for name in order])
    for q, _ in states(5):
        np.testing.assert_allclose(
            np.subtract(model.mass_matrix(q), plain.mass_matrix(q)), rotor, atol=1e-12)
    assert all(finding.passed for finding in check_dynamics(model))
    config = PlantConfig(joint_names=order, model='urdf')
    plant = MujocoPlant(config, text)
    assert plant.mjmodel.dof_armature.tolist() == [0.0, 0.3]
    with pytest.raises(CtcError, match='joint b: rotor_inertia is -0'):
        UrdfModel(text.replace('"0.3"', '"-0.3"'), order)


@pytest.mark.parametrize(('kind', 'where'), [('revolute', None), ('continuous', 0.8)])
def test_locked_joint_is_a_fixed_one(kind: str, where: float | None) -> None:
    """Check against the same arm with that joint fixed at that angle in the URDF."""
    angle = where or 0.0
    fixed = two_links().replace(
        f'<joint name="b" type="revolute"><origin xyz="0 0 {-L1}" rpy="0 0 0"/>',
        f'<joint name="b" type="fixed"><origin xyz="0 0 {-L1}" rpy="0 {-angle} 0"/>')
    assert fixed != two_links()
    locked = UrdfModel(two_links(kind), ('a',), locked={'b': where} if where else {})
    by_hand = UrdfModel(fixed, ('a',))
    for q, dq in states(10, n=1):
        np.testing.assert_allclose(locked.mass_matrix(q), by_hand.mass_matrix(q), rtol=1e-12)
        np.testing.assert_allclose(locked.mass_matrix(q), [[hand_m([q[0], angle])[0, 0]]])
        np.testing.assert_allclose(locked.gravity_torque(q), by_hand.gravity_torque(q),
                                   atol=1e-12)
        np.testing.assert_allclose(
            locked.inverse_dynamics(q, dq, [1.0]), by_hand.inverse_dynamics(q, dq, [1.0]))


@pytest.mark.parametrize(('text', 'names'), [(panda(), PANDA), (ur5(), UR5[::-1])])
def test_robots_pass_the_check(text: str, names: tuple[str, ...]) -> None:
    model = UrdfModel(text, names)
    for checked in (model, Scaled(model, 1.3, 0.6)):
        assert [x for x in check_dynamics(checked, samples=10) if not x.passed] == []


def test_massless_links_are_named() -> None:
    """Check a last link without mass, and one between joints with the same axis."""
    def arm(first: str, last: str, axis: str = '0 1 0') -> str:
        return urdf([link('base'), first, last, joint('j', 'revolute', 'base', 'm', '0 1 0'),
                     joint('k', 'revolute', 'm', 'e', axis)])
    heavy = link('e', 1.0, (0.2, 0, 0), (0.1, 0.1, 0.1))
    with pytest.raises(CtcError, match=r'inertia is moved by k \('):
        UrdfModel(arm(link('m', 1.0, (0.2, 0, 0), (0.1, 0.1, 0.1)), link('e')), ('j', 'k'))
    with pytest.raises(CtcError, match=r'inertia is moved by j, k \('):
        UrdfModel(arm(link('m'), heavy), ('j', 'k'))
    with pytest.raises(CtcError, match=r'inertia is moved by k, j \('):
        UrdfModel(arm(link('m'), link('e')), ('k', 'j'))
    assert UrdfModel(arm(link('m'), heavy, '0 0 1'), ('j', 'k')).n == 2
    with pytest.raises(CtcError, match='link m: mass is -1 kg'):
        UrdfModel(arm(link('m', -1.0, (0.2, 0, 0), (0.1, 0.1, 0.1)), heavy), ('j', 'k'))


def test_numbers_with_spaces_or_line_ends_around_them_count() -> None:
    """Python reads them, urdfdom does not: it leaves the whole inertia of the link out."""
    text = two_links().replace('izz="0.01"', 'izz=" 0.01\n"').replace('xyz="0 0', 'xyz="0\n0')
    q, dq, a = [0.3, -0.5], [1.0, 2.0], [0.5, -4.0]
    assert text.count('\n') == 7
    assert UrdfModel(text, ('a', 'b')).inverse_dynamics(q, dq, a) == UrdfModel(
        two_links(), ('a', 'b')).inverse_dynamics(q, dq, a)


def test_without_pinocchio(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check the message, also where another package has the name, and that XML needs none."""
    monkeypatch.setitem(sys.modules, 'pinocchio', None)
    with pytest.raises(CtcError, match=r'pip install pin, or apt install ros-jazzy-pin'):
        UrdfModel(two_links(), ('a', 'b'))
    assert Tree(two_links()).movable == ('a', 'b')
    monkeypatch.setitem(sys.modules, 'pinocchio', types.ModuleType('pinocchio'))
    with pytest.raises(CtcError, match='another package has its name'):
        UrdfModel(two_links(), ('a', 'b'))


@pytest.mark.parametrize('name', ['lower', 'universe'])
@pytest.mark.parametrize('kind', ['fixed', 'revolute'])
def test_a_joint_may_have_the_name_of_a_link(name: str, kind: str) -> None:
    """A URDF may have that, Pinocchio not: the dynamics are those under any other name."""
    old = 'name="c"' if kind == 'fixed' else 'name="b"'
    joints = ('a', 'b' if kind == 'fixed' else name)
    try:
        model = UrdfModel(two_links().replace(old, f'name="{name}"'), joints)
    except CtcError as error:  # What Pinocchio calls its own.
        assert name in ('universe', 'link 0') and kind == 'revolute' and '\n' not in str(error)
        return
    q, dq, a = [0.3, -0.5], [1.0, 2.0], [0.5, -4.0]
    assert model.inverse_dynamics(q, dq, a) == UrdfModel(
        two_links(), ('a', 'b')).inverse_dynamics(q, dq, a)


def survive(seed: int) -> bool:
    """Hand a mutated description to the plant; return whether there is a model of it."""
    text, names = ((two_links(), ('a', 'b')), (two_links(), ('a', 'b')), (panda(), PANDA),
                   (ur5(), UR5))[seed % 4]
    try:
        robot = make_plant(PlantConfig(joint_names=names, model='urdf'), mutated(text, seed))
        robot.step([-5.0] * len(names))
    except CtcError as error:
        assert '\n' not in str(error)
        return False
    return True


def test_any_description_is_a_robot_or_refused() -> None:
    """Nothing else is raised, whatever the libraries make of it, and no process ends."""
    made = [survive(seed) for seed in range(50)]
    assert 3 < sum(made) < 45


@pytest.mark.slow
def test_any_of_many_descriptions_is_a_robot_or_refused() -> None:
    for seed in range(100, 4000):
        survive(seed)


@pytest.mark.parametrize('bomb', BOMBS)
def test_what_is_too_much_is_refused_at_once(bomb: str) -> None:
    with pytest.raises(CtcError, match=bomb if bomb != 'size' else 'too large'):
        make_plant(PlantConfig(joint_names=('a', 'b'), model='urdf'), BOMBS[bomb])
    assert UrdfModel(chain(400), ('j0',)).n == 1


def test_whatever_a_library_raises_is_a_refused_description(
        monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError('out of\nluck')
    monkeypatch.setattr('pinocchio.buildReducedModel', fail)
    with pytest.raises(CtcError, match=r'RuntimeError: out of luck$'):
        make_plant(PlantConfig(joint_names=('a', 'b'), model='urdf', gravity=1.0), two_links())
