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

"""
The table of faults: robots of an independent plant with what real arms have, identified.

For each fault and robot: the share of 95 % intervals that hold among joints that are usable, the
wrong numbers that nothing warns of, whether ka holds |P| in an unseen motion as fast as the limits
allow, and how much better the recommended gains are there than `compensation` with those of the
run.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator
import dataclasses
import json
from pathlib import Path
import re
import tempfile
import traceback
from typing import Any

from ctc_chattering.configuration.compilation import compile_setups
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.gains import Recommendation
from ctc_chattering.identification.results import IdentificationResults
from ctc_chattering.identification.sentences import verdict_text
from ctc_chattering.identification.trial_runs import (
    COMPILED_COUNT,
    parameter_values,
    setups_tried,
    trial_runs,
)
from ctc_chattering.trajectory.waypoints import Route
from faults_of_arms import case, FAULTS, recorded
from faulty_robots import Case, Faulty, lab_gains, plant_of, Played, played, sampled
from identification_judge import judged, model_of, Outcome, outcome
import numpy as np
from rigid_bodies import Array, dynamics
from robots import arm, DESCRIBED, motion

#: Robots of the table.
ROBOTS = ('two_link', 'two_link_urdf', 'panda', 'ur5')
#: Duration of the unseen motion before it is made faster [s].
_UNSEEN = 10.0
#: Parts of the limits of velocity and torque that the motion takes.
_PART = 0.9
#: Least factor by which a motion is slowed down for its torque.
_SLOWEST = 0.1
#: What Pinocchio has in place of a limit that a joint has not is above [rad/s].
_NO_LIMIT = 100.0
#: Acceleration over the limit of velocity [1/s], as URDFs have none.
_ACCELERATION = 4.0
#: Error at which a run has failed [rad].
_FAILED = 1.5


def row(robot: str, fault: str, seed: int, duration: float, trials: int = COMPILED_COUNT
        ) -> dict[str, Any]:
    """Return what is found of one robot with one fault; without trials gains are not tried."""
    one = case(robot, fault, seed, duration)
    seen, recording = recorded(one, seed, duration)
    if not np.isfinite(seen.q).all():
        return {'robot': robot, 'fault': fault, 'seed': seed, 'lost': 'the plant diverged'}
    made = outcome(one, recording, seed)
    if made.results is not None and trials and all(x.usable for x in made.results.verdicts):
        made = with_trials(made, made.results, trials)
    found = {'robot': robot, 'fault': fault, 'seed': seed,
             **judged(one, seen, made, duration)}
    if made.results is not None:
        found.update(tried(one, made, made.results, seen, seed, bool(trials)))
    return found


def with_trials(made: Outcome, results: IdentificationResults, trials: int) -> Outcome:
    """Return an outcome with gains that survive trial runs."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'robot.urdf'
        file.write_text(made.urdf, encoding='utf-8')
        setups = setups_tried(
            results.recommended, values_of(made, results, file, results.recommended))
        compile_setups(setups, lambda _: None)
        recommended = trial_runs(
            results.found, results.run, results.recommended, setups, trials, 1)
    results = dataclasses.replace(results, recommended=recommended)
    return made._replace(results=results, severity=tuple(x.severity for x in results.verdicts),
                         reasons=tuple(map(verdict_text, results.verdicts)))


def values_of(made: Outcome, results: IdentificationResults, file: Path,
              recommended: Recommendation) -> dict[str, dict[str, Any]]:
    """Return the parameter file of gains."""
    shared = {'model': 'two_link', 'gravity': 9.81}
    if made.urdf:
        shared = {'model': 'urdf', 'gravity': 9.81, 'description': str(file)}
    assert made.model is not None
    return parameter_values(results.found, recommended, made.model, shared, None)


