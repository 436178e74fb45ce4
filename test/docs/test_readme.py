"""README and reference pages say what the code does."""

from __future__ import annotations

from pathlib import Path
import re

from ctc_chattering.analysis.result import simulated
from ctc_chattering.cli.bringup import make_parser as bringup_parser
from ctc_chattering.cli.ctc import make_parser as ctc_parser
from ctc_chattering.experiment import parameter_file
from ctc_chattering.experiment.node_parameters import parameter_table
from ctc_chattering.ros.topics import TOPICS

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / 'README.md').read_text(encoding='utf-8')


def test_the_readme_is_short() -> None:
    assert len(README.splitlines()) <= 150


def test_the_parameters_are_those_of_the_code() -> None:
    page = (ROOT / 'docs' / 'parameters.md').read_text(encoding='utf-8')
    begin = '<!-- parameters: the output of `ctc parameters` -->\n'
    end = '\n<!-- end of parameters'
    assert page[page.index(begin) + len(begin):page.index(end)] == parameter_table()


def test_every_topic_is_named() -> None:
    page = (ROOT / 'docs' / 'interfaces.md').read_text(encoding='utf-8')
    for name in TOPICS:
        assert f'`{name}`' in page or name.endswith('/parameters')


def test_every_key_of_the_metrics_is_named() -> None:
    page = (ROOT / 'docs' / 'interfaces.md').read_text(encoding='utf-8')
    setup = parameter_file.load(None, {'plant': {'duration': 0.1}})
    for key in simulated(setup).metrics():
        assert f'`{key}`' in page, key


def test_every_page_is_in_the_index() -> None:
    index = (ROOT / 'docs' / 'README.md').read_text(encoding='utf-8')
    for page in (ROOT / 'docs').rglob('*.md'):
        assert page.name == 'README.md' or f']({page.relative_to(ROOT / "docs")})' in index


def test_every_command_and_every_option_is_named() -> None:
    usage = ctc_parser().format_help()
    commands = re.findall(r'^    (\w+)', usage, re.MULTILINE)
    assert len(commands) >= 6
    for command in commands:
        assert f'`ctc {command}' in README
    for option in re.findall(r'--[a-z-]+', bringup_parser().format_usage()):
        assert option in README


def test_links_lead_somewhere() -> None:
    for page in (ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *(ROOT / 'docs').rglob('*.md')):
        for target in re.findall(r'\]\(([^)#]+)\)', page.read_text(encoding='utf-8')):
            assert target.startswith('http') or (page.parent / target).exists(), target
