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

"""The page of runs and metrics.json, read back and in a browser; what pages are made of."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote
from xml.etree import ElementTree

from browser import browser_page, eventually, inked
from ctc_chattering.analysis.markup import component
from ctc_chattering.analysis.page import (
    FigureFile,
    Folded,
    Item,
    Listing,
    PlottedRun,
    Section,
    SignalPlots,
)
from ctc_chattering.analysis.page import (
    write_page as write_sections,
)
from ctc_chattering.analysis.result import Result, write_metrics
from ctc_chattering.analysis.run_figures import internals
from ctc_chattering.analysis.run_names import LAW_COLOURS
from ctc_chattering.analysis.run_page import write_page
from ctc_chattering.analysis.run_samples import write_samples
from ctc_chattering.analysis.tables import bold, Table
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.closed_loop import Event, Run, run_closed_loop
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
from made_up_runs import made_up
import numpy as np
from pages import Page
import pytest

LAWS = {law: ControllerConfig(law=law) for law in ('compensation', 'chattering')}
PER_JOINT = ('rms_error_rad', 'rms_torque_nm', 'torque_variation_nm_per_s', 'max_torque_step_nm',
             'max_torque_rate_nm_per_s')


def result_of(law: str, duration: float, experiment: str = 'friction',
              change: float | None = None) -> Result:
    configs, events = [(0.0, LAWS[law])], []
    if change is not None:
        configs.append((change, LAWS['chattering']))
        events.append(Event(change, 'controller', {'law': 'chattering'}))
    run = run_closed_loop(PlantConfig(duration=duration), LAWS[law], ReferenceConfig(), events)
    return Result(experiment, configs, run)


@pytest.fixture(scope='module')
def results() -> list[Result]:
    return [result_of('compensation', 6.0), result_of('chattering', 6.0),
            result_of('compensation', 6.0, 'switch', change=5.0)]


def runs_of(path: Path) -> list[dict[str, Any]]:
    def refuse(text: str) -> NoReturn:
        raise AssertionError(f'{text} is not JSON')
    runs: list[dict[str, Any]] = json.loads(
        path.read_text(encoding='utf-8'), parse_constant=refuse)['runs']
    return runs


def written(path: Path, results: list[Result], figures: Any = (), bags: Any = ()) -> Page:
    write_page(results, figures, path / 'index.html', bags)
    return Page(path / 'index.html')


def test_metrics_are_those_of_the_results_in_strict_json(
        results: list[Result], tmp_path: Path) -> None:
    path = tmp_path / 'new' / 'metrics.json'
    write_metrics(results, path)
    assert runs_of(path) == [result.metrics() for result in results]
    tau = results[0].run.tau.copy()
    tau[:, 0] = np.nan
    broken = Result('friction', results[0].configs, Run(**{**vars(results[0].run), 'tau': tau}),
                    results[0].terms)
    write_metrics([broken], path)
    (entry,) = runs_of(path)
    assert entry['rms_torque_nm'] == [None, results[0].metrics()['rms_torque_nm'][1]]
    shown = written(tmp_path, [broken, results[1]]).values('value', 'data')
    assert np.isfinite(np.array(shown, float)).all()


def test_the_page_has_numbers_figures_and_links(results: list[Result], tmp_path: Path) -> None:
    """Check the error first, numbers with their digits, escaped captions, and no other source."""
    directory = tmp_path / 'the figures'
    directory.mkdir()
    figures = [FigureFile(directory / f'a & b: {i}.png', f'Title <{i}>', f'Caption "{i}" & more.')
               for i in range(3)]
    for figure in figures:
        figure.path.touch()
    page = written(tmp_path, results, figures, ['bags/a b', 'b', 'bags/c'])
    expected = []
    for run in (result.metrics() for result in results):
        expected += [run['max_error_norm1_rad'], run['reaching_time_s']]
        for joint in range(2):
            expected += [run[key][joint] for key in PER_JOINT]
    assert None in expected  # v is never reached under compensation
    values = [float(x) for x in page.values('value', 'data')]
    assert [x for x in values if x in expected] == [x for x in expected if x is not None]
    assert [float(x) for x in page.texts['data']] == pytest.approx(values, rel=6e-3)
    for word in ('[rad]', '[s]', '[N·m]', '[N·m/s]', *(x.label for x in results)):
        assert any(word in head for head in page.texts['th'])
    before, after = (r.metrics()['max_error_norm1_rad'] for r in results[:2])
    assert f'{before / after:.0f}× smaller' in page.texts['h1'][0]
    source = page.source
    assert (source.index('<h1>') < source.index('class="card"') < source.index('<img')
            < source.index('<table>'))
    assert page.texts['figcaption'] == [
        f'Figure {k}. {figure.title}. {figure.caption} PNG' for k, figure in enumerate(figures, 1)]
    assert page.values('alt', 'img') == [figure.title for figure in figures]
    for link, figure in zip(page.values('src'), figures, strict=True):
        assert (tmp_path / unquote(link)).samefile(figure.path) and not link.startswith('/')
    assert 'http:' not in source and 'https:' not in source
    assert not {'link', 'iframe'} & {tag for tag, _ in page.elements}
    links = [x for x in page.values('href', 'a') if not x.startswith('#')]
    assert [x for x in links if not x.endswith('.png')] == [
        'metrics.json', 'bags/a%20b', 'b', 'bags/c']
    assert 'figure img { filter: invert' in source[source.rindex('prefers-color-scheme: dark'):]


def test_a_larger_error_is_called_larger(results: list[Result], tmp_path: Path) -> None:
    swapped = [Result('friction', new.configs, old.run, old.terms)
               for old, new in ((results[1], results[0]), (results[0], results[1]))]
    heading = written(tmp_path, swapped).texts['h1'][0]
    assert 'larger' in heading and 'smaller' not in heading


def test_a_file_that_cannot_be_written(results: list[Result], tmp_path: Path) -> None:
    for write in (write_metrics, lambda r, path: write_page(r, [], path)):
        with pytest.raises(CtcError, match=r': is a folder, which is not replaced'):
            write(results, tmp_path)


def test_notes_are_on_the_page(tmp_path: Path) -> None:
    """Check the notes on a short run, one with gaps, and one whose ka is too small."""
    config = ControllerConfig(switching='implicit', ka=(8.0, 8.0))
    run = run_closed_loop(PlantConfig(duration=6.0), config, ReferenceConfig())
    lossy = Run(*(np.delete(x, np.s_[5200:5300], axis=0) for x in list(vars(run).values())[:-2]))
    weak = Result('weak', [(0.0, config)], run, source='one')
    assert any('ka is too small' in ax.get_title('right') for ax in internals(weak).axes)
    page = written(tmp_path, [
        weak,
        Result('lossy', [(0.0, config)], lossy), result_of('chattering', 0.3, 'short')])
    notes = '\n'.join(page.texts['p'])
    for note in ('weak: chattering (implicit): joint2: the chattering term is at its bound in ',
                 'ka is too small',
                 'lossy: chattering (implicit): 100 of 6001 samples are missing',
                 'short: chattering: metrics are computed from 0.15 s to 0.3 s, the second half'):
        assert note in notes
    assert any('bag one; kp 100, kv 50, ka 8, ' in text for text in page.texts['small'])
    assert '–' in page.texts['td']


HOSTILE = '</script><script>alert(1)</script>"\'&<!--\u2028${x}'


def sections(path: Path, tables: int) -> list[Section]:
    figure = FigureFile(path / 'a.svg', 'A', 'As it is.', (path / 'a.pdf',))
    rows = [['one', '1'], ['', '2'], ['', '3'], ['two', '4']]
    items: list[Item] = [Table(bold(f'Table {k}'), (), rows) for k in range(tables)]
    return [Section('First', [figure, *items]), Section('None', []),
            Section('Folded', [Folded('More', [figure, Listing('Texts', ['a'])]), figure])]


@pytest.mark.parametrize(('tables', 'indexed'), [(0, False), (1, True), (30, True)])
def test_a_long_page_has_an_index_of_all_that_is_numbered(
        tables: int, indexed: bool, tmp_path: Path) -> None:
    path = tmp_path / 'index.html'
    write_sections(path, 'Title', '', sections(tmp_path, tables), command='ctc <plot>')
    page = Page(path)
    links = [x[1:] for x in page.values('href') if x.startswith('#')]
    ids = page.values('id')
    assert ('<nav' in page.source) == indexed == bool(links)
    assert set(links) <= set(ids) and len(set(ids)) == len(ids)
    assert len(links) == (5 + tables) * indexed
    assert [x.partition('.')[0] for x in page.texts['figcaption']] == [
        f'Figure {k}' for k in (1, 2, 3)]
    assert page.values('rowspan', 'th') == ['3'] * tables
    assert 'href="a.pdf">PDF</a>' in page.source
    assert '<code>ctc &lt;plot&gt;</code>' in page.source
    assert 'None</h2>' not in page.source


def test_names_reach_the_plots_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / 'index.html'
    write_sections(path, HOSTILE, HOSTILE, [Section(HOSTILE, [SignalPlots(
        HOSTILE, HOSTILE, [HOSTILE], ['rad'],
        [PlottedRun(HOSTILE, tmp_path / 'samples' / 'a b.js', '#123456')], ['e'], 1.0)])])
    page = Page(path)
    assert '<script>alert' not in page.source and 'onerror=' not in page.source
    (plots,) = (x for x in page.texts['div'] if x.strip().startswith('{'))
    found = json.loads(plots)
    assert found['joints'] == [HOSTILE] and found['runs'] == [
        {'name': HOSTILE, 'key': 'a b', 'colour': '#123456', 'received': False,
         'path': 'samples/a%20b.js'}]


@pytest.mark.browser
def test_the_page_of_runs_in_a_browser(started_browser: Any, tmp_path: Path) -> None:
    """Check plots from a file, a link to a folded figure, and the width of a telephone."""
    runs = [made_up(7, 400, law=law, joint_names=[f'a_joint_of_a_robot_{i}' for i in range(7)])
            for law in ('compensation', 'chattering')]
    runs = [dataclasses.replace(x, experiment=HOSTILE) for x in runs]
    (tmp_path / 'a.svg').write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')
    figures = [FigureFile(tmp_path / 'a.svg', 'A', HOSTILE, group=x) for x in ('', '', HOSTILE)]
    write_page(runs, figures, tmp_path / 'index.html',
               plots=write_samples(runs, tmp_path / 'samples'))
    with browser_page(started_browser, offline=True, color_scheme='dark',
                      viewport={'width': 390, 'height': 800}) as page:
        page.goto((tmp_path / 'index.html').as_uri())
        page.locator('.signals').scroll_into_view_if_needed()
        eventually(lambda: len(inked(page)) > 8 and min(inked(page)) > 100, 'plots', page)
        assert page.evaluate('document.documentElement.scrollWidth') == 390
        page.emulate_media(color_scheme='light')
        strokes = ('[...document.querySelectorAll(".ctc-key line")].map('
                   'x => x.getAttribute("stroke"))')
        eventually(lambda: {*page.evaluate(strokes)} == {
            LAW_COLOURS['compensation'], LAW_COLOURS['chattering']}, 'colours', page)
        page.get_by_text('torque minus that of the first run').click()
        less = page.locator('.ctc-panel', has_text='torque minus that of the first run')
        eventually(lambda: less.count() == 7, 'differences', page)
        assert less.first.locator('.ctc-key').count() == 1
        assert page.locator('.ctc-panel').first.inner_text().count(HOSTILE[:9]) == 0
        folded = page.locator('main details').last
        assert folded.get_attribute('open') is None
        page.evaluate('id => location.hash = id', folded.get_attribute('id'))
        eventually(lambda: folded.get_attribute('open') is not None, 'the figures', page)
        assert page.locator('nav details').get_attribute('open') is None


@pytest.mark.browser
def test_seven_joints_fill_the_page(started_browser: Any, tmp_path: Path) -> None:
    """Check that no line of plots is half empty, and that one legend names the lines of a row."""
    run = made_up(7, 400, joint_names=[f'panda_joint{i}' for i in range(7)])
    changes = Table('Changes', ['law', *(f'panda_joint{i}' for i in range(1, 8))], [
        [f'chattering implicit_observer {k}, file', *['8058 / 17 / 16952'] * 7]
        for k in range(9)])
    write_sections(tmp_path / 'index.html', 'Title', '', [
        Section('Signals', write_samples([run], tmp_path / 'samples')),
        *(Section(f'Numbers {k}', [changes]) for k in range(4))])
    with browser_page(started_browser, offline=True,
                      viewport={'width': 1280, 'height': 900}) as page:
        page.goto((tmp_path / 'index.html').as_uri())
        page.locator('.signals').scroll_into_view_if_needed()
        eventually(lambda: len(inked(page)) > 14 and min(inked(page)) > 50, 'plots', page)
        rows = page.evaluate("""() => [...document.querySelectorAll('.ctc-row')].map(row => {
            const lines = {}, box = row.getBoundingClientRect();
            for (const panel of row.querySelectorAll('.ctc-panel')) {
              const {bottom, right} = panel.getBoundingClientRect();
              lines[Math.round(bottom)] = Math.max(lines[Math.round(bottom)] || 0, right);
            }
            return {ends: Object.values(lines).map(x => box.right - x),
                    panels: row.querySelectorAll('.ctc-panel').length,
                    keys: [...row.querySelectorAll('.ctc-key:has(svg)')].map(
                      x => x.textContent)};
        })""")
        assert [x['panels'] for x in rows] == [7, 1, 7]
        assert all(abs(end) < 2.0 for x in rows for end in x['ends'])
        assert rows[2]['keys'] == ['torque', 'nominal', 'compensation', 'robust']
        values = page.locator('.ctc-row').last.locator('.ctc-values')

        def has_values_of_each_line() -> bool:
            page.locator('.ctc-row').last.locator('.u-over').first.hover()
            return all(len(text.split()) == 4 for text in values.all_inner_texts())
        eventually(has_values_of_each_line, 'values of each line', page)
        wide = page.evaluate("""() => [...document.querySelectorAll('div.scroll')].map(
            x => x.scrollWidth - x.clientWidth)""")
        assert wide == [0] * 4
        with page.expect_download() as saved:
            page.get_by_role('button', name='SVG').click()
        texts = ElementTree.parse(saved.value.path()).findall('.//{*}text')
        assert [x.text for x in texts].count('compensation') == 1


def test_a_page_has_the_licence_of_uplot_and_loads_nothing_from_elsewhere() -> None:
    text = str(component())
    assert 'Permission is hereby granted' in text
    assert 'Copyright (c) 2022 Leon Sorokin' in text
    assert 'http' not in text.replace('https://github.com/leeoniya/uPlot', '')
