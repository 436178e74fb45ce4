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

"""What the figures of a map show, over one axis and two, read back from their axes."""

from __future__ import annotations

from collections.abc import Iterator
import itertools
from pathlib import Path
from typing import Any

from ctc_chattering.analysis import drawing
from ctc_chattering.runs import map_figures
from ctc_chattering.runs.figures import law_styles
from ctc_chattering.runs.map_data import MapData
from ctc_chattering.runs.map_figures import (
    error_map,
    failure_map,
    gain_map,
    lines,
    NO_NUMBER,
)
from figure_layout import overlaps
from map_tables import LAWS, made_up, table_of
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import QuadMesh
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.text import Text
import numpy as np
import pytest
from scipy.stats import binomtest  # type: ignore[import-untyped]

pytestmark = pytest.mark.filterwarnings('error')
AXES: dict[str, Any] = {
    'friction': [2.0, 5.0, 10.0, 20.0], 'ka': np.geomspace(1.0, 40.0, 9),
    'delay': [0.0, 1.0, 2.0], 'load': [0.5, 1.0, 2.0], 'rate': [5e-4, 1e-3, 2e-3]}
UNITS = {'friction': 'N*m', 'ka': 'N*m', 'delay': 'samples', 'load': '', 'rate': 's'}
SOME = ('compensation', 'chattering sign', 'chattering implicit')


def data_of(*names: str, repeats: int = 5, variants: tuple[str, ...] = SOME, **axes: Any
            ) -> MapData:
    axes = {name: AXES[name] for name in names} | axes
    return MapData(made_up(axes, repeats, variants=variants),
                   {name: UNITS[name] for name in axes}, ('model', 'noise'))


def panels(figure: Figure) -> list[Axes]:
    """Return the axes of maps: all but the colour bar."""
    return [ax for ax in figure.axes if ax.patch.get_hatch()]


def meshes(ax: Axes) -> list[QuadMesh]:
    return [x for x in ax.collections if isinstance(x, QuadMesh)]


def shown(ax: Axes) -> Any:
    """Return the numbers of a panel, shape (ny, nx); nan where there is none."""
    values: Any = meshes(ax)[0].get_array()
    return np.ma.filled(values.astype(float), np.nan)


def names(figure: Figure) -> list[str]:
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


@pytest.fixture(scope='module')
def plain() -> MapData:
    return data_of('friction', 'ka')


@pytest.fixture(scope='module')
def figure(plain: MapData) -> Figure:
    return error_map(plain)


def test_colours_are_the_median_errors(plain: MapData, figure: Figure) -> None:
    limits = {meshes(ax)[0].get_clim() for ax in panels(figure)}
    (low, high), = limits
    finite = plain.median[np.isfinite(plain.median)]
    assert low == finite.min() and high == finite.max()
    for v, ax in enumerate(panels(figure)):
        assert ax.get_title('left') == plain.variants[v]
        expected = np.where(np.isinf(plain.median[v]), np.nan, plain.median[v])
        assert np.array_equal(shown(ax), expected.T, equal_nan=True)
    assert np.isinf(plain.median).any()
    assert names(figure) == [NO_NUMBER]
    assert [ax.get_ylabel() for ax in figure.axes if ax not in panels(figure)] == [
        'median of the RMS error [rad]']


def test_cells_are_at_their_values(figure: Figure) -> None:
    ax = panels(figure)[0]
    corners = np.asarray(meshes(ax)[0].get_coordinates())
    for k, values in enumerate(np.arange(len(AXES[name])) for name in ('friction', 'ka')):
        edges = np.unique(corners[..., k])
        assert len(edges) == len(values) + 1
        assert (edges[:-1] < values).all() and (values < edges[1:]).all()
        assert (ax.get_xlim(), ax.get_ylim())[k] == pytest.approx((edges[0], edges[-1]))
    assert {x.get_xlabel() for x in panels(figure)} == {'friction [N·m]'}
    assert {x.get_ylabel() for x in panels(figure)} == {'ka [N·m]'}
    assert [x.get_text() for x in ax.get_xticklabels()] == ['2', '5', '10', '20']


