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

"""README and docs: links lead somewhere; laws, topics, commands, paths are those of the code."""

from __future__ import annotations

from collections.abc import Iterator
import os
from pathlib import Path
import re
import subprocess
import sys

import ctc_chattering
from ctc_chattering.analysis.result import simulate
from ctc_chattering.cli.ctc import COMMANDS
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.node_parameters import NODE_DESCRIPTIONS
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.configuration.topics import TOPICS
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.control.laws.registry import law_class, LAWS
from ctc_chattering.control.settings import HANDOVER_DURATION_S
from ctc_chattering.runs.conditions import condition
from ctc_chattering.runs.recommended import gains_by_rule
import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / 'docs'
PAGES = sorted(x for x in (*DOCS.rglob('*.md'), *(ROOT / 'validation').glob('*.md'))
               if x.parent.name != '_api')
README = (ROOT / 'README.md').read_text(encoding='utf-8')
#: Of the laws.
PAGE = (DOCS / 'laws.md').read_text(encoding='utf-8')


def test_the_pages_name_what_the_code_has() -> None:
    page = (ROOT / 'docs' / 'interfaces.md').read_text(encoding='utf-8')
    keys = simulate(parameter_file.load(None, {'plant': {'duration': 0.1}})).metrics()
    for name in (*keys, *(x for x in TOPICS if not x.endswith('/parameters'))):
        assert f'`{name}`' in page, name
    for command in (*(f'ctc {name}' for name in COMMANDS), 'bringup', *NODE_DESCRIPTIONS):
        assert f'`{command}`' in README, command
    assert f'fades linearly within {HANDOVER_DURATION_S:g} s' in PAGE
    assert len(README.splitlines()) <= 100


def test_two_commands_of_the_readme_set_all_up_on_a_bare_machine() -> None:
    """They are those of the demonstration and of the tests, as CI runs them; `make live` later."""
    (block, *_) = re.findall(r'```sh\n(.*?)```', README, re.DOTALL)
    assert [line.split('#')[0].strip() for line in block.splitlines()] == [
        'make demo', 'make test']
    assert README.index(block) < README.index('`make live`')
    targets = re.findall(r'^(\w+):', (ROOT / 'Makefile').read_text(encoding='utf-8'), re.M)
    assert {'demo', 'test', 'live'} <= set(targets)
    assert ' make test\n' in (ROOT / '.ci' / 'run').read_text(encoding='utf-8')


#: Pages whose code spans are checked, and where their paths begin.
PATHS = {'CONTRIBUTING.md': ('ctc_chattering', ''), 'docs/design.md': (
             'ctc_chattering', '', 'ctc_chattering/control'),
         'README.md': ('',), **{f'docs/{name}.md': ('ctc_chattering', '', 'docs') for name in (
             'laws', 'theory', 'plant', 'safety', 'comparison', 'identification')}}
#: What looks like a path and is none here: topics of ROS, and files of a system.
NO_PATHS = r'.*\.\.\.|/.*|~/|excite/.*|.*_controller/.*|(controller|plant|reference|~)/\w+'


@pytest.mark.parametrize('page', PATHS)
def test_paths_are_there(page: str) -> None:
    """A path with NAME stands for one of the caller's choice in a folder that is there."""
    text = (ROOT / page).read_text(encoding='utf-8')
    spans = re.findall(r'`([\w.~-]*/[\w./~-]*)`', text)
    missing = [span for span in spans if not re.fullmatch(NO_PATHS, span) and not any(
        (ROOT / base / (span.rpartition('/')[0] if 'NAME' in span else span)).exists() or (
            ROOT / base / f'{span}.py').exists() for base in PATHS[page])]
    assert not missing


def test_names_are_in_the_modules_that_contributing_names() -> None:
    text = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
    found = re.findall(r'`(\w+)`(?: and `(\w+)`)?\s+(?:of |\()`([\w/]+\.py)`', text)
    assert len(found) >= 5
    for first, second, path in found:
        module = (ROOT / 'ctc_chattering' / path).read_text(encoding='utf-8')
        for name in filter(None, (first, second)):
            assert re.search(rf'^(class |def )?{name}\b', module, re.MULTILINE), (name, path)


#: Beside those in docs/.
OTHERS = [*ROOT.glob('*.md'), *(ROOT / 'examples').glob('*.md')]


