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

"""
Parameters that bodies can have, from normal matrices made by Pinocchio's regressor.

Another way to the least squares over bodies: J = L Lᵀ, without bounds, by a quasi-Newton method.
"""

from __future__ import annotations

import dataclasses
from functools import cache

from ctc_chattering.dynamics.pseudo_inertia import parameters_of, pseudo_inertia
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.bodies import (
    BodyEstimate,
    consistent,
    physical_findings,
)
from ctc_chattering.identification.findings import Severity
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import minimize  # type: ignore[import-untyped]
from urdfs import PANDA, panda, TWO_LINKS, two_links, UR5, ur5

ROBOTS = {'panda': (panda, PANDA), 'ur5': (ur5, UR5), 'two links': (two_links, TWO_LINKS)}


@cache
def robot(name: str, states: int = 300, seed: int = 0, still: bool = False) -> tuple[Array, Array]:
    """Return the parameters, and the regressor with rotors along random states (N, n, 11 n)."""
    text, joints = ROBOTS[name]
    model = UrdfModel(text(), joints)
    n, data, rng = model.n, model._model.createData(), np.random.default_rng(seed)
    rows = []
    for _ in range(states):
        q, dq, ddq = rng.uniform(-1.5, 1.5, n), rng.uniform(-1, 1, n), rng.uniform(-3, 3, n)
        if still:
            dq = ddq = np.zeros(n)
        rows.append(np.hstack((
            pin.computeJointTorqueRegressor(model._model, data, q, dq, ddq), np.diag(ddq))))
    return model.inertial_parameters().reshape(-1, 10), np.array(rows)


def other(prior: Array, seed: int) -> Array:
    """Return bodies with less or more mass, and with a mass at a point of each."""
    rng, found = np.random.default_rng(seed), []
    for body in prior:
        at = np.append(rng.uniform(-0.1, 0.1, 3), 1.0)
        found.append(parameters_of(pseudo_inertia(body) * rng.uniform(0.7, 1.2)
                                   + 0.2 * body[0] * np.outer(at, at)))
    return np.array(found)


def estimated(prior: Array, rows: Array, true: Array, rotor: Array, noise: float,
              seed: int = 0) -> BodyEstimate:
    """Return what least squares make of a noisy torque, nearest to the model."""
    P, n = rows.shape[2], len(prior)
    x, known = np.concatenate((true.ravel(), rotor)), np.append(prior.ravel(), np.zeros(n))
    tau = rows @ (x - known) + noise * np.random.default_rng(seed).normal(size=rows.shape[:2])
    found = known + np.linalg.lstsq(rows.reshape(-1, P), tau.ravel(), rcond=1e-9)[0]
    return bodies(prior, found, rows.reshape(-1, P).T @ rows.reshape(-1, P) / noise ** 2,
                  np.einsum('tip,tiq->ipq', rows, rows) / len(rows))


def bodies(prior: Array, found: Array, information: Array, torque: Array | None = None
           ) -> BodyEstimate:
    """Return the estimate of bodies, and rotors if there are any in it, without gravity."""
    n, p = len(prior), len(found)
    P = 11 * n + 3
    known, whole = np.append(prior.ravel(), np.zeros(n + 3)), np.zeros((P, P))
    value, shown = known.copy(), np.zeros((n, P, P))
    value[:p], whole[:p, :p] = found, information
    if torque is not None:
        shown[:, :p, :p] = torque
    return BodyEstimate(tuple(f'link{i}' for i in range(n)), known, value, whole, shown,
                        np.zeros(3))


def rms(rows: Array, x: Array) -> Array:
    """Return the root mean square of each joint's torque."""
    found: Array = np.sqrt(np.square(rows @ x).mean(axis=0))
    return found


@pytest.mark.parametrize('name', ['two links', *(
    pytest.param(x, marks=pytest.mark.slow) for x in ('panda', 'ur5'))])
@pytest.mark.parametrize('noise', [0.01, 0.3])
def test_the_torque_of_other_motions_is_right(name: str, noise: float) -> None:
    """Bodies can have the parameters; on average they are at least as good as least squares."""
    prior, rows = robot(name)
    unseen = robot(name, 100, 1)[1]
    better = []
    for seed in range(2):
        true = other(prior, seed)
        rotor = np.random.default_rng(seed).uniform(0.0, 0.3, len(prior))
        x = np.append(true.ravel(), rotor)
        estimate = estimated(prior, rows, true, rotor, noise, seed)
        made = consistent(estimate)
        assert all(np.linalg.eigvalsh(pseudo_inertia(body))[0] > 0.0 for body in made.parameters)
        assert (made.rotor >= 0.0).all()
        assert not list(physical_findings(made, name, [0.0] * len(prior)))
        error, before = (rms(unseen, y[:-3] - x) for y in (made.found, estimate.known))
        assert (error < np.maximum(0.4 * noise, 0.0) + 0.05 * before).all()
        better.append(error / rms(unseen, estimate.found[:-3] - x))
    assert np.mean(better) < 1.1


