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

"""`ctc excite`: a motion that shows the friction of every joint."""

from __future__ import annotations

import argparse
from math import inf
from pathlib import Path
from textwrap import fill
from typing import Any

from ctc_chattering.analysis.output import prepare
from ctc_chattering.analysis.tables import columns, print_columns
from ctc_chattering.cli.options import add_output, add_params_file, check, find_file, numbers
from ctc_chattering.configuration import parameter_file
from ctc_chattering.errors import CtcError, given_by_user
from ctc_chattering.identification.excite import (
    CHECK,
    excite,
    MOTION,
    Plan,
    request_of,
    RUN,
    write,
)
import numpy as np

DETAILS = ('Slow reversals of every joint at a few poses, where it also creeps, then multisines, '
           'within the limits of the description, all at random. Write '
           'motion.yaml, its waypoints, and run.yaml, the parameter file with this motion under '
           'law compensation. Where the description has collision shapes, links keep their '
           'distance from each other; obstacles around the robot are not known.')
#: Options that are parameters of the motion.
_SCALARS = ('duration', 'poses', 'velocity_scale', 'clearance')
_LISTS = ('center', 'position_range', 'velocity_limit', 'acceleration_limit')
#: Characters of a line.
_LINE = 100


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc excite`."""
    add_params_file(parser)
    parser.add_argument('--duration', type=float, default=60.0, metavar='S',
                        help='duration [s], default: 60')
    parser.add_argument('--poses', type=int, default=3, metavar='N',
                        help='number of poses with slow reversals, default: 3')
    for name, text in (
            ('center', "centre of the motion [rad], default: the reference's"),
            ('position-range', 'largest distance from the centre [rad], default: 0.8'),
            ('velocity-limit', 'instead of that fraction of the limit of the description [rad/s]'),
            ('acceleration-limit', 'the same for the acceleration [rad/s²]'),
            ('friction', "expected Coulomb friction [N·m], default: the plant's")):
        parser.add_argument(f'--{name}', metavar='A,B,C',
                            help=f'{text}: a number per joint, or one for all')
    parser.add_argument(
        '--velocity-scale', type=float, default=0.5, metavar='X',
        help='fraction of the velocity and acceleration limits to use, default: 0.5')
    parser.add_argument('--clearance', type=float, default=0.02, metavar='M',
                        help='least distance between links [m], default: 0.02')
    parser.add_argument('--srdf', type=Path, metavar='FILE',
                        help='do not check links that this SRDF allows to touch')
    parser.add_argument('--floor', type=float, metavar='Z',
                        help='height of a floor in the frame of the root link [m]')
    parser.add_argument('--evaluations', type=int, default=20, metavar='N',
                        help='random motions, of which the first that keeps all limits is taken, '
                             'default: 20')
    parser.add_argument('--seed', type=int, default=0, metavar='S',
                        help='seed of the random motions, default: 0')
    parser.add_argument('--for', dest='joints', metavar='A,B',
                        help='joints that the motion is for: the others move little; default: all')
    add_output(parser)


def run(options: argparse.Namespace) -> int:
    """Run `ctc excite`."""
    check('--evaluations', options.evaluations, 1)
    check('--seed', options.seed, 0)
    file = find_file(options.params_file)
    # The motion of the reference is not played, and so may exceed the limits.
    still = {'reference': {'amplitude': 0.0, 'trajectory_file': ''}}
    setup, sections = parameter_file.load(file, still), parameter_file.read(file)
    with given_by_user((*_SCALARS, *_LISTS, 'friction')):
        request = _request(options, len(setup.controller.joint_names))
        friction = _friction(options, len(setup.controller.joint_names))
        request_of(setup, request)
    if options.floor is not None:
        check('--floor', options.floor, -inf)
    srdf = _text(options.srdf) if options.srdf is not None else ''
    if options.out is not None and not options.overwrite:
        prepare(options.out, (MOTION, RUN))  # Refused before the search rather than after it.
    found = excite(setup, request, friction, options.evaluations, options.seed, srdf,
                   options.floor, tuple(filter(None, (options.joints or '').split(','))))
    if options.out is not None:
        write(found, sections, prepare(options.out, (MOTION, RUN), options.overwrite))
    _show(found)
    if options.out is not None:
        print(f'{len(found.excitation.route.times)} waypoints: {options.out / MOTION}; play them '
              f'with bringup {options.out / RUN}')
    return 0


def _request(options: argparse.Namespace, n: int) -> dict[str, Any]:
    """Return what the options ask for."""
    return {name: getattr(options, name) for name in _SCALARS} | {
        name: numbers(name, text, n) for name in _LISTS
        if (text := getattr(options, name)) is not None}


def _friction(options: argparse.Namespace, n: int) -> tuple[float, ...] | None:
    """Return the friction that an option gives, length n [N·m]; None without it."""
    return None if options.friction is None else numbers(
        'friction', options.friction, n, ' >= 0', lambda x: x >= 0.0)


def _text(file: Path) -> str:
    """Return the text of an SRDF."""
    try:
        return file.read_text(encoding='utf-8')
    except (OSError, ValueError) as error:
        raise CtcError(f'{file}: {getattr(error, "strerror", None) or "not a text file"}'
                       ) from None


def _show(found: Plan) -> None:
    """Print what the motion reaches of what it may, and what is foretold of it."""
    motion, bounds = found.motion, found.bounds
    rows: list[tuple[str, ...]] = [
        ('joint', 'position', 'velocity', 'accel.', 'torque', 'kp', 'kv', 'sticks')]
    for i, joint in enumerate(found.limits):
        q = motion.q[:, i]
        peaks = zip((np.abs(x[:, i]).max() for x in (motion.dq, motion.ddq, motion.tau)),
                    (bounds.velocity[i], bounds.acceleration[i], found.effort[i]))
        rows.append((
            joint.name, f'{q.min():.2f} to {q.max():.2f}',
            *(f'{most:.3g}/{limit:.4g}' for most, limit in peaks), f'{found.kp[i]:g}',
            f'{found.kv[i]:g}', f'{found.hold[i]:.3f}'))
    wide = max(map(len, columns([row[1:] for row in rows])))
    print_columns([(_short(row[0], _LINE - 2 - wide), *row[1:]) for row in rows])
    (first, _), (_, last) = found.excitation.slow[0], found.excitation.creep[-1]
    begin, end = found.excitation.sines
    _say(f'slow reversals and creeping at {len(found.excitation.slow)} poses from {first:.1f} to '
         f'{last:.1f} s, multisines from {begin:.1f} to {end:.1f} s')
    _show_distances(found)
    _warn(found)


def _show_distances(found: Plan) -> None:
    """Print what is known of collisions."""
    links, near = found.links, found.near
    if links is None or near is None:
        _say('warning: the motion is not checked for collisions of the robot with itself: '
             f'{found.unchecked}')
        return
    _say(f'nearest approach of two links: {links.text(near, CHECK * near.sample)} is kept')
    for what, names in (('these touch at the centre', links.touching),
                        ('no collision shapes of', links.unseen)):
        if names:
            _say(f'warning: not checked, {what}: {", ".join(names)}')


def _short(name: str, room: int) -> str:
    """Return a name of no more than `room` characters, its end if it is longer."""
    return name if len(name) <= room else '…' + name[1 - room:]


def _say(text: str) -> None:
    """Print text in lines that a terminal has room for."""
    print(fill(text, _LINE, break_long_words=False, break_on_hyphens=False))


def _warn(found: Plan) -> None:
    """Print which limits are assumed, and on which joints the motion shows little."""
    for quantity in ('velocity', 'acceleration'):
        names = [joint.name for joint in found.limits if getattr(joint, quantity)[1] == inf]
        if names:
            _say(f'no {quantity} limit in the description, so the one above is assumed: '
                 + ('all joints' if len(names) == len(found.limits) else ', '.join(names)))
    held = [f'{joint.name} ({hold:.2g} of ±{slow:.2g} {joint.unit})' for joint, hold, slow in zip(
        found.limits, found.hold, found.bounds.slow) if hold > 0.5 * slow]
    if held:
        _say('warning: friction may hold joints through much of their slow reversals: '
             f'{", ".join(held)}; a greater position_range helps, a higher kp (a shorter '
             'control_period allows it), or a position controller that plays the motion')