def test_gains_are_decades_and_extremes_are_named() -> None:
    median = np.array([[1e-2, 1e-2, 1e-2, np.nan, np.nan, 1e-3],
                       [1e-3, 1e-1, np.nan, 1e-3, np.nan, 1e-3]])
    data = MapData(table_of(SOME[:2], {'a': [1., 2.], 'b': [1., 2., 3.]}, {
        'error': median.T[..., np.newaxis], 'failure': np.where(
            np.isnan(median), 'diverged', '').T[..., np.newaxis]}), {'a': '', 'b': ''})
    figure = gain_map(data, 0)
    (ax,) = panels(figure)
    assert ax.get_title('left') == 'chattering sign'
    mesh = meshes(ax)[0]
    assert shown(ax).T.ravel()[[0, 1, 5]] == pytest.approx([1.0, -1.0, 0.0])
    assert mesh.get_clim() == (-1.0, 1.0)
    colours = mesh.to_rgba(np.ma.asarray(mesh.get_array()).T).reshape(6, 4)
    cmap = mesh.get_cmap()
    assert colours[2].tolist() == list(cmap(0.0))
    assert colours[3].tolist() == list(cmap(1.0))
    assert colours[4, 3] == 0.0  # The hatched background shows.
    assert colours[2, 0] > colours[2, 2] and colours[1, 0] > colours[1, 2], 'red is worse'
    assert colours[3, 2] > colours[3, 0] and colours[0, 2] > colours[0, 0], 'blue is better'
    assert names(figure) == [NO_NUMBER]


def test_the_boundary_and_its_interval() -> None:
    """Check the lines where the probability only depends on the ordinate."""
    n, counts = 16, np.array([0, 2, 6, 11, 16])
    failure = np.full((3, 5, 1, n), '', object)
    for j, k in enumerate(counts):
        failure[:, j, :, :k] = 'error'
    data = MapData(table_of(('chattering sign',), {'a': range(3), 'b': range(5)}, {
        'error': np.ones((15, 1, n)), 'failure': failure.reshape(15, 1, n)}), {'a': '', 'b': ''})
    figure = failure_map(data)
    (ax,) = panels(figure)
    assert shown(ax)[:, 0] == pytest.approx(counts / n)
    intervals = [binomtest(int(k), n).proportion_ci(method='wilson') for k in counts]
    expected = [np.interp(0.5, y, np.arange(5.0)) for y in (
        counts / n, [x.low for x in intervals], [x.high for x in intervals])]
    lines = [x for x in ax.collections if isinstance(x, ContourSet)]
    for line, at in zip(lines, expected, strict=True):
        (path,) = line.get_paths()
        x, y = np.asarray(path.vertices).T
        assert y == pytest.approx(at, abs=1e-6)
        assert np.ptp(x) == pytest.approx(3.0)
    assert len(names(figure)) == 3


def test_half_of_the_runs_is_a_failure() -> None:
    failure = np.array([['', ''], ['error', ''], ['error', 'error'], ['error', 'error']])
    data = MapData(table_of(('compensation',), {'a': [0., 1.], 'b': [0., 1.]}, {
        'error': np.ones((4, 1, 2)), 'failure': failure[:, np.newaxis]}), {'a': '', 'b': ''})
    (ax,) = panels(failure_map(data))
    (line,) = (x for x in ax.collections if isinstance(x, ContourSet))
    corner = np.asarray(line.get_paths()[0].vertices)
    assert corner.min() == pytest.approx(-0.5)
    assert corner.max() == pytest.approx(1.0, abs=1e-6)


def test_refused_and_missing_cells_are_hatched() -> None:
    error, failure = np.full((6, 2, 2), 1e-3), np.full((6, 2, 2), '', object)
    error[2, 1], failure[2, 1] = np.nan, 'refused'
    table = table_of(('compensation', 'chattering sign'), {'a': [1., 2.], 'b': [1., 2., 3.]},
                     {'error': error, 'failure': failure})
    data = MapData(table.slice(0, 20), {'a': '', 'b': ''})
    for draw, expected in ((error_map, [[2, 0], [2, 1]]), (failure_map, [[2, 1]])):
        figure = draw(data)
        first, second = panels(figure)
        assert np.argwhere(np.isnan(shown(first))).tolist() == [[2, 1]]
        assert np.argwhere(np.isnan(shown(second))).tolist() == expected
        assert names(figure)[-1] == NO_NUMBER


