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

"""The page of commands: index, figures, and plots in a browser; what these are made of."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

from browser import browser_page, eventually, inked
from ctc_chattering.analysis.drawing import FigureFile
from ctc_chattering.analysis.markup import component
from ctc_chattering.analysis.page import (
    Folded,
    Item,
    Listing,
    PlottedRun,
    Section,
    SignalPlots,
    write_page,
)
from ctc_chattering.analysis.result import LAW_COLOURS
from ctc_chattering.analysis.run_page import write_page as write_page_of_runs
from ctc_chattering.analysis.run_page import write_samples
from ctc_chattering.analysis.tables import bold, Table
from made_up_runs import made_up
from pages import Page
import pytest

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
    write_page(path, 'Title', '', sections(tmp_path, tables), command='ctc <plot>')
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
    write_page(path, HOSTILE, HOSTILE, [Section(HOSTILE, [SignalPlots(
        HOSTILE, HOSTILE, [HOSTILE], ['rad'],
        [PlottedRun(HOSTILE, tmp_path / 'samples' / 'a b.js', '#123456')], ['e'], 1.0)])])
    page = Page(path)
    assert '<script>alert' not in page.source and 'onerror=' not in page.source
    (plots,) = (x for x in page.texts['div'] if x.strip().startswith('{'))
    found = json.loads(plots)
    assert found['joints'] == [HOSTILE] and found['runs'] == [
        {'name': HOSTILE, 'key': 'a b', 'colour': '#123456', 'path': 'samples/a%20b.js'}]


@pytest.mark.browser
def test_the_page_of_runs_in_a_browser(started_browser: Any, tmp_path: Path) -> None:
    """Check plots from a file, a link to a folded figure, and the width of a telephone."""
    runs = [made_up(7, 400, law=law, joint_names=[f'a_joint_of_a_robot_{i}' for i in range(7)])
            for law in ('compensation', 'chattering')]
    runs = [dataclasses.replace(x, experiment=HOSTILE) for x in runs]
    (tmp_path / 'a.svg').write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')
    figures = [FigureFile(tmp_path / 'a.svg', 'A', HOSTILE, group=x) for x in ('', '', HOSTILE)]
    write_page_of_runs(runs, figures, tmp_path / 'index.html',
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
        page.get_by_text('torque less that of the first run').click()
        less = page.locator('.ctc-panel', has_text='torque less that of the first run')
        eventually(lambda: less.count() == 7, 'differences', page)
        assert less.first.locator('.ctc-key').count() == 1
        assert page.locator('.ctc-panel').first.inner_text().count(HOSTILE[:9]) == 0
        folded = page.locator('main details').last
        assert folded.get_attribute('open') is None
        page.emulate_media(media='print')
        eventually(lambda: folded.locator('figure').first.bounding_box()['height'], 'it', page)
        page.emulate_media(media='screen')
        assert folded.get_attribute('open') is None
        page.evaluate('id => location.hash = id', folded.get_attribute('id'))
        eventually(lambda: folded.get_attribute('open') is not None, 'the figures', page)
        assert page.locator('nav details').get_attribute('open') is None


def test_a_page_has_the_licence_of_uplot_and_loads_nothing_from_elsewhere() -> None:
    text = str(component())
    assert 'Permission is hereby granted' in text
    assert 'Copyright (c) 2022 Leon Sorokin' in text
    assert 'http' not in text.replace('https://github.com/leeoniya/uPlot', '')
