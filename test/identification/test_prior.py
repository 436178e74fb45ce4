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
"""The prior of the bodies, and physical bounds against a general solver."""

from __future__ import annotations

from ctc_chattering.configuration.arm_knowledge import ASSUMED_ROTOR
from ctc_chattering.dynamics.pseudo_inertia import parameters_of, pseudo_inertia
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.prior import (
    BodyPrior,
    covariance_of,
    MIN_EIGENVALUE,
    PhysicalBounds,
)
from ctc_chattering.identification.regressor import BodyRegressor
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest
from scipy.optimize import minimize  # type: ignore[import-untyped]
import urdfs

UNCERTAINTY = 0.2


def prior_of(text: str, joints: tuple[str, ...]) -> tuple[BodyPrior, BodyRegressor]:
    regressor = BodyRegressor.of(UrdfModel(text, joints))
    assert regressor is not None
    return BodyPrior.of(regressor, UNCERTAINTY), regressor


def test_a_change_of_size_one_is_the_same_part_of_each_body() -> None:
    """Scaling all bodies, or their frames, changes nothing: a mass is known to 20 %."""
    prior, regressor = prior_of(urdfs.panda(), urdfs.PANDA)
    masses = regressor.parameters[:70:10]
    for i, mass in enumerate(masses):
        block = prior.transform[10 * i:10 * i + 10, 10 * i:10 * i + 10]
        assert np.linalg.norm(block[0]) == pytest.approx(UNCERTAINTY * mass, rel=0.5)
        # S X Sᵀ with X = 1 is the body itself.
        body = regressor.parameters[10 * i:10 * i + 10]
        identity = np.linalg.solve(block, UNCERTAINTY * body)
        assert np.abs(identity).max() == pytest.approx(1.0, abs=0.3)


def test_rotors_that_the_urdf_lacks_are_expected() -> None:
    prior, regressor = prior_of(urdfs.panda(), urdfs.PANDA)
    expected = prior.transform[70:77, 70:77].diagonal() * prior.mean[70:77]
    limits = regressor.model.effort_limits  # type: ignore[attr-defined]
    assert expected == pytest.approx(ASSUMED_ROTOR * np.array(limits))
    given, _ = prior_of(urdfs.panda().replace(
        '<limit', '<dynamics damping="0" rotor_inertia="0.1"/><limit'), urdfs.PANDA)
    assert not given.mean.any()


def test_a_sensor_behind_the_gear_feels_no_rotor() -> None:
    """Nothing of rotors is expected or unknown, unless the URDF has some."""
    _, regressor = prior_of(urdfs.panda(), urdfs.PANDA)
    prior = BodyPrior.of(regressor, UNCERTAINTY, rotors_show=False)
    assert prior.transform.shape == (80, 72) and not prior.mean.any()
    assert not prior.transform[70:77].any() and not prior.bounds.minimum
    _, given = prior_of(urdfs.panda().replace(
        '<limit', '<dynamics damping="0" rotor_inertia="0.1"/><limit'), urdfs.PANDA)
    assert BodyPrior.of(given, UNCERTAINTY, rotors_show=False).transform.shape == (80, 79)


def test_a_turn_of_the_base_keeps_the_strength_of_gravity() -> None:
    prior, _ = prior_of(urdfs.two_links(), urdfs.TWO_LINKS)
    turns = prior.transform[-3:, -2:]
    assert pytest.approx(np.zeros(2), abs=1e-12) == turns.T @ [0.0, 0.0, -9.81]
    weightless = BodyRegressor.of(UrdfModel(urdfs.two_links(), urdfs.TWO_LINKS, 0.0))
    assert BodyPrior.of(weightless, UNCERTAINTY).transform.shape == (25, 22)


def test_models_without_bodies_or_regressor() -> None:
    assert BodyPrior.of(None, UNCERTAINTY).transform.shape == (0, 0)
    own = BodyPrior.of(BodyRegressor.of(TwoLink()), UNCERTAINTY)
    assert own.transform.shape[0] == len(TwoLink().inertial_parameters()) + 5
    assert own.bounds.model.shape == (0, 4, 4)


