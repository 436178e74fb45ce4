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

"""Intervals contain the truth as often as they say, with correlated residuals as well."""

from __future__ import annotations

import dataclasses

from ctc_chattering.identification.least_squares import (
    correlation_length,
    Data,
    solve,
    spread,
    Term,
    TermKind,
)
import numpy as np
import pytest

#: Windows, and runs.
COUNT, RUNS = 1000, 60
TERMS = (Term(TermKind.FORWARDS, 0), Term(TermKind.VISCOUS, 0))


def correlated(rng: np.random.Generator, share: float) -> np.ndarray:
    """Return AR(1) noise."""
    white = rng.normal(size=COUNT)
    found = np.empty(COUNT)
    last = 0.0
    for k, x in enumerate(white):
        found[k] = last = share * last + x
    return found


def data(velocity: np.ndarray, noise: np.ndarray) -> Data:
    column = velocity[:, None]
    states = Data.at(np.ones_like(column), column, 0.0 * column, np.empty((COUNT, 1, 0)))
    return dataclasses.replace(states, residual=2.0 + 0.5 * column + noise[:, None])


@pytest.mark.parametrize('share', [
    0.0, pytest.param(0.6, marks=pytest.mark.slow), 0.9])
def test_intervals_cover_the_truth(share: float) -> None:
    rng = np.random.default_rng(7)
    covered = []
    for _ in range(RUNS):
        velocity = 1.0 + np.abs(np.sin(0.02 * np.arange(COUNT) + rng.uniform(0.0, 6.0)))
        fit = solve(data(velocity, correlated(rng, share)), TERMS)
        found = spread(fit, (0,))
        half = found.factor * found.error
        covered.append(np.abs(fit.value - (2.0, 0.5)) <= half)
    assert 0.87 <= np.mean(covered) <= 0.995


def test_the_correlation_length_is_that_of_ar_1() -> None:
    rng = np.random.default_rng(8)
    found = [correlation_length(correlated(rng, 0.8)) for _ in range(20)]
    assert np.mean(found) == pytest.approx((1.0 + 0.8) / (1.0 - 0.8), rel=0.2)
    assert correlation_length(np.zeros(50)) == 1.0
