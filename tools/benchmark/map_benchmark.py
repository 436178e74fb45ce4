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
Simulated seconds of a compiled run per second of a processor, beside other simulators.

``make map-benchmark`` prints a Markdown table. JAX and Drake are measured where they are
installed (``pip install jax drake``). All are run in turns, on one processor, one thread each, so
that a busy machine slows all of them alike. Computing time is counted, not the time of a clock.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
import dataclasses
from functools import partial
from importlib.metadata import PackageNotFoundError, version
import os
import platform
import statistics
import sys
import time
from typing import Any, NamedTuple

from ctc_chattering.analysis.metrics import rms, within
from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.compilation import compile_setups
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.runs.run_lists import result_row
from ctc_chattering.runs.score import score
from ctc_chattering.runs.spec import Failure
from ctc_chattering.simulation.closed_loop import Run
from fixed_case import by_jax, by_numba, Floats, FRICTION, PERIOD
import numpy as np
from other_simulators import DrakeLoop, Rollout

#: Length of a run [s].
DURATION = 5.0
#: Evaluated interval [s].
WINDOW = (2.5, 5.0)
#: Computing time of one measurement [s], at least.
LEAST = 0.3
#: Runs of the fixed case in one call of numba.
BY_NUMBA = 100
#: Runs of the fixed case in one call of JAX.
BY_JAX = 1000
#: Length over which the positions of a replayed run are compared [s]: what replays is not stable.
REPLAYED = 1.0
COMPILED = 'compiled'
COLUMNS = (
    COMPILED, 'plain Python', 'row of a map', 'scalars, numba', 'scalars, JAX', 'MuJoCo, replay',
    'MuJoCo, Python law', 'Drake')
LAWS: Mapping[str, Mapping[str, Any]] = {
    'compensation': {'law': 'compensation'},
    'chattering sign': {'law': 'chattering', 'switching': 'sign'},
    'chattering implicit_observer': {'law': 'chattering', 'switching': 'implicit_observer'},
    'observer_feedback': {'law': 'observer_feedback'}}
NOTES = """\
Simulated seconds per second of computing time, and how many times the compiled (median of {rounds}
rounds, smallest and largest in brackets); sample period and Runge-Kutta step of 1 ms.

- *compiled*: a run with all its samples; *row of a map*: with its numbers.
- *scalars*: one law, one arm, friction that stops at the end of a step, errors only; by numba one
  run after the other, by JAX {by_jax} runs in step (jit, scan, vmap; float64; one thread). No
  other law, sensor, drive, delay or seed. In step, each run takes the time of the slowest: events
  that are located, or laws that iterate, would cost all runs what they cost one.
- *MuJoCo, replay*: `mujoco.rollout` of the recorded torques, no law. *Python law*: plain Python
  and the tests' plant. Friction is a constraint, exact to the step in which a joint stops.
  With its steps of first order, whose position is half a step ahead, a replay is 3 times as fast.
- *Drake*: its discrete plant, of first order, and InverseDynamicsController, joined in C++. It has
  no friction in joints, and law (2) without its term C v.
- The paper's arm is no tree of bodies (its M12), MuJoCo and Drake have the arm of its URDF."""


class Contestant(NamedTuple):
    """A function that returns how much it simulated [s], and its check."""

    simulate: Callable[[], float]
    check: str = ''


class Case(NamedTuple):
    """A row of the table."""

    title: str
    setup: Setup
    #: Columns besides those of the package.
    others: Mapping[str, Callable[[Setup, Run], Contestant]]


def load(name: str, controller: Mapping[str, Any], **nodes: Mapping[str, Any]) -> Setup:
    """Return a parameter file of the package with other values."""
    plant = {'duration': DURATION, **nodes.pop('plant', {})}
    return parameter_file.load(config_directory() / f'{name}.yaml', {
        'plant': plant, 'controller': controller, **nodes})


def cases() -> Iterator[Case]:
    """Yield the rows of the table."""
    compensation = LAWS['compensation']
    urdf = {'model': 'urdf', 'description': str(config_directory() / 'two_link.urdf')}
    mujoco = {'MuJoCo, replay': replay, 'MuJoCo, Python law': by_mujoco}
    for law, values in LAWS.items():
        yield Case(f'two-link, {law}', load('friction', values),
                   {'scalars, numba': partial(scalars, by_numba, BY_NUMBA),
                    'scalars, JAX': partial(scalars, by_jax, BY_JAX)}
                   if values is compensation else {})
    yield Case('two-link of a URDF, compensation', load('friction', compensation, **{'/**': urdf}),
               mujoco)
    for law, values in LAWS.items():
        yield Case(f'Panda, {law}', load('panda', values),
                   mujoco if values is compensation else {})
    for title, name, more in (('two-link of a URDF', 'friction', urdf), ('Panda', 'panda', {})):
        n = {'friction': 2, 'panda': 7}[name]
        free = {'coulomb_friction': [0.0] * n, 'viscous_friction': [0.0] * n}
        yield Case(f'{title}, no friction', load(
            name, {**compensation, 'b': 1e-3, 'effort_limit': [1e4] * n}, plant=free,
            reference={'start_duration': 0.0}, **{'/**': more}), {'Drake': by_drake})


def contestants(case: Case) -> dict[str, Contestant]:
    """Return what is measured for a row, by column."""
    setup = case.setup
    compile_setups([setup], partial(print, flush=True))
    run = simulate(setup, truth=True).run
    plain = dataclasses.replace(setup, plant=setup.plant.changed({'compiled': False}))

    def by(setup: Setup) -> float:
        return float(simulate(setup).run.t[-1])

    def row() -> float:
        result_row(score(setup, WINDOW), len(setup.plant.joint_names), Failure())
        return DURATION

    found = {COLUMNS[0]: Contestant(partial(by, setup)),
             COLUMNS[1]: Contestant(partial(by, plain), largest_difference(
                 simulate(plain).run.q, simulate(setup).run.q)), COLUMNS[2]: Contestant(row)}
    for column, make in case.others.items():
        try:
            found[column] = make(setup, run)
        except ImportError as error:
            print(f'{column}: {error.name} is not installed', flush=True)
    return found


