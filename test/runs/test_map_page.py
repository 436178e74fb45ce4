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

"""The page of a map, read back, and what is beside it."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.drawing import FigureFile
from ctc_chattering.errors import CtcError
from ctc_chattering.runs.map_data import MapData
from ctc_chattering.runs.map_page import write_map_page, write_report
from ctc_chattering.runs.spec import MapSpec, read_spec, rows_of
from map_tables import made_up, table_of
import numpy as np
import pytest
from scipy.stats import binomtest  # type: ignore[import-untyped]

AXES = {'friction': [2.0, 8.0, 20.0], 'ka': [1.0, 5.0, 15.0, 40.0]}
UNITS = {'friction': 'N*m', 'ka': 'N*m'}


class Page(HTMLParser):
    """Collects texts and tables, and checks that tags nest."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.source = path.read_text(encoding='utf-8')
        self.open: list[str] = []
        self.texts: dict[str, list[str]] = {}
        self.tables: list[list[list[str]]] = []
        self.classes: list[tuple[str, str]] = []
        self.feed(self.source)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.classes += [(tag, value or '') for name, value in attrs if name == 'class']
        if tag == 'br':
            self.handle_data('\n')
        elif tag not in ('meta', 'img', 'wbr'):
            self.open.append(tag)
            self.texts.setdefault(tag, []).append('')
        if tag == 'table':
            self.tables.append([])
        elif tag == 'tr':
            self.tables[-1].append([])
        elif tag in ('td', 'th'):
            self.tables[-1][-1].append('')

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        data = data.replace('\N{NO-BREAK SPACE}', ' ')
        for tag in set(self.open):
            self.texts[tag][-1] += data
        if {'td', 'th'} & set(self.open):
            self.tables[-1][-1][-1] += data


def written(data: MapData, path: Path, facts: dict[str, str] | None = None) -> Page:
    write_map_page(data, [FigureFile(path / 'figures' / 'a.svg', 'A', 'B.')],
                   path / 'index.html', facts or {})
    return Page(path / 'index.html')


@pytest.fixture(scope='module')
def table() -> Any:
    return made_up(AXES, 5)


@pytest.fixture
def page(table: Any, tmp_path: Path) -> Page:
    return written(MapData(table, UNITS, ('model', 'noise')), tmp_path,
                   {'a run fails if': 'error > 0.005 rad & more', 'ka': 'gain',
                    'model': 'uniform'})


def test_the_table_has_the_shares_of_the_rows(table: Any, page: Page) -> None:
    rows = table.to_pylist()
    head, *lines = page.tables[0]
    kinds = [x for x in ('diverged', 'error', 'saturated') if x in head]
    assert set(kinds) == {row['failure'] for row in rows} - {''}
    assert [line[0] for line in lines] == list(dict.fromkeys(row['variant'] for row in rows))
    for line in lines:
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


def test_the_worst_law_comes_first(tmp_path: Path) -> None:
    failure = np.full((2, 3, 4), '', object)
    failure[0, 1] = 'error'
    failure[:, 2] = 'diverged'
    failure[1, 0, 0] = 'error'
    data = MapData(table_of(('compensation', 'chattering sign', 'observer_feedback'),
                            {'ka': [1.0, 2.0]}, {
        'error': np.where(failure == 'diverged', np.nan, 1.0), 'failure': failure}), {'ka': 'N*m'})
    page = written(data, tmp_path)
    head, *rows = page.tables[1]
    assert head == ['law', 'runs', 'only the law fails', 'only compensation fails']
    assert rows == [['observer_feedback', '8', '7', '0'], ['chattering sign', '8', '4', '1']]
    assert page.texts['h1'] == ['compensation fails in 12.5 %, observer_feedback in 100.0 % of '
                                'the runs']
    assert page.tables[2][1] == ['ka [N·m]', '1 to 2', '2', 'none']


