"""The README says what the code does."""

from __future__ import annotations

from pathlib import Path
import re

from ctc_chattering.cli.bringup import make_parser as bringup_parser
from ctc_chattering.cli.ctc import make_parser as ctc_parser
from ctc_chattering.graph import TOPICS
from ctc_chattering.settings import parameter_table

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / 'README.md').read_text(encoding='utf-8')


def test_the_parameters_are_those_of_the_code() -> None:
    begin = '<!-- parameters: the output of `ctc parameters` -->\n'
    end = '\n<!-- end of parameters'
    assert README[README.index(begin) + len(begin):README.index(end)] == parameter_table()


def test_every_topic_is_named() -> None:
    for name in TOPICS:
        assert f'`{name}`' in README or name.endswith('/parameters')


def test_every_command_and_every_option_is_named() -> None:
    usage = ctc_parser().format_help()
    commands = re.findall(r'^    (\w+)', usage, re.MULTILINE)
    assert len(commands) >= 6
    for command in commands:
        assert f'`ctc {command}' in README
    for option in re.findall(r'--[a-z-]+', bringup_parser().format_usage()):
        assert option in README


def test_the_python_example_runs() -> None:
    example = re.search(r'```python\n(.*?)```', README, re.DOTALL)
    assert example
    exec(compile(example[1], 'README.md', 'exec'), {})


def test_links_lead_somewhere() -> None:
    for page in (ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *(ROOT / 'docs').glob('*.md')):
        for target in re.findall(r'\]\(([^)#]+)\)', page.read_text(encoding='utf-8')):
            assert target.startswith('http') or (page.parent / target).exists(), target
