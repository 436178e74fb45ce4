"""`ctc`: simulate, reproduce the paper, show, plot and replay bags, compare, check models."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
import sys
from typing import Any

from ctc_chattering import __version__
from ctc_chattering.cli.comparison_options import add_comparison_options
from ctc_chattering.cli.options import (
    add_engine_option,
    add_params_file,
    add_run_options,
    guarded,
    Parser,
)
from ctc_chattering.cli.tune import add_tune_options


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = Parser(
        prog='ctc', description='Computed torque plus compensation plus chattering.')
    parser.add_argument('--version', action='version', version=__version__)
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')

    _add_experiments(commands)
    _add_bags(commands)
    _add_identify(commands)
    _add_models(commands)
    _add_identification(commands)
    return parser


def _add_experiments(commands: Any) -> None:
    simulate = _add(
        commands, 'simulate', 'run an experiment without ROS',
        'Write metrics.json and trajectory.npz (t, q, dq, q_d, dq_d, ddq_d, tau, v, names, units, '
        'gains).')
    add_run_options(simulate)
    _add_output(simulate, None)

    reproduce = _add(
        commands, 'reproduce', "run the paper's experiments over ROS and draw its figures",
        'Write bags, figures, metrics.json and index.html.')
    _add_output(reproduce, 'results')

    study = _add(
        commands, 'study', 'compare the switchings over sample period, gain and imperfections',
        'Simulate them and write study.md, study.csv, figures and study.html; with --laws, '
        'laws.md, laws.csv, laws_figures and laws.html.')
    _add_output(study, 'study')
    study.add_argument('--laws', action='store_true',
                       help='every law with its recommended settings, against compensation')
    study.add_argument('--jobs', type=int, metavar='N',
                       help='processes, as many as there are processors by default')
    add_engine_option(study)

    compare = _add(
        commands, 'compare', 'compare all laws joint by joint, on any robot',
        'Run every parameter file with every law and, under law chattering, every switching; '
        'print the RMS error of each joint. Write compare.md, compare.csv, figures, index.html, '
        'and a parameter file of every run.')
    add_comparison_options(compare)
    _add_output(compare, None)
    _add_map(commands)
    _add_tune(commands)


def _add_map(commands: Any) -> None:
    parser = _add(
        commands, 'map', 'run laws over grids and draws of parameters, and show which fails where',
        'Write map.parquet, a row a run; map.json, figures and index.html. What is there of the '
        'same map is not computed again.')
    parser.add_argument('spec', metavar='SPEC.yaml',
                        help='what to run, docs/maps.md; or the name of one of the package')
    parser.add_argument('--jobs', type=int, metavar='N',
                        help='processes, as many as there are processors by default')
    parser.add_argument('--scheduler', metavar='ADDRESS',
                        help='of a dask cluster that is there, tcp://host:port')
    add_engine_option(parser)
    parser.add_argument('--explain', metavar='POINT',
                        help='write and draw one run, by its number or by name=value,... of axes, '
                             'law and repeat')
    _add_output(parser, 'map')


def _add_tune(commands: Any) -> None:
    parser = _add(
        commands, 'tune', 'gains with little error and little torque variation for a robot that '
        'is known in part',
        'Search for them over draws of what is uncertain, within limits of the torque and its '
        'rate, and validate them on fresh draws. Write tuned.yaml, a parameter file; all other '
        'best compromises, figures and index.html.')
    add_tune_options(parser)
    _add_output(parser, 'tuned')


def _add_bags(commands: Any) -> None:
    plot = _add(
        commands, 'plot', 'draw the figures of bags',
        'Write them with metrics.json and index.html. Several bags are compared.')
    plot.add_argument('bags', nargs='+', type=Path, metavar='BAG',
                      help='bag, or a directory of bags')
    plot.add_argument('--format', choices=('svg', 'pdf', 'png'), default='svg',
                      help='figures in this format as well; the page has them as SVG')
    _add_output(plot, 'plots')

    export = _add(
        commands, 'export', 'write the samples of a bag as a table',
        'With names and units of the joints: trajectory.npz, which has the gains as well, or '
        'trajectory.csv.')
    export.add_argument('--csv', action='store_true',
                        help='comma-separated values in place of a NumPy file')
    _add_output(export, 'export')

    replay = _add(commands, 'replay', 'publish a bag on its topics again',
                  'With its own timing, and /clock.')
    replay.add_argument('--rate', type=float, default=1.0, metavar='R',
                        help='speed, 1 by default; 2 is twice as fast')
    replay.add_argument('--delay', type=float, default=1.0, metavar='S',
                        help='time to wait for subscribers first, 1 by default [s]')

    repair = _add(
        commands, 'repair', 'make a complete bag of one that was cut off or has wrong bytes',
        'Every tool reads it then; what was there is kept beside it.')
    for parser in (export, replay, repair):
        parser.add_argument('bag', type=Path, metavar='BAG')
    _add_live(commands)


def _add_live(commands: Any) -> None:
    live = _add(
        commands, 'live', 'show the arm and the law in the browser, of a graph or of bags',
        'Without a bag the page shows the running graph, and its buttons change law, gains and '
        'plant; arguments after --ros-args are for ROS, such as -r __ns:=/robot1. Two bags are '
        'shown side by side.')
    live.add_argument('bags', nargs='*', type=Path, metavar='BAG')
    live.add_argument('--export', type=Path, metavar='FILE',
                      help='write the page of the bags into one HTML file, and serve none')
    live.add_argument('--overwrite', action='store_true', help='replace that file')
    live.add_argument('--host', default='127.0.0.1', metavar='H',
                      help='address to listen on, by default 127.0.0.1, which other machines '
                           'do not reach')
    live.add_argument('--port', type=int, metavar='N',
                      help='port; by default the first free one from 8080 on')
    live.add_argument('--open', action=argparse.BooleanOptionalAction, default=None,
                      help='open it in the browser of this machine; by default in a terminal')
    live.add_argument('--read-only', action='store_true', help='no buttons, nothing is sent')
    live.add_argument('--dark', action='store_true', help='light letters on dark ground')
    live.add_argument('--parent', type=int, help=argparse.SUPPRESS)


def _add_identify(commands: Any) -> None:
    identify = _add(
        commands, 'identify', 'friction, delays, errors of the model and gains from bags',
        'From bags of any recorder, with intervals of 95 %. Write identified.yaml, identify.json, '
        'figures and index.html.')
    identify.add_argument('bags', nargs='+', type=Path, metavar='BAG', help='bag of the robot')
    identify.add_argument('--validate', type=Path, metavar='BAG',
                          help='bag that is not used for the fit, and predicted')
    identify.add_argument('--urdf', metavar='FILE',
                          help="the URDF, a path or package://NAME/PATH; by default the bag's")
    identify.add_argument('--model', metavar='NAME',
                          help="two_link, urdf, or package.module:Class; by default the bag's")
    identify.add_argument('--joints', metavar='A,B,C',
                          help="joints in the order of the commands; by default the bag's")
    identify.add_argument('--gravity', type=float, metavar='G',
                          help="by default the bag's, or 9.81 [m/s²]")
    identify.add_argument('--torque', choices=('command', 'effort'),
                          help='where torques are taken from; by default what explains more')
    identify.add_argument('--states', default='joint_states', metavar='TOPIC',
                          help='topic of the joint states, joint_states by default')
    identify.add_argument('--commands', default='effort_controller/commands', metavar='TOPIC',
                          help='topic of the commanded torques, effort_controller/commands by '
                               'default')
    identify.add_argument('--torque-rate', metavar='R',
                          help='rate that the drives allow, one number or one for each joint '
                               '[N·m/s]')
    _add_output(identify, 'identified')


def _add_models(commands: Any) -> None:
    check_model = _add(
        commands, 'check-model', 'test the dynamics of a robot model',
        'At random states: M symmetric and positive definite, ½ dM/dt - C skew-symmetric, G a '
        'gradient, all products consistent. Status 1 if a test fails.')
    check_model.add_argument(
        '--model', metavar='NAME',
        help='two_link, urdf, or package.module:Class; urdf by default if there is --urdf, else '
             'two_link')
    check_model.add_argument('--urdf', metavar='FILE',
                             help='model urdf: the URDF, a path or package://NAME/PATH')
    check_model.add_argument(
        '--joints', metavar='A,B,C',
        help='joints in the order of the model; by default all that the URDF has, or joint1, '
             'joint2')
    check_model.add_argument('--gravity', type=float, default=9.81, metavar='G',
                             help='9.81 by default [m/s²]')
    check_model.add_argument('--samples', type=int, default=100, metavar='N',
                             help='number of states, 100 by default')
    check_model.add_argument('--seed', type=int, default=0, metavar='S',
                             help='seed of the states, 0 by default')

    _add(commands, 'parameters', 'print all parameters of all nodes', 'As a Markdown table.')


def _add_identification(commands: Any) -> None:
    excite = _add(
        commands, 'excite', 'make a motion that shows the friction of every joint',
        'Slow reversals of every joint at a few poses, then Fourier series, within the limits of '
        'the description. Write motion.yaml, its waypoints, and run.yaml, the parameter file with '
        'this motion under law compensation. The motion is not checked for collisions.')
    add_params_file(excite)
    excite.add_argument('--duration', type=float, default=60.0, metavar='S',
                        help='60 by default [s]')
    excite.add_argument('--poses', type=int, default=3, metavar='N',
                        help='poses with slow reversals, 3 by default')
    for name, text in (
            ('center', "position about which it moves; the reference's center by default [rad]"),
            ('position-range', 'greatest distance from the centre, 0.8 by default [rad]'),
            ('velocity-limit', 'in place of the part of the limits of the description [rad/s]'),
            ('acceleration-limit', 'the same for the acceleration [rad/s²]'),
            ('friction', "Coulomb friction to expect; the plant's by default [N·m]")):
        excite.add_argument(f'--{name}', metavar='A,B,C',
                            help=f'{text}: a number per joint, or one for all')
    excite.add_argument(
        '--velocity-scale', type=float, default=0.5, metavar='X',
        help='part of the limits of velocity and acceleration to use, 0.5 by default')
    excite.add_argument('--draws', type=int, default=20, metavar='N',
                        help='random motions, of which the best conditioned one is taken; 20 by '
                             'default')
    excite.add_argument('--seed', type=int, default=0, metavar='S',
                        help='seed of these motions, 0 by default')
    _add_output(excite, None)


def _add(commands: Any, name: str, summary: str, details: str) -> argparse.ArgumentParser:
    """Add a subcommand; its own help begins with the line that it has in that of `ctc`."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=summary, description=f'{summary[0].upper()}{summary[1:]}. {details}')
    return parser


def _add_output(parser: argparse.ArgumentParser, default: str | None) -> None:
    parser.add_argument(
        '--out', type=Path, metavar='DIR', default=default and Path(default),
        help=f'directory to write into, {default} by default' if default
        else 'directory to write into; without it the numbers are only printed')
    parser.add_argument('--overwrite', action='store_true',
                        help='replace what an earlier run of this command wrote there')


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
    options = make_parser().parse_args(arguments)
    options.ros_args = ros
    # Imported here: each needs libraries that take time to load, or may be missing.
    from ctc_chattering.cli import commands, live
    if options.command == 'live':
        return live.live(options)
    return int(getattr(commands, options.command.replace('-', '_'))(options))


if __name__ == '__main__':
    sys.exit(main())
