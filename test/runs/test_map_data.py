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

"""Counts, quantiles, intervals, contrasts and Sobol indices of the rows of a map."""

from __future__ import annotations

from math import pi
from typing import Any

from ctc_chattering.runs.map_data import (
    compare_with_base,
    failure_share,
    MapData,
    passing_ranges,
    passing_values,
    pooled_interval,
    QUANTILES,
    sobol_indices,
    sobol_table,
    wilson_interval,
)
from ctc_chattering.runs.run_lists import draw_unit_cube
from map_tables import made_up, table_of
import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pytest
from scipy.stats import binomtest, norm  # type: ignore[import-untyped]

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


@pytest.mark.parametrize(('laws', 'axes'), [
    (1, {'friction': [2.0, 10.0]}), (2, {}), (1, {'friction': [2.0, 10.0], 'ka': [1.0]}),
    (3, {'friction': [2.0], 'ka': [1.0]}), (1, {'friction': [2.0]})])
def test_a_map_may_have_as_many_runs_as_labels(laws: int, axes: dict[str, list[float]]) -> None:
    """Check so few runs that there is a row for each axis and one for the law."""
    names = ['compensation', 'chattering sign', 'chattering implicit'][:laws]
    made = MapData(made_up(axes, 1, variants=names), dict.fromkeys(axes, ''))
    assert made.runs.shape == (laws, *(len(x) for x in axes.values() if len(x) > 1))
    assert (made.runs == 1).all()


def test_each_cell_has_the_numbers_of_its_rows(table: Any, data: MapData) -> None:
    """In whatever order rows are; to NumPy, a multiple of an infinite number is none."""
    rows, infinite = table.to_pandas().fillna({'error': np.inf}), 0
    assert data.variants == tuple(rows['variant'].unique())
    for place in np.ndindex(data.runs.shape):
        name, friction, ka = (x[k] for x, k in zip((data.variants, *AXES.values()), place))
        mine = rows[(rows['variant'] == name) & (rows['friction'] == friction)
                    & (rows['ka'] == ka)]
        failed, errors = mine['failure'] != '', mine['error'].clip(upper=1e300)
        assert (data.runs[place], data.failed[place]) == (len(mine), failed.sum())
        assert data.probability[place] == pytest.approx(failed.mean(), nan_ok=True)
        expected = errors.quantile(list(QUANTILES)).to_numpy()
        expected = np.where(expected > 1e290, np.inf, expected)
        there = (slice(None), *place)
        infinite += int(np.isinf(expected).sum())
        assert data.quantiles[there] == pytest.approx(expected, nan_ok=True)
    assert data.runs.min() == 0 < infinite, 'the test needs an empty cell, and divergence'


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


LAWS = ('compensation', 'chattering sign')


def contrast(data: MapData, variant: int, base: int) -> Any:
    """Return the row of a law."""
    return compare_with_base(data, base).loc[data.variants[variant]]


def grid(failures: Any, errors: Any = None, axes: Any = None) -> Any:
    """Return data of both laws over axes a and b; failures of shape (points, 2, repeats)."""
    failures = np.asarray(failures)
    axes = {'a': [1.0, 2.0], 'b': [10.0, 20.0, 40.0]} if axes is None else axes
    table = table_of(LAWS, axes, {
        'error': np.full(failures.shape, 0.01) if errors is None else errors,
        'failure': np.where(failures, 'error', '')})
    return MapData(table, {name: {'a': 'N*m'}.get(name, '') for name in axes})


