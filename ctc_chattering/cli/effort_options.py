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

"""The options that say what a recorded effort is."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import dataclasses
from math import isfinite

from ctc_chattering.analysis.recording import Recording
from ctc_chattering.cli.options import numbers
from ctc_chattering.errors import UsageError
import numpy as np

MOTOR, LINK, CURRENT = 'motor', 'link', 'current'


def add_effort_options(parser: argparse.ArgumentParser) -> None:
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


def declared(options: argparse.Namespace) -> str:
    """
    Return what the effort is, once `in_torques` has converted it; empty for a guess.

    Raises
    ------
    UsageError
        If options do not go together.

    """
    side: str | None = options.effort
    if options.gear_ratio and side not in (MOTOR, CURRENT):
        raise UsageError('--gear-ratio needs --effort motor or --effort current: '
                         f'{"behind the gear it is 1" if side == LINK else "what is the effort?"}')
    if options.torque_constant and side != CURRENT:
        raise UsageError('--torque-constant needs --effort current')
    if side == CURRENT and options.gear_ratio and not options.torque_constant:
        raise UsageError('--gear-ratio of currents needs --torque-constant')
    return MOTOR if side == CURRENT and options.torque_constant else side or ''


def in_torques(recordings: Sequence[Recording], options: argparse.Namespace) -> list[Recording]:
    """Return recordings whose effort is the torque at the joint [N·m], where options tell it."""
    if options.effort and all(x.effort is None for x in recordings):
        raise UsageError(f'--effort {options.effort}: {recordings[0].name} has no effort')
    n = len(recordings[0].joints)
    factor = np.ones(n)
    for option, text in (('--gear-ratio', options.gear_ratio),
                         ('--torque-constant', options.torque_constant)):
        if text:
            factor = factor * numbers(option, text, n, 'that is not 0',
                                      lambda x: isfinite(x) and x != 0.0)
    if (factor == 1.0).all():
        return list(recordings)
    return [dataclasses.replace(x, effort=x.effort * factor) if x.effort is not None else x
            for x in recordings]
