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

from ctc_chattering.analysis.output import prepare
from ctc_chattering.cli.options import add_format, add_output
from ctc_chattering.cli.presentation import present, PRESENTED
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.paper import EXPERIMENTS

DETAILS = 'Write bags, figures, metrics.json and index.html.'
#: Name in the output directory.
_BAGS = 'bags'


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc reproduce`."""
    add_format(parser)
    add_output(parser, 'results')


def run(options: argparse.Namespace) -> int:
    """Run `ctc reproduce`."""
    from ctc_chattering.bags.reader import read_bag
    from ctc_chattering.cli.progress import Progress
    from ctc_chattering.launch.graph import run_graph
    from ctc_chattering.ros.domain import own_domain

    out = prepare(options.out, (_BAGS, *PRESENTED), options.overwrite)
    bags = []
    width = max(len(experiment.name) for experiment in EXPERIMENTS)
    with own_domain():
        for experiment in EXPERIMENTS:
            duration = parameter_file.load(experiment.path, experiment.overrides).plant.duration
            bags.append(out / _BAGS / experiment.name)
            with Progress(f'{experiment.name:{width}}', duration) as progress:
                run_graph(experiment.path, experiment.overrides, bags[-1], progress=progress,
                          show=lambda _: None)
                progress(duration)
    return present([read_bag(bag) for bag in bags], bags, out, options.format, options.said)
