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

"""The check of any model, and the faults of inertias that no rigid body has."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ctc_chattering.dynamics.model import DynamicsTerms, Model, Scaled
from ctc_chattering.dynamics.model_check import check_dynamics, inertia_faults
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.numerics.linear_algebra import Rows, Vector
import numpy as np
from oracles import Array, Generic, Masses
import pytest
from urdfs import joint, link, PANDA, panda, two_links, UR5, ur5, urdf

SHAPES = 'values are finite and have their shapes'
SYMMETRIC, DEFINITE = 'M is symmetric', 'M is positive definite (condition number)'
SKEW, LAGRANGE = '½ dM/dt - C is skew-symmetric', 'C dq agrees with the derivatives of M'
GRADIENT = 'G is the gradient of the potential'
EVALUATE = 'evaluate agrees with M, C and G'
INVERSE = 'inverse_dynamics agrees with M a + C dq + G'
FORWARD = 'forward dynamics inverts inverse dynamics'


def failed(model: Model) -> set[str]:
    return {x.name for x in check_dynamics(model, samples=5) if not x.passed}


@pytest.mark.parametrize('model', [
    TwoLink(), TwoLink(0.0), Generic(), Scaled(TwoLink(), 1.4, 0.3),
    Masses(np.diag([1e-4, 3.0, 50.0]).tolist()), Masses([[1e-6]]),
    UrdfModel(two_links(), ('b', 'a'))])
def test_sound_models_pass(model: Model) -> None:
    """Check them at many states, with room to spare."""
    findings = check_dynamics(model, seed=4, samples=100)
    assert len(findings) >= 9
    for finding in findings:
        assert finding.passed
        assert finding.worst <= 0.1 * finding.tolerance


def grown(i: int, j: int, change: float) -> Callable[..., Array]:
    """Return what adds to an element of a matrix."""
    return lambda m, *_: np.array(m) + change * np.outer(np.eye(2)[i], np.eye(2)[j])


def of_c(upper: float, lower: float, corner: float = 0.0) -> Callable[..., Array]:
    """Return what adds to C, in proportion to the velocities."""
    return lambda c, _q, dq: np.array(c) + np.array(
        [[corner * dq[1], upper * dq[0]], [lower * dq[0], 0.0]])


#: A method of the two-link arm, what it returns instead, and all tests that fail.
FAULTS: list[tuple[str, Callable[..., Any], set[str]]] = [
    ('mass_matrix', grown(0, 1, 1e-8), {SYMMETRIC}),
    ('coriolis_matrix', of_c(-1e-3, 0.0, 1e-3), {SKEW}),  # As C dq, but no longer skew.
    ('coriolis_matrix', of_c(1e-3, -1e-3), {LAGRANGE}),  # Skew, but another C dq.
    ('gravity_torque', lambda g, q: [g[0], g[1] + 1e-3 * q[0]], {GRADIENT}),
    ('potential_energy', lambda v, *_: 1.0001 * v, {GRADIENT}),
    ('evaluate', lambda mcg, *_: (mcg[0] + 1e-4 * np.eye(2), *mcg[1:]), {EVALUATE}),
    ('evaluate', lambda mcg, *_: (mcg[0], mcg[1] + 1e-4, mcg[2]), {EVALUATE}),
    ('evaluate', lambda mcg, *_: (*mcg[:2], mcg[2] + 1e-4), {EVALUATE}),
    ('forward', lambda a, *_: a * (1.0 + 1e-5), {FORWARD})]
#: The same where what is computed from the part may fail as well.
MORE_FAULTS: list[tuple[str, Callable[..., Any], set[str]]] = [
    ('mass_matrix', grown(1, 1, -0.57), {DEFINITE}),
    ('mass_matrix', lambda *_: [[2.0, 2.0], [2.0, 2.0 + 1e-11]], {DEFINITE}),
    ('mass_matrix', grown(0, 0, float('nan')), {SHAPES}),
    ('mass_matrix', lambda m, *_: m[:1], {SHAPES}),
    ('gravity_torque', lambda g, *_: [*g, 0.0], {SHAPES}),
    ('coriolis_matrix', lambda c, *_: 1.0001 * np.array(c), {SKEW, LAGRANGE}),
    ('inverse_dynamics', lambda u, *_: np.array(u) + 1e-6, {INVERSE})]


@pytest.mark.parametrize(('method', 'change', 'names'), FAULTS + MORE_FAULTS)
def test_every_fault_is_found(method: str, change: Callable[..., Any], names: set[str]) -> None:
    model = Generic()
    right = getattr(model, method)
    setattr(model, method, lambda *x: change(right(*x), *x))
    found = failed(model)
    assert names <= found
    assert found == names or (method, change, names) in MORE_FAULTS


def test_what_a_model_raises_is_reported() -> None:
    """Check that it fails the tests concerned, and no more."""
    class Silent(Generic):

        def potential_energy(self, q: Vector) -> float:
            del q
            raise NotImplementedError('no height here')

        def evaluate(self, q: Array, dq: Array) -> DynamicsTerms:
            del q, dq
            raise ZeroDivisionError

    class Mute(Generic):

        def mass_matrix(self, q: Vector) -> Rows:
            del q
            raise KeyError('inertia')
    found = {x.name: x.error for x in check_dynamics(Silent(), samples=2) if not x.passed}
    assert found[GRADIENT] == 'NotImplementedError: no height here'
    assert found[EVALUATE].startswith('ZeroDivisionError')
    (finding,) = check_dynamics(Mute())
    assert (finding.name, finding.passed, finding.error) == (SHAPES, False, "KeyError: 'inertia'")


LOWER = '<inertia ixx="0.05" iyy="0.05" izz="0.01" ixy="0" ixz="0" iyz="0"/>'


def lower(inertia: str, mass: str = '1.5') -> str:
    """Return the two-link arm with another inertia of its second link."""
    changed = two_links().replace(LOWER, inertia).replace(
        '<mass value="1.5"/>', f'<mass value="{mass}"/>')
    assert changed != two_links() or inertia == LOWER
    return changed


def test_robots() -> None:
    """Sound ones have no fault; the UR5 carries a box without mass."""
    assert inertia_faults(two_links(), ('a', 'b')) == inertia_faults(panda(), PANDA) == []
    assert inertia_faults(lower(LOWER.replace('0.01', '0.1')), ('a', 'b')) == []  # Flat.
    assert inertia_faults(ur5(), UR5) == ['link ee_link moves and has a shape, but no mass']


@pytest.mark.parametrize(('text', 'words'), [
    (lower(LOWER.replace('ixx="0.05"', 'ixx="-0.05"')), 'none may be negative'),
    (lower(LOWER.replace('ixy="0"', 'ixy="0.06"')), 'none may be negative'),
    (lower(LOWER.replace('izz="0.01"', 'izz="0.102"')), 'or exceed the sum of the others'),
    (lower(LOWER, '0'), 'a shape, but no mass'),
    (two_links().replace('<link name="tool"/>', '<link name="tool"><visual/></link>'),
     'link tool moves and has a shape, but no inertia')])
def test_faults(text: str, words: str) -> None:
    (fault,) = inertia_faults(text, ('a', 'b'))
    assert words in fault


def test_what_does_not_move_may_have_any_inertia() -> None:
    """The base, and what is before the first joint of the model; a frame has no shape."""
    text = urdf([link('base', 1.0, inertia=(1.0, 1.0, 9.0)), link('arm', 1.0, (0.1, 0, 0)),
                 link('tip', 1.0, (0.1, 0, 0), (1.0, 1.0, 9.0)), '<link name="frame"/>',
                 joint('j', 'revolute', 'base', 'arm'), joint('k', 'revolute', 'arm', 'tip'),
                 joint('f', 'fixed', 'tip', 'frame')])
    assert [x.split()[1] for x in inertia_faults(text, ('j', 'k'))] == ['tip']
    assert [x.split()[1] for x in inertia_faults(text, ('k',))] == ['tip']
    assert inertia_faults(text, ()) == []
