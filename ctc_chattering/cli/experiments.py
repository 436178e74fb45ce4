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

"""`ctc simulate`, `reproduce`, `compile`: single runs, and machine code for them."""

from __future__ import annotations

import argparse
import time

from ctc_chattering.cli.command_line import say
from ctc_chattering.cli.options import add_output, add_run_options, load_setup
from ctc_chattering.cli.presentation import print_page, print_results, progress
from ctc_chattering.output_folder import check_folder, new_folder

#: Simulated duration of a run without an end [s].
_DURATION = 10.0
#: From which duration on plain Python takes longer than the compiler [s].
_LONG = 60.0
_SAMPLES = 'trajectory.npz'
#: The command that owns an output folder.
_SIMULATE = 'ctc simulate'


def simulate_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc simulate`."""
    add_run_options(parser)
    parser.add_argument('--plain', action='store_true',
                        help='do not compile first; a run of a minute or more does by itself')
    add_output(parser, figures=False)


def run_simulate(options: argparse.Namespace) -> int:
    """
    Run `ctc simulate`.

    Write metrics.json and trajectory.npz (t, q, dq, q_d, dq_d, ddq_d, tau, v, names, units,
    gains).
    """
    from ctc_chattering.analysis.export import export
    from ctc_chattering.analysis.result import METRICS, simulate, write_metrics
    from ctc_chattering.compiled.machine_code import HOW_TO_COMPILE
    from ctc_chattering.configuration.compilation import compile_setups, uncompiled_codes

    setup = load_setup(options)
    if setup.plant.duration == 0.0:
        say(f'duration is 0, no end: simulating {_DURATION:g} s')
        setup = setup.changed({'plant': {'duration': _DURATION}})
    if options.out is not None:
        check_folder(options.out, _SIMULATE, options.overwrite)
    duration = setup.plant.duration
    if uncompiled_codes([setup]):
        if duration < _LONG or options.plain:
            say(HOW_TO_COMPILE)
        else:
            compile_setups([setup], say)
    with progress(f'experiment {setup.plant.experiment}', duration) as moved:
        result = simulate(setup, moved)
        moved(duration)
    if options.out is not None:
        with new_folder(options.out, _SIMULATE, options.overwrite) as folder:
            write_metrics([result], folder / METRICS)
            export(result, folder / _SAMPLES)
    print_results([result])
    return 0


def reproduce_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc reproduce`."""
    add_output(parser, 'results')


def run_reproduce(options: argparse.Namespace) -> int:
    """
    Run `ctc reproduce`.

    Write bags, figures, metrics.json and index.html.
    """
    from ctc_chattering.analysis.run_page import fill_folder, PAGE
    from ctc_chattering.configuration.package_share import EXPERIMENTS
    from ctc_chattering.runs.reproduction import BAGS, record, REPRODUCE

    with new_folder(options.out, REPRODUCE, options.overwrite) as folder:
        with progress(f'each of {len(EXPERIMENTS)} experiments') as moved:
            results = record(folder / BAGS, lambda _, at, duration: moved(at, duration))
        print(f'drawing {len(results)} runs ...', flush=True)
        links = [f'{BAGS}/{name}' for name in EXPERIMENTS]
        fill_folder(results, folder, links, options.format, options.said)
    print_results(results)
    print_page(options.out / PAGE)
    return 0


def compile_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc compile`."""
    add_run_options(parser)
    parser.add_argument('--all', action='store_true', help='compile every law and switching')


def run_compile(options: argparse.Namespace) -> int:
    """
    Run `ctc compile`.

    Nodes, ctc simulate and all other commands then use it and run about 20 times as fast. It
    serves all files with this law and number of joints.
    """
    from ctc_chattering.compiled.machine_code import cache_directory
    from ctc_chattering.configuration.compilation import compile_setup

    start, setup = time.monotonic(), load_setup(options)
    made = compile_setup(setup, options.all, say)
    print(f'{made} functions compiled in {time.monotonic() - start:.0f} s; the others were '
          f'already compiled: {cache_directory()}')
    return 0
