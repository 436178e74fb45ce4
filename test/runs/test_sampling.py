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

"""Draws: their distributions against scipy, and which of them stay the same."""

from __future__ import annotations

from typing import Any

from ctc_chattering.runs.points import draws, unit_draws
from ctc_chattering.runs.spec import read_uncertain, Repeats, Uncertain
import numpy as np
import pytest
from scipy import stats  # type: ignore[import-untyped]


def uncertain(**distribution: Any) -> Uncertain:
    return read_uncertain('x', {'parameter': 'plant.coulomb_friction', **distribution})


def drawn(x: Uncertain, method: str = 'sobol', n: int = 1024) -> Any:
    return draws([x], Repeats(method, n, 3))[:, 0]


@pytest.mark.parametrize('method', ['random', 'latin_hypercube', 'sobol'])
@pytest.mark.parametrize(('x', 'distribution'), [
    (uncertain(uniform=[0.9, 1.1]), stats.uniform(0.9, 0.2)),
    (uncertain(log_uniform=[1e-3, 10.0]), stats.loguniform(1e-3, 10.0)),
    (uncertain(normal=[2.0, 0.5]), stats.norm(2.0, 0.5))], ids=['uniform', 'log', 'normal'])
def test_distributions(method: str, x: Uncertain, distribution: Any) -> None:
    assert stats.kstest(drawn(x, method), distribution.cdf).pvalue > 0.01


@pytest.mark.parametrize('method', ['latin_hypercube', 'sobol'])
def test_a_choice_is_balanced(method: str) -> None:
    values, counts = np.unique(drawn(uncertain(choice=[0, 1, 5, 7]), method), return_counts=True)
    assert values.tolist() == [0.0, 1.0, 5.0, 7.0]
    assert counts.tolist() == [256] * 4


def test_methods_are_what_they_are_called() -> None:
    """Check a stratum of each dimension for each draw, and the elementary intervals of Sobol."""
    for method in ('latin_hypercube', 'sobol'):
        u = unit_draws(method, 16, 3, 0)
        assert (np.sort((16 * u).astype(int), axis=0) == np.arange(16)[:, np.newaxis]).all()
    u = unit_draws('sobol', 16, 2, 0)
    assert len({(int(4 * x), int(4 * y)) for x, y in u}) == 16


@pytest.mark.parametrize('method', ['random', 'sobol'])
def test_more_repeats_begin_with_the_same(method: str) -> None:
    many, few = unit_draws(method, 37, 2, 5), unit_draws(method, 5, 2, 5)
    assert many[:5].tobytes() == few.tobytes()
    assert not np.array_equal(unit_draws(method, 5, 2, 6), few)


def test_nothing_uncertain() -> None:
    assert draws([], Repeats('sobol', 4, 0)).shape == (4, 0)
    assert draws([uncertain(normal=[0.0, 1.0])], Repeats('sobol', 1, 0)).shape == (1, 1)