def test_runs_are_compared_one_by_one() -> None:
    """Check counts against pairs of rows, some without a partner."""
    table = made_up({'friction': [2.0, 10.0], 'ka': [1.0, 12.0, 40.0]}, 6)
    table = table.take(pa.array(np.random.default_rng(0).permutation(len(table))[:150]))
    data = MapData(table, {'friction': '', 'ka': ''})
    rows = {(row['variant'], row['point'], row['repeat']): row['failure'] != ''
            for row in table.to_pylist()}
    base = {key[1:]: failed for key, failed in rows.items() if key[0] == 'compensation'}
    assert data.base is not None
    for v, name in enumerate(data.variants):
        pairs = [(failed, base[point, repeat]) for (variant, point, repeat), failed in rows.items()
                 if variant == name and (point, repeat) in base]
        if v == data.base:
            continue
        found = contrast(data, v, data.base)
        assert found.runs == len(pairs)
        assert found.worse == sum(a and not b for a, b in pairs)
        assert found.better == sum(b and not a for a, b in pairs)
    assert found.worse + found.better


def test_values_that_pass() -> None:
    failures = np.zeros((2, 3, 2, 2), bool)
    failures[0, 1, 0] = True
    failures[:, :, 1] = True
    failures[1, 2, 1, 0] = False  # Half of the runs fail: it does not pass.
    failures[1, 1, 1] = False
    data = grid(failures.reshape(6, 2, 2))
    along_b, along_a = passing_values(data, 1), passing_values(data, 0)
    assert along_b.index.tolist() == ['a 1 N·m', 'a 2 N·m']
    assert along_b.to_numpy().tolist() == [['10, 40', 'none'], ['10 to 40', '20']]
    assert along_a.index.tolist() == ['b 10', 'b 20', 'b 40']
    assert along_a.to_numpy().tolist() == [['1 to 2', 'none'], ['2', '2'], ['1 to 2', 'none']]


def test_the_interval_is_that_of_scipy() -> None:
    k, n = np.array([(k, n) for n in (1, 2, 3, 4, 16, 100) for k in range(n + 1)]).T
    for i, (low, high) in enumerate(zip(*wilson_interval(k, n))):
        expected = binomtest(int(k[i]), int(n[i])).proportion_ci(0.95, 'wilson')
        assert (low, high) == pytest.approx((expected.low, expected.high), abs=1e-12)
        assert 0.0 <= low <= k[i] / n[i] <= high <= 1.0


def test_without_a_run_nothing_is_known() -> None:
    assert [float(x) for x in wilson_interval(0, 0)] == [0.0, 1.0]
    assert np.isnan(failure_share(0, 0))
    assert failure_share([1, 0], [4, 2]).tolist() == [0.25, 0.0]


POINTS = 60


def shared(kind: str, size: float, draws: int, random: np.random.Generator
           ) -> tuple[npt.NDArray[np.int_], float]:
    """Return failures of each draw over 60 points of one axis, and the true probability."""
    if kind == 'draw decides':
        return POINTS * (random.random(draws) < size).astype(int), size
    x = (np.arange(POINTS) + 0.5) / POINTS
    moved = size * random.standard_normal((draws, 1))
    return (x + moved > 0.7).sum(axis=1), float(norm.sf((0.7 - x) / size).mean())


@pytest.mark.parametrize(('kind', 'size'), [
    ('draw decides', 0.5), ('draw decides', 0.1), ('draw decides', 0.02), ('boundary moves', 0.2),
    ('boundary moves', 0.5)])
@pytest.mark.parametrize('draws', [8, 16, 64])
def test_95_percent_are_95_percent_where_points_share_draws(kind: str, size: float, draws: int
                                                            ) -> None:
    """Check the coverage of 400 made-up maps; as if all runs were independent it is below 50 %."""
    random, repeats = np.random.default_rng(0), 400
    covered = np.zeros(2)
    for _ in range(repeats):
        failures, true = shared(kind, size, draws, random)
        low, high = pooled_interval(failures, [POINTS] * draws)
        covered[0] += low <= true <= high
        wrong = wilson_interval(failures.sum(), POINTS * draws)
        covered[1] += wrong[0] <= true <= wrong[1]
    assert 0.9 <= covered[0] / repeats <= 1.0
    assert covered[1] / repeats < 0.5


