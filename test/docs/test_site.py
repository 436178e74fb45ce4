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

"""The site has every page once, its links lead somewhere, and it builds without a warning."""

from __future__ import annotations

from collections.abc import Iterator
import os
from pathlib import Path
import re
import subprocess
import sys

import ctc_chattering
import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / 'docs'
PAGES = sorted(x for x in (*DOCS.rglob('*.md'), *(ROOT / 'validation').glob('*.md'))
               if x.parent.name != '_api')
#: These pages are made with the site.
MADE = ('docs/_api/commands', 'docs/_api/parameters', 'docs/api')
#: Beside those in docs/.
OTHERS = [*ROOT.glob('*.md'), *(ROOT / 'examples').glob('*.md')]


def site() -> dict[str, list[str]]:
    """Return the documents of each chapter, as index.rst has them."""
    text = (ROOT / 'index.rst').read_text(encoding='utf-8')
    return {re.findall(':caption: (.*)', block)[0]: re.findall(r'^   (\S+/\S+)$', block, re.M)
            for block in text.split('.. toctree::\n')[1:]}


def test_every_page_is_in_one_chapter() -> None:
    chapters = site()
    assert list(chapters) == ['Start', 'Robots', 'Theory', 'Reference', 'Validation']
    documents = [name for names in chapters.values() for name in names]
    pages = [str(page.relative_to(ROOT).with_suffix('')) for page in PAGES]
    assert sorted(documents) == sorted([*pages, *MADE, 'examples/README'])


def test_the_index_in_the_repository_has_the_same_chapters() -> None:
    text = (DOCS / 'README.md').read_text(encoding='utf-8')
    for chapter, names in site().items():
        section = text.split(f'\n## {chapter}\n')[1].split('\n## ')[0]
        links = re.findall(r'^\| \[.*?\]\((?!\.\./examples)(.*?)\.md\) \|', section, re.M)
        assert [os.path.normpath(f'docs/{link}') for link in links if link != '../CONTRIBUTING'
                ] == [name for name in names if name not in (
                    'docs/README', *MADE, 'examples/README')]


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
