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
`ctc compare`, `map`, `tune` and `stability`: many runs, and margins of a loop.

Each command passes its options to the folder `runs` and prints the results.
"""

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
from ctc_chattering.errors import as_usage_error, CtcError, ParameterError, UsageError
from ctc_chattering.number_format import format_joint_values
from ctc_chattering.output_files import check_file
from ctc_chattering.output_folder import check_folder, claim
from ctc_chattering.parameters import LEAST

if TYPE_CHECKING:
    from ctc_chattering.runs.run_lists import MapRuns


def compare_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc compare`."""
    from ctc_chattering.runs.conditions import ALL, CONDITIONS, SEED
    from ctc_chattering.runs.recommended import FILE, GAIN_SOURCES
    parser.add_argument('files', nargs='+', metavar='F',
                        help='Parameter file, or the name of one in the package, for example '
                             'panda.')
    parser.add_argument('--condition', action='append', default=[], metavar='X',
                        help='Condition of drives, sensors and model to use instead of the '
                             "parameter file's. Repeat the option for several conditions. "
                             f'[{" | ".join((*CONDITIONS, ALL))}]')
    parser.add_argument('--cases', default='', metavar='F',
                        help='File of further conditions, or the name of one in the package. '
                             "imperfections gives the paper's arm one imperfection at a time.")
    parser.add_argument('--laws', type=words, metavar='A,B', default=LAWS,
                        help='Laws to run. Default: all laws.')
    parser.add_argument('--gains', choices=GAIN_SOURCES, default=FILE,
                        help='Gains of the parameter file, or recommended gains of every law, '
                             'computed from the parameters that the controller knows. Default: '
                             'file.')
    parser.add_argument('--held-out', type=int, default=0, metavar='N',
                        help='Number of random conditions in which all laws are also evaluated. '
                             'Default: 0. [at least 0]')
    parser.add_argument('--seed', type=int, default=SEED, metavar='S',
                        help=f'Seed of the random conditions of --held-out. Default: {SEED}.')
    add_number(parser, '--passes', 'Show how every law learns in N passes of a periodic motion',
               minimum=1, maximum=100)
    add_jobs(parser)
    add_output(parser)


def run_compare(options: argparse.Namespace) -> int:
    """Run `ctc compare`."""
    from ctc_chattering.runs.compare import compare, ComparisonSpec
    from ctc_chattering.runs.compare_page import outcomes, to_markdown
    from ctc_chattering.runs.store import PAGE

    with progress('compare', unit='run') as show, as_usage_error(
            ('laws', 'condition', 'held_out', 'seed')):
        spec = ComparisonSpec(
            options.files, options.laws, options.condition, options.gains, options.held_out,
            options.seed, options.cases, options.passes or 0)
        rows = compare(
            spec, out=options.out, jobs=options.jobs, overwrite=options.overwrite, show=say,
            progress=show, extra=options.format, command=options.said)
    print(to_markdown(outcomes(rows)))
    if options.out is not None:
        print_page(options.out / PAGE)
    return 0


