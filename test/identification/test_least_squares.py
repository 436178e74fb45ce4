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

"""The regression solves what a plain least-squares solver does, and finds dependent columns."""

from __future__ import annotations

import dataclasses

from ctc_chattering.identification.least_squares import (
    BETWEEN,
    Data,
    solve,
    Term,
    TermKind,
)
from ctc_chattering.identification.windows import STRIBECK
import numpy as np
import pytest

RNG = np.random.default_rng(0)
COUNT = 400
V = RNG.uniform(-1.0, 1.0, (COUNT, 2))
WAY = np.sign(V) * (np.abs(V) > 0.05)
STRIBECK_COLUMNS = np.sign(V)[:, :, None] * np.exp(-np.square(V[:, :, None] / STRIBECK))
MORE = RNG.normal(size=(COUNT, 2, 3))
LOADS = np.abs(RNG.normal(size=(COUNT, 2)))
LATE = np.stack((np.cos(0.1 * np.arange(COUNT)), np.zeros(COUNT)), axis=1)


def data(residual: np.ndarray, more: np.ndarray = MORE) -> Data:
    return dataclasses.replace(
        Data.at(WAY, V, np.zeros_like(V), more), t=np.arange(COUNT, dtype=float),
        stribeck=STRIBECK_COLUMNS, load=LOADS, late=LATE, residual=residual * (WAY != 0.0))


def torque() -> np.ndarray:
    """Return friction of both joints, written out, and two errors of the model."""
    first = np.where(V[:, 0] > 0.0, 3.0, -2.0) + 0.7 * V[:, 0]
    second = 5.0 * np.sign(V[:, 1]) + 0.1 * np.sign(V[:, 1]) * LOADS[:, 1]
    return np.stack((first, second), axis=1) + 0.1 * MORE[:, :, 0] - 0.3 * MORE[:, :, 2]


TERMS = (Term(TermKind.FORWARDS, 0), Term(TermKind.BACKWARDS, 0), Term(TermKind.VISCOUS, 0),
         Term(TermKind.FORWARDS, 1), Term(TermKind.BACKWARDS, 1), Term(TermKind.LOAD, 1),
         Term(TermKind.MODEL, -1, 0), Term(TermKind.MODEL, -1, 2))
TRUTH = (3.0, 2.0, 0.7, 5.0, 5.0, 0.1, 0.1, -0.3)


def test_exact_data_give_exact_coefficients() -> None:
    fit = solve(data(torque()), TERMS)
    assert fit.value == pytest.approx(TRUTH, abs=1e-9)
    assert fit.residual == pytest.approx(np.zeros((COUNT, 2)), abs=1e-9)
    assert fit.of(Term(TermKind.VISCOUS, 0)) == pytest.approx(0.7)
    assert fit.of(Term(TermKind.VISCOUS, 1)) == 0.0


def test_a_lag_that_is_off_is_in_its_slope_and_in_no_friction() -> None:
    y = torque()
    y[:, 0] += 0.02 * LATE[:, 0]
    assert solve(data(y), TERMS).value[:3] != pytest.approx(TRUTH[:3], abs=1e-4)
    fit = solve(data(y), (*TERMS, Term(TermKind.LAG_SLOPE, 0)))
    assert fit.value == pytest.approx((*TRUTH, 0.02), abs=1e-9)


def test_the_weights_are_those_of_the_noise_of_each_joint() -> None:
    noise = RNG.normal(size=(COUNT, 2)) * (0.01, 1.0)
    found = data(torque() + noise)
    fit = solve(found, TERMS)
    rows = np.concatenate([found.columns(TERMS, i) * np.sqrt(fit.weight[i]) for i in range(2)])
    plain = np.linalg.lstsq(rows, (found.residual * np.sqrt(fit.weight)).T.reshape(-1),
                            rcond=None)[0]
    assert fit.value == pytest.approx(plain, rel=1e-8)
    used = (WAY != 0.0).sum(axis=0)
    assert 1.0 / np.sqrt(fit.weight) == pytest.approx(
        np.sqrt((fit.residual ** 2).sum(axis=0) / used), rel=0.01)


@pytest.mark.parametrize('place', [2.4, 10.6, 25.4])
def test_a_stribeck_column_between_two_velocities(place: float) -> None:
    velocity = STRIBECK[0] * (STRIBECK[1] / STRIBECK[0]) ** place
    column = data(torque()).columns([Term(TermKind.STRIBECK, 0, place)], 0)[:, 0]
    exact = np.sign(V[:, 0]) * np.exp(-np.square(V[:, 0] / velocity))
    assert column == pytest.approx(exact * (WAY[:, 0] != 0.0), abs=1e-4)
    step = 1e-5
    slope = (BETWEEN(place + step) - BETWEEN(place - step)) / (2.0 * step)
    assert BETWEEN(place, 1) == pytest.approx(slope, abs=1e-4)
