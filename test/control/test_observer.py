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

"""The observer of state and perturbation, against poles, exact motions and enumeration."""

import math

from ctc_chattering.control.observer import (
    design_observer,
    ModelTerms,
    Observed,
    StateObserver,
)
from ctc_chattering.dynamics.drive_response import discretize_drives
import numpy as np
from oracles import Array, box_by_enumeration, random_spd
import pytest

pytestmark = pytest.mark.filterwarnings('ignore::RuntimeWarning')  # Without a lag.
H, BANDWIDTH = 1e-3, 150.0
WIDE = np.full(2, 1e9)
MASS = np.array([[8.8, 0.9], [0.9, 0.6]])
NONE = np.zeros(2)


def observer(bound: Array = WIDE) -> StateObserver:
    return design_observer(discretize_drives(NONE, np.full(2, math.inf), H), BANDWIDTH, bound)


def at(q: Array = NONE, dq: Array = NONE, P: Array = NONE, slope: Array = NONE) -> Observed:
    return Observed(q, dq, NONE, P, slope)


def test_all_poles_are_where_the_bandwidth_says() -> None:
    """
    Check (A - θ)⁴ = 0, A the matrix of the error over a sample.

    That says (z - θ)⁴ for both joints; poles themselves, or coefficients found from them, would
    show the rounding to the power of 1/4. The states are in units of the same size, q, h dq,
    h² M⁻¹ P and h³ M⁻¹ Ṗ.
    """
    made, columns = observer(), []
    scale = np.eye(8)
    for i, unit in enumerate((np.eye(2), np.eye(2) / H, MASS / H ** 2, MASS / H ** 3)):
        scale[2 * i:2 * i + 2, 2 * i:2 * i + 2] = unit
    for unit in np.eye(8):
        moved = made.predict(
            ModelTerms(at(*(scale @ unit).reshape(4, 2)), MASS, NONE), NONE, NONE)
        found = made.correct(moved, MASS, NONE)
        columns.append(np.linalg.solve(scale, np.concatenate(
            [found.q, found.dq, found.perturbation, found.slope])))
    rest = np.array(columns).T - math.exp(-BANDWIDTH * H) * np.eye(8)
    assert np.abs(np.linalg.matrix_power(rest, 3)).max() > 1e-3
    np.testing.assert_allclose(np.linalg.matrix_power(rest, 4), 0.0, atol=1e-12)


def test_without_a_slope_three_poles_are_where_the_bandwidth_says() -> None:
    """Check (A - θ)³ = 0 as above; the slope stays 0."""
    made = design_observer(
        discretize_drives(NONE, np.full(2, math.inf), H), BANDWIDTH, WIDE, False)
    columns, scale = [], np.eye(6)
    for i, unit in enumerate((np.eye(2), np.eye(2) / H, MASS / H ** 2)):
        scale[2 * i:2 * i + 2, 2 * i:2 * i + 2] = unit
    for unit in np.eye(6):
        moved = made.predict(
            ModelTerms(at(*(scale @ unit).reshape(3, 2)), MASS, NONE), NONE, NONE)
        found = made.correct(moved, MASS, NONE)
        assert (found.slope == 0.0).all()
        columns.append(np.linalg.solve(scale, np.concatenate(
            [found.q, found.dq, found.perturbation])))
    rest = np.array(columns).T - math.exp(-BANDWIDTH * H) * np.eye(6)
    assert np.abs(np.linalg.matrix_power(rest, 2)).max() > 1e-3
    np.testing.assert_allclose(np.linalg.matrix_power(rest, 3), 0.0, atol=1e-12)


def test_friction_that_does_not_hold_both_joints() -> None:
    """Check dq⁺ = 0 or friction at its level, by enumeration over random coupled masses."""
    rng, made, mixed = np.random.default_rng(3), observer(), 0
    for _ in range(50):
        mass, load, level = random_spd(rng, 2), 8.0 * rng.normal(size=2), rng.uniform(1, 9, 2)
        dq = 1e-3 * rng.normal(size=2)
        after = made.predict(ModelTerms(at(dq=dq), mass, NONE), level, load).dq
        inverse = np.linalg.inv(mass).astype(np.float64)
        f = box_by_enumeration(inverse, -inverse @ (mass @ dq / H + load), level)
        np.testing.assert_allclose(after, dq + H * inverse @ (load - f), atol=1e-12)
        mixed += int((np.abs(f) < level).sum() == 1)
    assert mixed > 5


def test_the_estimate_keeps_its_bound_and_the_slope_does_not_push() -> None:
    """Check the corner that is nearest in the metric of M⁻¹ to a load far beyond the bound."""
    bound, load, inverse = np.array([4.0, 2.0]), np.array([30.0, 10.0]), np.linalg.inv(MASS)
    made, state = observer(bound), at()
    for k in range(1, 400):
        state = made.predict(ModelTerms(state, MASS, NONE), NONE, NONE)
        t = k * H
        state = made.correct(state, MASS, -inverse @ load * t * t / 2)
        assert (np.abs(state.perturbation) <= bound).all()
    assert (inverse @ (load - bound) > 0.0).all()
    np.testing.assert_array_equal(state.perturbation, bound)
    assert (state.slope <= 0.0).all()
