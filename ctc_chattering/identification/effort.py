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

"""The effort of joint states as torque at the joint: behind a gear, or from a current."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from numbers import Real
from typing import NamedTuple

from ctc_chattering.analysis.recording import Recording
from ctc_chattering.arguments import vector
from ctc_chattering.errors import CtcError, ParameterError, UsageError
from ctc_chattering.identification.regression.effort_side import CURRENT, LINK, MOTOR
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class EffortNames(NamedTuple):
    """What a message calls the arguments of `identify` that say what the effort is."""

    side: str = 'side'
    gear_ratio: str = 'gear_ratio'
    torque_constant: str = 'torque_constant'


#: In Python.
ARGUMENTS = EffortNames()
#: One number for all joints, or one for each; None where it is not known.
PerJoint = float | Sequence[float] | None


def check_effort(side: str, geared: bool, constant: bool, recordings: Sequence[Recording] = (),
                 names: EffortNames = ARGUMENTS) -> None:
    """
    Check that what is said of the effort goes together.

    Parameters
    ----------
    side : {'', 'motor', 'link', 'current'}
        What the effort is; empty for a guess.
    geared, constant : bool
        Whether there are gear ratios, and torque constants.
    recordings : sequence of Recording
        Of which one at least must have an effort, if something is said of it.
    names : EffortNames
        Of the arguments, for the message.

    Raises
    ------
    UsageError
        If not.

    """
    if geared and side not in (MOTOR, CURRENT):
        raise UsageError(
            f'{names.gear_ratio} needs {names.side} motor or {names.side} current: '
            f'{"behind the gear it is 1" if side == LINK else "what is the effort?"}')
    if constant and side != CURRENT:
        raise UsageError(f'{names.torque_constant} needs {names.side} current')
    if side == CURRENT and geared and not constant:
        raise UsageError(f'{names.gear_ratio} of currents needs {names.torque_constant}')
    if side and recordings and all(x.effort is None for x in recordings):
        raise UsageError(f'{names.side} {side}: {recordings[0].name} has no effort')


def in_torques(recordings: Sequence[Recording], side: str, gear_ratio: PerJoint,
               torque_constant: PerJoint) -> tuple[list[Recording], str]:
    """
    Return recordings whose effort is the torque at the joint, and what it then is.

    Parameters
    ----------
    recordings : sequence of Recording
        Of n joints.
    side : {'', 'motor', 'link', 'current'}
        What the effort is; empty for a guess.
    gear_ratio : float or sequence of float, optional
        Turns of the motor per turn of the joint.
    torque_constant : float or sequence of float, optional
        Torque of the motor per ampere, or of the joint without `gear_ratio` [N·m/A].

    Raises
    ------
    CtcError
        If an argument is not allowed, or they do not go together.

    """
    check_effort(side, gear_ratio is not None, torque_constant is not None, recordings)
    n = len(recordings[0].joints)
    factor = _factors('gear_ratio', gear_ratio, n) * _factors(
        'torque_constant', torque_constant, n)
    side = MOTOR if torque_constant is not None else side
    if (factor == 1.0).all():
        return list(recordings), side
    for x in recordings:
        if len(x.joints) != n:
            raise CtcError(f'{x.name}: {len(x.joints)} joints; {recordings[0].name} has {n}')
    return [dataclasses.replace(x, effort=x.effort * factor) if x.effort is not None else x
            for x in recordings], side


def _factors(name: str, value: PerJoint, n: int) -> Array:
    """Return n factors, of None ones; raise `ParameterError` if they are none."""
    if value is None:
        return np.ones(n)
    one = isinstance(value, Real) and not isinstance(value, bool)
    found = vector(name, [value] * n if one else value, n)
    if not (np.isfinite(found) & (found != 0.0)).all():
        raise ParameterError(name, value, 'finite numbers that are not 0')
    return found
