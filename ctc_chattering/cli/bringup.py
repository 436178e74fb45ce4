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
`bringup`: start plant, controller and reference, and stop them together.

The command line becomes a checked `Setup`, which `launch.graph` runs.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
import sys

from ctc_chattering import __version__
from ctc_chattering.cli.command_line import guarded, Parser
from ctc_chattering.cli.options import add_overrides, add_run_options, load_setup
from ctc_chattering.cli.presentation import progress
from ctc_chattering.errors import as_usage_error
from ctc_chattering.launch.graph import run_graph, Stopped
from ctc_chattering.learning.simulated_learner import check_learning
from ctc_chattering.ros import ros_arguments


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = Parser(
        prog='bringup',
        description='Start plant, controller and reference with one parameter file. All nodes '
                    'stop on Ctrl-C, on SIGTERM, at the end of the experiment, and when one of '
                    'them exits.',
        epilog='Arguments after --ros-args apply to all nodes. They are --params-file F, '
               '-p NAME:=VALUE, -p NODE:NAME:=VALUE, -r __ns:=/robot1 and other remaps. Their '
               'parameters override the options above, and the last value counts. The graph is '
               'confined to this host unless ROS_AUTOMATIC_DISCOVERY_RANGE is set.')
    parser.add_argument('--version', action='version', version=__version__,
                        help='Print the version and exit.')
    add_run_options(parser)
    add_overrides(parser, 'pacing')
    parser.add_argument('--record', type=Path, metavar='BAG',
                        help='Record all topics into this new directory.')
    parser.add_argument('--live', action='store_true', help='Also show the graph in the browser.')
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    return guarded('bringup', lambda: bringup(list(sys.argv[1:] if argv is None else argv)))


def bringup(arguments: Sequence[str]) -> int:
    """Run the graph with arguments of the command and of ROS."""
    for_program, ros = ros_arguments.parse(arguments)
    options = make_parser().parse_args(for_program)
    from tqdm import tqdm
    if options.live:
        from ctc_chattering.live import require_viser
        require_viser()

    with as_usage_error(ros.assigned):
        setup = load_setup(options, ros_arguments.bringup_values(ros))
        check_learning(setup)
    plant = setup.plant
    with progress(f'experiment {plant.experiment}', plant.duration) as show_time:
        try:
            run_graph(setup, options.record, ['--ros-args', *ros.for_ros], show_time, tqdm.write,
                      options.live)
            show_time(plant.duration)
        except Stopped as stopped:
            tqdm.write(f'bringup: {stopped}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
