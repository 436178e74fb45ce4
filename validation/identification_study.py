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

"""The table of validation/identification.md: robots with random friction, identified."""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
import dataclasses
import json
from pathlib import Path
import time
from typing import Any

from ctc_chattering.analysis.metrics import metrics
from ctc_chattering.dynamics.corrected_urdf import with_payload
from ctc_chattering.identification.gains import recommend, Recommendation
from ctc_chattering.identification.identify import Identification, identify
from ctc_chattering.identification.model_errors import candidates
from ctc_chattering.identification.perturbation import perturbation
from ctc_chattering.trajectory.motions import Route
from identified_robots import arm, record, Recorded, windows_of
from identified_robots import motion as motion_of
import numpy as np
from urdfs import heavier_links

#: Robots and plants of the study.
ROBOTS = (('two_link', 'builtin'), ('two_link_urdf', 'mujoco'), ('panda', 'builtin'),
          ('panda', 'mujoco'), ('ur5', 'builtin'), ('ur5', 'mujoco'))
#: What differs from the plain plant, by name.
CASES: dict[str, dict[str, Any]] = {
    'plain': {}, 'delay': {'input_delay': 2}, 'lag': {'actuator_lag': 2e-3, 'input_delay': 1},
    'link': {}, 'payload': {}}
#: Runs of a case other than plain, and runs in which the recommended gains are tried.
_FEW = 3


def outcome(robot: str, backend: str, case: str, seed: int, duration: float) -> dict[str, Any]:
    """Return one row: errors and intervals of what was identified."""
    made = recorded(robot, backend, case, seed, duration)
    text = arm(robot).urdf
    errors = candidates(made.model, text)
    begin = time.process_time()
    found = identify([made.recording.checked()], made.model, errors)
    seconds = time.process_time() - begin
    run = perturbation(found)
    recommended = recommend(found, run, made.model, made.recording.q)
    unseen = recorded(robot, backend, case, seed, 20.0, 500)
    other = perturbation(dataclasses.replace(
        found, data=windows_of(found, unseen.recording.checked(), made.model)))
    ka = np.array(recommended.values['ka'][0], float)
    known = [x.coulomb.value is not None for x in found.friction]
    return {'robot': robot, 'backend': backend, 'case': case, 'seed': seed, 'seconds': seconds,
            **friction(found, made), 'delay': found.timing.delay,
            'delays': list(found.timing.delays), 'true_delay': made.plant.input_delay,
            'lag': found.timing.lag.tolist(), 'true_lag': list(made.plant.actuator_lag),
            'errors': {x.name: [number.value, number.half] for x, number in found.errors},
            'ka_over_peak': (ka / other.peak)[known].tolist(),
            'advantage': advantage(robot, backend, case, seed, recommended)
            if case == 'plain' and seed < _FEW else []}


def advantage(robot: str, backend: str, case: str, seed: int, recommended: Recommendation
              ) -> list[float]:
    """Return how many times better than `compensation` with the same kp and kv, joint by joint."""
    values: dict[str, Any] = {name: x for name, (x, _) in recommended.values.items()}
    gains: dict[str, Any] = {name: values[name] for name in ('kp', 'kv') if name in values}
    rms = [np.array(metrics(recorded(robot, backend, case, seed, 20.0, 500, one).run)
                    ['rms_error_rad']) for one in (gains, values)]
    found: list[float] = (rms[0] / rms[1]).tolist()
    return found


def recorded(robot: str, backend: str, case: str, seed: int, duration: float, motion: int = 0,
             controller: Mapping[str, Any] | None = None) -> Recorded:
    """Return a recording of a case; with another `motion`, one that is not used for the fit."""
    mine = arm(robot)
    plant = {name: [value] * len(mine.joints) if name == 'actuator_lag' else value
             for name, value in CASES[case].items()}
    truth = ''
    if case == 'link':
        truth = heavier_links(mine.urdf, mine.joints, 1.1)[seed % len(mine.joints)][1]
    elif case == 'payload':
        truth = with_payload(mine.urdf, mine.joints, 1.0)
    route = motion_of(mine, duration, seed + motion)
    if motion:
        route = as_fast(route, motion_of(mine, 60.0, seed), mine.centre)
    return record(robot, seed, duration, backend=backend, plant=plant, truth=truth,
                  controller=controller, route=route)


