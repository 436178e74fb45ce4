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
`ctc plot`, `export`, `replay` and `repair`: commands on recorded bags.

Each reads bags through the folder `bags` and prints a short report.
"""

from __future__ import annotations

import argparse
import dataclasses
from math import inf
from pathlib import Path

from ctc_chattering.cli.command_line import say
from ctc_chattering.cli.options import add_bag, add_number, add_output, add_own, own
from ctc_chattering.cli.presentation import print_passes
from ctc_chattering.errors import as_ctc_error, CtcError, ParameterError, UsageError
from ctc_chattering.input_files import check_regular
from ctc_chattering.number_format import format_count
from ctc_chattering.output_folder import check_folder, new_folder
from ctc_chattering.parameters import LEAST


def plot_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc plot`."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG',
                        help='Bag, or directory of bags.')
    parser.add_argument('--window', nargs=2, type=float, metavar=('BEGIN', 'END'),
                        help='Part of the runs over which metrics are computed. Default: 5 to 10, '
                             'or the second half of a run too short for this. [s]')
    add_own(parser)
    add_output(parser, 'plots')


def run_plot(options: argparse.Namespace) -> int:
    """Run `ctc plot`."""
    from ctc_chattering.analysis.run_page import PAGE, PLOT, write_runs
    from ctc_chattering.bags.reader import find_bags, read_bag
    from ctc_chattering.cli.presentation import print_page, print_results

    window = options.window and tuple(options.window)
    if window and not -inf < window[0] < window[1] < inf:
        raise UsageError(str(ParameterError('--window', window, 'two times, BEGIN < END')))
    check_folder(options.out, PLOT, options.overwrite)
    bags, results = [], []
    for path in options.bags:
        with as_ctc_error(f'{path}: the directory cannot be searched for bags'):
            contained = find_bags(path)
        for bag in contained or [path]:
            try:
                result = read_bag(bag, **own(options))
                results.append(dataclasses.replace(result, window=window) if window else result)
                bags.append(bag)
            except CtcError as error:
                if not contained:
                    raise
                say(f'a bag is left out: {error}')
    if not results:
        folders = ', '.join(map(str, options.bags))
        raise CtcError(f'{folders}: there is no bag recorded by this package; name other bags')
    print(f'The figures of {format_count(len(results), "run")} are being drawn ...', flush=True)
    write_runs(results, options.out, bags, options.format, options.said, options.overwrite)
    print_results(results)
    print_page(options.out / PAGE)
    return 0


def export_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc export`."""
    add_bag(parser)
    add_own(parser)
    parser.add_argument('--csv', action='store_true',
                        help='Write trajectory.csv instead of trajectory.npz.')
    add_output(parser, 'export', figures=False)


def run_export(options: argparse.Namespace) -> int:
    """Run `ctc export`."""
    from ctc_chattering.analysis.export import commands_path, export
    from ctc_chattering.bags.reader import read_bag

    with new_folder(options.out, 'ctc export', options.overwrite) as folder:
        result = read_bag(options.bag, **own(options))
        name = 'trajectory.csv' if options.csv else 'trajectory.npz'
        export(result, folder / name)
    path = options.out / name
    print(f'{len(result.t)} samples were written to {path}')
    if commands_path(path).exists():
        print(f'{len(result.torque.t)} torques were written to {commands_path(path)}')
    for note in result.metrics()['notes']:
        print(note)
    return 0


def learn_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc learn`."""
    add_bag(parser)
    add_own(parser)
    parser.add_argument('-o', '--out', type=Path, metavar='F', default=Path('learned.npz'),
                        help='File to write. Default: learned.npz.')
    parser.add_argument('--overwrite', action='store_true', help='Replace a learned file.')


def run_learn(options: argparse.Namespace) -> int:
    """Run `ctc learn`."""
    from ctc_chattering.bags.recorded_passes import learn_from_bag
    from ctc_chattering.learning.learned_file import check_replaceable, write_correction
    from ctc_chattering.learning.learner import LearningState

    check_replaceable(options.out, options.overwrite)
    learned = learn_from_bag(options.bag, own(options))
    learner, motion = learned.learner, learned.learner.motion
    print_passes(learner.passes, learned.reference.joint_names)
    for t, reason in learned.left_out:
        print(f'a pass was left out at {t:.4g} s, because {reason}')
    if learner.state is not LearningState.LEARNING:
        print(f'learning {learner.state.value}')
    if motion is None or learner.rows is None:
        raise CtcError(f'{options.bag}: there is no whole pass to learn from')
    write_correction(options.out, learner.rows, motion, *learned[1:4])
    print(f'the correction was written to {options.out}; to begin with it, give the reference '
          f'learning: true and learning_file: {options.out}')
    return 0


def replay_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc replay`."""
    add_bag(parser)
    add_number(parser, '--rate', 'Factor on the speed of the recording', 1.0, 'float',
               minimum=LEAST)
    add_number(parser, '--delay', 'Time to wait for subscribers before the first message', 1.0,
               'float', unit='s', minimum=0.0)


def run_replay(options: argparse.Namespace) -> int:
    """Run `ctc replay`."""
    from ctc_chattering.bags.replay import replay
    print(f'{replay(options.bag, options.rate, options.delay)} messages were published')
    return 0


def repair_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc repair`."""
    parser.add_argument('bag', type=Path, metavar='BAG',
                        help='Directory of a bag, or one of its files, which is then repaired '
                             'alone.')


def run_repair(options: argparse.Namespace) -> int:
    """Run `ctc repair`."""
    from ctc_chattering.bags.repair import repair

    check_regular(options.bag)
    repaired = repair(options.bag)
    if repaired is None:
        print(f'{options.bag}: the bag is intact; nothing was changed')
        return 0
    if repaired.recovered:
        print(f'{options.bag}: {repaired.recovered} messages were recovered')
    else:
        print(f'{options.bag}: no file is damaged; metadata.yaml was written')
    for kept in repaired.replaced:
        print(f'the damaged file is kept as {kept}')
    return 0
