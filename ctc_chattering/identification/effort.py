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
Choice of the torque, commanded or measured, in N·m.

`identify` asks which torque it may use, and has the effort multiplied by constants of the user.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses

from ctc_chattering.errors import ParameterError, UsageError
from ctc_chattering.identification.recording import (
    Recording,
    RecordingError,
    RecordingFault,
)
from ctc_chattering.identification.stretches import COMMAND, EFFORT, Stretch
from ctc_chattering.parameters import checked_vector
import numpy as np

#: Kinds of a measured effort: torque of the motor at the joint [N·m], torque of a sensor behind
#: the gear [N·m], or a current [A].
MOTOR = 'motor'
LINK = 'link'
CURRENT = 'current'


def choose_source(stretches: Sequence[Stretch], side: str, name: str) -> str:
    """
    Return the torque that is used, `COMMAND` or `EFFORT`.

    An effort is used only if the user says that it is a torque or a current.

    Parameters
    ----------
    stretches : sequence of Stretch
        Stretches of all recordings.
    side : {'', 'motor', 'link', 'current'}
        Kind of the effort, as the user says.
    name : str
        Name of the recording, for messages.

    Raises
    ------
    CtcError
        If there are no commands, and the user does not say what the effort is.

    """
    is_commanded = any(x.command is not None for x in stretches)
    is_measured = any(x.effort is not None for x in stretches)
    if is_measured and side and not (is_commanded and side == LINK):
        return EFFORT
    if is_commanded:
        return COMMAND
    raise RecordingError(
        RecordingFault.TORQUE,
        f'{name}: the recording has no commanded torques, and does not tell what the effort is. '
        'Give --effort motor for the torque of the motors in N*m at the joint, --effort current '
        'for currents, or --effort link for a torque sensor behind the gear, which shows little '
        'of its friction')


def convert_effort(
        recordings: Sequence[Recording],
        side: str,
        torque_constant: Sequence[float] | None) -> tuple[list[Recording], str]:
    """
    Return recordings with the torque at the joint, and its kind.

    Parameters
    ----------
    recordings : sequence of Recording
        Recordings of n joints.
    side : {'', 'motor', 'link', 'current'}
        Kind of the effort, empty where it is not known.
    torque_constant : sequence of float, length n, optional
        Torque at the joint per unit of the effort [N·m/A, or 1 for a torque].

    Raises
    ------
    CtcError
        If an argument is not allowed, or they do not go together.

    """
    if side and all(x.effort is None for x in recordings):
        raise UsageError(f'effort {side}: {recordings[0].name} has no effort')
    if torque_constant is None:
        return list(recordings), side
    if not side:
        raise UsageError('torque_constant needs --effort: motor, link or current')
    n = len(recordings[0].joints)
    factor = checked_vector('torque_constant', torque_constant, n)
    if not (np.isfinite(factor) & (factor != 0.0)).all():
        raise ParameterError('torque_constant', torque_constant, 'finite numbers that are not 0')
    converted = []
    for recording in recordings:
        if len(recording.joints) != n:
            raise RecordingError(
                RecordingFault.JOINTS,
                f'{recording.name}: {len(recording.joints)} joints; '
                f'{recordings[0].name} has {n}')
        if recording.effort is not None:
            recording = dataclasses.replace(recording, effort=recording.effort * factor)
        converted.append(recording)
    return converted, MOTOR if side == CURRENT else side
