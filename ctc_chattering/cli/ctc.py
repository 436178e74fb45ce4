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
`ctc`: declarations of its subcommands, and their dispatch.

`main` parses a command line, and calls the function of the subcommand. Only the module of this
subcommand is imported.
"""

from __future__ import annotations

import argparse
from collections.abc import Collection, Sequence
from importlib import import_module
import shlex
import sys
from typing import NamedTuple

from ctc_chattering import __version__
from ctc_chattering.cli.command_line import guarded, Parser


class Command(NamedTuple):
    """
    Declaration of one subcommand.

    Attributes
    ----------
    module : str
        Module of this folder with the functions ``run_NAME`` and ``NAME_options``.
    summary : str
        First sentence of its help, also in the list of `ctc --help`.
    details : str
        Further sentences of its help.

    """

    module: str
    summary: str
    details: str


#: Subcommands in the order of `ctc --help`.
COMMANDS = {
    'simulate': Command(
        'experiments', 'Simulate an experiment without ROS.',
        'The command prints the errors and the torque variation. With --out it also writes '
        'metrics.json and trajectory.npz, which holds t, q, dq, q_d, dq_d, ddq_d, tau, v, the '
        'names and units of the joints, and the gains.'),
    'new-robot': Command(
        'robots', 'Write a parameter file for the robot that a URDF describes.',
        'The file has law observer_feedback with its recommended gains. The reference is a '
        'sinusoid within half of the joint limits, about a posture in which every joint carries '
        'its weight. The command prints the joints and the friction that it took from the URDF. '
        'docs/robots.md says what to set next.'),
    'compile': Command(
        'experiments', 'Compile a law and the plant to machine code.',
        'Nodes, ctc simulate and all other commands then use the machine code and run about 20 '
        'times as fast. The code serves every parameter file with the same law and number of '
        'joints.'),
    'export-c': Command(
        'robots', 'Write a law for one robot as a C library or a ros2_control controller.',
        'The library runs in hard real time without Python. Its torques equal those of this '
        'package to the last bit. docs/ros2_control.md describes both outputs.'),
    'reproduce': Command(
        'experiments', "Run the paper's experiments over ROS and draw its figures.",
        'The command writes bags, figures, metrics.json and index.html.'),
    'compare': Command(
        'runs', 'Compare all laws joint by joint on any robot.',
        'The command runs every parameter file with every law, and law chattering with every '
        'switching. It prints the RMS error of each joint. With --out it writes compare.parquet '
        'with one row per run, compare.json, compare.md, compare.csv, figures, index.html and a '
        'parameter file of every run. Repeat the command to continue an interrupted comparison.'),
    'map': Command(
        'runs', 'Run laws over grids and random draws of parameters to show where they fail.',
        'The command writes map.parquet with one row per run, map.json, figures and index.html. '
        'Repeat the command to continue an interrupted map.'),
    'tune': Command(
        'runs', 'Find gains with low error and low torque variation for a partly known robot.',
        'The search simulates random draws of the uncertain quantities and keeps the limits of '
        'torque and torque rate. Fresh draws validate the results. The command writes the '
        'parameter file tuned.yaml, all other Pareto-optimal gains, figures and index.html.'),
    'plot': Command(
        'bags', 'Draw the figures of one or more bags.',
        'The command writes figures, metrics.json and index.html. Several bags are compared on '
        'one page.'),
    'export': Command(
        'bags', 'Export the samples of a bag to NumPy or CSV.',
        'The command writes trajectory.npz, which also holds the gains, or trajectory.csv. Both '
        'have the names and units of the joints. Torques with time stamps of their own are '
        'written to trajectory_commands.csv.'),
    'learn': Command(
        'bags', 'Learn a correction of the reference from the passes in a bag.',
        'The correction makes the same motion more accurate with the same law and robot. The '
        'command writes a file for learning_file of the reference, and prints the RMS error of '
        'each pass. The bag may be recorded with or without learning.'),
    'replay': Command(
        'bags', 'Publish the messages of a bag on their topics again.',
        'The messages keep their original timing unless --rate changes it.'),
    'repair': Command(
        'bags', 'Repair a truncated or corrupted bag.',
        'The command rewrites each damaged file with the messages of all intact chunks. It keeps '
        'the damaged file under its name with the ending .damaged. Other files stay unchanged.'),
    'live': Command(
        'live', 'Show a running graph, or recorded bags, in the browser.',
        'Without a bag the page shows the running graph, and its controls change law, gains and '
        'plant. Arguments after --ros-args go to ROS, for example -r __ns:=/robot1. Two bags are '
        'shown side by side.'),
    'identify': Command(
        'identification',
        'Identify friction, bodies and drives from recordings, and derive gains.',
        'The recordings may come from any recorder. All intervals are 95 % confidence intervals. '
        'The command writes identified.yaml, identify.json, figures and index.html.'),
    'check-model': Command(
        'robots', 'Test the dynamics of a robot model at random states.',
        'The tests check that M is symmetric and positive definite, that ½ dM/dt - C is '
        'skew-symmetric, that G is a gradient, and that all products are consistent. The exit '
        'status is 1 if a test fails.'),
    'stability': Command(
        'runs', 'Compute which errors of model, lag and delay the control loop tolerates.',
        'The analysis treats the sampled loop with constant M and without limits. It uses the '
        'poles for constant errors and the small-gain theorem for varying errors. For an arm with '
        'a URDF it also prints the rotor inertias and masses that these margins allow. The exit '
        'status is 1 if the loop is unstable with the exact model. docs/theory.md states the '
        'assumptions and the theorem.'),
    'parameters': Command(
        'robots', 'Print all parameters of all nodes as a Markdown table.', ''),
    'excite': Command(
        'identification', 'Generate a motion that excites the friction of every joint.',
        'Every joint moves slowly to and fro at a few random poses, where it also creeps. Then '
        'all joints follow random multisines. The motion keeps the limits of the description. The '
        'command writes the waypoints motion.yaml, and run.yaml, a parameter file with this '
        'motion and law compensation. If the description has collision shapes, the links keep a '
        'distance from each other. Obstacles around the robot are not considered.')}


def make_parser(used: Collection[str] = COMMANDS.keys()) -> argparse.ArgumentParser:
    """Return the parser of the command line; only the `used` subcommands have options."""
    parser = Parser(prog='ctc', description=(
        'Control robot arms with friction by computed torque plus compensation plus chattering.'))
    parser.add_argument('--version', action='version', version=__version__,
                        help='Print the version and exit.')
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for name, declared in COMMANDS.items():
        command = commands.add_parser(name, help=declared.summary)
        if name in used:
            module = import_module(f'{__package__}.{declared.module}')
            function = name.replace('-', '_')
            command.description = f'{declared.summary} {declared.details}'.strip()
            command.set_defaults(run=getattr(module, f'run_{function}'))
            getattr(module, f'{function}_options')(command)
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
