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

"""The base class of models, the two-link arm, scaled ones, and the check of any model."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.dynamics.model import DynamicsTerms, Model, Scaled
from ctc_chattering.dynamics.model_check import check_dynamics
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.numerics.linear_algebra import Rows, Vector
import numpy as np
from oracles import Array, Generic, Masses, paper_c, paper_g, paper_m, states
import pytest
from urdfs import two_links


@pytest.mark.parametrize('model', [Generic(), TwoLink()])
def test_inverse_dynamics_is_equation_1(model: Model) -> None:
    """Check M a + C dq + G against the paper's matrices, and that forward dynamics undoes it."""
    rng = np.random.default_rng(1)
    for q, dq in states(50):
        a = rng.normal(size=2) * 5.0
        u = model.inverse_dynamics(q, dq, a.tolist())
        expected: Array = paper_m(q) @ a + paper_c(q, dq) @ dq + paper_g(q)
        np.testing.assert_allclose(u, expected, atol=1e-12)
        np.testing.assert_allclose(model.forward(*map(np.array, (q, dq, u))), a, atol=1e-11)


ARM = TwoLink()


def test_matrices_are_the_paper_s() -> None:
    """Check M, C and G against section 4 written in numpy."""
    for q, dq in states(100):
        np.testing.assert_allclose(ARM.mass_matrix(q), paper_m(q), rtol=0, atol=1e-14)
        np.testing.assert_allclose(ARM.coriolis_matrix(q, dq), paper_c(q, dq), rtol=0, atol=1e-14)
        np.testing.assert_allclose(ARM.gravity_torque(q), paper_g(q), rtol=0, atol=1e-12)


def test_closed_forms_are_the_generic_products() -> None:
    """Check every override against the base class, which knows only M, C and G."""
    generic = Generic()
    for q, dq in states(100):
        at = np.array(q), np.array(dq)
        for made, expected in zip(ARM.evaluate(*at), generic.evaluate(*at)):
            np.testing.assert_allclose(made, expected, rtol=0, atol=1e-13)
        for made, expected in zip(ARM.mass_and_bias(*at), generic.mass_and_bias(*at)):
            np.testing.assert_allclose(made, expected, rtol=0, atol=1e-12)


def test_gravity_can_be_off() -> None:
    """Check that g scales G and the potential, and is 9.81 by default."""
    off, moon = TwoLink(0.0), TwoLink(1.62)
    for q, dq in states(10):
        assert list(off.gravity_torque(q)) == [0.0, 0.0] == [off.potential_energy(q)] * 2
        np.testing.assert_allclose(moon.gravity_torque(q), paper_g(q, 1.62))
        assert off.inverse_dynamics(q, dq, [0.0, 0.0]) == pytest.approx(paper_c(q, dq) @ dq)


def test_the_urdf_has_the_model_s_dynamics_but_for_a_constant() -> None:
    text = (config_directory() / 'two_link.urdf').read_text(encoding='utf-8')
    theirs = UrdfModel(text, ('joint1', 'joint2'))
    rng = np.random.default_rng(0)
    for q, dq in rng.uniform(-3.0, 3.0, (20, 2, 2)):
        m, c, g = (np.array(x) for x in ARM.evaluate(q, dq))
        mass, coriolis, gravity = theirs.evaluate(q, dq)
        # No rigid body has the paper's M12, whose constant part is larger than M22.
        assert m - mass == pytest.approx(np.array([[0.0, 0.14], [0.14, 0.0]]))
        assert coriolis == pytest.approx(c)
        assert gravity == pytest.approx(g)


@pytest.mark.parametrize(('inertia', 'gravity'), [(1.3, 0.7), (1.0, 1.2)])
@pytest.mark.parametrize('base', [TwoLink, Generic])
def test_products(inertia: float, gravity: float, base: type[Model]) -> None:
    """Check every term at random states against the paper's matrices times the factors."""
    model = Scaled(base(), inertia, gravity)
    assert model.n == 2
    for (q, dq), (x, a) in zip(states(20), states(20, seed=2)):
        m, c, g = inertia * paper_m(q), inertia * paper_c(q, dq), gravity * paper_g(q)
        pairs: list[tuple[Any, Any]] = [
            (model.mass_matrix(q), m), (model.coriolis_matrix(q, dq), c),
            (model.gravity_torque(q), g),
            *zip(model.evaluate(np.array(q), np.array(dq)), (m, c, g)),
            (model.inverse_dynamics(q, dq, a), m @ a + c @ dq + g),
            (model.forward(*map(np.array, (q, dq, x))), np.linalg.solve(m, x - c @ dq - g))]
        for made, expected in pairs:
            np.testing.assert_allclose(made, expected, rtol=1e-11, atol=1e-10)


SHAPES = 'values are finite and have their shapes'
SYMMETRIC, DEFINITE = 'M is symmetric', 'M is positive definite (condition number)'
SKEW, LAGRANGE = '½ dM/dt - C is skew-symmetric', 'C dq is what M gives'
GRADIENT = 'G is the gradient of the potential'
EVALUATE, INVERSE = 'evaluate gives M, C and G', 'inverse_dynamics is M a + C dq + G'
FORWARD = 'forward dynamics undoes inverse dynamics'


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
