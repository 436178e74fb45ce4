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

"""`ctc excite` and `identify`: a motion that shows the friction, and what its bags tell."""

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

#: What is asked of the motion: parameters that are options.
_ASKED = {name: dataclasses.replace(spec, default=None) if name in ('center', 'friction') else spec
          for name, spec in ExcitationConfig.parameters().items()
          if name not in ('joint_names', 'start')}


def excite_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc excite`."""
    add_params_file(parser)
    for spec in _ASKED.values():
        add_declared(parser, spec)
    parser.add_argument('--for', dest='joints', type=words, default=(), metavar='A,B',
                        help='joints that the motion is for: the others move little; default: all')
    add_output(parser, 'excite', figures=False)


def run_excite(options: argparse.Namespace) -> int:
    """
    Run `ctc excite`.

    Slow reversals of every joint at a few poses, where it also creeps, then multisines, within the
    limits of the description, all at random. Write motion.yaml, its waypoints, and run.yaml, the
    parameter file with this motion under law compensation. Where the description has collision
    shapes, links keep their distance from each other; obstacles around the robot are not known.
    """
    # The motion of the reference is not played, and so may exceed the limits.
    still = {'reference': {'amplitude': 0.0, 'trajectory_file': ''}}
    setup = parameter_file.load(find_config(options.params_file), still)
    out = options.out
    check_folder(out, EXCITE, options.overwrite)
    with as_usage_error(_ASKED):
        plan = excite(setup, {name: x for name in _ASKED
                              if (x := getattr(options, name)) is not None}, options.joints)
    write_excitation(plan, setup, out, options.overwrite)
    print(plan.text())
    print(f'{len(plan.excitation.times) - 1} waypoints: {out / MOTION}; play them with bringup '
          f'{out / RUN}')
    return 0


def _say(text: str) -> None:
    """Print text in lines that a terminal has room for."""
    print('\n'.join(paragraph(text, 0)))


def identify_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc identify`."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG',
                        help='bag of the robot, or a table of comma-separated values: t, q_JOINT '
                             '..., tau_JOINT ...')
    parser.add_argument('--urdf', metavar='FILE',
                        help="URDF, a path or package://NAME/PATH, default: the bag's")
    parser.add_argument('--model', default='', metavar='NAME',
                        help="two_link, urdf, or package.module:Name, default: the bag's")
    parser.add_argument('--joints', type=words, default=(), metavar='A,B,C',
                        help="joints in the order of the commands, default: the bag's")
    add_declared(parser, dataclasses.replace(
        GRAVITY, default=None, description="Acceleration of gravity, default: the bag's, or 9.81"))
    parser.add_argument('--effort', choices=(MOTOR, LINK, CURRENT),
                        help='what the effort is: the torque of the motor, that of the link '
                             '(sensor behind the gear), or a current; needed without commands')
    add_declared(parser, TORQUE_CONSTANT)
    parser.add_argument('--states', default='joint_states', metavar='TOPIC',
                        help='topic of the joint states, default: joint_states')
    parser.add_argument('--commands', default='effort_controller/commands', metavar='TOPIC',
                        help='topic of the commanded torques, default: '
                             'effort_controller/commands; TOPIC:FIELD for a field of any message')
    add_declared(parser, TORQUE_RATE)
    add_declared(parser, UNCERTAINTY)
    parser.add_argument('--payload', action='append', type=payload, metavar='KG@LINK', default=[],
                        help='known payload at the origin of a link, as 1.3@tool0, for each bag '
                             'in turn, 0 for none; without a link, at the tip. A run with and one '
                             'without it tell torque constants from masses')
    add_number(parser, '--trials', 'number of simulated robots, drawn within the intervals, on '
               'which the gains are tried; default: 24, or 8 without numba; 0 for none', minimum=0)
    add_output(parser, 'identified')


def run_identify(options: argparse.Namespace) -> int:
    """
    Run `ctc identify`.

    The bags may come from any recorder; intervals are those of 95 %. Write identified.yaml,
    identify.json, figures and index.html.
    """
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
        # Motions are not kept here: long ones are large.
        found = identify([motions.pop(0) for _ in options.bags], options.model, urdf,
                         options.gravity, options.effort or '', options.torque_rate or (),
                         options.torque_constant, options.payload, options.urdf_uncertainty)
    identified = write_identified(
        found, out, options.trials, say, options.format, options.said, options.overwrite)
    return _show_robot(identified, out)


def payload(text: str) -> tuple[float, str]:
    """Return mass [kg] and link of a payload."""
    mass, _, link = text.partition('@')
    return float(mass), link


def _show_robot(found: IdentifiedRobot, out: Path) -> int:
    """Print what was found, and where it is."""
    print(found.results.text())
    print()
    if found.missing:
        _say(f'{VALUES} is not written, since there are no gains of {", ".join(found.missing)}')
        print_page(out / PAGE)
    else:
        print_page(out / PAGE, f'ctc simulate {out / VALUES}')
    if not any(x.usable for x in found.results.verdicts):
        raise CtcError(f'no joint is usable: why, and what to record, is in {out / PAGE}')
    return 0
