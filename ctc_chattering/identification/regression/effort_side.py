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
What commands and measured efforts are: torques of the motor, of the link, currents, or less.

A torque measured at the motor, or by its current, contains the friction of the gear. One measured
behind the gear does not: it is what the rigid bodies need. Then friction is what the commands
show. A law acts through its commands, and so they are also preferred where a part of the friction
is missing in one of the two.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import NamedTuple

from ctc_chattering.analysis.recording import Stretch
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.regression.finding import ALL_JOINTS, Finding, Severity
from ctc_chattering.identification.regression.rows import Rows
from ctc_chattering.identification.regression.torque import COMMAND, EFFORT
from ctc_chattering.identification.regression.torque_shape import (
    TorqueShape,
    TorqueWindows,
    weak_torques,
)
from ctc_chattering.identification.regression.weak_form import TestFunction
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt

#: Sides of a measured effort.
MOTOR, LINK, CURRENT = 'motor', 'link', 'current'
#: Friction of an effort behind the gear, as a part of that of the commands, or of the torque.
_BEHIND_GEAR, _HARDLY_ANY = 0.5, 0.01
#: Least ratio of the frictions of two signals that both show all of it.
_SAME_FRICTION = 0.8
#: Friction is told by this many standard errors, and this part of the torque.
_CLEAR, _SOME = 5.0, 0.005
#: Factors between effort and command, and between a torque and the model, of another unit.
_OTHER_UNIT, _OTHER_UNIT_THAN_MODEL = 1.5, 2.0
#: Part of the weight below which it is missing, and standard error of a part that is exact.
_NO_WEIGHT, _EXACT = 0.3, 0.06
#: Difference of an echo, as a part of the largest command; samples of delay; part that is equal.
_EQUAL, _DELAYS, _MOSTLY = 1e-5, 20, 0.9
#: Part that is equal after another delay, above which commands are in wrong places.
_ELSEWHERE = 0.005


class TorqueSides(NamedTuple):
    """
    What the signals are.

    Attributes
    ----------
    side : {'', 'motor', 'link', 'current'}
        Of the effort; empty without effort, or where the motion does not tell.
    source : {'', 'command', 'effort'}
        The signal to use; empty for the one that explains more.
    findings : tuple of Finding

    """

    side: str
    source: str
    findings: tuple[Finding, ...] = ()


def torque_sides(parts: Sequence[Stretch], rows: Sequence[Rows], phi: TestFunction,
                 joints: Sequence[str], declared: str = '', source: str = '') -> TorqueSides:
    """
    Return what the torques of stretches are.

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
    source : {'', 'command', 'effort'}
        Signal that the user asks for.

    Raises
    ------
    CtcError
        If commands are in another order than `joints`, have no weight or another unit, or if all
        there is is an effort without friction, or in another unit.

    """
    windows = TorqueWindows.of(rows)
    command, effort = (weak_torques(parts, rows, phi, kind) for kind in (COMMAND, EFFORT))
    theirs = None
    if command is not None and source != EFFORT:
        windows.check_order(command, joints)
        theirs = windows.shape(command)
        check_commands(theirs)
    if effort is None:
        return TorqueSides('', source)
    if theirs is not None:
        delay = _echo(parts)
        if delay is not None:
            return TorqueSides('', source, (Finding(
                Severity.NOTE, ALL_JOINTS, 'the effort is the command, '
                f'{delay} samples later: it is not measured, but it has stamps'),))
    mine = windows.shape(effort)
    guess = _guess(mine, theirs)
    if theirs is None:
        return _of_effort_only(declared, guess, mine, source)
    return _of_both(declared, guess, mine, theirs, source)


def check_commands(shape: TorqueShape) -> None:
    """Raise `CtcError` if commands have no weight, or are no torques."""
    weight = _exact(shape.weight, shape.weight_error, shape.load)
    inertia = _exact(shape.inertia, shape.inertia_error, shape.size)
    if not np.isfinite(weight) or _same(weight, _OTHER_UNIT_THAN_MODEL):
        return
    if abs(weight) < _NO_WEIGHT and inertia > 1.0 / _OTHER_UNIT_THAN_MODEL:
        raise CtcError(
            f'the commands have {weight:.2f} of the weight that the model has, and {inertia:.2f} '
            'of its inertial torque: the robot compensates its weight itself; give --gravity 0')
    raise CtcError(
        f'the commands have {weight:.2f} of the weight that the model has: they are no torques '
        'in N*m, or the model is another robot; if the robot compensates its weight itself, give '
        '--gravity 0')


def _guess(effort: TorqueShape, command: TorqueShape | None) -> str:
    """Return the side of the effort; empty where nothing tells."""
    weight = _exact(effort.weight, effort.weight_error, effort.load)
    if command is None:
        if np.isfinite(weight) and not _same(weight, _OTHER_UNIT_THAN_MODEL):
            return CURRENT
        part = _median((np.abs(effort.friction) + 2.0 * effort.friction_error) / effort.size)
        return LINK if part < _HARDLY_ANY else ''
    known = np.where(effort.weight_error < _EXACT * np.abs(effort.weight), effort.weight, np.nan)
    ratio = _median(known / command.weight)
    if np.isfinite(ratio) and not _same(ratio, _OTHER_UNIT):
        return CURRENT
    part = _friction_ratio(effort, command)
    return '' if np.isnan(part) else LINK if abs(part) < _BEHIND_GEAR else MOTOR


