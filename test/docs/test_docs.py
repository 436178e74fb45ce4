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

"""README and docs have valid links, and the laws, topics, commands and paths of the code."""

from __future__ import annotations

from collections.abc import Iterator
import importlib.util
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
from ctc_chattering.runs.conditions import find_condition
from ctc_chattering.runs.recommended import gains_by_rule
import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / 'docs'
PAGES = sorted(x for x in (*DOCS.rglob('*.md'), *(ROOT / 'validation').glob('*.md'))
               if x.parent.name != '_api')
README = (ROOT / 'README.md').read_text(encoding='utf-8')
LAWS_PAGE = (DOCS / 'laws.md').read_text(encoding='utf-8')


def test_the_readme_names_every_command_in_at_most_90_lines() -> None:
    for command in (*(f'ctc {name}' for name in COMMANDS), 'bringup', *NODE_DESCRIPTIONS):
        assert f'`{command}`' in README, command
    assert len(README.splitlines()) <= 90


def test_the_page_of_interfaces_names_every_topic_and_metric() -> None:
    page = (DOCS / 'interfaces.md').read_text(encoding='utf-8')
    keys = simulate(parameter_file.load(None, {'plant': {'duration': 0.1}})).metrics()
    for name in (*keys, *(x for x in TOPICS if not x.endswith('/parameters'))):
        assert f'`{name}`' in page, name


def test_two_commands_of_the_readme_do_all_the_set_up() -> None:
    """Check that `make demo` and `make test` come first, and that CI runs `make test`."""
    blocks = re.findall(r'```sh\n(.*?)```', README, re.DOTALL)
    (block,) = (x for x in blocks if 'make demo' in x)
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
#: Spans that look like paths but are topics of ROS or files of a system.
NO_PATHS = (r'.*\.\.\.|/.*|~/|(excite|identified)/.*|.*_controller/.*|'
            r'(controller|plant|reference|~)/\w+')


@pytest.mark.parametrize('page', PATHS)
def test_paths_in_the_text_exist(page: str) -> None:
    """A path with NAME stands for any file in an existing folder."""
    text = (ROOT / page).read_text(encoding='utf-8')
    spans = re.findall(r'`([\w.~-]*/[\w./~-]*)`', text)
    missing = [span for span in spans if not re.fullmatch(NO_PATHS, span) and not any(
        (ROOT / base / (span.rpartition('/')[0] if 'NAME' in span else span)).exists() or (
            ROOT / base / f'{span}.py').exists() for base in PATHS[page])]
    assert not missing


def test_contributing_names_the_right_module_for_each_class_and_function() -> None:
    text = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
    found = re.findall(r'`(\w+)`(?: and `(\w+)`)?\s+(?:of |\()`([\w/]+\.py)`', text)
    assert len(found) >= 5
    for first, second, path in found:
        module = (ROOT / 'ctc_chattering' / path).read_text(encoding='utf-8')
        for name in filter(None, (first, second)):
            assert re.search(rf'^(class |def )?{name}\b', module, re.MULTILINE), (name, path)


#: Pages outside docs/ and validation/.
OTHERS = [*ROOT.glob('*.md'), *(ROOT / 'examples').glob('*.md')]


def test_every_page_is_in_both_indices() -> None:
    """Check the index of the site, and docs/README.md."""
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
def test_every_link_has_a_target(page: Path) -> None:
    for target in links(page):
        path, _, anchor = target.partition('#')
        to = page.parent / path if path else page
        assert to.exists(), target
        assert not anchor or anchor in anchors(to), target


def test_the_links_of_generated_pages_have_targets(tmp_path: Path) -> None:
    """They stand in docs/_api, beside each other."""
    spec = importlib.util.spec_from_file_location('reference_pages', DOCS / 'reference_pages.py')
    assert spec is not None and spec.loader is not None
    reference_pages = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(reference_pages)
    (tmp_path / '_api').mkdir()
    reference_pages.write(tmp_path / '_api')
    for page in (tmp_path / '_api').glob('*.md'):
        for target in links(page):
            path, _, anchor = target.partition('#')
            name = os.path.normpath(Path('_api') / path)
            to = next(x for x in (tmp_path / name, DOCS / name) if x.exists())
            assert not anchor or anchor in anchors(to), target


def test_the_changelog_has_one_line_for_each_change() -> None:
    """Every entry stands under Added, Changed, Removed or Fixed of its version."""
    versions = re.split(r'^.+\n-+\n', (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8'),
                        flags=re.MULTILINE)[1:]
    assert versions
    for text in versions:
        for line in filter(None, text.splitlines()):
            assert re.fullmatch(r'\* (Added|Changed|Removed|Fixed)|  \* .{,140}', line), line


@pytest.mark.slow
def test_the_site_builds_without_warnings_and_loads_nothing_from_the_network(
        tmp_path: Path) -> None:
    """Every public name is on the page of the API."""
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
    lines = LAWS_PAGE[LAWS_PAGE.index('| `law` |'):].split('\n\n')[0].splitlines()[2:]
    return [[cell.strip() for cell in re.split(r'(?<!\\)\|', line.strip().strip('|'))]
            for line in lines]


def test_the_table_has_every_law_with_its_parameters() -> None:
    assert [row[0].strip('`') for row in rows()] == list(LAWS)
    declared = {law: {name for name, spec in ControllerConfig.parameters().items()
                      if law in spec.laws} for law in LAWS}
    for law, _, _, parameters, _ in rows():
        assert set(re.findall(r'`(\w+)`', parameters)) == declared[law.strip('`')]


def test_the_page_has_the_duration_of_a_change_of_law() -> None:
    assert f'fades linearly within {HANDOVER_DURATION_S:g} s' in LAWS_PAGE


def test_every_law_has_a_paragraph_and_its_module_a_reference() -> None:
    for law in LAWS:
        assert f'**`{law}`' in LAWS_PAGE
        text = __import__(law_class(law).__module__, fromlist=['']).__doc__ or ''
        assert re.search(r'\b(19|20)\d\d\b|of the paper', text)
        assert text.startswith(f'\nLaw `{law}`')
        assert re.search(r'  \((\d|[A-Z]+1)\)\n', text)


def test_the_documented_pole_of_integral_follows_from_its_rule() -> None:
    """Evaluate (RU1) with the numbers of `real_arm`, whose friction is 9.9 N·m."""
    p = 0.24 / (2e-3 + 1e-3 * (1 + 1) + 9.9 / 1000.0)
    assert f'this is {p:.0f} rad/s' in LAWS_PAGE
    friction = find_config('friction')
    given = find_condition('real_arm').cases(parameter_file.load(friction))[0].overrides
    setup = parameter_file.load(friction, {**given, 'controller': {
        **given['controller'], 'law': 'integral', 'friction_level': [9.9, 9.9]}})
    assert gains_by_rule(setup)['ki'] == pytest.approx([p ** 3] * 2)