def scalars(make: Callable[[], Callable[[Floats, int, int], Floats]], runs: int, _setup: Setup,
            run: Run) -> Contestant:
    """Return the fixed case."""
    errors, friction = make(), np.full(runs, FRICTION)
    first, steps = round(WINDOW[0] / PERIOD), round(DURATION / PERIOD)

    def simulate_all() -> float:
        errors(friction, first, steps)
        return runs * DURATION

    return Contestant(simulate_all, difference(errors(friction, first, steps)[0], run))


def replay(setup: Setup, run: Run) -> Contestant:
    """Return MuJoCo with the torques of a run."""
    rollout = Rollout(setup, run)
    rows = round(REPLAYED / PERIOD)

    def positions() -> float:
        rollout.positions()
        return DURATION

    found, known = rollout.positions()[:rows], run.q[:rows + 1]
    moved = np.ptp(known, axis=0).max()
    return Contestant(positions, f'in a motion of {moved:.2g} rad in {REPLAYED:g} s '
                      + largest_difference(found, known[1:], 1e-2 * moved))


def by_mujoco(setup: Setup, run: Run) -> Contestant:
    """Return the loop of `ctc simulate` with MuJoCo's plant."""
    from mujoco_plant import simulated_by_mujoco  # MuJoCo may be missing.

    def closed_loop() -> float:
        return float(simulated_by_mujoco(setup).run.t[-1])

    return Contestant(closed_loop, difference(
        errors_of(simulated_by_mujoco(setup, truth=True).run), run))


def by_drake(setup: Setup, run: Run) -> Contestant:
    """Return Drake's loop; its errors are compared from the start on."""
    loop = DrakeLoop(setup)

    def closed_loop() -> float:
        loop.positions()
        return DURATION

    return Contestant(closed_loop, 'from t = 0 on, ' + difference(
        rms(run.q_d - loop.positions()), run, (0.0, DURATION)))


def errors_of(run: Run, window: tuple[float, float] = WINDOW) -> Floats:
    """Return the RMS error of every joint, shape (n,) [rad]."""
    return rms((run.q_d - run.q)[within(run.t, window)])


def difference(errors: Floats, run: Run, window: tuple[float, float] = WINDOW) -> str:
    """Return how far RMS errors, shape (n,) [rad], are from those of a run."""
    return f'RMS errors differ by {_allowed(errors / errors_of(run, window) - 1.0, 1e-2):.2%}'


def largest_difference(a: Floats, b: Floats, most: float = 1e-9) -> str:
    """Return how far positions are apart."""
    return f'positions differ by {_allowed(a - b, most):.1e} rad'


def _allowed(differences: Floats, most: float) -> float:
    """Return the largest difference; end the benchmark if it is above `most`."""
    found = float(np.abs(differences).max())
    if not found <= most:
        raise SystemExit(f'not the same motion: {found:.2g} > {most:g}')
    return found


def rate(contestant: Contestant) -> float:
    """Return simulated time per computing time."""
    total, begin = 0.0, time.process_time()
    while (used := time.process_time() - begin) < LEAST:
        total += contestant.simulate()
    return total / used


def cell(rates: Sequence[float], compiled: Sequence[float]) -> str:
    """Return a cell: median rate, and the ratios to the compiled, round by round."""
    ratios = [a / b for a, b in zip(rates, compiled)]
    shown = ((statistics.median(ratios), min(ratios), max(ratios)) if rates is not compiled else
             (1.0, min(rates) / statistics.median(rates), max(rates) / statistics.median(rates)))
    rate = statistics.median(rates)
    return f'{rate:.{0 if rate >= 10.0 else 1}f}: ' + '{:.2g} [{:.2g}, {:.2g}]'.format(*shown)


def installed() -> str:
    """Return the versions of what is measured."""
    found = []
    for name in ('numba', 'numpy', 'mujoco', 'jax', 'drake'):
        try:
            found.append(f'{name} {version(name)}')
        except PackageNotFoundError:
            found.append(f'{name} not installed')
    return ', '.join(found)


def main() -> None:
    """Measure in turns and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rounds', type=int, default=5)
    rounds = parser.parse_args().rounds
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    print(f'{platform.release()}, Python {platform.python_version()}, {installed()}; '
          f'load average {os.getloadavg()[0]:.1f} before', flush=True)
    measured = {case.title: contestants(case) for case in cases()}
    rates: dict[tuple[str, str], list[float]] = {}
    for number in range(rounds):
        for title, found in measured.items():
            for column, contestant in found.items():
                rates.setdefault((title, column), []).append(rate(contestant))
        print(f'round {number + 1} of {rounds}', file=sys.stderr, flush=True)
    print('| | ' + ' | '.join(COLUMNS) + ' |')
    print('|---|' + '--:|' * len(COLUMNS))
    for title in measured:
        compiled = rates[title, COMPILED]
        print(f'| {title} | ' + ' | '.join(
            cell(rates[title, x], compiled) if (title, x) in rates else ''
            for x in COLUMNS) + ' |')
    print('\n' + NOTES.format(rounds=rounds, by_jax=BY_JAX))
    print('\nChecked against compiled runs:\n')
    for title, found in measured.items():
        for column, contestant in found.items():
            if contestant.check:
                print(f'- {title}, {column}: {contestant.check}')


if __name__ == '__main__':
    main()