def test_every_page_is_in_both_indices() -> None:
    """Check the one of the site, and docs/README.md."""
    site = (ROOT / 'index.rst').read_text(encoding='utf-8')
    index = (DOCS / 'README.md').read_text(encoding='utf-8')
    for page in PAGES:
        assert f'   {page.relative_to(ROOT).with_suffix("")}\n' in site
        link = os.path.relpath(page, DOCS)
        assert f']({link})' in index or (page.name == 'README.md' and page.parent == DOCS), link


def anchors(page: Path) -> set[str]:
    """Return the anchors of the headings of a page, as GitHub makes them."""
    text = re.sub(r'```.*?```', '', page.read_text(encoding='utf-8'), flags=re.DOTALL)
    titles = re.findall('^#+ (.*)$', text, re.M)
    return {re.sub(r'[^\w\- ]', '', re.sub(r'\]\(.*?\)', '', title)).strip().lower().replace(
        ' ', '-') for title in titles}


def links(page: Path) -> Iterator[str]:
    """Yield the targets of a page's links and images within the repository."""
    text = re.sub(r'```.*?```', '', page.read_text(encoding='utf-8'), flags=re.DOTALL)
    for target in re.findall(r'\]\(([^)\s]+)\)', text):
        if not re.match('https?:|mailto:', target):
            yield target


@pytest.mark.parametrize('page', [*PAGES, *OTHERS], ids=lambda x: str(x.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for target in links(page):
        path, _, anchor = target.partition('#')
        to = page.parent / path if path else page
        assert to.exists(), target
        assert not anchor or anchor in anchors(to), target


@pytest.mark.slow
def test_the_site_builds_without_a_warning_and_asks_nothing_of_the_network(
        tmp_path: Path) -> None:
    """Every public name is on the page of the API; no page loads a script, style or picture."""
    pytest.importorskip('furo', reason='make docs installs it')
    subprocess.check_call([
        sys.executable, '-m', 'sphinx', '-W', '--keep-going', '--quiet', '-c', str(DOCS),
        '-d', str(tmp_path / 'doctrees'), str(ROOT), str(tmp_path / 'site')])
    api = (tmp_path / 'site' / 'docs' / 'api.html').read_text(encoding='utf-8')
    for name in set(ctc_chattering.__all__) - {'__version__'}:
        assert f'id="ctc_chattering.{name}"' in api, name
    loads = r'(?:src=|<link [^>]*href=)"?(?:https?:)?//|url\(["\']?(?:https?:)?//|@import'
    for path in (tmp_path / 'site').rglob('*.*'):
        if path.suffix in ('.html', '.css'):
            assert not re.findall(loads, path.read_text(encoding='utf-8')), path


def rows() -> list[list[str]]:
    """Return the cells of the table of laws."""
    lines = PAGE[PAGE.index('| `law` |'):].split('\n\n')[0].splitlines()[2:]
    return [[cell.strip() for cell in re.split(r'(?<!\\)\|', line.strip().strip('|'))]
            for line in lines]


def test_the_table_has_every_law_with_its_parameters() -> None:
    assert [row[0].strip('`') for row in rows()] == list(LAWS)
    declared = {law: {name for name, spec in ControllerConfig.parameters().items()
                      if law in spec.laws} for law in LAWS}
    for law, _, _, parameters, _ in rows():
        assert set(re.findall(r'`(\w+)`', parameters)) == declared[law.strip('`')]


def test_every_law_has_a_paragraph_and_every_module_a_reference() -> None:
    for law in LAWS:
        assert f'**`{law}`' in PAGE
        text = __import__(law_class(law).__module__, fromlist=['']).__doc__ or ''
        assert re.search(r'\b(19|20)\d\d\b|of the paper', text)
        assert text.startswith(f'\nLaw `{law}`')
        assert re.search(r'  \((\d|[A-Z]+1)\)\n', text)


def test_the_pole_of_integral_on_the_paper_s_arm() -> None:
    """Check (RU1) with the numbers of `real_arm`, whose friction is 9.9 N·m."""
    p = 0.24 / (2e-3 + 1e-3 * (1 + 1) + 9.9 / 1000.0)
    assert f'this is {p:.0f} rad/s' in PAGE
    friction = find_config('friction')
    given = condition('real_arm').overrides(parameter_file.load(friction))[0]
    setup = parameter_file.load(friction, {**given, 'controller': {
        **given['controller'], 'law': 'integral', 'friction_level': [9.9, 9.9]}})
    assert gains_by_rule(setup)['ki'] == pytest.approx([p ** 3] * 2)
