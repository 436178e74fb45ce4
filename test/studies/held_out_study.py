"""Held-out conditions for `observer_feedback`, on independent plants: `make held-out`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import json
from pathlib import Path
from typing import Any

from held_out import controller, drawn, run, TELLINGS, told
import numpy as np

#: RMS error of a joint, relative to that of `compensation`, from which a run counts as worse;
#: slips a second at rest from which it counts as hunting.
_WORSE, _HUNTS = 1.2, 2.0


def judged(seed: int, label: str, tellings: Sequence[str]) -> list[dict[str, Any]]:
    """Return the rows of a condition: `compensation` and what is told to the law."""
    c, arm, path, first = drawn(seed)
    rows = []
    for telling in ('compensation', *tellings):
        values = told(c, telling)
        found = run(c, arm, path, first, controller(c, values))
        rows.append({'label': label, 'seed': seed, 'robot': c.robot, 'telling': telling,
                     'condition': c.text(), 'values': values, **found})
    for row in rows:
        row['verdict'] = verdict(row, rows[0])
    return rows


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
        return f'  {row["telling"]:13} diverged at {row["diverged"]:.2f} s'
    text = (f'  {row["telling"]:13} {row["verdict"]:6} rms {min(row["rms"]):.1e} to '
            f'{max(row["rms"]):.1e} rad')
    if base['diverged'] is None:
        part = np.array(row['rms']) / np.array(base['rms'])
        text += f', {part.min():.1e} to {part.max():.1e} of compensation'
    return f'{text}, {row["slips"]:.1f} slips/s, variation {max(row["variation"]):.0f} N·m/s'


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the table of all labels and tellings, in Markdown."""
    lines = ['| law of | told | conditions | held | worse | diverged | median of the errors '
             'relative to compensation | hunting at rest |', '|---' * 8 + '|']
    rows = list({(x['label'], x['seed'], x['telling']): x for x in rows}.values())
    bases = {(x['label'], x['seed']): x for x in rows if x['telling'] == 'compensation'}
    for label in dict.fromkeys(x['label'] for x in rows):
        for telling in ('compensation', *TELLINGS):
            mine = [x for x in rows if (x['label'], x['telling']) == (label, telling)]
            if not mine:
                continue
            counts = [sum(x['verdict'] == v for x in mine) for v in ('held', 'worse', 'diverged')]
            both = [(x, bases[label, x['seed']]) for x in mine if x['diverged'] is None]
            parts = [float(np.median(np.array(x['rms']) / np.array(y['rms'])))
                     for x, y in both if y['diverged'] is None]
            stops = [x['slips'] > _HUNTS for x, _ in both if 'trapezoid' in x['condition']]
            lines.append(
                f'| {label} | {telling} | {len(mine)} | {counts[0]} | {counts[1]} | {counts[2]} '
                f'| {np.median(parts) if parts else float("nan"):.2g} '
                f'| {sum(stops)} of {len(stops)} |')
    return '\n'.join(lines)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--first', type=int, default=3000, help='seed of the first condition')
    parser.add_argument('--count', type=int, default=44, help='number of conditions')
    parser.add_argument('--tellings', nargs='*', default=list(TELLINGS), choices=TELLINGS)
    parser.add_argument('--label', default='this', help='what the rows are called in the table')
    parser.add_argument('--rows', type=Path, default=Path('held_out.jsonl'))
    options = parser.parse_args()
    known = [json.loads(x) for x in options.rows.read_text().splitlines()
             ] if options.rows.exists() else []
    done = {(x['label'], x['seed'], x['telling']) for x in known}
    for seed in range(options.first, options.first + options.count):
        left = [x for x in options.tellings if (options.label, seed, x) not in done]
        if not left:
            continue
        rows = judged(seed, options.label, left)
        known += rows
        print(seed, rows[0]['condition'], *(line(x, rows[0]) for x in rows), sep='\n', flush=True)
        with options.rows.open('a') as file:
            file.writelines(json.dumps(x) + '\n' for x in rows)
    print(table(known))


if __name__ == '__main__':
    main()
