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

"""`ctc`: simulate, reproduce the paper, show, plot and replay bags, compare, check models."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Sequence
from importlib import import_module
import shlex
import sys

from ctc_chattering import __version__
from ctc_chattering.cli.command_line import guarded, Parser

#: The subcommands with what `ctc --help` says of them; their modules are in `commands`.
COMMANDS = {
    'simulate': 'simulate an experiment without ROS',
    'new-robot': 'write a parameter file for the robot of a URDF',
    'compile': 'compile a law and the plant, for nodes and simulation',
    'reproduce': "run the paper's experiments over ROS and draw its figures",
    'compare': 'compare all laws joint by joint, on any robot',
    'map': 'run laws over grids and random draws of parameters, and show which law fails where',
    'tune': 'find gains with low error and low torque variation for a partly known robot',
    'plot': 'draw the figures of bags',
    'export': 'export the samples of a bag to NumPy or CSV',
    'replay': 'publish a bag on its topics again',
    'repair': 'repair a truncated or corrupted bag',
    'live': 'show a running graph, or bags, in the browser',
    'identify': 'identify friction, delays and model errors from bags, and derive gains',
    'check-model': 'test the dynamics of a robot model',
    'stability': 'compute which errors of model, lag and delay the loop tolerates',
    'parameters': 'print all parameters of all nodes',
    'excite': 'generate a motion that excites the friction of every joint'}


def make_parser(used: Collection[str] = COMMANDS.keys()) -> argparse.ArgumentParser:
    """Return the parser of the command line; only the `used` subcommands have options."""
    parser = Parser(
        prog='ctc', description='Computed torque plus compensation plus chattering.')
    parser.add_argument('--version', action='version', version=__version__)
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for name, summary in COMMANDS.items():
        command = commands.add_parser(name, help=summary)
        if name in used:
            module = import_module(f'ctc_chattering.cli.commands.{name.replace("-", "_")}')
            command.description = f'{summary[0].upper()}{summary[1:]}. {module.DETAILS}'
            command.set_defaults(run=module.run)
            module.add_options(command)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    name = ' '.join(('ctc', *(word for word in arguments[:1] if not word.startswith('-'))))
    return guarded(name, lambda: _run(arguments))


def _run(arguments: list[str]) -> int:
    ros: list[str] = []
    if arguments[:1] == ['live'] and '--ros-args' in arguments:
        first = arguments.index('--ros-args')
        arguments, ros = arguments[:first], arguments[first:]
    options = make_parser(arguments).parse_args(arguments)
    options.ros_args, options.said = ros, shlex.join(['ctc', *arguments])
    return int(options.run(options))


if __name__ == '__main__':
    sys.exit(main())
