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

#: The subcommands with their modules, and what `ctc --help` says of them. Command NAME is the
#: function run_NAME there; NAME_options adds its arguments.
COMMANDS = {
    'simulate': ('experiments', 'simulate an experiment without ROS'),
    'new-robot': ('robots', 'write a parameter file for the robot of a URDF'),
    'compile': ('experiments', 'compile a law and the plant, for nodes and simulation'),
    'export-c': ('robots', 'write a law for one robot as a C library, or a controller of '
                           'ros2_control'),
    'reproduce': ('experiments', "run the paper's experiments over ROS and draw its figures"),
    'compare': ('runs', 'compare all laws joint by joint, on any robot'),
    'map': ('runs', 'run laws over grids and random draws of parameters, and show which law fails '
                    'where'),
    'tune': ('runs', 'find gains with low error and low torque variation for a partly known '
                     'robot'),
    'plot': ('bags', 'draw the figures of bags'),
    'export': ('bags', 'export the samples of a bag to NumPy or CSV'),
    'replay': ('bags', 'publish a bag on its topics again'),
    'repair': ('bags', 'repair a truncated or corrupted bag'),
    'live': ('live', 'show a running graph, or bags, in the browser'),
    'identify': ('identification',
                 'identify friction, bodies and drives from recordings, and derive gains'),
    'check-model': ('robots', 'test the dynamics of a robot model'),
    'stability': ('runs', 'compute which errors of model, lag and delay the loop tolerates'),
    'parameters': ('robots', 'print all parameters of all nodes'),
    'excite': ('identification', 'generate a motion that excites the friction of every joint')}


def make_parser(used: Collection[str] = COMMANDS.keys()) -> argparse.ArgumentParser:
    """Return the parser of the command line; only the `used` subcommands have options."""
    parser = Parser(
        prog='ctc', description='Computed torque plus compensation plus chattering.')
    parser.add_argument('--version', action='version', version=__version__)
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for name, (chapter, summary) in COMMANDS.items():
        command = commands.add_parser(name, help=summary)
        if name in used:
            module, own = import_module(f'{__package__}.{chapter}'), name.replace('-', '_')
            run = getattr(module, f'run_{own}')
            details = ' '.join((run.__doc__ or '').split()).partition('`. ')[2]
            command.description = f'{summary[0].upper()}{summary[1:]}. {details}'
            command.set_defaults(run=run)
            getattr(module, f'{own}_options')(command)
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
