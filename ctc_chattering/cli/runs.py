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

"""`ctc compare`, `map`, `tune`, `stability`: many runs, and what a loop tolerates."""

from __future__ import annotations

import argparse
import dataclasses
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TYPE_CHECKING

from ctc_chattering.analysis.output import prepare, write_json, writing
from ctc_chattering.cli.command_line import say
from ctc_chattering.cli.options import (
    add_declared,
    add_jobs,
    add_loop_options,
    add_number,
    add_output,
    load_setup,
    words,
)
from ctc_chattering.cli.presentation import present, print_page, progress
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.control.controller import LAWS
from ctc_chattering.errors import CtcError, given_by_user
from ctc_chattering.parameters import LEAST, Parameter
from ctc_chattering.simulation.plant_config import PlantConfig

if TYPE_CHECKING:
    from ctc_chattering.analysis.result import Result
    from ctc_chattering.configuration.loop_setup import Setup
    from ctc_chattering.runs.points import Runs
    from ctc_chattering.runs.tune import TuneSpec


def compare_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc compare`."""
    from ctc_chattering.runs.compare import FILE, GAINS
    from ctc_chattering.runs.conditions import ALL, CONDITIONS, SEED
    parser.add_argument('files', nargs='+', metavar='F',
                        help='parameter file, or the name of one in the package, such as panda')
    parser.add_argument('--condition', action='append', default=[], metavar='X',
                        help="drives, sensors and model error instead of the file's: "
                             f'{" | ".join((*CONDITIONS, ALL))}; may be repeated')
    parser.add_argument('--cases', default='', metavar='F',
                        help='file of further conditions, or the name of one in the package: '
                             "imperfections, the paper's arm with one at a time")
    parser.add_argument('--laws', type=words, metavar='A,B', default=LAWS,
                        help='laws to run, default: all')
    parser.add_argument('--gains', choices=GAINS, default=FILE,
                        help='of the file, which is the default, or recommended: of every law by '
                             'a rule in what the controller knows')
    parser.add_argument('--held-out', type=int, default=0, metavar='N',
                        help='also evaluate all laws in N random conditions')
    parser.add_argument('--seed', type=int, default=SEED, metavar='S',
                        help=f'seed of the held-out conditions, default: {SEED}')
    add_jobs(parser)
    parser.add_argument('--ros', action='store_true',
                        help='run the nodes and evaluate their bags instead of simulating')
    add_output(parser)


def run_compare(options: argparse.Namespace) -> int:
    """
    Run `ctc compare`.

    Run every parameter file with every law and, under law chattering, every switching; print the
    RMS error of each joint. Write compare.md, compare.csv, figures, index.html, and a parameter
    file of every run.
    """
    from ctc_chattering.runs.compare import compare
    from ctc_chattering.runs.compare_page import NAMES, PAGE, to_markdown, write_comparison
    from ctc_chattering.runs.score import over_simulation, Runner

    runner: Runner = over_simulation
    if options.ros:
        from ctc_chattering.runs.reproduction import over_ros as runner
    if options.out is not None and not options.overwrite:
        prepare(options.out, NAMES)  # Refused before the runs rather than after them.
    with progress('compare', unit='law') as moved, given_by_user(
            ('laws', 'condition', 'held_out', 'seed')):
        outcomes = compare(
            list(map(find_config, options.files)), options.laws, options.condition, options.gains,
            options.held_out, options.seed, 1 if options.ros else options.jobs, runner, say, moved,
            options.cases)
    print(to_markdown(outcomes))
    if options.out is not None:
        prepare(options.out, NAMES, options.overwrite)
        write_comparison(outcomes, options.out, options.format, options.said)
        print_page(options.out / PAGE)
    return 0


def map_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc map`."""
    parser.add_argument('spec', metavar='SPEC.yaml',
                        help='what to run (docs/maps.md), or the name of a map in the package')
    where = parser.add_mutually_exclusive_group()
    add_jobs(where)
    where.add_argument('--scheduler', metavar='ADDRESS',
                       help='address of a running dask cluster, tcp://host:port')
    parser.add_argument('--explain', metavar='POINT',
                        help='write and plot one run, given by its number or by name=value,... of '
                             'axes, law and repeat')
    add_output(parser, 'map')


def run_map(options: argparse.Namespace) -> int:
    """
    Run `ctc map`.

    Write map.parquet, one row per run, map.json, figures and index.html. An interrupted map is
    continued.
    """
    from ctc_chattering.runs.map import compute_map, map_spec
    from ctc_chattering.runs.points import Runs
    from ctc_chattering.runs.store import PAGE

    for needed in ('matplotlib', 'pandas'):  # At the end; they take time to import.
        if find_spec(needed) is None:
            raise ModuleNotFoundError(name=needed)
    spec = map_spec(options.spec)
    if options.explain is not None:
        return _explain(Runs(spec), options)
    with progress('map', unit='run') as moved:
        compute_map(spec, options.out, options.jobs, options.scheduler, options.overwrite,
                    partial(print, flush=True), moved, options.format, options.said)
    print_page(options.out / PAGE)
    return 0


def _explain(runs: Runs, options: argparse.Namespace) -> int:
    """Write and print one run of a map, as `ctc simulate` computes it."""
    from ctc_chattering.analysis.result import write_npz
    from ctc_chattering.analysis.run_page import NAMES
    from ctc_chattering.runs.points import find_run

    run = find_run(runs, options.explain)
    which = {name: x for name, x in runs.columns(run).items() if name not in ('law', 'switching')}
    print(', '.join(f'{name} {x:g}' if isinstance(x, float) else f'{name} {x}'
                    for name, x in which.items()))
    row = _row_of(runs, run, options.out)
    if row is not None:
        print('in the map: ' + (f'{row["failure"]}: {row["reason"]}' if row['failure'] else
                                f'no failure, error {row["error"]:.3g} rad'))
    file, samples = 'run.yaml', 'trajectory.npz'
    out = prepare(options.out / 'explain' / str(run), (file, samples, *NAMES), options.overwrite)
    setup = runs.setup(run)
    values: dict[str, dict[str, Any]] = {
        node: {name: _absolute(x) if name in ('description', 'trajectory_file') else x
               for name, x in mine.items()} for node, mine in setup.values.items()}
    values['plant']['experiment'] = f'run_{run}'
    with writing(out / file):
        parameter_file.dump(values, out / file)
    print(f'its parameters: {out / file}')
    result, failure = _simulated(parameter_file.load(out / file))
    if failure:
        print(f'this run ends: {failure}')
    if result is None:
        return 0
    result = dataclasses.replace(result, window=runs.spec.window)
    write_npz(result, out / samples)
    return present([result], [], out, options.format, options.said)


def _row_of(runs: Runs, run: int, directory: Path) -> dict[str, Any] | None:
    """Return the row of a run, if the map of a directory has it."""
    from ctc_chattering.runs.store import about, read_about, TABLE
    from pyarrow import parquet
    if not (directory / TABLE).exists() or (
            read_about(directory).get('key') != about(runs)['key']):
        return None
    found = parquet.read_table(directory / TABLE, filters=[('run', '=', run)]).to_pylist()
    return found[0] if found else None


def _absolute(location: str) -> str:
    """Return a path from anywhere; ``package://`` is none."""
    return str(Path(location).resolve()) if location and '://' not in location else location


