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
Executables of the nodes, which `bringup` also starts.

Signal handlers are set before anything else is imported. Importing ROS takes a good part of a
second, and SIGINT would cause a traceback meanwhile. The interpreter is not finalized, because
this takes as long.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
import gc
import importlib
import os
import sys
from typing import Any, NoReturn

from ctc_chattering import __version__
from ctc_chattering.ros import process


def main(name: str, argv: Sequence[str] | None = None) -> int:
    """
    Run a node.

    Parameters
    ----------
    name : str
        Name of its module in `ctc_chattering.nodes`.
    argv : sequence of str, optional
        Arguments with the program's name first, by default those of the process.

    Returns
    -------
    int
        Exit status.

    """
    process.handle_stop(lambda *_: os._exit(0))  # The node is not in the graph yet.
    from ctc_chattering.cli.command_line import guarded
    return guarded(name, lambda: _run(name, list(sys.argv if argv is None else argv)[1:]))


def _run(name: str, arguments: Sequence[str]) -> int:
    """Run a node with its arguments and those for ROS."""
    from ctc_chattering.errors import as_usage_error
    from ctc_chattering.launch import child_process
    from ctc_chattering.ros import ros_arguments
    for_program, ros = ros_arguments.parse(arguments)
    parent = _make_parser(name).parse_args(for_program).parent
    if parent is not None:
        child_process.end_with(parent)
    values = ros.values([name])[name]
    module = importlib.import_module(f'ctc_chattering.nodes.{name}')
    run = importlib.import_module('ctc_chattering.ros.run_node').run

    if parent is not None:
        child_process.await_start()

    def make_node() -> Any:
        with as_usage_error(ros.assigned):
            return getattr(module, f'{name.capitalize()}Node')(values)
    return int(run(make_node, name, ['--ros-args', *ros.for_ros], process.collect_signals()))


def _make_parser(name: str) -> argparse.ArgumentParser:
    """Return the parser of the arguments that are not for ROS."""
    from ctc_chattering.cli.command_line import Parser
    from ctc_chattering.configuration.node_parameters import NODE_DESCRIPTIONS
    parser = Parser(
        prog=name, description=NODE_DESCRIPTIONS[name],
        usage='%(prog)s [--help] [--version] [--ros-args [--params-file F] [-p NAME:=VALUE] '
              '[-r FROM:=TO] ...]',
        epilog='`ctc parameters` lists all parameters.')
    parser.add_argument('--version', action='version', version=__version__,
                        help='Print the version and exit.')
    parser.add_argument('--parent', type=int, help=argparse.SUPPRESS)
    return parser


def execute(name: str, argv: Sequence[str] | None = None) -> NoReturn:
    """Run a node, and end the process with it."""
    status = main(name, argv)
    gc.collect()  # The last reference to the node holds its DDS participant.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


# Entry points of the executables.
plant = partial(execute, 'plant')
controller = partial(execute, 'controller')
reference = partial(execute, 'reference')
recorder = partial(execute, 'recorder')

if __name__ == '__main__':
    execute(sys.argv[1], sys.argv[1:])