def tried(one: Case, made: Outcome, results: IdentificationResults, seen: Played, seed: int,
          gains: bool) -> dict[str, Any]:
    """Return what the recommended gains are worth in an unseen motion."""
    robot, recommended = one.robot, results.recommended
    known = np.abs(seen.velocity).max(axis=0)
    route = fast(robot, _UNSEEN, seed, known)
    assert made.model is not None
    size, speed = perturbation_of(played(robot, route, seed), made.model)
    # A robot that its drives do not hold leaves the limits.
    peak = np.where(speed <= speeds(robot, known), np.abs(size), 0.0).max(axis=0)
    usable = [x.usable for x in results.verdicts]
    found: dict[str, Any] = {'ka_over_peak': [
        round(k / p, 3) for k, p, good in zip(recommended.values['ka'], peak.tolist(), usable)
        if good and k is not None and p > 0.0]}
    if not gains or not all(usable):
        return found
    values = values_of(made, results, Path(), recommended)['controller']
    kp, kv = lab_gains(robot)
    n = [1.0] * robot.n
    before = config_of(robot, {'law': 'compensation', 'kp': [kp * x for x in n],
                               'kv': [kv * x for x in n]})
    rms = [tracked(robot, model, config, route, seed) for model, config in (
        (model_of(one), before), (made.model, config_of(robot, values)))]
    with np.errstate(all='ignore'):
        better = rms[0] / rms[1]
    return {**found, 'trials': list(recommended.trials),
            'better': np.nan_to_num(better, nan=0.0).round(2).tolist()}


def speeds(robot: Faulty, known: Array) -> Array:
    """Return the limits of velocity, shape (n,) [rad/s]; known speeds where there is none."""
    limit = arm(robot.name).limits()[1]
    return np.where((limit > 0.0) & (limit < _NO_LIMIT), limit, known)


def fast(robot: Faulty, duration: float, seed: int, known: Array) -> Route:
    """
    Return a motion that was not recorded, as fast as the limits allow.

    A joint without a limit of velocity is as fast as it was in the recorded motion, `known`.
    """
    route = motion(arm(robot.name), duration, seed + 500)
    speed, torque = speeds(robot, known / _PART), arm(robot.name).limits()[0]
    torque = np.where(torque > 0.0, torque, np.inf)
    q, dq, ddq = sampled(route, 0.01).transpose(1, 0, 2)
    times = min(float((_PART * speed / np.abs(dq).max(axis=0)).min()),
                float(np.sqrt((_ACCELERATION * speed / np.abs(ddq).max(axis=0)).min())))
    # Where weight and friction alone are beyond that, slower motions are none the better.
    slowest = _SLOWEST * times
    while times > slowest and (
            _torque(robot, q, times * dq, times ** 2 * ddq) > _PART * torque).any():
        times *= 0.9
    points = [(a, tuple(times * x for x in b), tuple(times ** 2 * x for x in c))
              for a, b, c in route.points]
    return Route(route.names, [round(t / times) for t in route.times], points)


def _torque(robot: Faulty, q: Array, dq: Array, ddq: Array) -> Array:
    """Return the largest torque of each joint with friction [N·m]."""
    n = robot.n
    mass, bias, most = np.empty((n, n)), np.empty(n), np.zeros(n)
    for x, v, a in zip(q, dq, ddq):
        dynamics(robot.nominal, x, v, mass, bias)
        most = np.maximum(most, np.abs(mass @ a + bias))
    found: Array = most + robot.physics.coulomb + robot.physics.viscous * np.abs(dq).max(axis=0)
    return found


def tracked(robot: Faulty, model: Model, config: ControllerConfig, route: Route, seed: int
            ) -> Array:
    """Return the RMS error of each joint under a law of this package; nan where it fails."""
    wanted = sampled(route, robot.period)
    plant = plant_of(robot, wanted[0, 0], seed)
    controller = Controller(config, model)
    delay, rows = config.input_delay, wanted.tolist()
    rows += rows[-1:] * (delay + 1)
    total = np.zeros(robot.n)
    for k in range(len(wanted)):
        q, dq = plant.measured()
        q_d, dq_d, ddq_d = rows[k]
        sample = controller.try_step(q.tolist(), dq.tolist(), q_d, dq_d, ddq_d,
                                     rows[k + 1:k + 1 + delay])
        error = plant.q - wanted[k, 0]
        if sample is None or not (np.abs(error) < _FAILED).all():
            return np.full(robot.n, np.nan)
        total += np.square(error)
        plant.step(sample.tau)
    found: Array = np.sqrt(total / len(wanted))
    return found


def config_of(robot: Faulty, values: dict[str, Any]) -> ControllerConfig:
    """Return the controller of a parameter file's values."""
    return ControllerConfig.from_mapping({
        'joint_names': list(robot.joints), 'control_period': robot.period,
        'model': 'urdf' if arm(robot.name).urdf else 'two_link', **values})


