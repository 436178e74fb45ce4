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

"""Writes the pages of all commands and of all parameters, for the site of `make docs`."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from ctc_chattering.cli.bringup import make_parser as bringup_parser
from ctc_chattering.cli.ctc import COMMANDS
from ctc_chattering.cli.ctc import make_parser as ctc_parser
from ctc_chattering.configuration.node_parameters import parameter_table

#: An option with the same help in this many commands is described once.
_COMMON = 3
_BEGIN = """# Commands

`ctc COMMAND --help` prints the same in a terminal.
The exit status is 0 after success, 1 after a failure, 2 for a wrong command line or a missing
package, and 130 after Ctrl-C. Commands overwrite nothing without `--overwrite`, and with it only
[their own output](../interfaces.md#output-folders). `F` is a path or a parameter file of the
package: `friction`, `disturbance`, `switch`, `switching`, `panda`, `ur5`.

## plant, controller, reference, recorder

`NODE [--help] [--version] [--ros-args …]` starts one node. Its parameters are in
[parameters](parameters.md). An unknown parameter or argument is refused with status 2.

"""


def write(directory: Path) -> None:
    """Write both pages into a directory."""
    directory.mkdir(exist_ok=True)
    for name, text in (('commands', commands()),
                       ('parameters', f'# All parameters\n\n{parameter_table()}')):
        (directory / f'{name}.md').write_text(text, encoding='utf-8')


def commands() -> str:
    """Return the page of commands."""
    parsers = _parsers()
    counts = Counter(_row(x) for parser in parsers.values() for x in _options(parser))
    common = [row for row, count in counts.items() if count >= _COMMON]
    return _BEGIN + '## Common options\n\n' + _table(common) + ''.join(
        _section(name, parser, common) for name, parser in parsers.items())


def _parsers() -> dict[str, argparse.ArgumentParser]:
    commands = next(x for x in ctc_parser()._actions
                    if isinstance(x, argparse._SubParsersAction))
    return {'bringup': bringup_parser(),
            **{f'ctc {name}': commands.choices[name] for name in COMMANDS}}


def _options(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    return [x for x in parser._actions
            if x.dest not in ('help', 'version') and x.help != argparse.SUPPRESS]


def _section(name: str, parser: argparse.ArgumentParser, common: Iterable[str]) -> str:
    rows = [row for x in _options(parser) if (row := _row(x)) not in common]
    words = ' '.join((name, *(_usage(x) for x in _options(parser))))
    text = '\n\n'.join(filter(None, (parser.description, parser.epilog)))
    return f'\n## {name}\n\n`{words}`\n\n{text}\n' + (f'\n{_table(rows)}' if rows else '')


def _usage(option: argparse.Action) -> str:
    if not option.option_strings:
        word = _value(option)
        return {'+': f'{word}…', '*': f'[{word}…]', '?': f'[{word}]'}.get(
            str(option.nargs), word)
    return f'[{_words(option)}]'


def _words(option: argparse.Action) -> str:
    names = ' | '.join(option.option_strings)
    return names if option.nargs == 0 else f'{names} {_value(option)}'


def _value(option: argparse.Action) -> str:
    if option.choices:
        return '{' + ','.join(map(str, option.choices)) + '}'
    return str(option.metavar or option.dest.upper())


def _row(option: argparse.Action) -> str:
    words = (_words(option) if option.option_strings else _value(option)).replace('|', '\\|')
    meaning = (option.help or '').replace('%%', '%').replace('|', '\\|')
    return f'| `{words}` | {meaning} |\n'


def _table(rows: Iterable[str]) -> str:
    return '| option | meaning |\n|---|---|\n' + ''.join(rows)
