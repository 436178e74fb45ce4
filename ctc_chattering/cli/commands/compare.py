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
from ctc_chattering.errors import given_by_user
from ctc_chattering.runs.compare import FILE, GAINS
from ctc_chattering.runs.conditions import ALL, CONDITIONS, SEED

DETAILS = ('Run every parameter file with every law and, under law chattering, every switching; '
           'print the RMS error of each joint. Write compare.md, compare.csv, figures, '
           'index.html, and a parameter file of every run.')


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc compare`."""
    parser.add_argument('files', nargs='+', metavar='F',
                        help='parameter file, or the name of one in the package, such as panda')
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
    parser.add_argument('--seed', type=int, default=SEED, metavar='S',
                        help=f'seed of the held-out conditions, default: {SEED}')
    add_jobs(parser)
    parser.add_argument('--ros', action='store_true',
                        help='run the nodes and evaluate their bags instead of simulating')
    add_format(parser)
    add_output(parser)


def run(options: argparse.Namespace) -> int:
    """Run `ctc compare`."""
    from ctc_chattering.cli.progress import counting_bar
    from ctc_chattering.runs.compare import compare
    from ctc_chattering.runs.compare_page import NAMES, PAGE, to_markdown, write_comparison
    from ctc_chattering.runs.score import over_simulation, Runner

    runner: Runner = over_simulation
    if options.ros:
        from ctc_chattering.runs.reproduction import over_ros as runner
    if options.out is not None and not options.overwrite:
        prepare(options.out, NAMES)  # Refused before the runs rather than after them.
    jobs = 1 if options.ros else number_of_jobs(options.jobs)
    with (counting_bar(desc='compare', unit='law') as progress, given_by_user(
            ('laws', 'condition', 'held_out', 'seed'))):
        outcomes = compare(
            list(map(find_file, options.files)), options.laws.split(','), options.condition or [],
            options.gains, options.held_out, options.seed, jobs, runner, say, progress)
    print(to_markdown(outcomes))
    if options.out is not None:
        prepare(options.out, NAMES, options.overwrite)
        write_comparison(outcomes, options.out, options.format, options.said)
        print_page(options.out / PAGE)
    return 0
