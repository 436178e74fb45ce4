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

"""The page and metrics.json, read back."""

from __future__ import annotations

from html.parser import HTMLParser
import json
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote

from ctc_chattering.analysis.drawing import FigureFile
from ctc_chattering.analysis.result import Result, write_metrics
from ctc_chattering.analysis.run_page import write_page
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.closed_loop import Event, Run, simulate
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
import numpy as np
import pytest

VOID = {'meta', 'img', 'br'}
LAWS = {law: ControllerConfig(law=law) for law in ('compensation', 'chattering')}
PER_JOINT = ('rms_error_rad', 'rms_torque_nm', 'torque_variation_nm_per_s', 'max_torque_step_nm',
             'max_torque_rate_nm_per_s')


class Page(HTMLParser):
    """Collects what a test asks for, and checks that tags nest."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.source = path.read_text(encoding='utf-8')
        self.open: list[str] = []
        self.attributes: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {}
        self.table: list[float] = []
        self.feed(self.source)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
            self.texts.setdefault(tag, []).append('')
        if tag == 'data' and 'table' in self.open:
            self.table.append(float(dict(attrs)['value'] or ''))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        for tag in set(self.open):
            self.texts[tag][-1] += data

    def values(self, tag: str, attribute: str) -> list[str]:
        return [attrs[attribute] or '' for name, attrs in self.attributes
                if name == tag and attribute in attrs]


def result_of(law: str, duration: float, experiment: str = 'friction',
              change: float | None = None) -> Result:
    configs, events = [(0.0, LAWS[law])], []
    if change is not None:
        configs.append((change, LAWS['chattering']))
        events.append(Event(change, 'controller', {'law': 'chattering'}))
    run = simulate(PlantConfig(duration=duration), LAWS[law], ReferenceConfig(), events)
    return Result(experiment, configs, run)


@pytest.fixture(scope='module')
def results() -> list[Result]:
    return [result_of('compensation', 6.0), result_of('chattering', 6.0),
            result_of('compensation', 6.0, 'switch', change=5.0)]


@pytest.fixture
def figures(tmp_path: Path) -> list[FigureFile]:
    """Return files that are only there: the page does not look into them."""
    directory = tmp_path / 'the figures'
    directory.mkdir()
    files = []
    for i in range(3):
        path = directory / f'a & b: {i}.png'
        path.write_bytes(b'')
        files.append(FigureFile(path, f'Title <{i}>', f'Caption "{i}" & more.'))
    return files


def refuse(text: str) -> NoReturn:
    raise AssertionError(f'{text} is not JSON')


def runs_of(path: Path) -> list[dict[str, Any]]:
    runs: list[dict[str, Any]] = json.loads(
        path.read_text(encoding='utf-8'), parse_constant=refuse)['runs']
    return runs


def test_metrics_are_those_of_the_results(results: list[Result], tmp_path: Path) -> None:
    path = tmp_path / 'new' / 'metrics.json'
    write_metrics(results, path)
    assert runs_of(path) == [result.metrics() for result in results]
    assert path.read_text().startswith('{\n  "runs": [\n    {')


def test_metrics_are_strict_json(results: list[Result], tmp_path: Path) -> None:
    run = results[0].run
    tau = run.tau.copy()
    tau[:, 0] = np.nan
    broken = Result('friction', results[0].configs, Run(**{**vars(run), 'tau': tau}),
                    results[0].terms)
    write_metrics([broken], tmp_path / 'metrics.json')
    entry = runs_of(tmp_path / 'metrics.json')[0]
    assert entry['rms_torque_nm'][0] is None
    assert entry['rms_torque_nm'][1] == results[0].metrics()['rms_torque_nm'][1]
    write_page([broken, results[1]], [], tmp_path / 'index.html')
    assert np.isfinite(Page(tmp_path / 'index.html').table).all()


def test_the_table_has_the_numbers_of_the_metrics(
        results: list[Result], figures: list[FigureFile], tmp_path: Path) -> None:
    write_metrics(results, tmp_path / 'metrics.json')
    write_page(results, figures, tmp_path / 'index.html')
    page = Page(tmp_path / 'index.html')
    expected = []
    for run in runs_of(tmp_path / 'metrics.json'):
        expected += [run['max_error_norm1_rad'], run['reaching_time_s']]
        for joint in range(2):
            expected += [run[key][joint] for key in PER_JOINT]
    assert page.table == [x for x in expected if x is not None]
    assert None in expected  # v is never reached under compensation
    for unit in ('rad', 's', 'N·m', 'N·m/s'):
        assert any(head.endswith(f'[{unit}]') for head in page.texts['th'])
    for result in results:
        assert any(result.label in head for head in page.texts['th'])


def test_digits_shown_are_the_value_rounded(results: list[Result], tmp_path: Path) -> None:
    write_page(results, [], tmp_path / 'index.html')
    page = Page(tmp_path / 'index.html')
    for shown, value in zip(page.texts['data'], page.values('data', 'value')):
        assert float(shown) == pytest.approx(float(value), rel=6e-3)


def test_the_page_needs_no_other_resource(
        results: list[Result], figures: list[FigureFile], tmp_path: Path) -> None:
    write_page(results, figures, tmp_path / 'index.html')
    page = Page(tmp_path / 'index.html')
    sources = page.values('img', 'src')
    assert len(sources) == len(figures)
    for source, figure in zip(sources, figures):
        assert not source.startswith('/')
        assert (tmp_path / unquote(source)).samefile(figure.path)
    assert 'http:' not in page.source and 'https:' not in page.source
    assert not {'link', 'iframe'} & {tag for tag, _ in page.attributes}
    assert not page.values('script', 'src') and 'ctcPlots = ' not in page.source


def test_figures_have_captions_and_text_is_escaped(
        results: list[Result], figures: list[FigureFile], tmp_path: Path) -> None:
    write_page(results, figures, tmp_path / 'index.html')
    page = Page(tmp_path / 'index.html')
    assert page.texts['figcaption'] == [
        f'Figure {k}. {figure.title}. {figure.caption} PNG' for k, figure in enumerate(figures, 1)]
    assert page.values('img', 'alt') == [figure.title for figure in figures]


def test_the_error_comes_first(
        results: list[Result], figures: list[FigureFile], tmp_path: Path) -> None:
    write_page(results, figures, tmp_path / 'index.html')
    page = Page(tmp_path / 'index.html')
    before, after = (r.metrics()['max_error_norm1_rad'] for r in results[:2])
    assert before > 10.0 * after
    assert f'{before / after:.0f}× smaller' in page.texts['h1'][0]
    source = page.source
    assert (source.index('<h1>') < source.index('class="card"') < source.index('<img')
            < source.index('<table>'))


def test_a_larger_error_is_called_larger(results: list[Result], tmp_path: Path) -> None:
    swapped = [Result('friction', new.configs, old.run, old.terms)
               for old, new in ((results[1], results[0]), (results[0], results[1]))]
    write_page(swapped, [], tmp_path / 'index.html')
    heading = Page(tmp_path / 'index.html').texts['h1'][0]
    assert 'larger' in heading and 'smaller' not in heading


def test_links_to_bags_and_metrics(results: list[Result], tmp_path: Path) -> None:
    write_page(results, [], tmp_path / 'index.html', ['bags/a b', 'b', 'bags/c'])
    assert Page(tmp_path / 'index.html').values('a', 'href') == [
        'metrics.json', 'bags/a%20b', 'b', 'bags/c']


def test_a_run_too_short_to_evaluate(tmp_path: Path) -> None:
    short = [result_of(law, 0.3, '<b>$x</b>') for law in LAWS]
    write_page(short, [], tmp_path / 'index.html')
    page = Page(tmp_path / 'index.html')
    assert '–' in page.texts['td']
    assert page.texts['h1'] == ['Computed torque plus compensation plus chattering']
    assert any('<b>$x</b>' in head for head in page.texts['th'])


@pytest.mark.parametrize('write', [write_metrics, lambda r, path: write_page(r, [], path)])
def test_a_file_that_cannot_be_written(
        results: list[Result], tmp_path: Path, write: Any) -> None:
    with pytest.raises(CtcError, match=r'^cannot write '):
        write(results, tmp_path)


def test_notes_are_on_the_page(tmp_path: Path) -> None:
    """Check the notes on a short run, one with gaps, and one whose ka is too small."""
    config = ControllerConfig(switching='implicit', ka=(8.0, 8.0))
    run = simulate(PlantConfig(duration=6.0), config, ReferenceConfig())
    lossy = Run(*(np.delete(x, np.s_[5200:5300], axis=0) for x in list(vars(run).values())[:-1]))
    results = [Result('weak', [(0.0, config)], run, source='one'),
               Result('lossy', [(0.0, config)], lossy), result_of('chattering', 0.3, 'short')]
    write_page(results, [], tmp_path / 'index.html')
    page = Page(tmp_path / 'index.html')
    notes = '\n'.join(page.texts['p'])
    assert 'weak: chattering (implicit): joint2: chattering term at its bound for ' in notes
    assert 'ka too small' in notes
    assert 'lossy: chattering (implicit): 100 of 6001 samples are missing' in notes
    assert 'short: chattering: metrics are computed from 5 s to 10 s' in notes
    assert any('bag one; kp 100, kv 50, ka 8, ' in text for text in page.texts['small'])


def test_dark_mode_and_narrow_screens(tmp_path: Path, figures: list[FigureFile]) -> None:
    """Check that figures follow the page's colours, and keep a legible width in a scrolled box."""
    write_page([], figures, tmp_path / 'index.html')
    page = Page(tmp_path / 'index.html')
    dark = page.source[page.source.rindex('prefers-color-scheme: dark'):]
    assert 'figure img { filter: invert' in dark
    assert 'min-width' in page.source
    assert page.values('a', 'class') == ['scroll', 'file'] * len(figures)