def _simulated(setup: Setup) -> tuple[Result | None, str]:
    """Return a run, or what comes before its failure, and the failure."""
    from ctc_chattering.analysis.result import simulate
    reached = 0.0

    def moved(t: float) -> None:
        nonlocal reached
        reached = t
        shown(t)

    with progress(f'experiment {setup.plant.experiment}:', setup.plant.duration) as shown:
        try:
            return simulate(setup, moved), ''
        except CtcError as error:
            failure = str(error)
    until = {'plant': {'duration': reached}}
    return simulate(setup.changed(until)) if reached else None, failure


#: Options of `ctc tune` that are keys of the spec, and of its section `tune`.
_KEYS = ('duration', 'repeats', 'seed')
_OF_TUNE = ('law', 'switching', 'torque_limit', 'torque_rate_limit')


def tune_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc tune`."""
    robot = parser.add_mutually_exclusive_group(required=True)
    robot.add_argument('file', nargs='?', metavar='F',
                       help='parameter file, or the name of one in the package, such as panda, '
                            'with a default uncertainty; or a spec with robot, uncertainty, '
                            'limits and ranges: docs/tuning.md')
    robot.add_argument('--params-file', metavar='F', help='parameter file')
    robot.add_argument('--identified', type=Path, metavar='DIR',
                       help='output of ctc identify; its intervals are the uncertainty')
    for name, first in (('law', 'observer_feedback'), ('switching', 'implicit_observer')):
        parser.add_argument(f'--{name}', metavar='X',
                            help=f"instead of the spec's; without a spec {first}")
    for flag, name, text, unit in (
            ('--torque-limit', 'torque_limit', 'largest torque', 'N*m'),
            ('--torque-rate', 'torque_rate_limit', 'largest change of the torque sent', 'N*m/s')):
        add_declared(parser, Parameter(
            name, 'float[]', None, f'{text}, by default of the file and the description',
            unit=unit, minimum=LEAST, infinite=True, shape='n'), flag)
    add_number(parser, '--trials', 'gains to try', 200, minimum=1)
    add_number(parser, '--percentile', 'percentile of error and torque variation over the draws, '
               '100 for the worst case', 95.0, 'float', minimum=LEAST, maximum=100.0)
    parser.add_argument('--draws', type=int, dest='repeats', metavar='N',
                        help="draws of what is uncertain, default: the spec's, or 32")
    parser.add_argument('--duration', type=float, metavar='S',
                        help="duration of a run [s], instead of the file's")
    parser.add_argument('--seed', type=int, metavar='S',
                        help="seed of search and draws, default: the spec's, or 0")
    add_jobs(parser)
    add_output(parser, 'tuned')


def run_tune(options: argparse.Namespace) -> int:
    """
    Run `ctc tune`.

    The search runs on random draws of what is uncertain, within limits of torque and torque rate;
    results are validated on fresh draws. Write tuned.yaml, a parameter file, all other
    Pareto-optimal gains, figures and index.html.
    """
    from ctc_chattering.runs.search import require_optuna
    from ctc_chattering.runs.tune import tune
    from ctc_chattering.runs.tune_page import closest, NAMES, PAGE, text, TUNED, write_tuning

    require_optuna('ctc tune')
    with given_by_user(key for key in (*_KEYS, *_OF_TUNE) if getattr(options, key) is not None):
        spec = _tune_spec(options)
    out = prepare(options.out, NAMES, options.overwrite)
    with progress('tune', unit='run') as moved:
        tuning = tune(spec, options.trials, options.percentile, jobs=options.jobs,
                      show=partial(print, flush=True), progress=moved)
    write_tuning(tuning, out, options.format, options.said)
    print(text(tuning))
    if tuning.best is None:
        raise CtcError(f'no trial keeps the limits; {closest(tuning.trials)}; see {out / PAGE}')
    print()
    print_page(out / PAGE, f'ctc simulate {out / TUNED}')
    return 0


def _tune_spec(options: argparse.Namespace) -> TuneSpec:
    """Return what is tuned, from a spec, a parameter file, or what was identified."""
    from ctc_chattering.configuration.yaml_file import read_yaml
    from ctc_chattering.runs.spec import errors_of
    from ctc_chattering.runs.tune import parse_tune, tune_spec

    params_file = options.params_file
    if options.file:
        spec = find_config(options.file)
        tree = read_yaml(spec)
        if 'ros__parameters' not in str(tree):
            with errors_of(spec):
                return parse_tune(_with_options(tree, options), spec)
        params_file = options.file
    tree = {'params_file': params_file} if params_file else {}
    return tune_spec(_with_options(tree, options), options.identified)


def _with_options(tree: Any, options: argparse.Namespace) -> Any:
    """Return a spec with the options in place of its values."""
    if not isinstance(tree, dict):
        return tree
    given = {key: x for key in (*_KEYS, *_OF_TUNE) if (x := getattr(options, key)) is not None}
    section = {key: given.pop(key) for key in _OF_TUNE if key in given}
    for key in ('torque_limit', 'torque_rate_limit'):
        if key in section:
            limits = section[key]
            section[key] = list(limits) if len(limits) > 1 else limits[0]
    return {**tree, **given, **({'tune': {**(tree.get('tune') or {}), **section}}
                                if section else {})}


def stability_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc stability`."""
    add_loop_options(parser)
    declared = PlantConfig.parameters()
    add_declared(parser, dataclasses.replace(
        declared['actuator_lag'], kind='float', shape='', default=None,
        description="true lag of all drives, instead of the plant's"), '--lag')
    add_declared(parser, dataclasses.replace(
        declared['input_delay'], default=None,
        description="true delay in samples, instead of the plant's"), '--delay')
    add_output(parser)


def run_stability(options: argparse.Namespace) -> int:
    """
    Run `ctc stability`.

    For the sampled loop with constant M, without limits: by its poles for constant errors, by the
    small-gain theorem for varying ones. Exit status 1 if the loop is unstable for the exact model.
    docs/theory.md states the theorem and what it does not cover.
    """
    from ctc_chattering.analysis.tables import number_text, print_columns, Table
    from ctc_chattering.runs.stability import as_json, loops_of, margins, region, rows

    _, _, setup = load_setup(options)
    config, drives = setup.controller, dict[str, Any]()
    if options.actuator_lag is not None:
        drives['actuator_lag'] = [options.actuator_lag] * len(config.joint_names)
    if options.input_delay is not None:
        drives['input_delay'] = options.input_delay
    loops = loops_of(dataclasses.replace(setup, plant=setup.plant.changed(drives)))
    robot = loops.robots[0]
    json, figures, page = 'stability.json', 'figures', 'index.html'
    if options.out is not None:
        prepare(options.out, (json, figures, page), options.overwrite)
    about = [(config.law, f'kp {number_text(config.kp)}, kv {number_text(config.kv)}, sampled '
                          f'every {1e3 * robot.period:g} ms')]
    lag = config.assumed_lag if config.takes('actuator_lag') else (0.0,)
    about += [(who, f'lag {number_text(tuple(1e3 * x for x in lags))} ms, delay {delay}')
              for who, lags, delay in (('law', lag, config.input_delay),
                                       ('robot', tuple(robot.lag.tolist()), robot.delay))]
    print('\n'.join(f'{name}: {text}' for name, text in about))
    found = margins(loops)
    table = list(rows(found, robot.period))
    print_columns(table)
    if options.out is not None:
        from ctc_chattering.analysis import drawing
        from ctc_chattering.analysis.page import Section, write_page
        write_json(as_json(found), options.out / json)
        drawn = drawing.save(region(loops, found), options.out / figures,
                             ('svg', options.format))
        lead = ('Which errors of the model, lags and delays the sampled loop tolerates, with '
                'constant M and without limits of the torque.')
        write_page(options.out / page, f'Stability of {config.law}', lead, [
            Section('Stable region', drawn), Section('Margins', [Table('', (), table)]),
            Section('What was computed', [Table('', (), about)])], [(json, json)], options.said)
        print_page(options.out / page)
    return 0 if found.radius < 1.0 else 1
