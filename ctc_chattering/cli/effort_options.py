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
from math import isfinite

from ctc_chattering.analysis.recording import Recording
from ctc_chattering.cli.options import numbers
from ctc_chattering.identification.effort import check_effort, CURRENT, EffortNames, LINK, MOTOR

_NAMES = EffortNames('--effort', '--gear-ratio', '--torque-constant')


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
    """Return what the effort is, empty for a guess; raise `UsageError` for what contradicts."""
    side: str = options.effort or ''
    check_effort(side, bool(options.gear_ratio), bool(options.torque_constant), names=_NAMES)
    return side


def factors(options: argparse.Namespace, recordings: Sequence[Recording]
            ) -> dict[str, tuple[float, ...]]:
    """Return the arguments of `identify` that the options give; raise `UsageError`."""
    check_effort(declared(options), bool(options.gear_ratio), bool(options.torque_constant),
                 recordings, _NAMES)
    return {name: numbers(option, text, len(recordings[0].joints), 'that is not 0',
                          lambda x: isfinite(x) and x != 0.0)
            for name, option in _NAMES._asdict().items() if name != 'side'
            and (text := getattr(options, name))}
