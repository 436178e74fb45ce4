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

"""Counts and quantiles of a map against loops over its rows."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

from ctc_chattering.runs.map_data import COLUMNS, GridAxis, MapData, QUANTILES
from map_tables import made_up, table_of
import numpy as np
import pyarrow as pa
import pytest

AXES = {'friction': [2.0, 10.0, 20.0], 'ka': [1.0, 5.0, 15.0, 40.0]}
UNITS = {'friction': 'N*m', 'ka': 'N*m'}


@pytest.fixture(scope='module')
def table() -> Any:
    """Return a map of which rows are missing, in another order than it was run."""
    whole = made_up(AXES, 5)
    random = np.random.default_rng(3)
    rows = random.permutation(len(whole))[:200]
    rows = rows[rows // 5 != rows[0] // 5]  # A cell without a run.
    return whole.take(pa.array(rows[np.argsort(rows % 7, kind='stable')]))


@pytest.fixture(scope='module')
def data(table: Any) -> MapData:
    return MapData(table, UNITS, ('model', 'noise'))


def cells(table: Any) -> dict[tuple[str, float, float], list[dict[str, Any]]]:
    found = defaultdict(list)
    for row in table.to_pylist():
        found[row['variant'], row['friction'], row['ka']].append(row)
    return found


def test_counts_are_those_of_the_rows(table: Any, data: MapData) -> None:
    rows = cells(table)
    assert data.shape == (3, 4)
    assert data.variants == tuple(dict.fromkeys(table['variant'].to_pylist()))
    for v, name in enumerate(data.variants):
        for i, friction in enumerate(AXES['friction']):
            for j, ka in enumerate(AXES['ka']):
                mine = rows[name, friction, ka]
                assert data.runs[v, i, j] == len(mine)
                assert data.failed[v, i, j] == sum(row['failure'] != '' for row in mine)
                expected = data.failed[v, i, j] / len(mine) if mine else np.nan
                assert data.probability[v, i, j] == pytest.approx(expected, nan_ok=True)
    assert data.runs.min() == 0, 'the test needs an empty cell'


def test_quantiles_are_those_of_numpy(table: Any, data: MapData) -> None:
    rows = cells(table)
    infinite = 0
    for v, name in enumerate(data.variants):
        for i, friction in enumerate(AXES['friction']):
            for j, ka in enumerate(AXES['ka']):
                errors = np.array([np.inf if row['error'] is None else row['error']
                                   for row in rows[name, friction, ka]])
                # To numpy, a multiple of an infinite number is none.
                expected = np.full(3, np.nan) if not len(errors) else np.quantile(
                    np.where(np.isinf(errors), 1e300, errors), QUANTILES)
                expected[expected > 1e290] = np.inf
                infinite += int(np.isinf(expected).sum())
                assert data.quantiles[:, v, i, j] == pytest.approx(expected, nan_ok=True)
    assert infinite, 'the test needs runs that diverged'
    assert np.array_equal(data.median, data.quantiles[1], equal_nan=True)


def test_the_order_of_the_rows_does_not_matter(table: Any, data: MapData) -> None:
    order = np.argsort(np.asarray(table['run']))
    other = MapData(table.take(pa.array(order)), UNITS, ('model', 'noise'))
    moved = [other.variants.index(name) for name in data.variants]
    assert np.array_equal(other.runs[moved], data.runs)
    assert np.array_equal(other.quantiles[:, moved], data.quantiles, equal_nan=True)


def test_what_was_run(table: Any, data: MapData) -> None:
    assert [axis.label for axis in data.axes] == ['friction [N·m]', 'ka [N·m]']
    assert [axis.values for axis in data.axes] == [tuple(x) for x in AXES.values()]
    assert data.runs.max() == 5
    assert data.base is not None
    assert data.variants[data.base] == 'compensation'
    assert data.laws[data.variants.index('chattering sign')] == 'chattering'
    assert set(COLUMNS) <= set(table.column_names)
    small = table.select([*COLUMNS, *AXES, *data.uncertain])
    assert np.array_equal(MapData(small, UNITS, data.uncertain).runs, data.runs)


def test_an_axis_of_one_value_is_no_axis() -> None:
    table = made_up({'friction': [8.0], 'ka': [5.0, 10.0]}, 3)
    data = MapData(table, UNITS)
    assert [axis.name for axis in data.axes] == ['ka']
    assert data.runs.tolist() == [[3, 3]] * 6


def test_without_axes_or_base() -> None:
    data = MapData(made_up({}, 7, variants=('chattering sign',)), {}, ('model',))
    assert data.shape == ()
    assert data.runs.tolist() == [7]
    assert data.base is None
    assert data.median[0] == pytest.approx(np.median(data.rows['error']))


def test_refused_runs_are_failures() -> None:
    columns = {'error': [[[np.nan, np.nan]], [[0.1, 0.2]]],
               'failure': [[['refused', 'refused']], [['', 'error']]]}
    data = MapData(table_of(('compensation',), {'ka': [1.0, 2.0]}, columns), {'ka': ''})
    assert data.failed.tolist() == [[2, 1]]
    assert data.median.tolist() == [[np.inf, pytest.approx(0.15)]]


def test_words() -> None:
    assert GridAxis('ka', (1.0, 2.0), 'N·m').label == 'ka [N·m]'
    assert GridAxis('load', (1.0, 2.0)).label == 'load'
    assert GridAxis('ka', (1.0, 2.5), 'N·m').at(1) == 'ka 2.5 N·m'
    assert GridAxis('load', (1e-7, 2.0)).at(0) == 'load 1e-07'
