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

"""`ctc compare`: all laws on any robots, tuned or as they are."""

from __future__ import annotations

import argparse

from ctc_chattering.analysis.output import prepare
from ctc_chattering.cli.command_line import say
from ctc_chattering.cli.options import (
    add_format,
    add_jobs,
    add_output,
    find_file,
    number_of_jobs,
)
from ctc_chattering.cli.presentation import print_page
from ctc_chattering.control.controller import LAWS
from ctc_chattering.errors import given_by_user, near, UsageError
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.studies.comparison import FILE, GAINS
from ctc_chattering.studies.conditions import ALL, check_conditions, CONDITIONS

DETAILS = ('Run every parameter file with every law and, under law chattering, every switching; '
           'print the RMS error of each joint. Write compare.md, compare.csv, figures, '
           'index.html, and a parameter file of every run.')


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc compare`."""
    parser.add_argument('files', nargs='+', metavar='F',
                        help='parameter file, or the name of one in the package, such as panda')
    parser.add_argument('--backend', action='append', metavar='X',
                        help="plant instead of the file's: builtin | mujoco; may be repeated")
    parser.add_argument('--condition', action='append', metavar='X',
                        help="drives, sensors and model error instead of the file's: "
                             f'{" | ".join((*CONDITIONS, ALL))}; may be repeated')
    parser.add_argument('--laws', metavar='A,B', default=','.join(LAWS),
                        help='laws to run, default: all')
    parser.add_argument('--gains', choices=GAINS, default=FILE,
                        help='of the file, which is the default, or recommended: of every law by '
                             'a rule in what the controller knows')
    parser.add_argument('--held-out', type=int, default=0, metavar='N',
                        help='also evaluate all laws in N random conditions')
    parser.add_argument('--seed', type=int, default=0, metavar='S',
                        help='seed of the held-out conditions, default: 0')
    add_jobs(parser)
    parser.add_argument('--ros', action='store_true',
                        help='run the nodes and evaluate their bags instead of simulating')
    add_format(parser)
    add_output(parser)


def run(options: argparse.Namespace) -> int:
    """Run `ctc compare`."""
    from ctc_chattering.cli.progress import counting_bar
    from ctc_chattering.studies.compare_laws import compare
    from ctc_chattering.studies.comparison_files import NAMES, PAGE, write_comparison
    from ctc_chattering.studies.comparison_tables import to_markdown
    from ctc_chattering.studies.score import over_simulation, Runner

    runner: Runner = over_simulation
    if options.ros:
        from ctc_chattering.studies.over_ros import over_ros as runner
    files, backends, laws = list(map(find_file, options.files)), _backends(options), _laws(options)
    others, conditions = _others(options), options.condition or []
    check_conditions(conditions)
    if options.out is not None:
        prepare(options.out, NAMES, options.overwrite)
    with counting_bar(desc='compare', unit='law') as progress:
        outcomes = compare(
            files, laws, conditions, backends, options.gains, others, options.seed,
            1 if options.ros else number_of_jobs(options.jobs), runner, say, progress)
    print(to_markdown(outcomes))
    if options.out is not None:
        write_comparison(outcomes, options.out, options.format, options.said)
        print_page(options.out / PAGE)
    return 0


def _backends(options: argparse.Namespace) -> list[str]:
    """Return the backends, none for the file's; raise `UsageError`."""
    for name in options.backend or ():
        with given_by_user(['plant_backend']):
            PlantConfig.parameters()['plant_backend'].check(name, 0)
    return options.backend or []


def _laws(options: argparse.Namespace) -> list[str]:
    """Return the laws, or raise `UsageError`."""
    names: list[str] = options.laws.split(',')
    for law in names:
        if law not in LAWS:
            raise UsageError(f'--laws: no law is called {law}; allowed: {", ".join(LAWS)}'
                             + near(law, LAWS))
    return names


def _others(options: argparse.Namespace) -> int:
    """Return the number of held-out conditions, or raise `UsageError`."""
    if options.held_out < 0 or not 0 <= options.seed < 2 ** 32:
        raise UsageError('allowed: --held-out from 0 on, --seed from 0 to 2**32 - 1')
    return int(options.held_out)