def test_against_another_method() -> None:
    """One body whose estimate has a negative mass; no weight of the model, all is shown."""
    prior, _ = robot('two links')
    rng = np.random.default_rng(3)
    A = rng.normal(size=(10, 10))
    A = A @ A.T * 1e6
    asked = prior[0] + 0.2 * np.abs(prior[0]).max() * rng.normal(size=10)
    asked[0] = -0.5
    made = consistent(bodies(prior[:1], asked, A))
    assert np.linalg.eigvalsh(pseudo_inertia(asked))[0] < 0.0 < np.linalg.eigvalsh(
        pseudo_inertia(made.parameters[0]))[0]
    lower = np.tril_indices(4)

    def cost(elements: Array) -> float:
        L = np.zeros((4, 4))
        L[lower] = elements
        change = parameters_of(L @ L.T) - asked
        return float(change @ A @ change) * 1e-6
    best = min(minimize(cost, start, method='BFGS', options={'gtol': 1e-8, 'maxiter': 2000}).fun
               for start in rng.normal(size=(4, 10)))
    change = made.found[:10] - asked
    assert change @ A @ change * 1e-6 == pytest.approx(best, rel=2e-3)


@pytest.mark.parametrize('name', ['two links', *(
    pytest.param(x, marks=pytest.mark.slow) for x in ('panda', 'ur5'))])
@pytest.mark.parametrize('rotor, mass', [(-0.6, 1.0), (0.0, -1.0)])
def test_what_no_body_can_have_is_refused(name: str, rotor: float, mass: float) -> None:
    """The torque of the last joint with a negative inertia; of all joints with links of -1 kg."""
    prior, rows = robot(name)
    rotors = np.append(np.zeros(len(prior) - 1), rotor)
    made = consistent(estimated(prior, rows, mass * prior, rotors, 0.05))
    assert all(np.linalg.eigvalsh(pseudo_inertia(body))[0] > 0.0 for body in made.parameters)
    findings = list(physical_findings(made, [f'joint{i}' for i in range(len(prior))],
                                      [0.0] * len(prior)))
    refused = {x.joint for x in findings if x.severity == Severity.REFUSED}
    assert len(prior) - 1 in refused and (rotor or len(refused) >= len(prior) - 1)
    assert 'no body can have' in findings[0].reason
    assert f'joint{findings[0].joint}' in findings[0].reason and 'N*m' in findings[0].reason


def test_what_is_not_shown_stays_as_the_model_has_it() -> None:
    """Weight alone shows no inertia; without data nothing changes, and no solver is needed."""
    prior, rows = robot('panda', still=True)
    none = bodies(prior, prior.ravel(), np.zeros((70, 70)))
    np.testing.assert_array_equal(consistent(none).parameters, prior)
    true = prior.copy()
    true[4, 1:4] += [0.1, -0.05, 0.02]
    made = consistent(estimated(prior, rows, true, np.zeros(7), 1e-3))
    assert rms(rows, made.found[:-3] - np.append(true.ravel(), np.zeros(7))).max() < 1e-3
    moved = np.abs(made.parameters - prior) / np.abs(prior).max(axis=1, keepdims=True)
    assert moved[:, 4:].max() < moved[:, 1:4].max()
    assert (made.rotor == 0.0).all()


def test_a_model_that_no_body_is_becomes_one() -> None:
    """A flat URDF, one with a mass alone, and one with too large a moment of inertia."""
    prior, _ = robot('two links')
    for k, wrong in enumerate(([2.0] + [0.0] * 9, [2.0, 0, 0, 0, 0.1, 0, 0.1, 0, 0, 0.5])):
        bad = prior.copy()
        bad[k] = wrong
        made = consistent(bodies(bad, bad.ravel(), np.zeros((20, 20))))
        assert np.linalg.eigvalsh(pseudo_inertia(made.parameters[k]))[0] > 0.0
        assert made.parameters[k, 0] == pytest.approx(2.0, rel=0.5)


def test_refused() -> None:
    prior, _ = robot('two links')
    with pytest.raises(CtcError, match='not finite'):
        consistent(bodies(prior, prior.ravel(), np.full((20, 20), np.nan)))
    with pytest.raises(CtcError, match='no moved body of the model has a mass'):
        consistent(bodies(0.0 * prior, 0.0 * prior.ravel(), np.zeros((20, 20))))


@pytest.mark.parametrize('noise, sign', [(1e-12, 1.0), (0.01, -1.0)])
def test_information_that_no_data_have_is_refused(noise: float, sign: float) -> None:
    """A torque that is known to 1e-12 N*m hides what is expected of the bodies in rounding."""
    prior, rows = robot('panda')
    estimate = estimated(prior, rows, prior, np.zeros(7), noise)
    with pytest.raises(CtcError, match=r'is from -.* to .*; allowed: from 0 to about 1e12'):
        consistent(dataclasses.replace(estimate, information=sign * estimate.information))
