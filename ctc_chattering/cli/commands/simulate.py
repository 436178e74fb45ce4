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

"""`ctc simulate`: one experiment without ROS."""

from __future__ import annotations

import argparse
import sys

from ctc_chattering.analysis.output import prepare
from ctc_chattering.analysis.result import METRICS, simulate, write_metrics, write_npz
from ctc_chattering.cli.options import add_output, add_run_options, load_setup
from ctc_chattering.cli.presentation import print_results
from ctc_chattering.configuration import parameter_file

DETAILS = ('Write metrics.json and trajectory.npz (t, q, dq, q_d, dq_d, ddq_d, tau, v, names, '
           'units, gains).')
#: Simulated duration of a run without an end [s].
_DURATION = 10.0
_SAMPLES = 'trajectory.npz'


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc simulate`."""
    add_run_options(parser)
    add_output(parser)


def run(options: argparse.Namespace) -> int:
    """Run `ctc simulate`."""
    from ctc_chattering.analysis.compilation import can_be_compiled, PLAIN, way
    from ctc_chattering.cli.command_line import say
    from ctc_chattering.cli.progress import Progress
    from ctc_chattering.compiled.machine_code import HOW_TO_COMPILE

    file, over, setup = load_setup(options)
    if setup.plant.duration == 0.0:
        print(f'duration is 0, no end: simulating {_DURATION:g} s', file=sys.stderr)
        over.setdefault('plant', {})['duration'] = _DURATION
        setup = parameter_file.load(file, over)
    if options.out is not None:
        prepare(options.out, (METRICS, _SAMPLES), options.overwrite)
    if way(setup) == PLAIN and can_be_compiled(setup):
        say(HOW_TO_COMPILE)
    with Progress(f'experiment {setup.plant.experiment}:', setup.plant.duration) as progress:
        result = simulate(setup, progress)
        progress(setup.plant.duration)
    if options.out is not None:
        write_metrics([result], options.out / METRICS)
        write_npz(result, options.out / _SAMPLES)
    print_results([result])
    return 0