def test_draws_of_one_run_are_independent_and_one_draw_says_nothing() -> None:
    expected = binomtest(3, 8).proportion_ci(method='wilson')
    assert pooled_interval([1, 0, 0, 1, 1, 0, 0, 0], [1] * 8) == pytest.approx(
        (expected.low, expected.high))
    assert np.isnan(pooled_interval([7], [9])).all()
    assert np.isnan(pooled_interval([7, 0], [9, 0])).all()


def test_a_failure_that_no_draw_shows_is_not_excluded() -> None:
    """Check that 16 draws without a failure exclude no less than 16 runs would."""
    low, high = pooled_interval([0] * 16, [100] * 16)
    assert low == 0.0
    assert high == pytest.approx(0.221, abs=1e-3)
    assert pooled_interval([100] * 16, [100] * 16) == pytest.approx((1.0 - high, 1.0))
    assert high > binomtest(0, 16).proportion_ci(method='wilson').high


@pytest.mark.parametrize(('probability', 'expected'), [
    ([0.0, 0.1, 0.2], '1 to 3'), ([0.5, 0.6, 1.0], 'none'), ([0.0, 0.5, 0.4], '1, 3'),
    ([np.nan, 0.0, 0.0], '2 to 3')])
def test_ranges_are_the_values_that_pass(probability: list[float], expected: str) -> None:
    assert passing_ranges([1.0, 2.0, 3.0], probability) == expected


def test_of_ishigami() -> None:
    """Its indices are known: 0.314, 0.442 and 0; in total 0.558, 0.442 and 0.244."""
    x, y, z = pi * (2.0 * draw_unit_cube('saltelli', 5 * 1024, 3, 0).T - 1.0)
    values = np.sin(x) + 7.0 * np.sin(y) ** 2 + 0.1 * z ** 4 * np.sin(x)
    indices, intervals = sobol_indices(values, 3)
    for k, exact in enumerate(([0.3139, 0.4424, 0.0], [0.5576, 0.4424, 0.2437])):
        value, ends = indices[:, k], intervals[..., k]
        assert value == pytest.approx(exact, abs=0.03)
        assert (ends[0] <= exact).all()
        assert (exact <= ends[1]).all()
        assert (ends[1] - ends[0] < 0.25).all()


def test_draws_are_a_b_and_a_with_one_column_of_b() -> None:
    A, B, *mixed = draw_unit_cube('saltelli', 5 * 8, 3, 1).reshape(5, 8, 3)
    for k, each in enumerate(mixed):
        assert (each[:, k] == B[:, k]).all()
        assert (np.delete(each, k, 1) == np.delete(A, k, 1)).all()


def drawn(diverged: float) -> MapData:
    """Return a map of errors that grow with the first of two draws, and diverge beyond."""
    u = draw_unit_cube('saltelli', 4 * 64, 2, 0)
    error = np.where(u[:, 0] > diverged, np.nan, np.exp(u[:, 0])).reshape(1, 1, -1)
    failure = np.where(np.isnan(error), 'diverged', np.where(error > 2.0, 'error', ''))
    return MapData(table_of(['compensation'], {}, {'error': error, 'failure': failure},
                            {'model': u[:, 0], 'lag': u[:, 1]}), {}, ['model', 'lag'],
                   saltelli=True)


def test_the_table_has_what_varies() -> None:
    """The logarithm of an error is left out where a run has none."""
    table = sobol_table(drawn(2.0))
    assert [row[1] for row in table.rows] == ['log error', 'fails']
    assert [row[1] for row in sobol_table(drawn(0.9)).rows] == ['fails']
    assert table.heads == ['law', 'of', 'model', 'model, total', 'lag', 'lag, total']
    assert table.rows[0][:2] == ['compensation', 'log error']
    assert table.rows[0][3].startswith('1.0')
    assert table.rows[0][5].startswith('0.00')
