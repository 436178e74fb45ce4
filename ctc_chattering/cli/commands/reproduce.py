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

"""`ctc reproduce`: the paper's experiments over ROS, and its figures."""

from __future__ import annotations

import argparse
from contextlib import ExitStack

from ctc_chattering.analysis.output import prepare
from ctc_chattering.analysis.run_page import NAMES
from ctc_chattering.cli.options import add_format, add_output
from ctc_chattering.cli.presentation import present
from ctc_chattering.configuration.package_share import EXPERIMENTS

DETAILS = 'Write bags, figures, metrics.json and index.html.'


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc reproduce`."""
    add_format(parser)
    add_output(parser, 'results')


def run(options: argparse.Namespace) -> int:
    """Run `ctc reproduce`."""
    from ctc_chattering.cli.progress import Progress
    from ctc_chattering.runs.reproduction import BAGS, reproduce

    out = prepare(options.out, (BAGS, *NAMES), options.overwrite)
    width = max(len(experiment.name) for experiment in EXPERIMENTS)
    with ExitStack() as bars:
        shown: dict[str, Progress] = {}

        def moved(name: str, time: float, duration: float) -> None:
            if name not in shown:
                bars.close()  # That of the experiment before.
                shown[name] = bars.enter_context(Progress(f'{name:{width}}', duration))
            shown[name](time)
        results = reproduce(out, moved)
    bags = [out / BAGS / experiment.name for experiment in EXPERIMENTS]
    return present(results, bags, out, options.format, options.said)