def map_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc map`."""
    parser.add_argument('spec', metavar='SPEC.yaml',
                        help='Specification of the runs (docs/maps.md), or the name of a map in '
                             'the package.')
    where = parser.add_mutually_exclusive_group()
    add_jobs(where)
    where.add_argument('--scheduler', metavar='ADDRESS',
                       help='Address of a running dask cluster, tcp://host:port.')
    parser.add_argument('--explain', type=int, metavar='N',
                        help='Write the parameter file of run N instead of computing the map. '
                             'Column run of map.parquet has the numbers.')
    add_output(parser, 'map')


def run_map(options: argparse.Namespace) -> int:
    """Run `ctc map`."""
    from ctc_chattering.runs.map import compute_map, map_spec
    from ctc_chattering.runs.run_lists import MapRuns
    from ctc_chattering.runs.store import PAGE

    if options.explain is not None:
        return _explain(MapRuns(map_spec(options.spec)), options)
    with progress('map', unit='run') as show:
        compute_map(options.spec, options.out, options.jobs, options.scheduler, options.overwrite,
                    partial(print, flush=True), show, options.format, options.said)
    print_page(options.out / PAGE)
    return 0


def _explain(runs: MapRuns, options: argparse.Namespace) -> int:
    """Write the parameter file of a run of a map, for `ctc simulate` and `bringup`."""
    if not 0 <= (run := options.explain) < len(runs):
        raise UsageError(str(ParameterError(
            '--explain', run, f'the number of a run, 0 to {len(runs) - 1}')))
    print(', '.join(f'{name} {x:g}' if isinstance(x, float) else f'{name} {x}'
                    for name, x in runs.columns(run).items() if name not in ('law', 'switching')))
    values = runs.setup(run).values
    for parameters in values.values():
        for name in {'description', 'trajectory_file', 'learning_file'} & parameters.keys():
            if (location := parameters[name]) and '://' not in location:
                parameters[name] = str(Path(location).resolve())
    values['plant']['experiment'] = name = f'run_{run}'
    file = claim(options.out, 'ctc map', 'explain') / f'{name}.yaml'
    check_file(file, options.overwrite)
    parameter_file.dump(values, file)
    print(f'the parameters of run {run} were written to {file}; next: ctc simulate {file}, or for '
          f'figures bringup {file} --record {name} and ctc plot {name}')
    return 0


def tune_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc tune`."""
    robot = parser.add_mutually_exclusive_group(required=True)
    robot.add_argument('file', nargs='?', metavar='F',
                       help='Specification with robot, uncertainty, law, limits and ranges '
                            '(docs/tuning.md). A parameter file, or the name of one in the '
                            'package such as panda, gets a default uncertainty.')
    robot.add_argument('--identified', type=Path, metavar='DIR',
                       help='Output directory of ctc identify. Its intervals are the uncertainty.')
    add_number(parser, '--trials', 'Number of gain settings to try', 200, minimum=1)
    add_number(parser, '--percentile', 'Percentile of error and torque variation over the draws. '
               '100 is the worst case', 95.0, 'float', minimum=LEAST, maximum=100.0)
    parser.add_argument('--draws', type=int, metavar='N',
                        help='Number of draws of the uncertain quantities. Default: the number in '
                             'the specification, or 32. [at least 1]')
    add_jobs(parser)
    add_output(parser, 'tuned')


def run_tune(options: argparse.Namespace) -> int:
    """Run `ctc tune`."""
    from ctc_chattering.runs.tune import require_optuna, tune
    from ctc_chattering.runs.tune_page import (
        closest_trial_text,
        PAGE,
        report_text,
        TUNE,
        TUNED,
        write_tuning,
    )
    from ctc_chattering.runs.tune_spec import tune_spec

    require_optuna()
    overrides = {} if options.draws is None else {'repeats': options.draws}
    with as_usage_error(overrides):
        spec = tune_spec(overrides if options.identified else find_config(options.file),
                         options.identified, overrides)
    out = options.out
    check_folder(out, TUNE, options.overwrite)
    with progress('tune', unit='trial') as show:
        tuning = tune(spec, options.trials, options.percentile, jobs=options.jobs,
                      show=partial(print, flush=True), progress=show)
    write_tuning(tuning, out, options.format, options.said, options.overwrite)
    print(report_text(tuning))
    if tuning.best is None:
        raise CtcError(f'no trial keeps the limits; {closest_trial_text(tuning.trials)}; '
                       f'see {out / PAGE}')
    print()
    print_page(out / PAGE, f'ctc simulate {out / TUNED}')
    return 0


#: The options of `ctc stability`.
stability_options = add_loop_options


def run_stability(options: argparse.Namespace) -> int:
    """Run `ctc stability`."""
    from ctc_chattering.analysis.tables import print_columns
    from ctc_chattering.control.recommended_gains import (
        MAX_POLE_PER_RESONANCE,
        pole_over_resonance,
    )
    from ctc_chattering.runs.arm_margins import arm_margins, arm_rows
    from ctc_chattering.runs.stability import margin_rows, stability

    setup = load_setup(options)
    config, plant = setup.controller, setup.plant
    result = stability(setup)
    kp, kv = map(format_joint_values, (config.kp, config.kv))
    print(f'{config.law}: kp {kp}, kv {kv}, sampled every {1e3 * config.control_period:g} ms')
    lag = config.assumed_lag if config.takes('actuator_lag') else (0.0,)
    for owner, lags, delay in (('law', lag, config.input_delay),
                               ('robot', plant.actuator_lag, plant.input_delay)):
        milliseconds = format_joint_values(tuple(1e3 * x for x in lags))
        print(f'{owner}: lag {milliseconds} ms, delay {delay} samples')
    margins = arm_margins(setup)
    print_columns([*margin_rows(result, config.control_period),
                   *(arm_rows(margins) if margins else ())])
    if (ratio := pole_over_resonance(config)) > MAX_POLE_PER_RESONANCE:
        print(f'warning: the pole is {ratio:.2g} times the resonance of {config.resonance:g} Hz; '
              'with encoders at the motors the arm may oscillate above '
              f'{MAX_POLE_PER_RESONANCE:g} times; lower kp and kv')
    return 0 if result.radius < 1.0 else 1
