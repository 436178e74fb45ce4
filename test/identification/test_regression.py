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
"""The Bayesian regression, against a plain solver, and the coverage of its intervals."""

from __future__ import annotations

from ctc_chattering.identification.friction_terms import FrictionTerm, TermKind
from ctc_chattering.identification.prior import BodyPrior
from ctc_chattering.identification.regression import (
    BLOCKS,
    correlation_length,
    Fit,
    fit,
    mean_sign,
    Observations,
    OUTLIER_DEVIATIONS,
    resting_weight,
    Unknowns,
)
from ctc_chattering.identification.selection import basic_terms
from ctc_chattering.numerics.linear_algebra import Array
from made_up_windows import arm_windows, NO_BODIES, observed, velocities, windows
import numpy as np
import pytest
import urdfs

COUNT = 600
COULOMB, VISCOUS = 2.0, 0.5


def correlated(rng: np.random.Generator, share: float, count: int = COUNT) -> Array:
    """Return AR(1) noise."""
    noise = rng.normal(size=count)
    for k in range(1, count):
        noise[k] += share * noise[k - 1]
    return noise


def plain_terms(data: Observations) -> Unknowns:
    return Unknowns(NO_BODIES, tuple(
        term for joint in np.flatnonzero(data.moving).tolist()
        for term in basic_terms(data, joint)))


def friction_of(velocity: Array) -> Array:
    return np.sign(velocity) * COULOMB + velocity * VISCOUS


def number(solution: Fit, joint: int, kind: TermKind) -> tuple[float, float]:
    """Return a coefficient and half its interval."""
    row = solution.unknowns.row(joint, kind)
    return float(row @ solution.value), float(solution.half_interval(row))


def test_exact_data_give_exact_coefficients() -> None:
    velocity = velocities(COUNT, 2)
    torque = friction_of(velocity) + np.array([0.3, 0.0])
    solution = fit(data := observed(windows(velocity), torque), plain_terms(data))
    for joint, offset in enumerate((0.3, 0.0)):
        for kind, truth in ((TermKind.COULOMB, COULOMB), (TermKind.VISCOUS, VISCOUS),
                            (TermKind.OFFSET, offset)):
            assert number(solution, joint, kind)[0] == pytest.approx(truth, abs=1e-4)
    assert np.abs(solution.held_out - torque).max() < 1e-3


@pytest.mark.parametrize('share', [0.0, 0.95])
def test_it_is_ridge_regression_with_the_noise_of_each_joint(share: float) -> None:
    """
    A plain solver of all rows, each over its noise, and of the prior.

    Noise that lasts widens intervals, and is no smaller weight of its joint.
    """
    rows, regressor = arm_windows(urdfs.two_links(), urdfs.TWO_LINKS, COUNT)
    prior, rng = BodyPrior.of(regressor, 0.2), np.random.default_rng(1)
    noise = np.column_stack((correlated(rng, 0.0), correlated(rng, share)))
    noise *= np.array([0.05, 1.0]) / noise.std(axis=0)
    rotors = 0.2 * rows.bodies[:, :, regressor.inertial_count:-3].sum(axis=2)
    data = observed(rows, rows.model_torque + rotors + friction_of(rows.velocity) + noise)
    unknowns = Unknowns(prior, plain_terms(data).terms)
    solution = fit(data, unknowns)
    scale = np.sqrt(solution.noise.information * solution.noise.weights)
    columns = np.concatenate([unknowns.columns(data, j) * scale[:, j, None] for j in range(2)])
    target = np.concatenate([data.beyond_model[:, j] * scale[:, j] for j in range(2)])
    m = unknowns.count
    expected = np.linalg.lstsq(np.vstack((columns, np.eye(m))),
                               np.concatenate((target, unknowns.mean)), rcond=None)[0]
    assert unknowns.bounds.allow(expected)
    assert solution.value == pytest.approx(expected, abs=1e-6)
    length = np.repeat(solution.noise.correlation, COUNT)[:, None]
    inverse = np.linalg.inv(columns.T @ columns + np.eye(m))
    lasting = columns.T @ (length * columns) + np.eye(m)
    assert inverse @ lasting @ inverse == pytest.approx(solution.covariance, abs=1e-9)
    assert solution.noise.deviation == pytest.approx([0.05, 1.0], rel=0.25)
    assert (length[-1] > 5.0) == (share > 0.0)


@pytest.mark.parametrize('share', [
    0.0, pytest.param(0.6, marks=pytest.mark.slow), 0.9])
def test_intervals_cover_the_truth(share: float) -> None:
    covered = []
    for seed in range(30):
        rng = np.random.default_rng((seed, 7))
        velocity = velocities(COUNT, 1, seed)
        torque = friction_of(velocity) + 0.3 * correlated(rng, share)[:, None]
        solution = fit(data := observed(windows(velocity), torque), plain_terms(data))
        for kind, truth in ((TermKind.COULOMB, COULOMB), (TermKind.VISCOUS, VISCOUS)):
            value, half = number(solution, 0, kind)
            covered.append(abs(value - truth) <= half)
    assert np.mean(covered) >= 0.9


def test_friction_is_not_negative() -> None:
    velocity = velocities(COUNT, 1)
    torque = COULOMB * np.sign(velocity) - 0.01 * velocity
    torque += 0.05 * np.random.default_rng(1).normal(size=torque.shape)
    solution = fit(data := observed(windows(velocity), torque), plain_terms(data))
    viscous, half = number(solution, 0, TermKind.VISCOUS)
    assert viscous == 0.0 and half > 0.0
    assert number(solution, 0, TermKind.COULOMB)[0] == pytest.approx(COULOMB, rel=0.01)


