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

"""The check of a model: sound ones pass, and each planted fault fails its own test."""

from __future__ import annotations

from ctc_chattering.dynamics.model import Model, Scaled
from ctc_chattering.dynamics.model_check import check_dynamics, PropertyCheck
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.numerics.linear_algebra import Rows, Vector
import numpy as np
from oracles import Array, Generic, Masses
import pytest
from urdfs import two_links

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