def test_a_model_without_any_mass_is_refused() -> None:
    massless = urdfs.two_links().replace('mass value="', 'mass value="0" was="')
    with pytest.raises(CtcError, match=r'M is singular|no moved body of the model has a mass'):
        prior_of(massless, urdfs.TWO_LINKS)


def bodies_of(prior: BodyPrior, regressor: BodyRegressor, x: Array) -> list[Array]:
    """Return the pseudo-inertias of changed bodies."""
    count = regressor.inertial_count
    values = regressor.parameters[:count] + (prior.transform @ x)[:count]
    return [pseudo_inertia(row) for row in values.reshape(-1, 10)]


@pytest.mark.parametrize('seed', range(3))
def test_the_nearest_physical_bodies_are_those_of_a_general_solver(seed: int) -> None:
    """J = L Lᵀ for each body and rotors that are squares, by a quasi-Newton method."""
    prior, regressor = prior_of(urdfs.two_links(), urdfs.TWO_LINKS)
    count, rng = prior.transform.shape[1], np.random.default_rng(seed)
    root = rng.normal(size=(count, count))
    information = root @ root.T + np.eye(count)
    wanted = np.asarray(12.0 * rng.normal(size=count), float)
    found = prior.bounds.nearest(wanted, information)
    for body in bodies_of(prior, regressor, found):
        assert np.linalg.eigvalsh(body)[0] > 0.0
    n = regressor.model.n
    inverse = np.linalg.inv(prior.transform[:10 * n + n, :10 * n + n])
    known = regressor.parameters[:10 * n + n]

    def unknowns(y: Array) -> Array:
        lower = np.zeros((n, 4, 4))
        rows, columns = np.tril_indices(4)
        lower[:, rows, columns] = y[:10 * n].reshape(n, 10)
        values = [parameters_of(x @ x.T) + MIN_EIGENVALUE * row
                  for x, row in zip(lower, known[:10 * n].reshape(n, 10))]
        x = inverse @ (np.concatenate([*values, np.square(y[10 * n:11 * n])]) - known)
        return np.concatenate((x, y[11 * n:]))

    def cost(y: Array) -> float:
        error = unknowns(y) - wanted
        return float(error @ information @ error)
    start = np.concatenate([np.linalg.cholesky(
        pseudo_inertia(row) + 1e-3 * np.eye(4))[np.tril_indices(4)]
        for row in known[:10 * n].reshape(n, 10)] + [np.full(n, 0.1), np.zeros(2)])
    best = min((minimize(cost, start + 0.1 * k * rng.normal(size=len(start)), method='BFGS',
                         options={'maxiter': 5000, 'gtol': 1e-8}) for k in range(3)),
               key=lambda x: x.fun)
    error = found - wanted
    assert float(error @ information @ error) == pytest.approx(best.fun, rel=5e-3)


def test_unknowns_inside_the_bounds_stay() -> None:
    prior, _ = prior_of(urdfs.panda(), urdfs.PANDA)
    inside = 0.1 * np.abs(np.random.default_rng(0).normal(size=prior.transform.shape[1]))
    assert prior.bounds.nearest(inside, np.eye(len(inside))) is inside


def test_an_unknown_at_its_bound_is_exactly_there() -> None:
    bounds = PhysicalBounds().with_minimum({0: -1.0, 2: 0.0})
    information = np.array([[2.0, 0.5, 0.3], [0.5, 1.0, 0.0], [0.3, 0.0, 4.0]])
    found = bounds.nearest(np.array([0.5, 0.2, -3.0]), information)
    # With x2 = 0 the others follow by least squares.
    slope = information @ (found - [0.5, 0.2, -3.0])
    assert found[2] == 0.0
    assert slope[:2] == pytest.approx(np.zeros(2), abs=1e-3)


def test_the_covariance_is_the_inverse() -> None:
    root = np.random.default_rng(0).normal(size=(6, 6))
    information = root @ root.T + np.eye(6)
    assert covariance_of(information) @ information == pytest.approx(np.eye(6), abs=1e-9)
