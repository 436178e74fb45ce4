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

"""Distributions, kinds of failure and correlations, read back from the axes."""

from __future__ import annotations

from ctc_chattering.runs.map_data import KINDS, MapData, pooled
from ctc_chattering.runs.map_figures import (
    correlations,
    distributions,
    KIND_COLOURS,
    rank_correlations,
    shares,
)
from map_tables import made_up, table_of
from matplotlib.patches import Rectangle
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


def test_bars_are_the_shares_of_the_kinds(data: MapData) -> None:
    figure = shares(data)
    (ax,) = figure.axes
    bars = [x for x in ax.patches if isinstance(x, Rectangle)]
    for kind, colour in enumerate(KIND_COLOURS):
        mine = [bar for bar in bars if same(bar, colour)]
        counts = [int((data.of(v)['failure'] == KINDS[kind]).sum())
                  for v in range(len(data.variants))]
        assert [bar.get_width() for bar in mine] == pytest.approx(
            [n / 80 for n in counts] if any(counts) else [])
        worse = [int(data.of(v)['failure'].isin(KINDS[:kind]).sum())
                 for v in range(len(data.variants))]
        assert [bar.get_x() for bar in mine] == pytest.approx([n / 80 for n in worse][:len(mine)])
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        kind for kind in KINDS if (data.rows['failure'] == kind).any()]
    (interval,) = ax.collections
    for v, segment in enumerate(interval.get_segments()):  # type: ignore[attr-defined]
        rows = data.of(v)
        draws = [rows['failure'][rows['repeat'] == k] != '' for k in rows['repeat'].unique()]
        assert segment[:, 0] == pytest.approx(pooled([x.sum() for x in draws], [*map(len, draws)]))
    assert [text.get_text() for text in ax.get_yticklabels()] == list(data.variants)


def test_one_draw_has_no_interval() -> None:
    """Check that there is no bar, and no warning."""
    data = MapData(made_up({'ka': [1.0, 8.0, 40.0]}, 1), {'ka': ''})
    (interval,) = shares(data).axes[0].collections
    assert not any(len(x) for x in interval.get_segments())  # type: ignore[attr-defined]


def same(bar: Rectangle, colour: str) -> bool:
    return tuple(bar.get_facecolor()[:3]) == tuple(
        int(colour[k:k + 2], 16) / 255.0 for k in (1, 3, 5))


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


def test_bars_are_the_correlations(data: MapData) -> None:
    figure = correlations(data)
    for ax, name, expected in zip(figure.axes, data.variants, rank_correlations(data),
                                  strict=True):
        bars = [x for x in ax.patches if isinstance(x, Rectangle)]
        assert ax.get_title('left') == name
        assert [bar.get_width() for bar in bars] == pytest.approx(expected)
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == [
        'ka', 'model', 'noise']


def test_without_axes_the_figure_shows_what_chance_gives() -> None:
    data = MapData(made_up({}, 65), {}, ('model', 'noise'))
    ax = correlations(data).axes[0]
    *_, band = (x for x in ax.patches if isinstance(x, Rectangle))
    assert (band.get_x(), band.get_width()) == pytest.approx((-1.96 / 8.0, 2 * 1.96 / 8.0))
