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
Which torque signal is used, and whether it can be the torque of this robot, joint by joint.

Weight, inertial torque and friction are free columns, so that errors of the model change little.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import NamedTuple

from ctc_chattering.bags.recording import Recording, Stretch
from ctc_chattering.errors import CtcError, ParameterError, UsageError
from ctc_chattering.identification.drives import COMMAND, EFFORT, has
from ctc_chattering.identification.findings import ALL_JOINTS, Finding, Kind
from ctc_chattering.identification.least_squares import coefficients, correlation_length, without
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import joined, Rows
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import vector
import numpy as np
from scipy.optimize import linear_sum_assignment  # type: ignore[import-untyped]

#: Fewest windows of a joint that are used.
_FEWEST = 30
#: Part of a signal's variance that may be left for it to say something.
_UNEXPLAINED = 0.3
#: Ratio of the variances left, in the order given and in the one found, on each moved joint.
_CLEARLY = 4.0
#: Weight, as a part of the torque, that counts as none.
_NOTHING = 1e-6
#: Part of the variance that counts as explained altogether.
_ALL = 1e-4


class TorqueShape(NamedTuple):
    """
    A torque by what explains it; n joints, nan where a joint does not tell.

    Attributes
    ----------
    weight, error : ndarray, shape (n,)
        Part of the model's weight, and its standard error.
    friction : ndarray, shape (n,)
        Coulomb friction and viscous friction at the RMS velocity [N·m].
    load : ndarray, shape (n,)
        RMS of the model's weight [N·m].

    """

    weight: Array
    error: Array
    friction: Array
    load: Array


def _columns(rows: Rows, i: int, torque: Array) -> tuple[Array, Array]:
    """Return the columns of joint i, shape (K, 5), and its torque where it slides."""
    used = np.flatnonzero((rows.way[:, i] != 0.0) & np.isfinite(torque))
    weight = rows.gravity[used, i]
    return np.column_stack((weight, rows.base[used, i] - weight, rows.way[used, i],
                            rows.velocity[used, i], np.ones(len(used)))), torque[used]


def _left(x: Array, y: Array) -> float:
    """Return which part of the variance of y columns leave."""
    whole = float(np.square(y - y.mean()).sum()) if len(y) else 0.0
    if len(y) < _FEWEST or whole <= 0.0:
        return 1.0
    return max(_ALL, float(np.square(without(x, y, 1e-6)).sum()) / whole)


def torque_shape(rows: Rows, torque: Array) -> TorqueShape:
    """Return what explains a torque, by windows and joints [N·m], nan where unknown."""
    found = np.full((4, torque.shape[1]), np.nan)
    for i, one in enumerate(torque.T):
        x, y = _columns(rows, i, one)
        if _left(x, y) > _UNEXPLAINED:
            continue
        value = coefficients(x, y)
        rest, speed = y - x @ value, float(np.sqrt(np.square(x[:, 3]).mean()))
        weight = float(np.linalg.norm(x[:, 0]))
        alone = float(np.linalg.norm(without(x[:, 1:], x[:, 0])))
        # What the other columns have, too, or what is none, is not told.
        told = weight > _NOTHING * np.linalg.norm(y) and alone > _NOTHING * weight
        deviation = np.sqrt(float(rest @ rest) / len(y) * max(1.0, correlation_length(rest)))
        found[:, i] = (value[0], deviation / alone if told else np.inf,
                       value[2] + value[3] * speed, weight / np.sqrt(len(y)))
    return TorqueShape(*found)


def check_order(rows: Rows, torque: Array, joints: Sequence[str]) -> None:
    """Raise `CtcError` if the columns of a torque fit other joints better."""
    moving = [i for i in range(len(joints)) if len(_columns(rows, i, torque[:, i])[1]) >= _FEWEST
              and np.nanstd(torque[:, i]) > 0.0]
    left = np.array([[_left(*_columns(rows, i, torque[:, k])) for i in moving] for k in moving])
    if len(moving) < 2:
        return
    _, fitting = linear_sum_assignment(np.log(left))
    given, best = left.diagonal(), left[np.arange(len(moving)), fitting]
    moved = fitting != np.arange(len(moving))
    if (moved.any() and (best[moved] < _UNEXPLAINED).all()
            and np.log(given[moved] / best[moved]).mean() > np.log(_CLEARLY)):
        raise CtcError(
            f'the commands do not fit the joints in the order {",".join(joints)}: they leave '
            f"{given[moved].max():.0%} of a joint's torque unexplained, and "
            f'{best[moved].max():.0%} in another one: give --joints in their order')


#: Sides of a measured effort.
MOTOR, LINK, CURRENT = 'motor', 'link', 'current'
#: Friction of an effort behind the gear, as a part of that of the commands.
_BEHIND_GEAR = 0.5
#: Factor between a torque and the model of another unit.
_OTHER_UNIT = 2.0
#: Standard error of a part of the weight that is exact.
_EXACT = 0.06


