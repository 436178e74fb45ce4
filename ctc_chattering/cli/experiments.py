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
`ctc simulate`, `reproduce` and `compile`: single runs, and machine code for them.

`simulate` runs a closed loop in this process, `reproduce` starts the nodes over ROS.
"""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING

from ctc_chattering.cli.command_line import say
from ctc_chattering.cli.options import add_output, add_run_options, load_setup
from ctc_chattering.cli.presentation import (
    print_page,
    print_passes,
    print_results,
    progress,
)
from ctc_chattering.number_format import format_count
from ctc_chattering.numerics.time_grid import seconds
from ctc_chattering.output_folder import check_folder, new_folder

if TYPE_CHECKING:
    from ctc_chattering.configuration.loop_setup import Setup
    from ctc_chattering.learning.learner import Learner

#: Simulated duration of a run without an end.
_DEFAULT_DURATION_S = 10.0
#: Shortest simulated duration for which compiling first saves time.
_COMPILED_DURATION_S = 60.0
#: The command that owns an output folder.
_SIMULATE = 'ctc simulate'


def simulate_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc simulate`."""
    add_run_options(parser)
    parser.add_argument('--plain', action='store_true',
                        help='Run in plain Python. Without this option a run of a minute or more '
                             'is compiled first.')
    add_output(parser, figures=False)


def run_simulate(options: argparse.Namespace) -> int:
    """Run `ctc simulate`."""
    from ctc_chattering.analysis.export import export
    from ctc_chattering.analysis.result import METRICS, simulate, write_metrics
    from ctc_chattering.compiled.machine_code import HOW_TO_COMPILE
    from ctc_chattering.configuration.compilation import compile_setups, uncompiled_codes

    setup = load_setup(options)
    if setup.plant.duration == 0.0:
        say('duration is 0, so the run has no end; ctc simulates '
            f'{_DEFAULT_DURATION_S:g} s instead')
        setup = setup.changed({'plant': {'duration': _DEFAULT_DURATION_S}})
    if options.out is not None:
        check_folder(options.out, _SIMULATE, options.overwrite)
    duration = setup.plant.duration
    if uncompiled_codes([setup]):
        if duration < _COMPILED_DURATION_S or options.plain:
            say(HOW_TO_COMPILE)
        else:
            compile_setups([setup], say)
    with progress(f'experiment {setup.plant.experiment}', duration) as show:
        result = simulate(setup, show)
        show(duration)
    if options.out is not None:
        with new_folder(options.out, _SIMULATE, options.overwrite) as folder:
            write_metrics([result], folder / METRICS)
            export(result, folder / 'trajectory.npz')
    print_results([result])
    if result.learner is not None:
        _print_learning(result.learner, setup)
    return 0


def _print_learning(learner: Learner, setup: Setup) -> None:
    """Print the passes of a run, or when the first one would have ended."""
    from ctc_chattering.learning.learner import duration_of_passes

    motion = learner.motion
    if learner.passes:
        print_passes(learner.passes, setup.reference.joint_names)
        print(learner.report)
    elif motion is not None and motion.is_periodic:
        first_end = seconds(duration_of_passes(motion, 0) + motion.duration)
        print(f'nothing was learned, because the first pass ends after {first_end:g} s; raise '
              'duration of the plant, or give --duration')
    else:
        print(learner.report)


def reproduce_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc reproduce`."""
    add_output(parser, 'results')


def run_reproduce(options: argparse.Namespace) -> int:
    """Run `ctc reproduce`."""
    from ctc_chattering.analysis.run_page import fill_folder, PAGE
    from ctc_chattering.configuration.package_share import EXPERIMENTS
    from ctc_chattering.runs.reproduction import BAGS, record, REPRODUCE

    with new_folder(options.out, REPRODUCE, options.overwrite) as folder:
        with progress(f'each of {len(EXPERIMENTS)} experiments') as show:
            results = record(folder / BAGS, lambda _, t, duration: show(t, duration))
        print(f'The figures of {len(results)} runs are being drawn ...', flush=True)
        links = [f'{BAGS}/{name}' for name in EXPERIMENTS]
        fill_folder(results, folder, links, options.format, options.said)
    print_results(results)
    print_page(options.out / PAGE)
    return 0


def compile_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc compile`."""
    add_run_options(parser)
    parser.add_argument('--all', action='store_true', help='Compile every law and every '
                                                           'switching.')


def run_compile(options: argparse.Namespace) -> int:
    """Run `ctc compile`."""
    from ctc_chattering.compiled.machine_code import cache_directory
    from ctc_chattering.configuration.compilation import compile_setup

    start, setup = time.monotonic(), load_setup(options)
    count = compile_setup(setup, options.all, say)
    elapsed = time.monotonic() - start
    print(f'compiled {format_count(count, "function")} in {elapsed:.0f} s; all others were '
          f'compiled before; the machine code is in {cache_directory()}')
    return 0