def test_a_third_axis() -> None:
    data = data_of('friction', 'ka', 'delay', repeats=2)
    figure = error_map(data)
    assert figure.get_suptitle() == 'RMS error over friction and ka'
    for k, ax in enumerate(panels(figure)):
        expected = data.median[k // 3, :, :, k % 3].T
        expected = np.clip(expected, *meshes(ax)[0].get_clim()) * np.where(
            np.isinf(expected), np.nan, 1.0)
        assert np.clip(shown(ax), *meshes(ax)[0].get_clim()) == pytest.approx(
            expected, nan_ok=True)
    assert [ax.get_title('left') for ax in panels(figure)] == [
        f'{law}\ndelay {k} samples' for law in SOME for k in range(3)]


def test_more_laws_than_fit_beside_each_other_are_rows() -> None:
    data = data_of(friction=[2., 20.], ka=[1., 9.], delay=[0., 1.], variants=tuple(LAWS))
    figure = error_map(data)
    found = panels(figure)
    for k, ax in enumerate(found):
        assert shown(ax)[1, 1] >= data.median[k // 2, 1, 1, k % 2]
    assert [ax.get_title('left') for ax in found[::2]] == [f'{x}\ndelay 0 samples' for x in LAWS]
    assert [ax.get_title('left') for ax in panels(gain_map(data, 0))[::2]] == [
        f'{x}\ndelay 0 samples' for x in list(LAWS)[1:]]


def long_names(axes: int) -> MapData:
    """Return a map of laws, axes and draws of long names."""
    table = made_up({name: AXES[name][:3] for name in list(AXES)[:axes]}, 5)
    laws = [f'{x} with settings of its own' for x in table['variant'].to_pylist()]
    table = table.set_column(table.column_names.index('variant'), 'variant', [laws])
    long = {x: f'a_rather_long_name_for_{x}' for x in (*list(AXES)[:axes], 'model', 'noise')}
    table = table.rename_columns([long.get(x, x) for x in table.column_names])
    return MapData(table, {long[x]: UNITS[x] for x in list(AXES)[:axes]},
                   (long['model'], long['noise']))


CASES: dict[str, Any] = {
    'six laws': lambda: failure_map(data_of('friction', 'ka', variants=tuple(LAWS), repeats=3)),
    'three axes': lambda: gain_map(data_of('rate', 'ka', 'delay', variants=tuple(LAWS)[:3]), 0),
    'more laws than columns': lambda: failure_map(data_of(
        'ka', variants=tuple(LAWS), repeats=4, rate=[5e-4, 1e-3, 2e-3], delay=[0., 1.])),
    'one law, 2x2, one run': lambda: error_map(data_of(
        variants=('chattering sign',), repeats=1, friction=[5e-4, 2e-3], ka=[1.0, 100.0])),
    'all diverged': lambda: gain_map(MapData(table_of(SOME, {'a': [0., 1., 10.], 'b': range(9)}, {
        'error': np.full((27, 3, 1), np.nan), 'failure': np.full((27, 3, 1), 'diverged')}),
        {'a': 'N*m', 'b': ''}), 0),
    'long names': lambda: failure_map(long_names(3)),
    'long names of laws': lambda: error_map(long_names(2)),
    'long names of an axis': lambda: lines(long_names(1)),
    'lines': lambda: lines(data_of('ka', variants=tuple(LAWS)))}


def texts(figure: Figure) -> Iterator[tuple[str, Any]]:
    """Yield the texts of a figure and their boxes."""
    figure.draw_without_rendering()
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
    hidden = [text for ax in figure.axes for axis in (ax.xaxis, ax.yaxis)
              for place, text in zip(axis.get_ticklocs(), axis.get_ticklabels())
              if not min(axis.get_view_interval()) <= place <= max(axis.get_view_interval())]
    for text in figure.findobj(Text):
        if text.get_visible() and text.get_text().strip() and text not in hidden:
            yield text.get_text(), text.get_window_extent(renderer)


@pytest.mark.parametrize('case', CASES)
def test_texts_are_apart_and_on_the_paper(case: str) -> None:
    figure = CASES[case]()
    assert not overlaps(figure)
    found = list(texts(figure))
    assert len(found) > 5
    for text, box in found:
        assert box.x0 >= 0.0 and box.y0 >= 0.0, text
        assert box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1, text
    shrunk = [(text, box.padded(-1.0)) for text, box in found]
    for (one, a), (other, b) in itertools.combinations(shrunk, 2):
        assert not a.overlaps(b), (one, other)


def test_equal_data_give_equal_files(tmp_path: Path) -> None:
    for out in ('a', 'b'):
        data = data_of(friction=[2., 20.], ka=[1., 9.], variants=('chattering sign',))
        with rc_context({'svg.hashsalt': 'map'}):
            files = drawing.save(map_figures.figures(data), tmp_path / out, ['svg'])
    assert [file.path.name for file in files] == [
        'error.svg', 'failure.svg']
    for file in files:
        assert file.path.read_bytes() == (tmp_path / 'a' / file.path.name).read_bytes()


def test_figures_are_limited_and_say_so() -> None:
    some: dict[str, Any] = {'friction': [1., 2.], 'ka': [1., 2.], 'delay': range(9)}
    found = list(map_figures.figures(data_of(variants=SOME[1:2], repeats=1, **some)))
    assert [stem for stem, _, _ in found] == ['error', 'failure']
    assert 'Of delay, 6 of 9 values.' in found[0][2]
    assert len(panels(found[0][1])) == 6
    four = data_of(variants=SOME[1:2], repeats=1, **some, load=range(1, 8))
    assert not list(map_figures.figures(four))


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
    assert [text.get_text() for text in below.get_xticklabels()] == [f'{x:.4g}' for x in KA]


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
