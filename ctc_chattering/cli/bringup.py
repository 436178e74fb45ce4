"""`bringup`: start plant, controller and reference, record if asked, stop them all together."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
import sys

from ctc_chattering import params
from ctc_chattering.cli.options import add_run_options, guarded, overrides, params_file
from ctc_chattering.cli.progress import Progress
from ctc_chattering.core.plant import PACINGS
from ctc_chattering.orchestra import perform, Stopped


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog='bringup',
        description='Start plant, controller and reference with one parameter file; stop all of '
                    'them on Ctrl-C, SIGTERM, the end of the experiment or the death of any.',
        epilog='Arguments from --ros-args on go to every node, such as -r __ns:=/robot1. '
               'The graph is confined to this host unless ROS_AUTOMATIC_DISCOVERY_RANGE is set.')
    add_run_options(parser)
    parser.add_argument('--pacing', choices=PACINGS, help="in place of the file's pacing")
    parser.add_argument('--record', type=Path, metavar='BAG', help='directory to create')
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    split = arguments.index('--ros-args') if '--ros-args' in arguments else len(arguments)
    options = make_parser().parse_args(arguments[:split])
    return guarded('bringup', lambda: bringup(options, arguments[split:]))


def bringup(options: argparse.Namespace, ros_args: Sequence[str]) -> int:
    """Run the graph as `options` say."""
    over = overrides(options)
    if options.pacing is not None:
        over.setdefault('plant', {})['pacing'] = options.pacing
    file = params_file(options)
    setup = params.load(file, over)
    with Progress(setup.plant.experiment, setup.plant.duration) as progress:
        try:
            perform(file, over, options.record, ros_args, progress,
                    progress.write)
            progress.complete()
        except Stopped as stopped:
            progress.write(f'bringup: {stopped}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
