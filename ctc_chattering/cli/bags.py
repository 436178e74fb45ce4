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

"""`ctc plot`, `export`, `replay`, `repair`: what is done with bags."""

from __future__ import annotations

import argparse
import dataclasses
from math import inf
from pathlib import Path

from ctc_chattering.cli.command_line import say
from ctc_chattering.cli.options import add_bag, add_number, add_output, add_own, own
from ctc_chattering.errors import as_ctc_error, CtcError, ParameterError, UsageError
from ctc_chattering.input_files import check_regular
from ctc_chattering.number_format import format_count
from ctc_chattering.output_folder import check_folder, new_folder
from ctc_chattering.parameters import LEAST


def plot_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc plot`."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG',
                        help='bag, or directory of bags')
    parser.add_argument('--window', nargs=2, type=float, metavar=('BEGIN', 'END'),
                        help='part of the runs over which metrics are computed [s]; default: 5 to '
                             '10, or the second half of a run that has too little of that')
    add_own(parser)
    add_output(parser, 'plots')


def run_plot(options: argparse.Namespace) -> int:
    """
    Run `ctc plot`.

    Write them with metrics.json and index.html. Several bags are compared.
    """
    from ctc_chattering.analysis.run_page import PAGE, PLOT, write_runs
    from ctc_chattering.bags.reader import find_bags, read_bag
    from ctc_chattering.cli.presentation import print_page, print_results

    window = options.window and tuple(options.window)
    if window and not -inf < window[0] < window[1] < inf:
        raise UsageError(str(ParameterError('--window', window, 'two times, BEGIN < END')))
    check_folder(options.out, PLOT, options.overwrite)
    bags, results = [], []
    for path in options.bags:
        with as_ctc_error(f'{path}: cannot be searched for bags'):
            found = find_bags(path)
        for bag in found or [path]:
            try:
                result = read_bag(bag, **own(options))
                results.append(dataclasses.replace(result, window=window) if window else result)
                bags.append(bag)
            except CtcError as error:
                if not found:
                    raise
                say(f'left out: {error}')
    if not results:
        raise CtcError(f'no bag of this package in {", ".join(map(str, options.bags))}')
    print(f'drawing {format_count(len(results), "run")} ...', flush=True)
    write_runs(results, options.out, bags, options.format, options.said, options.overwrite)
    print_results(results)
    print_page(options.out / PAGE)
    return 0


def export_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc export`."""
    add_bag(parser)
    add_own(parser)
    parser.add_argument('--csv', action='store_true',
                        help='write trajectory.csv instead of trajectory.npz')
    add_output(parser, 'export', figures=False)


def run_export(options: argparse.Namespace) -> int:
    """
    Run `ctc export`.

    Write trajectory.npz, which also has the gains, or trajectory.csv, with names and units of the
    joints. Torques that have times of their own are in trajectory_commands.csv.
    """
    from ctc_chattering.analysis.export import commands_path, export
    from ctc_chattering.bags.reader import read_bag

    with new_folder(options.out, 'ctc export', options.overwrite) as folder:
        result = read_bag(options.bag, **own(options))
        name = 'trajectory.csv' if options.csv else 'trajectory.npz'
        export(result, folder / name)
    path = options.out / name
    print(f'{len(result.t)} samples: {path}')
    if commands_path(path).exists():
        print(f'{len(result.torque.t)} torques: {commands_path(path)}')
    for note in result.metrics()['notes']:
        print(note)
    return 0


def replay_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc replay`."""
    add_bag(parser)
    add_number(parser, '--rate', 'speed factor', 1.0, 'float', minimum=LEAST)
    add_number(parser, '--delay', 'time to wait for subscribers first', 1.0, 'float', unit='s',
               minimum=0.0)


def run_replay(options: argparse.Namespace) -> int:
    """
    Run `ctc replay`.

    With its original timing.
    """
    from ctc_chattering.bags.replay import replay
    print(f'{replay(options.bag, options.rate, options.delay)} messages')
    return 0


def repair_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc repair`."""
    parser.add_argument('bag', type=Path, metavar='BAG',
                        help='directory of a bag, or one of its files, which is repaired alone')


def run_repair(options: argparse.Namespace) -> int:
    """
    Run `ctc repair`.

    Damaged files are written anew with all messages of whole chunks. A damaged file is kept
    beside the new one, with the ending .damaged; other files are left as they are.
    """
    from ctc_chattering.bags.repair import repair

    check_regular(options.bag)
    repaired = repair(options.bag)
    if repaired is None:
        print(f'{options.bag}: nothing to repair')
    elif not repaired.recovered:
        print(f'{options.bag}: no file is damaged; metadata.yaml is written')
    else:
        print(f'{options.bag}: {repaired.recovered} messages recovered')
    for kept in repaired.replaced if repaired else ():
        print(f'kept as it was: {kept}')
    return 0
