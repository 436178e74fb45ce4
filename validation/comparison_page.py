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
from statistics import median

from ctc_chattering.cli.ctc import main as ctc

DOCS = Path(__file__).resolve().parents[1] / 'docs'
PAGE = DOCS / 'comparison.md'
README = DOCS.parent / 'README.md'
#: A block of a page, and the directory in docs/ that it shows.
_BLOCK = re.compile(r'(<!-- tables: (\S+) -->\n).*?(<!-- end of tables -->)', re.DOTALL)
#: Rows of README: law, switching, settings.
_ROWS = (('observer_feedback', '', 'recommended'), ('extended_state_observer', '', 'recommended'),
         ('pid_kalman', '', 'recommended'), ('chattering', 'implicit_observer', 'recommended'),
         ('compensation', '', 'file'))
_HEADS = ('law', 'held-out conditions survived', 'median error [rad]',
          'RMS e₁, e₂ in the condition above [rad]', 'torque variation there [N·m/s]')
#: Settings in words.
_WORDS = {'file': 'gains of the paper', 'recommended': ''}


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
    law, switching, settings = variant
    errors, joints = held_out_errors(directory, variant), [
        x for x in lines(directory) if named(x) == variant and x['condition'] == 'real_arm']
    name = ', '.join(filter(None, (law, f'`{switching}`' if switching else '',
                                   _WORDS[settings])))
    return (name, f'{sum(x < inf for x in errors)} of {len(errors)}',
            f'{median(errors):.1e}' if median(errors) < inf else 'lost',
            ', '.join(f'{float(x["rms_error"]):.1e}' for x in joints),
            ', '.join(f'{float(f"""{float(x["torque_variation_per_s"]):.2g}"""):.0f}'
                      for x in joints))


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
