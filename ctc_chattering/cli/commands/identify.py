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

"""`ctc identify`: from bags to friction, delays, errors of the model and gains."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from ctc_chattering.analysis.output import prepare
from ctc_chattering.analysis.tables import paragraph
from ctc_chattering.cli.command_line import say
from ctc_chattering.cli.options import add_format, add_output, numbers
from ctc_chattering.cli.presentation import print_page
from ctc_chattering.configuration.package_share import read_description
from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.identification.effort import check_effort, CURRENT, EffortNames, LINK, MOTOR

if TYPE_CHECKING:
    from ctc_chattering.bags.recording import RecordedMotion, Recording
    from ctc_chattering.identification.identified_robot import IdentifiedRobot

#: Options that say what the effort is.
_EFFORT = EffortNames('--effort', '--gear-ratio', '--torque-constant')
DETAILS = ('The bags may come from any recorder; intervals are those of 95 %. Write '
           'identified.yaml, identify.json, figures and index.html.')


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc identify`."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG', help='bag of the robot')
    parser.add_argument('--validate', type=Path, metavar='BAG',
                        help='bag that is not used for the fit, to validate it')
    parser.add_argument('--urdf', metavar='FILE',
                        help="URDF, a path or package://NAME/PATH, default: the bag's")
    parser.add_argument('--model', default='', metavar='NAME',
                        help="two_link, urdf, or package.module:Name, default: the bag's")
    parser.add_argument('--joints', metavar='A,B,C',
                        help="joints in the order of the commands, default: the bag's")
    parser.add_argument('--gravity', type=float, metavar='G',
                        help="acceleration of gravity [m/s²], default: the bag's, or 9.81")
    parser.add_argument('--torque', choices=('command', 'effort'),
                        help='source of the torques, default: what explains the motion better')
    _add_effort_options(parser)
    parser.add_argument('--states', default='joint_states', metavar='TOPIC',
                        help='topic of the joint states, default: joint_states, or the only '
                             'one that fits')
    parser.add_argument('--commands', default='effort_controller/commands', metavar='TOPIC',
                        help='topic of the commanded torques, default: '
                             'effort_controller/commands, or the only one that fits; TOPIC:FIELD '
                             'for a field of any message')
    parser.add_argument('--torque-rate', metavar='R',
                        help='rate limit of the drives, one number or one for each joint '
                             '[N·m/s]')
    parser.add_argument('--payload', action='append', metavar='KG@LINK', default=[],
                        help='known payload at the origin of a link, as 1.3@tool0, for each bag '
                             'in turn, 0 for none; given once, that of the last bag. A run with '
                             'and one without it tell torque constants from masses')
    parser.add_argument('--trials', type=int, metavar='N',
                        help='number of simulated robots, drawn within the intervals, on which '
                             'the gains are tried; default: 24, or 8 without numba; 0 for none')
    parser.add_argument('--seed', type=int, default=1, metavar='S',
                        help='seed of the trials, default: 1')
    add_format(parser)
    add_output(parser, 'identified')


def run(options: argparse.Namespace) -> int:
    """Run `ctc identify`."""
    from ctc_chattering.identification.identified_robot import (
        identify,
        NAMES,
        write_identified,
    )

    for name in ('trials', 'seed'):
        if (getattr(options, name) or 0) < 0:
            raise UsageError(f'--{name}: {getattr(options, name)} is not allowed; allowed: 0 or '
                             'more')
    side = _declared(options)
    urdf = read_description(options.urdf) if options.urdf else ''
    *motions, last = _motions(options, urdf)
    of_effort = _factors(options, [x.recording for x in (*motions, last)])
    motions += [] if options.validate else [last]
    rate = _rates(options.torque_rate, len(motions[0].recording.joints))
    out = prepare(options.out, NAMES, options.overwrite)
    found = identify(motions, last if options.validate else None, options.model, urdf,
                     options.gravity, options.torque or '', side, rate, **of_effort,
                     payloads=_payloads(options.payload, len(motions)))
    return _shown(write_identified(found, out, options.trials, options.seed, say, options.format,
                                   options.said), out)


def _motions(options: argparse.Namespace, urdf: str) -> list[RecordedMotion]:
    """Return the motion of each bag, the one to validate last."""
    from ctc_chattering.bags.motion import read_motion

    joints = tuple(filter(None, (options.joints or '').split(',')))
    motions = [read_motion(bag, joints, urdf, options.states, options.commands, options.model)
               for bag in (*options.bags, *filter(None, [options.validate]))]
    for motion in motions:
        for note in motion.notes:
            say(note)
    return motions


def _payloads(texts: list[str], count: int) -> list[tuple[float, str]]:
    """Return mass [kg] and link of the payload of each bag; empty without any."""
    found = []
    for text in texts:
        mass, _, link = text.partition('@')
        try:
            found.append((float(mass), link))
        except ValueError:
            raise UsageError(f'--payload: {text} is not allowed; allowed: KG@LINK, as 1.3@tool0, '
                             'or 0') from None
    return [(0.0, '')] * (count - 1) + found if len(found) == 1 else found


def _rates(text: str | None, n: int) -> tuple[float, ...]:
    """Return the allowed rate of each joint [N·m/s] from the option; empty without."""
    if text is None:
        return ()
    return numbers('--torque-rate', text, n, ' above 0', lambda x: x > 0.0)


def _shown(found: IdentifiedRobot, out: Path) -> int:
    """Print what was found, and where it is."""
    from ctc_chattering.identification.identified_robot import PAGE, VALUES

    print(found.results.text())
    print()
    if found.missing:
        print(f'{VALUES} is not written, since it would have no gains of all joints:')
        for line in found.missing:
            print('\n'.join(paragraph(line)))
        print_page(out / PAGE)
    else:
        print_page(out / PAGE, f'ctc simulate {out / VALUES}')
    if not any(x.usable for x in found.results.verdicts):
        raise CtcError(f'no joint is usable: why, and what to record, is in {out / PAGE}')
    return 0


def _add_effort_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say what the effort in joint states is."""
    parser.add_argument('--effort', choices=(MOTOR, LINK, CURRENT),
                        help='what the effort is: the torque of the motor, that of the link '
                             '(sensor behind the gear), or a current; default: guessed')
    parser.add_argument('--gear-ratio', metavar='N',
                        help='turns of the motor per turn of the joint, where the effort is a '
                             'torque or a current at the motor; one number or one for each joint')
    parser.add_argument('--torque-constant', metavar='K',
                        help='torque of the motor per ampere [N·m/A], or of the joint without '
                             '--gear-ratio')


def _declared(options: argparse.Namespace) -> str:
    """Return what the effort is, empty for a guess; raise `UsageError` for what contradicts."""
    side: str = options.effort or ''
    check_effort(side, bool(options.gear_ratio), bool(options.torque_constant), names=_EFFORT)
    return side


def _factors(options: argparse.Namespace, recordings: Sequence[Recording]
             ) -> dict[str, tuple[float, ...]]:
    """Return the arguments of `identify` that the options give; raise `UsageError`."""
    check_effort(_declared(options), bool(options.gear_ratio), bool(options.torque_constant),
                 recordings, _EFFORT)
    return {name: numbers(option, text, len(recordings[0].joints), ' that is not 0',
                          lambda x: isfinite(x) and x != 0.0)
            for name, option in _EFFORT._asdict().items() if name != 'side'
            and (text := getattr(options, name))}
