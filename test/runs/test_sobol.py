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

"""Sobol indices against a closed form, and what a page says of them."""

from __future__ import annotations

from math import pi

from ctc_chattering.runs.map_data import MapData, sobol_indices, sobol_table
from ctc_chattering.runs.points import unit_draws
from map_tables import table_of
import numpy as np
import pytest


def test_of_ishigami() -> None:
    """Its indices are known: 0.314, 0.442 and 0; in total 0.558, 0.442 and 0.244."""
    x, y, z = pi * (2.0 * unit_draws('saltelli', 5 * 1024, 3, 0).T - 1.0)
    values = np.sin(x) + 7.0 * np.sin(y) ** 2 + 0.1 * z ** 4 * np.sin(x)
    indices, intervals = sobol_indices(values, 3)
    for k, exact in enumerate(([0.3139, 0.4424, 0.0], [0.5576, 0.4424, 0.2437])):
        value, ends = indices[:, k], intervals[..., k]
        assert value == pytest.approx(exact, abs=0.03)
        assert (ends[0] <= exact).all()
        assert (exact <= ends[1]).all()
        assert (ends[1] - ends[0] < 0.25).all()


def test_draws_are_a_b_and_a_with_one_column_of_b() -> None:
    A, B, *mixed = unit_draws('saltelli', 5 * 8, 3, 1).reshape(5, 8, 3)
    for k, each in enumerate(mixed):
        assert (each[:, k] == B[:, k]).all()
        assert (np.delete(each, k, 1) == np.delete(A, k, 1)).all()


def data(diverged: float) -> MapData:
    """Return a map of errors that grow with the first of two draws, and diverge beyond."""
    u = unit_draws('saltelli', 4 * 64, 2, 0)
    error = np.where(u[:, 0] > diverged, np.nan, np.exp(u[:, 0])).reshape(1, 1, -1)
    failure = np.where(np.isnan(error), 'diverged', np.where(error > 2.0, 'error', ''))
    return MapData(table_of(['compensation'], {}, {'error': error, 'failure': failure},
                            {'model': u[:, 0], 'lag': u[:, 1]}), {}, ['model', 'lag'],
                   saltelli=True)


def test_the_table_has_what_varies() -> None:
    """The logarithm of an error is left out where a run has none."""
    table = sobol_table(data(2.0))
    assert [row[1] for row in table.rows] == ['log error', 'fails']
    assert [row[1] for row in sobol_table(data(0.9)).rows] == ['fails']
    assert table.heads == ['law', 'of', 'model', 'model, total', 'lag', 'lag, total']
    assert table.rows[0][:2] == ['compensation', 'log error']
    assert table.rows[0][3].startswith('1.0')
    assert table.rows[0][5].startswith('0.00')
