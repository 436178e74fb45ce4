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

"""Distributions, read back from the axes, and correlations."""

from __future__ import annotations

from ctc_chattering.runs.map_data import dependence_table, MapData, rank_correlations
from ctc_chattering.runs.map_figures import distributions
from map_tables import made_up, table_of
import numpy as np
import pytest
from scipy.stats import ecdf  # type: ignore[import-untyped]

pytestmark = pytest.mark.filterwarnings('error')


@pytest.fixture(scope='module')
def data() -> MapData:
    found = MapData(made_up({'ka': [4.0, 30.0]}, 40), {'ka': 'N*m'}, ('model', 'noise'))
    assert found.rows['failure'].nunique() > 3
    return found


def test_distributions_are_those_of_scipy(data: MapData) -> None:
    (ax,) = distributions(data).axes
    for v, line in enumerate(ax.lines):
        mine = data.of(v)['error'].to_numpy()
        expected = ecdf(mine[np.isfinite(mine)]).cdf
        part = np.isfinite(mine).mean()
        x, y = np.asarray(line.get_data())
        assert x[:-1] == pytest.approx(expected.quantiles)
        assert y[:-1] == pytest.approx(expected.probabilities * part)
        assert y[-1] == pytest.approx(part), 'a run that diverged has no error'
        assert line.get_drawstyle() == 'steps-post'
        assert line.get_label() == data.variants[v]


def test_a_long_distribution_is_thinned() -> None:
    error = np.random.default_rng(0).permutation(np.arange(1.0, 5001.0))
    data = MapData(table_of(('compensation',), {}, {
        'error': error.reshape(1, 1, -1), 'failure': np.full((1, 1, 5000), '')}), {})
    x, y = np.asarray(distributions(data).axes[0].lines[0].get_data())
    assert len(x) <= 1001
    assert y[:-1] * 5000.0 == pytest.approx(x[:-1])
    assert x[0] == 1.0 and x[-2] == 5000.0


def test_correlations_have_spearmans_closed_form() -> None:
    """Check 1 - 6 Σd² / (n (n² - 1)) on draws without ties; a run that diverged is the last."""
    random, n = np.random.default_rng(5), 30
    model, error = random.random(n), random.random(n)
    error[np.argmax(error)] = np.nan
    data = MapData(table_of(('compensation', 'chattering sign'), {}, {
        'error': np.stack([error, np.full(n, 0.5)])[np.newaxis],
        'failure': np.where(np.isnan([error, np.zeros(n)]), 'diverged', '')[np.newaxis]},
        {'model': model, 'same': np.ones(n)}), {}, ('model', 'same'))
    ranks = [np.argsort(np.argsort(np.nan_to_num(x, nan=9.0))) for x in (model, error)]
    expected = 1.0 - 6.0 * np.square(ranks[0] - ranks[1]).sum() / (n * (n * n - 1.0))
    assert rank_correlations(data) == pytest.approx(
        np.array([[expected, np.nan], [np.nan, np.nan]]), nan_ok=True)


def test_the_table_has_the_correlations(data: MapData) -> None:
    table = dependence_table(data)
    assert table.heads == ['law', 'ka', 'model', 'noise']
    assert [row[0] for row in table.rows] == list(data.variants)
    assert np.array([row[1:] for row in table.rows], float) == pytest.approx(
        rank_correlations(data), abs=0.0051)
