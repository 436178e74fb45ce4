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
from html.parser import HTMLParser
import json
from pathlib import Path

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
import pytest

HOSTILE = '</script><script>alert(1)</script>"\'&<!--\u2028${x}'


class CommandPage(HTMLParser):
    """Anchors, links to them, captions, spans of rows, and what the plots are told."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.links: list[str] = []
        self.spans: list[str] = []
        self.captions: list[str] = []
        self.plots = ''
        self.within = ''
        self.feed(path.read_text(encoding='utf-8'))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or '' for name, value in attrs}
        self.ids += [values['id']] if 'id' in values else []
        self.links += [values['href'][1:]] if values.get('href', '').startswith('#') else []
        self.spans += [values.get('rowspan', '1')] if tag == 'th' and 'scope' in values else []
        self.within = tag if values.get('class') == 'signals' or tag == 'figcaption' else ''
        if tag == 'figcaption':
            self.captions.append('')
        elif tag == 'b' and self.captions:
            self.within = 'figcaption'

    def handle_endtag(self, _: str) -> None:
        self.within = ''

    def handle_data(self, data: str) -> None:
        if self.within == 'div':
            self.plots += data
        elif self.within == 'figcaption':
            self.captions[-1] += data


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
    text, page = path.read_text(encoding='utf-8'), CommandPage(path)
    assert ('<nav' in text) == indexed == bool(page.links)
    assert set(page.links) <= set(page.ids) and len(set(page.ids)) == len(page.ids)
    assert len(page.links) == (5 + tables) * indexed
    assert [x.partition('.')[0] for x in page.captions] == [f'Figure {k}' for k in (1, 2, 3)]
    assert page.spans == ['3', '1'] * tables
    assert 'href="a.pdf">PDF</a>' in text and '<code>ctc &lt;plot&gt;</code>' in text
    assert 'None</h2>' not in text


def test_names_reach_the_plots_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / 'index.html'
    write_page(path, HOSTILE, HOSTILE, [Section(HOSTILE, [SignalPlots(
        HOSTILE, HOSTILE, [HOSTILE], ['rad'],
        [PlottedRun(HOSTILE, tmp_path / 'samples' / 'a b.js', '#123456')], ['e'], 1.0)])])
    text = path.read_text(encoding='utf-8')
    assert '<script>alert' not in text and 'onerror=' not in text
    found = json.loads(CommandPage(path).plots)
    assert found['joints'] == [HOSTILE] and found['runs'] == [
        {'name': HOSTILE, 'key': 'a b', 'colour': '#123456', 'path': 'samples/a%20b.js'}]


@pytest.mark.browser
def test_the_page_of_runs_in_a_browser(tmp_path: Path) -> None:
    """Check plots from a file, a link to a folded figure, and the width of a telephone."""
    runs = [made_up(7, 400, law=law, joint_names=[f'a_joint_of_a_robot_{i}' for i in range(7)])
            for law in ('compensation', 'chattering')]
    runs = [dataclasses.replace(x, experiment=HOSTILE) for x in runs]
    (tmp_path / 'a.svg').write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')
    figures = [FigureFile(tmp_path / 'a.svg', 'A', HOSTILE, group=x) for x in ('', '', HOSTILE)]
    write_page_of_runs(runs, figures, tmp_path / 'index.html',
                       plots=write_samples(runs, tmp_path / 'samples'))
    with browser_page(offline=True, viewport={'width': 390, 'height': 800},
                      color_scheme='dark') as page:
        page.goto((tmp_path / 'index.html').as_uri())
        page.locator('.signals').scroll_into_view_if_needed()
        eventually(lambda: len(inked(page)) > 8 and min(inked(page)) > 100, 'plots', page)
        assert page.evaluate('document.documentElement.scrollWidth') == 390
        assert page.evaluate('[...document.querySelectorAll("section > .scroll")].every(x => '
                             'x.style.getPropertyValue("--right") === "2.5rem")')
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


def test_style_and_script_stand_in_a_page_with_the_licence_of_uplot() -> None:
    text = str(component())
    assert text.count('<style>') == text.count('</style>') == 1
    assert text.count('<script>') == text.count('</script>') == 1
    assert 'Permission is hereby granted' in text
    assert 'Copyright (c) 2022 Leon Sorokin' in text
    # Nothing is loaded from elsewhere.
    assert 'http' not in text.replace('https://github.com/leeoniya/uPlot', '')