def test_values_that_pass_along_each_axis(page: Page) -> None:
    assert [text for text in page.texts['summary'] if text.startswith('Values')] == [
        f'Values of {name} [N·m] at which less than half of the runs fail' for name in AXES]
    over_friction, over_ka = page.tables[2:4]
    assert over_friction[0][0] == 'ka' and over_ka[0][0] == 'friction'
    assert [line[0] for line in over_friction[1:]] == [f'ka {x:g} N·m' for x in AXES['ka']]
    assert [line[0] for line in over_ka[1:]] == [f'friction {x:g} N·m' for x in AXES['friction']]
    assert all(len(line) == 7 for line in over_ka)


def test_what_was_run(page: Page) -> None:
    assert dict(page.tables[-1]) == {
        'ka': 'gain', 'model': 'uniform',
        'a run fails if': 'error > 0.005 rad & more'}
    assert page.texts['p'][0] == '6 laws over friction × ka, 12 points: 360 runs.'
    assert any('map.parquet (a row a run)' in text for text in page.texts['p'])


def test_draws_only_and_no_base(tmp_path: Path) -> None:
    page = written(MapData(made_up({}, 1200, variants=('chattering sign',)), {}), tmp_path)
    assert page.texts['p'][0] == '1 law: 1\N{NARROW NO-BREAK SPACE}200 runs.'
    assert 'Against' not in page.source
    assert 'points' not in ' '.join(page.tables[0][0])
    assert len(page.tables) == 2


def test_no_failure_and_one_value(tmp_path: Path) -> None:
    data = MapData(table_of(('compensation',), {'ka': [3.0]}, {
        'error': [[[1e-5, 1e-4]]], 'failure': [[['', '']]]}), {'ka': 'N*m'})
    page = written(data, tmp_path)
    assert page.texts['h1'] == ['compensation fails in 0.0 % of the runs']
    assert page.tables[0][1] == ['compensation', '2', '0.0 %\n0.0 to 65.8', '1.00e-05\n1.00e-04']


def test_a_page_that_cannot_be_written(table: Any, tmp_path: Path) -> None:
    with pytest.raises(CtcError, match=r'^cannot write '):
        write_map_page(MapData(table, UNITS), [], tmp_path, {})


SPEC = """
params_file: friction
duration: 3.0
window: [1.0, 2.5]
laws: [compensation, chattering sign]
axes:
  ka: {parameter: controller.ka, values: [5, 20]}
  load: {parameter: plant.coulomb_friction, values: [1], factor: true}
uncertain:
  model: {parameters: [controller.inertia_scale, controller.gravity_scale], uniform: [0.8, 1.2]}
  noise: {parameter: plant.position_noise, log_uniform: [1.0e-5, 2.0e-4]}
sampling: latin_hypercube
repeats: 3
seed: 4
failure: {error_above: 0.005, saturated_above: 0.25, not_reached: true}
"""


@pytest.fixture
def spec(tmp_path: Path) -> MapSpec:
    path = tmp_path / 'small.yaml'
    path.write_text(SPEC, encoding='utf-8')
    return read_spec(path)


def test_the_page_has_the_spec_as_it_was_given(spec: MapSpec) -> None:
    found = dict(rows_of(spec.tree))
    assert found['window'] == '[1.0, 2.5]'
    assert found['laws'] == '[compensation, chattering sign]'
    assert found['axes ka'] == '{parameter: controller.ka, values: [5, 20]}'
    assert found['uncertain noise'] == (
        '{parameter: plant.position_noise, log_uniform: [1.0e-05, 0.0002]}')
    assert (found['sampling'], found['seed']) == ('latin_hypercube', '4')
    assert found['failure error_above'] == '0.005'
    assert found['failure not_reached'] == 'true'


def test_figures_and_page_are_beside_the_results(spec: MapSpec, tmp_path: Path) -> None:
    table = made_up({axis.name: axis.values for axis in spec.axes}, 3,
                    variants=[x.name for x in spec.variants])
    page = write_report(spec, table, tmp_path / 'out')
    assert page == tmp_path / 'out' / 'index.html'
    text = page.read_text(encoding='utf-8')
    for file in ('lines',):
        assert (tmp_path / 'out' / 'figures' / f'{file}.svg').is_file()
        assert f'src="figures/{file}.svg"' in text
    assert 'href="map.parquet"' in text and 'href="map.json"' in text
    assert '[1.0, 2.5]' in text
    assert 'ka [N·m]' in text
