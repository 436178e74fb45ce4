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

"""README and reference pages say what the code does."""

from __future__ import annotations

from pathlib import Path
import re

from ctc_chattering.analysis.result import simulate
from ctc_chattering.cli.ctc import COMMANDS
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.node_parameters import NODE_DESCRIPTIONS
from ctc_chattering.ros.topics import TOPICS
import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / 'README.md').read_text(encoding='utf-8')


def test_the_readme_is_short() -> None:
    lines = README.splitlines()
    assert len(lines) <= 100
    assert not [line for line in lines if len(line) > 120 and not line.startswith(('|', '!['))]


def test_every_topic_is_named() -> None:
    page = (ROOT / 'docs' / 'interfaces.md').read_text(encoding='utf-8')
    for name in TOPICS:
        assert f'`{name}`' in page or name.endswith('/parameters')


def test_every_key_of_the_metrics_is_named() -> None:
    page = (ROOT / 'docs' / 'interfaces.md').read_text(encoding='utf-8')
    setup = parameter_file.load(None, {'plant': {'duration': 0.1}})
    for key in simulate(setup).metrics():
        assert f'`{key}`' in page, key


def test_the_readme_names_every_command() -> None:
    for command in (*(f'ctc {name}' for name in COMMANDS), 'bringup', *NODE_DESCRIPTIONS):
        assert f'`{command}`' in README, command


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