def _of_effort_only(declared: str, guess: str, effort: TorqueShape, source: str) -> TorqueSides:
    """Return what follows without commands; raise `CtcError` if friction cannot be told."""
    if (declared or guess) == CURRENT:
        weight = np.where(effort.weight_error < _EXACT * np.abs(effort.weight), effort.weight,
                          np.nan)
        factors = ','.join('?' if np.isnan(x) else f'{1.0 / x:.3g}' for x in weight)
        raise CtcError(
            f'the effort is {_median(weight):.3g} of the torque of the model: if it is a current, '
            'give --effort current --torque-constant K1,K2,... with N*m at the joint per ampere '
            f'(by the weight of the model: {factors}), or record the commanded torques')
    if declared == LINK or (guess == LINK and not declared):
        part = _median(np.abs(effort.friction) / effort.size)
        raise CtcError(
            f'the effort shows no friction ({part:.1%} of the torque, median of the joints): it '
            'is measured behind the gear; only the commanded torques show friction: record them, '
            'too; or give --effort motor if there is no friction between motor and link')
    if declared:
        return TorqueSides(declared, source)
    return TorqueSides('', source, (Finding(
        Severity.CARE, ALL_JOINTS, 'torques are the measured effort, without commands: friction '
        'between the motor and the place of the measurement is not in it',
        'record the commands, or give --effort motor'),))


def _of_both(declared: str, guess: str, effort: TorqueShape, command: TorqueShape, source: str
             ) -> TorqueSides:
    """Return what follows from effort and commands."""
    side, part = declared or guess, _friction_ratio(effort, command)
    told = '' if np.isnan(part) else f': it shows {part:.2f} of the friction of the commands'
    if side in (LINK, CURRENT):
        what = {LINK: f'the effort is measured behind the gear{told}',
                CURRENT: 'the effort is a current, or has another unit than N*m'}[side]
        return TorqueSides(side, COMMAND, (Finding(
            Severity.NOTE, ALL_JOINTS, f'{what}; friction is taken from the commands',
            '' if declared else f'--effort {side} confirms it'),))
    found: list[Finding] = []
    if guess in (LINK, CURRENT):
        found.append(Finding(
            Severity.CARE, ALL_JOINTS, f'the effort is declared as that of the {declared}, but '
            f'looks like {guess}{told}', f'--effort {guess}'))
    elif not (np.isnan(part) or _same(part, 1.0 / _SAME_FRICTION)):
        found.append(Finding(
            Severity.NOTE, ALL_JOINTS, f'the effort shows {part:.2f} of the friction of the '
            'commands; friction is taken from these, through which a law acts'))
    return TorqueSides(side, COMMAND if found else source, tuple(found))


def _friction_ratio(effort: TorqueShape, command: TorqueShape) -> float:
    """Return the median of the effort's friction over the commands', where these show any."""
    clear = command.friction > np.maximum(
        _CLEAR * command.friction_error, _SOME * command.size)
    return _median(np.where(clear, effort.friction / command.friction, np.nan))


def _echo(parts: Sequence[Stretch]) -> int | None:
    """Return after how many samples the effort repeats the command; None if it does not."""
    part = max((x for x in parts if x.command is not None and x.effort is not None),
               key=lambda x: len(x.q), default=None)
    if part is None or part.command is None or part.effort is None:
        return None
    least = _least(part.command)
    for delay in range(min(_DELAYS, len(part.q) // 2)):
        if least and _repeats(part.command, part.effort, delay, delay, least).mean() > _MOSTLY:
            return delay
    return None


def _least(command: Array) -> float:
    """Return from which difference on a torque is another one [N·m]."""
    return _EQUAL * float(max(np.nanmax(command, initial=0.0), -np.nanmin(command, initial=0.0)))


def _repeats(command: Array, effort: Array, delay: int, first: int, least: float
             ) -> npt.NDArray[np.bool_]:
    """Return which efforts from `first` on are the commands before, shape (N - first, n)."""
    # Joint by joint, for long recordings.
    return np.stack([np.abs(x[first:] - y[first - delay:len(y) - delay]) <= least
                     for x, y in zip(effort.T, command.T)], axis=1)


def placed_unevenly(parts: Sequence[Stretch]) -> list[Stretch]:
    """
    Return stretches that know by how much their commands may be in wrong places.

    Where the effort repeats some commands after fewer samples than others, the recorder received
    these later than others.
    """
    delay = _echo(parts)
    if delay is None:
        return list(parts)
    found = []
    for part in parts:
        if part.command is not None and part.effort is not None:
            shares = [_share(part.command, part.effort, delay, other)
                      for other in (delay + 1, delay - 1)]
            early, later = (float(share > _ELSEWHERE) for share in shares)
            part = dataclasses.replace(part, late=(part.late[0] - early, part.late[1] + later))
        found.append(part)
    return found


def _share(command: Array, effort: Array, delay: int, other: int) -> float:
    """Return the part of the efforts that repeat a command after `other` samples only."""
    if other < 0:
        return 0.0
    least, first = _least(command), max(delay, other)
    usual, mine = (_repeats(command, effort, x, first, least) for x in (delay, other))
    return float((mine & ~usual).mean())


def _exact(values: Array, errors: Array, sizes: Array) -> float:
    """
    Return the median of values that are known exactly, weighted by `sizes`; nan without any.

    A load at the tip is much for joints near it, which carry little, and little for the others.
    """
    known = np.flatnonzero(errors < _EXACT * np.maximum(1.0, np.abs(values)))
    if not len(known):
        return float('nan')
    order = known[np.argsort(values[known])]
    below = np.cumsum(sizes[order])
    return float(values[order[np.searchsorted(below, 0.5 * below[-1])]])


def _median(values: Array) -> float:
    """Return the median of what is finite; nan if nothing is."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float('nan')


def _same(ratio: float, factor: float) -> bool:
    """Return whether a ratio is 1 within a factor."""
    return 1.0 / factor <= ratio <= factor
