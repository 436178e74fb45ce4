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
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ctc_chattering.cli.command_line import say
from ctc_chattering.cli.options import (
    add_jobs,
    add_loop_options,
    add_number,
    add_output,
    load_setup,
    words,
)
from ctc_chattering.cli.presentation import print_page, progress
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.control.laws.registry import LAWS
from ctc_chattering.errors import as_usage_error, CtcError, UsageError
from ctc_chattering.number_format import format_joint_values
from ctc_chattering.output_files import check_file
from ctc_chattering.output_folder import check_folder, claim
from ctc_chattering.parameters import LEAST

if TYPE_CHECKING:
    from ctc_chattering.runs.points import Runs


def compare_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc compare`."""
    from ctc_chattering.runs.conditions import ALL, CONDITIONS, SEED
    from ctc_chattering.runs.recommended import FILE, GAINS
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
    add_output(parser)


def run_compare(options: argparse.Namespace) -> int:
    """
    Run `ctc compare`.

    Run every parameter file with every law and, under law chattering, every switching; print the
    RMS error of each joint. Write compare.parquet, one row per run, compare.json, compare.md,
    compare.csv, figures, index.html, and a parameter file of every run. An interrupted comparison
    is continued.
    """
    from ctc_chattering.runs.compare import compare
    from ctc_chattering.runs.compare_page import outcomes, to_markdown
    from ctc_chattering.runs.store import PAGE

    with progress('compare', unit='run') as moved, as_usage_error(
            ('laws', 'condition', 'held_out', 'seed')):
        rows = compare(
            options.files, options.laws, options.condition, options.gains, options.held_out,
            options.seed, options.jobs, say, moved, options.cases, options.out, options.overwrite,
            options.format, options.said)
    print(to_markdown(outcomes(rows)))
    if options.out is not None:
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
    parser.add_argument('--explain', type=int, metavar='N',
                        help='write the parameter file of one run, whose number is column run of '
                             'map.parquet')
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

    if options.explain is not None:
        return _explain(Runs(map_spec(options.spec)), options)
    with progress('map', unit='run') as moved:
        compute_map(options.spec, options.out, options.jobs, options.scheduler, options.overwrite,
                    partial(print, flush=True), moved, options.format, options.said)
    print_page(options.out / PAGE)
    return 0


def _explain(runs: Runs, options: argparse.Namespace) -> int:
    """Write the parameter file of a run of a map, for `ctc simulate` and `bringup`."""
    if not 0 <= (run := options.explain) < len(runs):
        raise UsageError(f'--explain {run}: allowed: 0 to {len(runs) - 1}')
    print(', '.join(f'{name} {x:g}' if isinstance(x, float) else f'{name} {x}'
                    for name, x in runs.columns(run).items() if name not in ('law', 'switching')))
    values = {node: {
        name: str(Path(x).resolve()) if name in ('description', 'trajectory_file') and x
        and '://' not in x else x for name, x in mine.items()}
        for node, mine in runs.setup(run).values.items()}
    values['plant']['experiment'] = name = f'run_{run}'
    file = claim(options.out, 'ctc map', 'explain') / f'{name}.yaml'
    check_file(file, options.overwrite)
    parameter_file.dump(values, file)
    print(f'its parameters: {file}; next: ctc simulate {file}, or for figures '
          f'bringup {file} --record {name} and ctc plot {name}')
    return 0


def tune_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc tune`."""
    robot = parser.add_mutually_exclusive_group(required=True)
    robot.add_argument('file', nargs='?', metavar='F',
                       help='spec with robot, uncertainty, law, limits and ranges: '
                            'docs/tuning.md; or a parameter file, or the name of one in the '
                            'package, such as panda, with a default uncertainty')
    robot.add_argument('--identified', type=Path, metavar='DIR',
                       help='output of ctc identify; its intervals are the uncertainty')
    add_number(parser, '--trials', 'gains to try', 200, minimum=1)
    add_number(parser, '--percentile', 'percentile of error and torque variation over the draws, '
               '100 for the worst case', 95.0, 'float', minimum=LEAST, maximum=100.0)
    parser.add_argument('--draws', type=int, metavar='N',
                        help="draws of what is uncertain, default: the spec's, or 32")
    add_jobs(parser)
    add_output(parser, 'tuned')


def run_tune(options: argparse.Namespace) -> int:
    """
    Run `ctc tune`.

    The search runs on random draws of what is uncertain, within limits of torque and torque rate;
    results are validated on fresh draws. Write tuned.yaml, a parameter file, all other
    Pareto-optimal gains, figures and index.html.
    """
    from ctc_chattering.runs.tune import require_optuna, tune
    from ctc_chattering.runs.tune_page import closest, PAGE, text, TUNE, TUNED, write_tuning
    from ctc_chattering.runs.tune_spec import tune_spec

    require_optuna()
    more = {} if options.draws is None else {'repeats': options.draws}
    with as_usage_error(more):
        spec = tune_spec(more if options.identified else find_config(options.file),
                         options.identified, more)
    out = options.out
    check_folder(out, TUNE, options.overwrite)
    with progress('tune', unit='trial') as moved:
        tuning = tune(spec, options.trials, options.percentile, jobs=options.jobs,
                      show=partial(print, flush=True), progress=moved)
    write_tuning(tuning, out, options.format, options.said, options.overwrite)
    print(text(tuning))
    if tuning.best is None:
        raise CtcError(f'no trial keeps the limits; {closest(tuning.trials)}; see {out / PAGE}')
    print()
    print_page(out / PAGE, f'ctc simulate {out / TUNED}')
    return 0


#: The options of `ctc stability`.
stability_options = add_loop_options


def run_stability(options: argparse.Namespace) -> int:
    """
    Run `ctc stability`.

    For the sampled loop with constant M, without limits: by its poles for constant errors, by the
    small-gain theorem for varying ones. For an arm with a URDF it says which rotors and masses
    that allows. Exit status 1 if the loop is unstable for the exact model.
    docs/theory.md says what it covers, and where the theorem is.
    """
    from ctc_chattering.analysis.tables import print_columns
    from ctc_chattering.control.recommended_gains import (
        MAX_POLE_PER_RESONANCE,
        pole_over_resonance,
    )
    from ctc_chattering.runs.arm_margins import arm_margins, arm_rows
    from ctc_chattering.runs.stability import rows, stability

    setup = load_setup(options)
    config, plant, found = setup.controller, setup.plant, stability(setup)
    kp, kv = map(format_joint_values, (config.kp, config.kv))
    print(f'{config.law}: kp {kp}, kv {kv}, sampled every {1e3 * config.control_period:g} ms')
    lag = config.assumed_lag if config.takes('actuator_lag') else (0.0,)
    for who, lags, delay in (('law', lag, config.input_delay),
                             ('robot', plant.actuator_lag, plant.input_delay)):
        print(f'{who}: lag {format_joint_values(tuple(1e3 * x for x in lags))} ms, delay {delay}')
    margins = arm_margins(setup)
    print_columns([*rows(found, config.control_period), *(arm_rows(margins) if margins else ())])
    if (part := pole_over_resonance(config)) > MAX_POLE_PER_RESONANCE:
        print(f'warning: the pole is {part:.2g} of the resonance of {config.resonance:g} Hz; at '
              f'most {MAX_POLE_PER_RESONANCE:g} is calm with encoders at the motors')
    return 0 if found.radius < 1.0 else 1