def perturbation_of(seen: Played, model: Model) -> tuple[Any, Any]:
    """Return what drives do beyond a model, means of 20 samples [N·m], and speeds [rad/s]."""
    torque = np.array([model.inverse_dynamics(*state) for state in zip(
        seen.position.tolist(), seen.velocity.tolist(), seen.acceleration.tolist())])
    rest, whole = seen.drive - torque, len(torque) // 20
    rest, speed = (x[:20 * whole].reshape(whole, 20, -1)
                   for x in (rest, np.abs(seen.velocity)))
    return rest.mean(axis=1), speed.max(axis=1)


def table(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of the table in Markdown."""
    yield ('| fault | robot | runs | joints usable, with care, not | intervals that hold | wrong '
           'without a warning | ka over unseen peak | better: least, median |')
    yield '|---|---|---|---|---|---|---|---|'
    groups: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    for one in rows:
        groups[one['fault'], one['robot']].append(one)
    order = {fault: k for k, fault in enumerate(FAULTS)}
    for key in sorted(groups, key=lambda x: (order[x[0]], x[1])):
        yield f'| {" | ".join((*key, *_cells(groups[key])))} |'
    if rows:
        yield f'| {" | ".join(("all", "", *_cells(rows)))} |'


def _cells(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the cells of one line."""
    yield str(len(rows)) + ''.join(
        f', {name} {count}' for name in ('lost', 'failed')
        if (count := sum(name in one for one in rows)))
    rows = [one for one in rows if 'wrong' in one]
    yield ', '.join(str(sum(one[name] for one in rows)) for name in ('usable', 'care', 'refused'))
    held = [x for one in rows for x in one['held']]
    yield f'{100.0 * np.mean(held):.0f} % of {len(held)}' if held else ''
    wrong = [x for one in rows for x in one['wrong']]
    yield f'**{len(wrong)}** in {sum(bool(one["wrong"]) for one in rows)}' if wrong else '0'
    ratio = [x for one in rows for x in one.get('ka_over_peak', [])]
    yield (f'{min(ratio):.2f} to {max(ratio):.2f}, below 1: {sum(x < 1.0 for x in ratio)}'
           if ratio else '')
    better = [x for one in rows for x in one.get('better', [])]
    yield f'{min(better):.2g}, {np.median(better):.2g}' if better else ''


def main() -> None:
    """Run what was not run yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=20)
    parser.add_argument('--first', type=int, default=0)
    parser.add_argument('--duration', type=float, default=25.0)
    parser.add_argument('--only', default='', metavar='A,B',
                        help='faults and robots, with commas; of both kinds, those of both')
    parser.add_argument('--trials', type=int, default=COMPILED_COUNT,
                        help='of the recommended gains, as `ctc identify` has it; 0: try no gains')
    parser.add_argument('--rows', type=Path, default=Path('faults.jsonl'),
                        help='where outcomes are added, one a line; those there are not run again')
    options = parser.parse_args()
    only = set(filter(None, options.only.split(',')))
    others = {x for x in only if x in DESCRIBED or re.fullmatch(r'drawn\d+', x)}
    if unknown := only - {*FAULTS, *ROBOTS, *others}:
        parser.error(f'--only: {", ".join(sorted(unknown))} is not allowed; allowed: '
                     f'{", ".join((*FAULTS, *ROBOTS, *DESCRIBED))}, and drawn1, drawn2, ...')
    robots = sorted(only & {*ROBOTS, *others}) or ROBOTS
    rows = [json.loads(line) for line in options.rows.read_text().splitlines()
            ] if options.rows.exists() else []
    done = {(one['robot'], one['fault'], one['seed']) for one in rows}
    for key in ((robot, fault, seed)
                for seed in range(options.first, options.first + options.seeds)
                for fault in (only & {*FAULTS} or FAULTS) for robot in robots):
        if key in done:
            continue
        try:
            rows.append(row(*key, options.duration, options.trials))
        except Exception:  # A defect of what is judged: it is in the table.
            rows.append({**dict(zip(('robot', 'fault', 'seed'), key)),
                         'failed': traceback.format_exc()})
        with options.rows.open('a') as file:
            file.write(json.dumps(rows[-1]) + '\n')
    print('\n'.join(table(rows)))


if __name__ == '__main__':
    main()