def test_a_contact_loses_its_weight() -> None:
    velocity = velocities(COUNT, 1)
    torque = friction_of(velocity) + 0.02 * np.random.default_rng(1).normal(size=velocity.shape)
    torque[100:110] += 50.0
    solution = fit(data := observed(windows(velocity), torque), plain_terms(data))
    weights = solution.noise.weights[:, 0]
    assert weights[100:110].max() < 1e-3 and np.median(weights) > 0.9
    assert number(solution, 0, TermKind.COULOMB)[0] == pytest.approx(COULOMB, rel=0.01)


def test_windows_in_which_a_joint_rests_tell_little_of_it() -> None:
    """A uniform distribution up to the static friction has a third of its square as variance."""
    assert resting_weight(np.array([0.0, 1.0]), 3.0, 1.0).tolist() == [1.0, 0.25]
    velocity = velocities(COUNT, 1)
    velocity[200:] = 0.0
    torque = friction_of(velocity)
    torque[200:] = 1.3
    data = observed(windows(velocity), torque)
    assert data.used[:, 0].sum() == 200
    assert number(fit(data, plain_terms(data)), 0, TermKind.COULOMB)[0] == pytest.approx(COULOMB)


@pytest.mark.parametrize('torque', [np.nan, 3.0])
def test_a_joint_that_never_moves_or_has_no_torque_is_in_no_equation(torque: float) -> None:
    velocity = velocities(COUNT, 2)
    values = friction_of(velocity)
    values[:, 1] = torque
    if np.isfinite(torque):
        velocity[:, 1] = 0.0
    else:
        values[:10, 1] = 1.0  # Fewer windows than are fitted.
    data = observed(windows(velocity), values)
    assert data.moving.tolist() == [True, False] and not data.used[:, 1].any()
    solution = fit(data, plain_terms(data))
    assert number(solution, 0, TermKind.COULOMB)[0] == pytest.approx(COULOMB, abs=1e-4)


def test_blocks_that_differ_widen_the_intervals() -> None:
    """Friction that drifts differs between blocks of time, though the noise is small."""
    velocity = velocities(COUNT, 1)
    drift = 1.0 + 0.3 * np.linspace(-1.0, 1.0, COUNT)[:, None]
    halves = []
    for factor in (np.ones_like(drift), drift):
        torque = factor * friction_of(velocity)
        torque += 0.02 * np.random.default_rng(1).normal(size=torque.shape)
        solution = fit(data := observed(windows(velocity), torque), plain_terms(data))
        halves.append(number(solution, 0, TermKind.COULOMB)[1])
    assert halves[1] > 5.0 * halves[0]


def test_each_block_is_predicted_by_the_others() -> None:
    """A torque in one block alone is not predicted there, and is in its held-out torque."""
    velocity = velocities(COUNT, 1)
    torque = friction_of(velocity)
    inside = slice(3 * COUNT // BLOCKS, 4 * COUNT // BLOCKS)
    torque[inside] += 0.5
    solution = fit(data := observed(windows(velocity), torque), plain_terms(data))
    left = data.beyond_model - solution.held_out
    assert np.abs(left[inside] - 0.5).max() < 0.05
    assert OUTLIER_DEVIATIONS > 1.0


def test_the_correlation_length_is_that_of_ar_1() -> None:
    rng = np.random.default_rng(8)
    lengths = [correlation_length(correlated(rng, 0.8, 1000)) for _ in range(20)]
    assert np.mean(lengths) == pytest.approx((1.0 + 0.8) / (1.0 - 0.8), rel=0.2)
    assert correlation_length(np.zeros(50)) == 1.0


def test_the_sign_of_a_torque_changes_within_a_window() -> None:
    torque = np.array([[3.0], [1.0], [-1.0], [-3.0]])
    assert mean_sign(torque)[:, 0].tolist() == [1.0, 0.5, -0.5, -1.0]
    assert mean_sign(np.zeros((1, 1))).tolist() == [[0.0]]


def test_the_column_of_a_term_is_its_torque() -> None:
    velocity = velocities(50, 2)
    rows = windows(velocity, model_torque=3.0 * np.ones_like(velocity))
    sign = np.ones_like(velocity)
    expected = {
        TermKind.COULOMB: np.sign(velocity[:, 0]), TermKind.OFFSET: np.ones(50),
        TermKind.VISCOUS: velocity[:, 0], TermKind.LOAD: 3.0 * np.sign(velocity[:, 0]),
        TermKind.SCALE: np.full(50, 3.0), TermKind.DEAD_BAND: sign[:, 0],
        TermKind.COUPLED_COULOMB: np.sign(velocity[:, 1]),
        TermKind.COUPLED_VISCOUS: velocity[:, 1]}
    for kind, column in expected.items():
        term = FrictionTerm(kind, 0, 2.0, 1)
        assert term.column(rows, sign) == pytest.approx(2.0 * column), kind
    slow = FrictionTerm(TermKind.STRIBECK, 0, 1.0, 8)
    assert slow.stribeck_velocity == pytest.approx(0.05)
    assert slow.column(rows, sign) == pytest.approx(
        np.sign(velocity[:, 0]) * np.exp(-np.square(velocity[:, 0] / 0.05)), abs=1e-9)
