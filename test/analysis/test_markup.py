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

"""Names from outside in every kind of page, in figures and in Markdown: always text."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
import re
from xml.etree import ElementTree

from ctc_chattering.analysis.drawing import save
from ctc_chattering.analysis.markup import fragment, Markup
from ctc_chattering.analysis.page import FigureFile
from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.run_figures import tracking
from ctc_chattering.analysis.run_page import write_page
from ctc_chattering.analysis.tables import bold, columns, markdown, markdown_table
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.identification import results as identification
from ctc_chattering.identification.gains import recommend
from ctc_chattering.identification.identify import identify_recordings
from ctc_chattering.identification.perturbation import measure_perturbation
from ctc_chattering.output_files import file_stem
from ctc_chattering.runs.compare_page import Outcome, to_markdown
from ctc_chattering.runs.compare_page import write_page as write_comparison_page
from ctc_chattering.runs.map_data import MapData
from ctc_chattering.runs.map_figures import draw_lines
from ctc_chattering.runs.map_page import write_map_page
from ctc_chattering.runs.recommended import BASELINE, LawSettings
from ctc_chattering.runs.tune import search_gains, Tuning
from ctc_chattering.runs.tune_page import write_page as write_search_page
from identified_bags import short
from jinja2 import UndefinedError
from made_up_runs import made_up
from map_specs import compared
from map_tables import table_of
from pages import Page
import pytest
from tunings import short_spec

#: What runs, closes, or breaks something, wherever it is not text.
HOSTILE = ('<script>alert(1)</script>"><iframe srcdoc="<script>alert(1)</script>"></iframe>'
           "' onerror='alert(1)' $x_{ a|b {{7*7}} {% raw %} {0} **b** &lt;i> \x1b[1m\n</td> $")
#: As long, and harmless.
PLAIN = 'a' * len(HOSTILE)


def words(text: str) -> str:
    return ' '.join(text.split())


def figure_files(name: str, out: Path) -> list[FigureFile]:
    return [FigureFile(out / 'figures' / f'{file_stem(name)}.svg', name, name)] * 2


def runs(name: str) -> list[Result]:
    joints = [f'1{name}', f'2{name}']
    made = [made_up(2, 50, law=law, joint_names=joints) for law in ('compensation', 'chattering')]
    return [dataclasses.replace(x, experiment=experiment, source=source, window=(0.0, 0.05))
            for x in made for experiment, source in ((name, name), (f'short {name}', ''))]


def of_runs(name: str, out: Path) -> None:
    """Write the page of `ctc plot`: experiment, joints, bags."""
    write_page(runs(name), figure_files(name, out), out / 'index.html', [name] * 4)


def map_of(name: str) -> MapData:
    failure = [[['', 'error'], ['error', '']], [['', ''], ['error', 'error']]]
    return MapData(table_of(
        ('compensation', name), {name: [1.0, 2.0]}, {
            'error': [[[1.0, 2.0], [3.0, 1.0]]] * 2, 'failure': failure}, {f'{name}2': [1, 2]}),
        {name: 'rad'}, [f'{name}2'])


def of_a_map(name: str, out: Path) -> None:
    """Write the page of `ctc map`: axes, uncertain parameters, variants, units, facts."""
    write_map_page(map_of(name), figure_files(name, out), out / 'index.html',
                   {name: name, 'x': name})


@lru_cache(1)
def search() -> Tuning:
    return search_gains(short_spec(duration=0.1), 1, 100.0, 1)


def of_a_search(name: str, out: Path) -> None:
    """Write the page of `ctc tune`: uncertain parameters."""
    spec = search().spec
    uncertain = tuple(dataclasses.replace(x, name=name) for x in spec.uncertain)
    named = dataclasses.replace(search(), spec=dataclasses.replace(spec, uncertain=uncertain))
    write_search_page(named, figure_files(name, out), out / 'index.html')


@lru_cache(1)
def identified() -> identification.IdentificationResults:
    recording = short(duration=3.0).recording
    found = identify_recordings([recording], TwoLink())
    run = measure_perturbation(found, False)
    return identification.IdentificationResults('', found, run, recommend(found, run, TwoLink()))


def of_an_identification(name: str, out: Path) -> None:
    """Write the page of `ctc identify`: bags, joints."""
    found = dataclasses.replace(identified().found, joints=(f'1{name}', f'2{name}'))
    identification.write_page(dataclasses.replace(identified(), source=name, found=found),
                              figure_files(name, out), out / 'index.html', {name: name})


def outcomes(name: str) -> list[Outcome]:
    return compared(
        name, (BASELINE, 1e-3, 1.0, ''), (LawSettings('chattering', 'sign'), 1.0, 2.0, ''))


def of_a_comparison(name: str, out: Path) -> None:
    """Write the page of `ctc compare`: experiment, joints."""
    write_comparison_page(outcomes(name), figure_files(name, out), out / 'index.html')


@pytest.mark.parametrize('write', [
    of_runs, of_a_map, of_a_search, of_an_identification, of_a_comparison])
def test_no_name_becomes_an_element(write: Callable[[str, Path], None], tmp_path: Path) -> None:
    """A page has the same elements and attributes whatever the names, and shows the names."""
    pages = []
    for name in (PLAIN, HOSTILE):
        out = tmp_path / name[:1]
        out.mkdir()
        write(name, out)
        pages.append(Page(out / 'index.html'))
    plain, hostile = ([(tag, *x) for tag, x in page.elements if tag != 'wbr'] for page in pages)
    assert hostile == plain
    shown = words(pages[1].text).count(words(HOSTILE))
    assert shown == pages[0].text.count(PLAIN) >= 2
    urls = pages[1].values('href') + pages[1].values('src')
    assert not any(':' in url or url.startswith('/') for url in urls)


@pytest.mark.filterwarnings('ignore:Glyph')
def test_figures_show_names_as_they_are(tmp_path: Path) -> None:
    """Check that nothing is taken for a formula, except powers of ten, nor for a path."""
    name = ' a|b $x_{ \x1b--> </td> $'
    found = [('../../a/b', draw_lines(map_of(name)), ''), ('c', tracking(runs(name)[0]), '')]
    files = save(found, tmp_path / 'figures', ['svg'])
    assert {x.name for x in tmp_path.iterdir()} == {'figures'}
    assert {x.path.parent for x in files} == {tmp_path / 'figures'}
    for file in files:
        text = file.path.read_text(encoding='utf-8')
        assert r'<!-- $\mathdefault{' in text and name[:9] in text
        tags = {x.tag.rpartition('}')[2] for x in ElementTree.fromstring(text).iter()}
        assert not {'script', 'iframe', 'td', 'a'} & tags


def test_a_name_breaks_no_row_of_markdown() -> None:
    text = to_markdown(outcomes(HOSTILE))
    assert '<' not in text and '\x1b' not in text
    for one, other in pairwise(line for line in text.splitlines() if line.startswith('|')):
        if not other.startswith('| law'):
            assert len(re.findall(r'(?<!\\)\|', one)) == len(re.findall(r'(?<!\\)\|', other))
    assert markdown_table(['a|b', 'c'], [['\n* x\n', '[x](http://y)']]) == [
        r'| a\|b | c |', '| --- | --- |', r'|  \* x  | [x]\(http://y) |']


@pytest.mark.parametrize(('text', 'shown'), [
    ('implicit_observer, 5 s ≤ t [N·m]', 'implicit_observer, 5 s ≤ t [N·m]'),
    ('_x_ `a` ~b~ $c$ \\ d', r'\_x\_ \`a\` \~b\~ \$c\$ \\ d'),
    ('<b>a & b</b>', '&lt;b>a &amp; b&lt;/b>'),
    (bold('<b>*'), r'**&lt;b>\***'), (fragment('<code>{{ x }}</code>', x="'|'"), r"`'\|'`")])
def test_markdown(text: str, shown: str) -> None:
    assert markdown(text) == shown


def test_only_markup_is_not_escaped() -> None:
    assert fragment('<p>{{ a }}{{ b }}</p>', a='<i>"', b=Markup('<i>')) == (
        '<p>&lt;i&gt;&#34;<i></p>')
    assert fragment('{{ x | url }}', x='javascript:a b') == 'javascript%3Aa%20b'
    with pytest.raises(UndefinedError):
        fragment('{{ x }}')


def test_columns_on_a_terminal_and_names_of_files_have_no_control_codes() -> None:
    assert columns([['a\x1b[2Jb', 'c'], ['d\ne', 'f']]) == ['a [2Jb  c', 'd e     f']
    assert [file_stem(x) for x in ('../../x', '\n', 'a b')] == ['x', 'run', 'a_b']
