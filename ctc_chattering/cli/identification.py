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
`ctc excite` and `identify`: an excitation motion, and the robot identified from its bags.

Both commands read files, call the folder `identification` and print its results.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from ctc_chattering.analysis.tables import paragraph
from ctc_chattering.cli.command_line import say
from ctc_chattering.cli.options import add_declared, add_number, add_output, add_params_file, words
from ctc_chattering.cli.presentation import print_page
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import find_config, read_description
from ctc_chattering.errors import as_usage_error, CtcError
from ctc_chattering.identification.bag_motion import read_motion
from ctc_chattering.identification.effort import CURRENT, LINK, MOTOR
from ctc_chattering.identification.excite import (
    EXCITE,
    excite,
    MOTION,
    RUN,
    write_excitation,
)
from ctc_chattering.identification.identified_robot import (
    GRAVITY,
    IdentifiedRobot,
    IDENTIFY,
    identify,
    PAGE,
    TORQUE_CONSTANT,
    TORQUE_RATE,
    UNCERTAINTY,
    VALUES,
    write_identified,
)
from ctc_chattering.identification.random_motions import ExcitationConfig
from ctc_chattering.identification.table_motion import read_table, SUFFIX
from ctc_chattering.output_folder import check_folder

#: Parameters of the motion that are options.
_MOTION_OPTIONS = {
    name: dataclasses.replace(spec, default=None) if name in ('center', 'friction') else spec
    for name, spec in ExcitationConfig.parameters().items()
    if name not in ('joint_names', 'start')}


def excite_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc excite`."""
    add_params_file(parser)
    for spec in _MOTION_OPTIONS.values():
        add_declared(parser, spec)
    parser.add_argument('--for', dest='joints', type=words, default=(), metavar='A,B',
                        help='Joints to excite. The other joints move little. Default: all '
                             'joints.')
    add_output(parser, 'excite', figures=False)


def run_excite(options: argparse.Namespace) -> int:
    """Run `ctc excite`."""
    # The reference's own motion is not run, and so it may exceed the limits.
    still = {'reference': {'amplitude': 0.0, 'trajectory_file': ''}}
    setup = parameter_file.load(find_config(options.params_file), still)
    out = options.out
    check_folder(out, EXCITE, options.overwrite)
    with as_usage_error(_MOTION_OPTIONS):
        plan = excite(setup, {name: x for name in _MOTION_OPTIONS
                              if (x := getattr(options, name)) is not None}, options.joints)
    write_excitation(plan, setup, out, options.overwrite)
    print(plan.text())
    print(f'{len(plan.excitation.times) - 1} waypoints were written to {out / MOTION}; next: '
          f'bringup {out / RUN}')
    return 0


def _say(text: str) -> None:
    """Print text in lines of the terminal's width."""
    print('\n'.join(paragraph(text, 0)))


def identify_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc identify`."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG',
                        help='Bag of the robot, or a table of comma-separated values with the '
                             'columns t, q_JOINT ..., tau_JOINT ....')
    parser.add_argument('--urdf', metavar='FILE',
                        help='URDF of the robot, as a path or package://NAME/PATH. Default: the '
                             "bag's description.")
    parser.add_argument('--model', default='', metavar='NAME',
                        help='Robot model: two_link, urdf, or your own as package.module:Name. '
                             "Default: the bag's model.")
    parser.add_argument('--joints', type=words, default=(), metavar='A,B,C',
                        help="Joints in the order of the commands. Default: the bag's joints.")
    add_declared(parser, dataclasses.replace(
        GRAVITY, default=None,
        description="Acceleration of gravity. Default: the bag's value, or 9.81"))
    parser.add_argument('--effort', choices=(MOTOR, LINK, CURRENT),
                        help='Meaning of the recorded effort: torque of the motor, torque of the '
                             'link (sensor behind the gear), or current of the motor. It is '
                             'needed if no commands were recorded.')
    add_declared(parser, TORQUE_CONSTANT)
    parser.add_argument('--states', default='joint_states', metavar='TOPIC',
                        help='Topic of the joint states. Default: joint_states.')
    parser.add_argument('--commands', default='effort_controller/commands', metavar='TOPIC',
                        help='Topic of the commanded torques, or TOPIC:FIELD for a field of any '
                             'message. Default: effort_controller/commands.')
    add_declared(parser, TORQUE_RATE)
    add_declared(parser, UNCERTAINTY)
    parser.add_argument('--payload', action='append', type=payload, metavar='KG@LINK', default=[],
                        help='Known payload at the origin of a link, for example 1.3@tool0. '
                             'Without a link it is at the tip. Repeat the option for each bag in '
                             'turn, with 0 for no payload. A run with and a run without payload '
                             'separate torque constants from masses. [kg]')
    add_number(parser, '--trials', 'Number of simulated robots for trial runs of the gains. They '
               'are drawn within the intervals. 0 for no trial runs. Default: 24, or 8 without '
               'numba', minimum=0)
    add_output(parser, 'identified')


def run_identify(options: argparse.Namespace) -> int:
    """Run `ctc identify`."""
    out = options.out
    check_folder(out, IDENTIFY, options.overwrite)
    urdf = read_description(options.urdf) if options.urdf else ''
    motions = [
        read_table(bag, options.joints, urdf) if bag.suffix == SUFFIX else
        read_motion(bag, options.joints, urdf, options.states, options.commands, options.model)
        for bag in options.bags]
    for note in [note for motion in motions for note in motion.notes]:
        say(note)
    with as_usage_error(('torque_rate', 'torque_constant', 'payloads', 'urdf_uncertainty')):
        # Long recordings are large, so no reference to them stays here.
        robot = identify([motions.pop(0) for _ in options.bags], options.model, urdf,
                         options.gravity, options.effort or '', options.torque_rate or (),
                         options.torque_constant, options.payload, options.urdf_uncertainty)
    identified = write_identified(
        robot, out, options.trials, say, options.format, options.said, options.overwrite)
    return _show_robot(identified, out)


def payload(text: str) -> tuple[float, str]:
    """Return mass [kg] and link of a payload."""
    mass, _, link = text.partition('@')
    return float(mass), link


def _show_robot(robot: IdentifiedRobot, out: Path) -> int:
    """Print the results and the path of the page."""
    print(robot.results.text())
    print()
    if robot.missing:
        _say(f'{VALUES} is not written, because there are no gains for '
             f'{", ".join(robot.missing)}')
        print_page(out / PAGE)
    else:
        print_page(out / PAGE, f'ctc simulate {out / VALUES}')
    if not any(x.usable for x in robot.results.verdicts):
        raise CtcError(f'no joint is usable; {out / PAGE} gives the reasons and what to record')
    return 0
