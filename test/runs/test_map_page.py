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

"""Tables, page and figures of a map: their numbers, and what is beside the results."""

from __future__ import annotations

from pathlib import Path
import re
from typing import Any

from ctc_chattering.analysis.tables import Table
from ctc_chattering.runs import map_figures
from ctc_chattering.runs.map_data import MapData
from ctc_chattering.runs.map_figures import (
    draw_errors,
    draw_failures,
    draw_gain,
    draw_lines,
    NO_NUMBER,
)
from ctc_chattering.runs.map_page import base_tables, failure_table, headline, lead, write_report
from ctc_chattering.runs.spec import spec_rows
from figure_layout import overlaps
from map_specs import spec
from map_tables import LAWS, made_up, table_of
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
import numpy as np
import pytest
from scipy.stats import binomtest  # type: ignore[import-untyped]

GRID = {'friction': [2.0, 8.0, 20.0], 'ka': [1.0, 5.0, 15.0, 40.0]}


def cells(table: Table) -> list[list[str]]:
    """Return the rows as plain text, the lines of a cell apart."""
    return [[re.sub('<.*?>', '', cell.replace('<br>', '\n')).replace('\N{NO-BREAK SPACE}', ' ')
             for cell in row] for row in table.rows]


def test_the_table_has_the_shares_of_the_rows() -> None:
    table = made_up(GRID, 5)
    rows, found = table.to_pylist(), failure_table(MapData(table, dict.fromkeys(GRID, 'N*m')))
    kinds = [x for x in ('diverged', 'error', 'saturated') if x in found.heads]
    assert set(kinds) == {row['failure'] for row in rows} - {''}
    assert [line[0] for line in found.rows] == list(dict.fromkeys(x['variant'] for x in rows))
    for line in cells(found):
        mine = [row for row in rows if row['variant'] == line[0]]
        counts = [sum(row['failure'] != '' for row in mine), *(
            sum(row['failure'] == kind for row in mine) for kind in kinds)]
        assert line[1] == f'{len(mine)}' == '60'
        for k, cell in zip(counts, line[2:-1]):
            share, _, interval = cell.partition('\n')
            assert share == f'{k / 0.6:.1f} %'
            low, high = map(float, interval.split(' to '))
            # At least as wide as if all 60 runs were independent, for five draws are shared.
            alone = binomtest(k, 60).proportion_ci(method='wilson')
            assert low <= 100 * alone.low + 0.06 and high >= 100 * alone.high - 0.06
        errors = sorted(np.inf if row['error'] is None else row['error'] for row in mine)
        for text, value in zip(line[-1].split('\n'), (errors[29], errors[56])):
            if np.isinf(value):
                assert text == 'diverged'
            else:
                assert float(text.replace('−', '-')) == pytest.approx(value, rel=5e-3)


def test_the_worst_law_comes_first() -> None:
    failure = np.full((2, 3, 4), '', object)
    failure[0, 1] = 'error'
    failure[:, 2] = 'diverged'
    failure[1, 0, 0] = 'error'
    data = MapData(table_of(('compensation', 'chattering sign', 'observer_feedback'),
                            {'ka': [1.0, 2.0]}, {
        'error': np.where(failure == 'diverged', np.nan, 1.0), 'failure': failure}), {'ka': 'N*m'})
    (found,) = base_tables(data)
    assert found.heads == ['law', 'runs', 'only the law fails', 'only compensation fails']
    assert cells(found) == [
        ['observer_feedback', '8', '7', '0'], ['chattering sign', '8', '4', '1']]
    assert headline(data) == (
        'compensation fails in 12.5 %, observer_feedback in 100.0 % of the runs')
    assert lead(data) == '3 laws over ka, 2 points: 24 runs.'


def test_one_law_that_never_fails() -> None:
    data = MapData(table_of(('compensation',), {'ka': [3.0]}, {
        'error': [[[1e-5, 1e-4]]], 'failure': [[['', '']]]}), {'ka': 'N*m'})
    assert headline(data) == 'compensation fails in 0.0 % of the runs'
    assert lead(data) == '1 law: 2 runs.'
    assert not list(base_tables(data))
    assert cells(failure_table(data)) == [
        ['compensation', '2', '0.0 %\n0.0 to 65.8', '1.00e-05\n1.00e-04']]


def test_page_and_figures_of_a_spec(tmp_path: Path) -> None:
    ka = {'parameter': 'controller.ka', 'values': [5, 20]}
    small = spec(axes={'ka': ka}, laws=['compensation', 'chattering sign'])
    found = dict(spec_rows(small.tree))
    assert found['laws'] == '[compensation, chattering sign]'
    assert found['axes ka'] == '{parameter: controller.ka, values: [5, 20]}'
    table = made_up({'ka': [5.0, 20.0]}, 3, variants=[x.name for x in small.variants])
    text = write_report(small, table, tmp_path / 'out').read_text(encoding='utf-8')
    assert (tmp_path / 'out' / 'figures' / 'lines.svg').is_file()
    for part in ('src="figures/lines.svg"', 'href="map.parquet"', 'href="map.json"',
                 'ka [N·m]', 'Values of ka [N·m] at which less than half'):
        assert part in text


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
    return draw_errors(plain)


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


def test_the_boundary_and_its_interval() -> None:
    """Check the lines where the probability only depends on the ordinate."""
    n, counts = 16, np.array([0, 2, 6, 11, 16])
    failure = np.full((3, 5, 1, n), '', object)
    for j, k in enumerate(counts):
        failure[:, j, :, :k] = 'error'
    data = MapData(table_of(('chattering sign',), {'a': range(3), 'b': range(5)}, {
        'error': np.ones((15, 1, n)), 'failure': failure.reshape(15, 1, n)}), {'a': '', 'b': ''})
    figure = draw_failures(data)
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
    'six laws': lambda: draw_failures(data_of('friction', 'ka', variants=tuple(LAWS), repeats=3)),
    'three axes': lambda: draw_gain(data_of('rate', 'ka', 'delay', variants=tuple(LAWS)[:3]), 0),
    'all diverged': lambda: draw_gain(MapData(table_of(SOME, {'a': [0., 1., 10.], 'b': range(9)}, {
        'error': np.full((27, 3, 1), np.nan), 'failure': np.full((27, 3, 1), 'diverged')}),
        {'a': 'N*m', 'b': ''}), 0),
    'long names': lambda: draw_failures(long_names(3)),
    'long names of an axis': lambda: draw_lines(long_names(1))}


@pytest.mark.parametrize('case', CASES)
def test_nothing_is_over_a_legend_or_a_label(case: str) -> None:
    assert not overlaps(CASES[case]())


def test_figures_are_limited_and_say_so() -> None:
    some: dict[str, Any] = {'friction': [1., 2.], 'ka': [1., 2.], 'delay': range(9)}
    found = list(map_figures.figures(data_of(variants=SOME[1:2], repeats=1, **some)))
    assert [stem for stem, _, _ in found] == ['error', 'failure']
    assert '6 of 9 values of delay are shown.' in found[0][2]
    assert len(panels(found[0][1])) == 6
    four = data_of(variants=SOME[1:2], repeats=1, **some, load=range(1, 8))
    assert not list(map_figures.figures(four))
