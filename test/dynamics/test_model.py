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

from typing import Any

from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.dynamics.model import Model, Scaled
from ctc_chattering.dynamics.model_check import check_dynamics, PropertyCheck
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


def test_base_class_is_abstract() -> None:
    """Check that a model without M, C, G cannot be made."""
    with pytest.raises(TypeError):
        Model()  # type: ignore[abstract]


ARM = TwoLink()


def test_matrices_are_the_paper_s() -> None:
    """Check M, C and G against section 4 written in numpy."""
    for q, dq in states(100):
        np.testing.assert_allclose(ARM.mass_matrix(q), paper_m(q), rtol=0, atol=1e-14)
        np.testing.assert_allclose(ARM.coriolis_matrix(q, dq), paper_c(q, dq), rtol=0, atol=1e-14)
        np.testing.assert_allclose(ARM.gravity_torque(q), paper_g(q), rtol=0, atol=1e-12)


def test_mass_matrix_is_positive_definite_everywhere() -> None:
    """Check eigenvalues over a turn of q2, and the bound α >= ‖M‖₂ that the theorem needs."""
    least, most = np.inf, 0.0
    for q2 in np.linspace(-np.pi, np.pi, 721).tolist():
        m = np.array(ARM.mass_matrix([0.3, q2]))
        assert (m == m.T).all()
        eigenvalues = np.linalg.eigvalsh(m)
        least, most = min(least, eigenvalues[0]), max(most, eigenvalues[-1])
    assert least > 0.4
    assert most == pytest.approx(np.linalg.norm([[9.79, 1.27], [1.27, 0.62]], 2))


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


FACTORS = [(0.9, 0.9), (1.3, 0.7), (0.5, 0.0), (1.0, 1.2), (1.1, 1.0)]


@pytest.mark.parametrize(('inertia', 'gravity'), FACTORS)
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


def test_factor_one_is_the_model() -> None:
    """Check the products bit for bit, and the acceleration up to rounding."""
    plain = TwoLink()
    model = Scaled(plain, 1.0, 1.0)
    for (q, dq), (x, _) in zip(states(20), states(20, seed=2)):
        assert [list(row) for row in model.mass_matrix(q)] == [
            list(row) for row in plain.mass_matrix(q)]
        assert list(model.gravity_torque(q)) == list(plain.gravity_torque(q))
        assert list(model.inverse_dynamics(q, dq, x)) == pytest.approx(
            list(plain.inverse_dynamics(q, dq, x)), rel=1e-14)
        np.testing.assert_allclose(
            model.forward(*map(np.array, (q, dq, x))),
            plain.forward(*map(np.array, (q, dq, x))), rtol=1e-9, atol=1e-9)


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


def test_findings() -> None:
    """Check their order, and that they depend on the seed and on nothing else."""
    first, again, other = (check_dynamics(TwoLink(), seed=seed) for seed in (1, 1, 2))
    assert first == again != other
    assert [x.name for x in first] == [
        SHAPES, SYMMETRIC, DEFINITE, SKEW, LAGRANGE, GRADIENT, EVALUATE, INVERSE, FORWARD]
    assert all(isinstance(x, PropertyCheck) and len(x.q) == len(x.dq) == 2 for x in first)