def as_fast(route: Route, known: Route, centre: Sequence[float]) -> Route:
    """Return a motion whose joints, scaled about the centre, are nearly as fast as in another."""
    mine, other = (np.abs([dq for _, dq, _ in it.points]).max(axis=0) for it in (route, known))
    scale = np.minimum(0.9 * other / mine, 1.3)
    points = [((np.array(q) - centre) * scale + centre, np.array(dq) * scale,
               np.array(ddq) * scale) for q, dq, ddq in route.points]
    return Route(route.names, route.times, [
        tuple(tuple(x.tolist()) for x in point) for point in points])  # type: ignore[misc]


def friction(found: Identification, made: Recorded) -> dict[str, Any]:
    """Return relative errors of friction, and whether intervals contain the truth."""
    rows: dict[str, Any] = defaultdict(list)
    for i, one in enumerate(found.friction):
        for name, number, true in (('coulomb', one.coulomb, made.plant.coulomb_friction[i]),
                                   ('viscous', one.viscous, made.plant.viscous_friction[i])):
            if number.value is not None:
                rows[name].append(number.value / true - 1.0)
                rows[f'{name}_covered'].append(bool(abs(number.value - true) <= number.half))
            else:
                rows[f'{name}_missing'].append(number.reason)
    return rows


def table(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of the table in Markdown."""
    yield ('| robot | plant | case | runs | Coulomb: median, worst | viscous: median, worst | '
           'intervals that hold | delay exact | error of a lag | errors of the model found '
           '| ka over unseen peak | better than `compensation` | s |')
    yield '|---|---|---|---|---|---|---|---|---|---|---|---|---|'
    groups: dict[tuple[str, str, str], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[row['robot'], row['backend'], row['case']].append(row)
    for (robot, backend, case), mine in groups.items():
        cells = [robot, backend, case, str(len(mine))]
        for name in ('coulomb', 'viscous'):
            values = np.abs(np.concatenate([row[name] for row in mine]))
            cells.append(f'{100 * np.median(values):.1g} %, {100 * values.max():.1g} %')
        held = np.concatenate([row['coulomb_covered'] + row['viscous_covered'] for row in mine])
        exact = sum(row['delay'] == row['true_delay'] and len(row['delays']) == 1 for row in mine)
        off = max(float(np.abs(np.subtract(row['lag'], row['true_lag'])).max()) for row in mine)
        ratio = np.concatenate([row['ka_over_peak'] for row in mine])
        better = [x for row in mine for x in row.get('advantage', [])]
        cells += [f'{100 * held.mean():.0f} % of {len(held)}', f'{exact} of {len(mine)}',
                  f'{1e6 * off:.0f} µs', _named(mine), f'{ratio.min():.2f} to {ratio.max():.2f}',
                  f'{min(better):.0f} times' if better else '',
                  f'{max(row["seconds"] for row in mine):.0f}']
        yield f'| {" | ".join(cells)} |'


def _named(rows: list[dict[str, Any]]) -> str:
    """Return which errors of the model were found, in how many runs."""
    counts: dict[str, int] = defaultdict(int)
    for row in rows:
        clear = [f'{name} {value[0]:+.3f}' for name, value in row['errors'].items()
                 if value[0] is not None]
        counts[', '.join(clear) or 'none'] += 1
    return '; '.join(f'{name} ({count})' for name, count in counts.items())


def main() -> None:
    """Run the study, or print the table of what was run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=20)
    parser.add_argument('--first', type=int, default=0)
    parser.add_argument('--duration', type=float, default=60.0)
    parser.add_argument('--only', default='', help='robot, plant or case')
    parser.add_argument('--rows', type=Path, default=Path('identification.jsonl'),
                        help='where outcomes are added, one a line; those there are not run again')
    options = parser.parse_args()
    rows = [json.loads(line) for line in options.rows.read_text().splitlines()
            ] if options.rows.exists() else []
    done = {(row['robot'], row['backend'], row['case'], row['seed']) for row in rows}
    for seed in range(options.first, options.first + options.seeds):
        for robot, backend in ROBOTS:
            for case in CASES:
                key = (robot, backend, case, seed)
                skip = (case in ('link', 'payload') and not arm(robot).urdf) or (
                    case != 'plain' and seed >= options.first + _FEW)
                wanted = not options.only or options.only in (robot, backend, case)
                if key in done or skip or not wanted:
                    continue
                rows.append(outcome(*key, options.duration))
                with options.rows.open('a') as file:
                    file.write(json.dumps(rows[-1]) + '\n')
    print('\n'.join(table(rows)))


if __name__ == '__main__':
    main()
