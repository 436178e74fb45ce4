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

"""Error and failures over one axis, read back from the axes."""

from __future__ import annotations

from ctc_chattering.analysis.tables import short
from ctc_chattering.runs.figures import law_styles
from ctc_chattering.runs.map_data import MapData
from ctc_chattering.runs.map_figures import lines
from map_tables import made_up
import numpy as np
import pytest
from scipy.stats import binomtest  # type: ignore[import-untyped]

pytestmark = pytest.mark.filterwarnings('error')
KA = np.geomspace(1.0, 40.0, 7)


@pytest.fixture(scope='module')
def data() -> MapData:
    found = MapData(made_up({'ka': KA}, 9), {'ka': 'N*m'})
    assert np.isinf(found.median).any()
    return found


def test_lines_are_the_medians(data: MapData) -> None:
    above, below = lines(data).axes
    assert above.get_yscale() == 'log'
    drawn = {line.get_label(): line for line in above.lines}
    for v, name in enumerate(data.variants):
        finite = np.isfinite(data.median[v])
        assert np.asarray(drawn[name].get_xdata()) == pytest.approx(np.arange(7))
        y = np.asarray(drawn[name].get_ydata())
        assert np.array_equal(y[finite], data.median[v][finite])
        assert np.isnan(y[~finite]).all()
    crosses = [len(np.asarray(line.get_xdata())) for line in above.lines
               if line.get_marker() == 'x']
    assert crosses == np.isinf(data.median).sum(axis=1).tolist()
    assert [above.get_xlabel(), below.get_xlabel()] == ['ka [N·m]'] * 2
    assert [text.get_text() for text in below.get_xticklabels()] == [short(x) for x in KA]


def test_bars_are_wilsons_intervals(data: MapData) -> None:
    below = lines(data).axes[1]
    assert len(below.containers) == len(data.variants)
    for v, container in enumerate(below.containers):
        line, _, (bars,) = container.lines  # type: ignore[attr-defined]
        assert np.array_equal(line.get_ydata(), data.failed[v] / 9)
        for k, segment in zip(data.failed[v], bars.get_segments()):
            interval = binomtest(int(k), 9).proportion_ci(method='wilson')
            assert segment[:, 1] == pytest.approx([interval.low, interval.high])
        assert np.abs(line.get_xdata() - np.arange(7)).max() < 0.5


def test_bands_are_from_5_to_95_percent(data: MapData) -> None:
    above = lines(data).axes[0]
    top = above.get_ylim()[1]
    for v, band in enumerate(above.collections):
        ends = np.asarray(band.get_paths()[0].vertices)
        for x, low, high in zip(range(7), *data.quantiles[[0, 2], v]):
            here = ends[np.isclose(ends[:, 0], x), 1]
            assert (here.min(), here.max()) == pytest.approx((min(low, top), min(high, top)))


def test_styles_differ_without_colour(data: MapData) -> None:
    looks = law_styles(data.laws)
    assert len({(look['marker'], look['linestyle']) for look in looks}) == len(looks)
    assert len({look['color'] for look in looks}) == len(looks)
    assert looks[0]['color'] == '#D55E00'


def test_a_map_in_which_all_runs_diverged() -> None:
    table = made_up({'ka': [400.0, 800.0]}, 2, variants=('chattering sign',))
    data = MapData(table, {'ka': ''})
    assert np.isinf(data.median).all()
    above = lines(data).axes[0]
    assert [len(np.asarray(line.get_xdata())) for line in above.lines
            if line.get_marker() == 'x'] == [2]