class Faulty(Generic):
    """The two-link arm with one fault at a time."""

    def __init__(self, fault: str) -> None:
        super().__init__()
        self.fault = fault

    def mass_matrix(self, q: Vector) -> Rows:
        m = [list(row) for row in super().mass_matrix(q)]
        if self.fault == 'asymmetric':
            m[0][1] *= 1.0 + 1e-8
        if self.fault == 'indefinite':
            m[1][1] = 0.05
        if self.fault == 'singular':
            m = [[2.0, 2.0], [2.0, 2.0 + 1e-11]]
        if self.fault == 'not a number':
            m[0][0] = float('nan')
        return m[:1] if self.fault == 'one row' else m

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:
        c = [list(row) for row in super().coriolis_matrix(q, dq)]
        if self.fault == 'c scaled':
            c = [[(1.0 + 1e-4) * x for x in row] for row in c]
        if self.fault == 'c of its own':  # as C dq, but no longer skew
            c[0][0] += 1e-3 * dq[1]
            c[0][1] -= 1e-3 * dq[0]
        if self.fault == 'c is skew':  # skew, but another C dq
            c[0][1] += 1e-3 * dq[0]
            c[1][0] -= 1e-3 * dq[0]
        return c

    def gravity_torque(self, q: Vector) -> Vector:
        g = list(super().gravity_torque(q))
        if self.fault == 'g':
            g[1] += 1e-3 * q[0]
        return [*g, 0.0] if self.fault == 'g too long' else g

    def potential_energy(self, q: Vector) -> float:
        return super().potential_energy(q) * (1.0001 if self.fault == 'potential' else 1.0)

    def evaluate(self, q: Array, dq: Array) -> tuple[Array, Array, Array]:
        terms = super().evaluate(q, dq)
        for term, name in zip(terms, 'mcg'):
            if self.fault == f'evaluate {name}':
                term.flat[-1] += 1e-4
        return terms

    def inverse_dynamics(self, q: Vector, dq: Vector, a: Vector) -> Vector:
        made = list(super().inverse_dynamics(q, dq, a))
        if self.fault == 'inverse':
            made[0] += 1e-6
        return made

    def forward(self, q: Array, dq: Array, u: Array) -> Array:
        made = super().forward(q, dq, u)
        if self.fault == 'forward':
            made[1] *= 1.0 + 1e-5
        return made


@pytest.mark.parametrize(('fault', 'names'), [
    ('', set()), ('asymmetric', {SYMMETRIC}), ('indefinite', {DEFINITE}),
    ('singular', {DEFINITE}), ('not a number', {SHAPES}), ('one row', {SHAPES}),
    ('g too long', {SHAPES}), ('c scaled', {SKEW, LAGRANGE}), ('c of its own', {SKEW}),
    ('c is skew', {LAGRANGE}), ('g', {GRADIENT}), ('potential', {GRADIENT}),
    ('evaluate m', {EVALUATE}), ('evaluate c', {EVALUATE}), ('evaluate g', {EVALUATE}),
    ('inverse', {INVERSE}), ('forward', {FORWARD})])
def test_every_fault_is_found(fault: str, names: set[str]) -> None:
    """Check that its test fails; what is computed from the faulty part may fail as well."""
    found = failed(Faulty(fault))
    assert names <= found
    assert bool(names) == bool(found)
    if fault in ('asymmetric', 'c of its own', 'c is skew', 'potential', 'g', 'forward',
                 'evaluate m', 'evaluate c', 'evaluate g'):
        assert found == names


def test_where_it_is_worst() -> None:
    """Check that the state reported has the error reported."""
    finding = next(x for x in check_dynamics(Faulty('asymmetric')) if x.name == SYMMETRIC)
    m = np.array(Faulty('asymmetric').mass_matrix(finding.q))
    assert abs(m[0, 1] - m[1, 0]) / np.sqrt(m[0, 0] * m[1, 1]) == pytest.approx(finding.worst)


def test_what_a_model_raises_is_reported() -> None:
    """Check that it fails the tests concerned, and no more."""
    class Silent(Generic):

        def potential_energy(self, q: Vector) -> float:
            del q
            raise NotImplementedError('no height here')

        def evaluate(self, q: Array, dq: Array) -> tuple[Array, Array, Array]:
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


class Light(Masses):
    """A heavy and a very light joint, with a fault in the light one only."""

    def __init__(self) -> None:
        super().__init__([[100.0, 0.0], [0.0, 1e-4]])

    def mass_matrix(self, q: Vector) -> Rows:
        return [[100.0, 0.0], [0.0, 1e-4 + 1e-8 * np.sin(q[0])]]


def test_a_light_joint_counts_as_much_as_a_heavy_one() -> None:
    assert failed(Light()) >= {SKEW}
