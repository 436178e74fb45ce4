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

"""Held-out conditions for `observer_feedback`, on the independent plant: runs, verdicts, table."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import json
from pathlib import Path
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.controller.trips import TripMonitor
from ctc_chattering.dynamics.registry import make_model
from ctc_chattering.numerics.time_grid import period_ns
from held_out import Condition, drawn, DURATION, Path3, RIVALS, robot, TELLINGS, told
from independent_plant import Physics, Plant
from machine_code import compile_step
import numpy as np
from rigid_bodies import Array

#: Errors count from this time on [s].
COUNTS = 5.0
#: A larger error is a run that diverged [rad].
DIVERGED = 3.0
#: Longest step of a plant of two joints [s].
_FINE = 2e-5
#: Longest step of a plant of more joints [s].
_COARSE = 1e-4
#: RMS error of a joint, relative to that of `compensation`, from which a run counts as worse.
_WORSE = 1.2


def controller(c: Condition, values: dict[str, Any]) -> Controller:
    """Return the package's controller with the model that the lab believes, compiled."""
    known = robot(c.robot)
    kind = 'urdf' if known.urdf else 'two_link'
    config = ControllerConfig.from_mapping(
        {**values, 'joint_names': list(known.joints), 'model': kind})
    made = Controller(config, make_model(kind, 9.81, known.joints, known.urdf))
    compile_step(made)
    return made


def run(c: Condition, physics: Physics, path: Path3, first: Array, law: Controller
        ) -> dict[str, Any]:
    """
    Return what happens, as a row; positions are true ones.

    A trip does not end the run: the row has its instant [s] and the largest error by then [rad].
    """
    count, delay = int(DURATION / c.period), law.config.input_delay
    plant = Plant(physics, first, c.period, c.delay, held=False, encoder=c.encoder,
                  longest=_COARSE if len(first) > 2 else _FINE)
    errors, torques = [], []
    h, rng, lost = period_ns(c.period), np.random.default_rng((c.seed, 27)), 0
    off = np.rint(h * c.jitter * rng.uniform(-1.0, 1.0, count + 1)).astype(int)
    off[0] = 0
    held: Sequence[float] = ()
    monitor, tripped = TripMonitor(law.config.joint_names, period_ns(c.period)), None
    for k in range(count):
        q, dq = plant.measured()
        x = 1e-9 * off[k]  # From the grid to the instant of this state [s].
        points = [((path.q[j] + x * (path.dq[j] + 0.5 * x * path.ddq[j])).tolist(),
                   (path.dq[j] + x * path.ddq[j]).tolist(), path.ddq[j].tolist())
                  for j in range(k, k + delay + 1)]
        error = np.array(points[0][0]) - plant.q
        errors.append(error)
        lost = lost + 1 if k and lost < 2 and rng.random() < c.lost else 0
        if not lost:
            sample = law.try_step(q.tolist(), dq.tolist(), *points[0], ahead=points[1:],
                                  t=k * h + int(off[k]))
            if sample is None or not np.isfinite(error).all() or np.abs(error).max() > DIVERGED:
                return {'diverged': round(k * c.period, 3), 'tripped': tripped}
            if tripped is None and monitor.check(law, sample):
                tripped = [round(k * c.period, 3), float(np.abs(errors).max())]
            held = sample.tau
        torques.append(held)
        plant.step(held, c.period + 1e-9 * (off[k + 1] - off[k]))
    last = int(COUNTS / c.period)
    e, tau = np.array(errors)[last:], np.array(torques)[last:]
    return {'diverged': None, 'tripped': tripped, 'rms': np.sqrt((e * e).mean(axis=0)).tolist(),
            'peak': float(np.abs(e).max()),
            'variation': (np.abs(np.diff(tau, axis=0)).sum(axis=0)
                          / (DURATION - COUNTS)).tolist()}


def judged(seed: int, label: str, tellings: Sequence[str], irregular: bool = False
           ) -> list[dict[str, Any]]:
    """Return the rows of a condition: `compensation` and what is told to the law."""
    c, physics, path, first = drawn(seed, irregular)
    rows = []
    for telling in ('compensation', *tellings):
        values = told(c, telling)
        found = run(c, physics, path, first, controller(c, values))
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
        return f'  {row["telling"]:13} diverged at {row["diverged"]:.2f} s{trip(row)}'
    text = (f'  {row["telling"]:13} {row["verdict"]:6} rms {min(row["rms"]):.1e} to '
            f'{max(row["rms"]):.1e} rad')
    if base['diverged'] is None:
        part = np.array(row['rms']) / np.array(base['rms'])
        text += f', {part.min():.1e} to {part.max():.1e} of compensation'
    return f'{text}, variation {max(row["variation"]):.0f} N·m/s{trip(row)}'


def trip(row: dict[str, Any]) -> str:
    """Return when the controller trips and the largest error by then, as text; '' for never."""
    if row['tripped'] is None:
        return ''
    return f', tripped at {row["tripped"][0]:.2f} s, {row["tripped"][1]:.2f} rad'


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the table of all labels and tellings, in Markdown."""
    lines = ['| law of | told | conditions | held | worse | diverged | trips of these '
             '| median of the errors relative to compensation |',
             '|---' * 8 + '|']
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
            lines.append(
                f'| {label} | {telling} | {len(mine)} | {counts[0]} | {counts[1]} | {counts[2]} '
                f'| {", ".join(map(str, trips))} '
                f'| {np.median(parts) if parts else float("nan"):.2g} |')
    return '\n'.join(lines)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--first', type=int, default=3000, help='seed of the first condition')
    parser.add_argument('--count', type=int, default=44, help='number of conditions')
    parser.add_argument('--tellings', nargs='*', default=list(TELLINGS),
                        choices=(*TELLINGS, *RIVALS))
    parser.add_argument('--irregular', action='store_true',
                        help='lose states, and measure the others off the grid')
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
        rows = judged(seed, options.label, left, options.irregular)
        known += rows
        print(seed, rows[0]['condition'], *(line(x, rows[0]) for x in rows), sep='\n', flush=True)
        with options.rows.open('a') as file:
            file.writelines(json.dumps(x) + '\n' for x in rows)
    print(table(known))


if __name__ == '__main__':
    main()
