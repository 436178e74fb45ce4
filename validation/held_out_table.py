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

"""What is made of the rows of held-out conditions: verdicts, lines and a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

#: RMS error of a joint, relative to that of `compensation`, from which a run counts as worse;
#: slips a second at rest from which it counts as hunting.
_WORSE, _HUNTS = 1.2, 2.0


def verdict(row: dict[str, Any], base: dict[str, Any]) -> str:
    """Return `diverged`, `worse` than `compensation`, or `held`."""
    if row['diverged'] is not None:
        return 'diverged'
    if base['diverged'] is None and (np.array(row['rms']) > _WORSE * np.array(base['rms'])).any():
        return 'worse'
    return 'held'


def line(row: dict[str, Any], base: dict[str, Any]) -> str:
    """Return a row as text."""
    if row['diverged'] is not None:
        return f'  {row["telling"]:13} diverged at {row["diverged"]:.2f} s{trip(row)}'
    text = (f'  {row["telling"]:13} {row["verdict"]:6} rms {min(row["rms"]):.1e} to '
            f'{max(row["rms"]):.1e} rad')
    if base['diverged'] is None:
        part = np.array(row['rms']) / np.array(base['rms'])
        text += f', {part.min():.1e} to {part.max():.1e} of compensation'
    return (f'{text}, {row["slips"]:.1f} slips/s, variation {max(row["variation"]):.0f} N·m/s'
            f'{trip(row)}')


def trip(row: dict[str, Any]) -> str:
    """Return when the controller trips and the largest error by then, as text; '' for never."""
    if row['tripped'] is None:
        return ''
    return f', tripped at {row["tripped"][0]:.2f} s, {row["tripped"][1]:.2f} rad'


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the table of all labels and tellings, in Markdown."""
    lines = ['| law of | told | conditions | held | worse | diverged | trips of these '
             '| median of the errors relative to compensation | hunting at rest |',
             '|---' * 9 + '|']
    rows = list({(x['label'], x['seed'], x['telling']): x for x in rows}.values())
    bases = {(x['label'], x['seed']): x for x in rows if x['telling'] == 'compensation'}
    for label in dict.fromkeys(x['label'] for x in rows):
        for telling in dict.fromkeys(x['telling'] for x in rows):
            mine = [x for x in rows if (x['label'], x['telling']) == (label, telling)]
            if not mine:
                continue
            counts = [sum(x['verdict'] == v for x in mine) for v in ('held', 'worse', 'diverged')]
            trips = [sum(x['verdict'] == v and x['tripped'] is not None for x in mine)
                     for v in ('held', 'worse', 'diverged')]
            both = [(x, bases[label, x['seed']]) for x in mine if x['diverged'] is None]
            parts = [float(np.median(np.array(x['rms']) / np.array(y['rms'])))
                     for x, y in both if y['diverged'] is None]
            stops = [x['slips'] > _HUNTS for x, _ in both if 'trapezoid' in x['condition']]
            lines.append(
                f'| {label} | {telling} | {len(mine)} | {counts[0]} | {counts[1]} | {counts[2]} '
                f'| {", ".join(map(str, trips))} '
                f'| {np.median(parts) if parts else float("nan"):.2g} '
                f'| {sum(stops)} of {len(stops)} |')
    return '\n'.join(lines)
