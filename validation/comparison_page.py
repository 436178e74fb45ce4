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

"""Compares every law, with gains by rule: the tables of docs/comparison.md and of README."""

from __future__ import annotations

import csv
from math import inf
from pathlib import Path
import re

from ctc_chattering.cli.ctc import main as ctc

DOCS = Path(__file__).resolve().parents[1] / 'docs'
PAGE = DOCS / 'comparison.md'
README = DOCS.parent / 'README.md'
#: A block of a page, and the directory in docs/ that it shows.
_BLOCK = re.compile(r'(<!-- tables: (\S+) -->\n).*?(<!-- end of tables -->)', re.DOTALL)
#: Rows of README: law, switching, settings.
_ROWS = (('observer_feedback', '', 'recommended'), ('pid_kalman', '', 'recommended'),
         ('chattering', 'implicit_observer', 'recommended'))
_HEADS = ('law', 'simulations survived', 'worst error [rad]', 'median error [rad]',
          'torque variation, relative to the first')


def filled(page: str) -> str:
    """Return docs/comparison.md with the first table and the figures of each directory."""
    return _BLOCK.sub(lambda block: f'{block[1]}{_content(block[2])}{block[3]}', page)


def filled_readme(page: str) -> str:
    """Return README with its table as the directory has it now."""
    return _BLOCK.sub(lambda block: f'{block[1]}{_short(block[2])}{block[3]}', page)


def _content(directory: str) -> str:
    tables = (DOCS / directory / 'compare.md').read_text(encoding='utf-8')
    judged = '\n\n'.join(tables.split('\n\n')[:2])
    figures = sorted((DOCS / directory / 'figures').iterdir())
    return f'\n{judged}\n\n' + ''.join(
        f'![{x.stem.replace("_", " ")}]({x.relative_to(DOCS).as_posix()})\n\n' for x in figures)


def _short(directory: str) -> str:
    lines = [_HEADS, ('---',) * len(_HEADS), *(_row(directory, x) for x in _ROWS)]
    return ''.join(f'| {" | ".join(x)} |\n' for x in lines)


def _row(directory: str, variant: tuple[str, str, str]) -> tuple[str, ...]:
    """Return a row of the first table of a directory, with its law in one cell."""
    text = (DOCS / directory / 'compare.md').read_text(encoding='utf-8')
    rows = (line.strip('| ').split(' | ') for line in text.splitlines() if ' of 24 | ' in line)
    (cells,) = ((law, *row) for law, switching, settings, *row in rows
                if (law, switching.strip(), settings) == variant)
    return (', '.join(filter(None, (variant[0], variant[1] and f'`{variant[1]}`'))), *cells[1:])


def lines(directory: str) -> list[dict[str, str]]:
    """Return the lines of the CSV file of a directory in docs/."""
    with (DOCS / directory / 'compare.csv').open(encoding='utf-8') as stream:
        return list(csv.DictReader(stream))


def named(line: dict[str, str]) -> tuple[str, ...]:
    """Return law, switching and settings of a line."""
    return line['law'], line['switching'], line['settings']


def held_out_errors(directory: str, variant: tuple[str, ...]) -> list[float]:
    """Return the largest error of any joint in each held-out condition [rad]; inf if lost."""
    found: dict[str, float] = {}
    for x in lines(directory):
        if named(x) == variant and x['condition'].startswith('held_out_'):
            error = inf if x['failure'] else float(x['rms_error'])
            found[x['condition']] = max(found.get(x['condition'], 0.0), error)
    return list(found.values())


def main() -> None:
    """Compare the laws in one condition and in held-out ones, and write the pages."""
    compared = ctc(['compare', 'friction', '--gains', 'recommended', '--condition', 'real_arm',
                    '--held-out', '24', '--overwrite', '--out', str(DOCS / 'comparison/two_link')])
    for path, fill in ((PAGE, filled), (README, filled_readme)):
        if compared == 0:
            path.write_text(fill(path.read_text(encoding='utf-8')), encoding='utf-8')


if __name__ == '__main__':
    main()