def torque_source(parts: Sequence[Stretch], rows: Sequence[Rows], phi: TestFunction,
                  joints: Sequence[str], declared: str = '') -> tuple[str, tuple[Finding, ...]]:
    """
    Return which torque is used, and findings: an effort only if the user says that it is one.

    Parameters
    ----------
    parts, rows
        Stretches and their windows.
    phi : TestFunction
        φ.
    joints : sequence of str, length n
        Names.
    declared : {'', 'motor', 'link', 'current'}
        Side of the effort that the user gives; 'motor' for currents that were converted.

    Raises
    ------
    CtcError
        If commands are in another order than `joints`, have no weight or another unit, or if
        there are none and the effort is not declared as that of the motor.

    """
    whole = joined(rows)
    command, effort = (_weak(parts, rows, phi, kind) for kind in (COMMAND, EFFORT))
    theirs = None
    if command is not None:
        check_order(whole, command, joints)
        theirs = torque_shape(whole, command)
        check_commands(theirs)
    if effort is None or (declared != MOTOR and theirs is not None):
        return COMMAND, ()
    if declared != MOTOR:
        raise CtcError(
            'torques would be those of the effort: if it is the torque of the motors, in N*m at '
            'the joint, give --effort motor; if it is a current, --effort current '
            '--torque-constant K1,K2,... with N*m at the joint per ampere; behind the gear it '
            'shows no friction: record the commanded torques, too')
    if theirs is not None:
        mine = torque_shape(whole, effort)
        part = np.nanmedian(np.append(mine.friction / theirs.friction, np.nan))
        if abs(part) < _BEHIND_GEAR:
            return COMMAND, (Finding(
                Kind.DOUBT, ALL_JOINTS, f'the effort shows {part:.2f} of the friction of the '
                'commands: it is not that of the motor, and friction is taken from the commands',
                '--effort says what it is: of the motor, the link, or a current'),)
    return EFFORT, ()


def _weak(parts: Sequence[Stretch], rows: Sequence[Rows], phi: TestFunction, source: str
          ) -> Array | None:
    """Return a signal over all windows, shape (J, n) [N·m], nan for unknown; None without it."""
    found = []
    for part, mine in zip(parts, rows):
        values = has(part, source)
        found.append(np.full_like(mine.base, np.nan) if values is None
                     else phi.sums(values, phi.over, mine.centres))
    torque = np.concatenate(found)
    return torque if np.isfinite(torque).any() else None


def check_commands(shape: TorqueShape) -> None:
    """Raise `CtcError` if commands have no weight, or are no torques."""
    known = np.flatnonzero(shape.error < _EXACT * np.maximum(1.0, np.abs(shape.weight)))
    if not len(known):
        return
    # The median by load: one at the tip is much for joints near it, which carry little.
    order = known[np.argsort(shape.weight[known])]
    below = np.cumsum(shape.load[order])
    weight = float(shape.weight[order[np.searchsorted(below, 0.5 * below[-1])]])
    if not 1.0 / _OTHER_UNIT <= weight <= _OTHER_UNIT:
        raise CtcError(
            f'the commands have {weight:.2f} of the weight that the model has: if the robot '
            'compensates its weight itself, give --gravity 0; else they are no torques in N*m, '
            'or the model is another robot')


def in_torques(recordings: Sequence[Recording], side: str,
               torque_constant: Sequence[float] | None) -> tuple[list[Recording], str]:
    """
    Return recordings whose effort is the torque at the joint, and what it then is.

    Parameters
    ----------
    recordings : sequence of Recording
        Of n joints.
    side : {'', 'motor', 'link', 'current'}
        What the effort is; empty where it is not known.
    torque_constant : sequence of float, length n, optional
        Torque at the joint per unit of the effort [N·m/A, or 1 for a torque of the motor].

    Raises
    ------
    CtcError
        If an argument is not allowed, or they do not go together.

    """
    if side and all(x.effort is None for x in recordings):
        raise UsageError(f'effort {side}: {recordings[0].name} has no effort')
    if torque_constant is None:
        return list(recordings), side
    if side not in (MOTOR, CURRENT):
        raise UsageError('torque_constant needs an effort that is of the motor, or a current')
    n = len(recordings[0].joints)
    factor = vector('torque_constant', torque_constant, n)
    if not (np.isfinite(factor) & (factor != 0.0)).all():
        raise ParameterError('torque_constant', torque_constant, 'finite numbers that are not 0')
    for x in recordings:
        if len(x.joints) != n:
            raise CtcError(f'{x.name}: {len(x.joints)} joints; {recordings[0].name} has {n}')
    return [x if x.effort is None else dataclasses.replace(x, effort=x.effort * factor)
            for x in recordings], MOTOR
