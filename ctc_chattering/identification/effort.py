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
A torque signal compared with the model, joint by joint, and with the order of the joints.

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
from ctc_chattering.identification.least_squares import correlation_length, scaled
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import Rows
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import vector
import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment  # type: ignore[import-untyped]

#: Fewest and most windows of a joint that are used.
_FEWEST, _MOST = 30, 4000
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
    weight, inertia : ndarray, shape (n,)
        Part of the model's weight, and of its inertial torque.
    weight_error, inertia_error : ndarray, shape (n,)
        Their standard errors.
    friction, friction_error : ndarray, shape (n,)
        Coulomb friction and viscous friction at the RMS velocity, and its standard error [N·m].
    size, load : ndarray, shape (n,)
        RMS of the torque, and of the model's weight [N·m].

    """

    weight: Array
    inertia: Array
    weight_error: Array
    inertia_error: Array
    friction: Array
    friction_error: Array
    size: Array
    load: Array


@dataclasses.dataclass(frozen=True)
class TorqueWindows:
    """
    What may explain a torque in J windows of n joints.

    Attributes
    ----------
    way, weight, inertia, velocity : ndarray, shape (J, n)
        Direction of sliding, parts of the model's torque [N·m], and velocity [rad/s].

    """

    way: Array
    weight: Array
    inertia: Array
    velocity: Array

    @classmethod
    def of(cls, rows: Sequence[Rows]) -> TorqueWindows:
        """Return those of stretches."""
        way, base, weight, velocity = (
            np.concatenate([getattr(part, name) for part in rows])
            for name in ('way', 'base', 'gravity', 'velocity'))
        return cls(way, weight, base - weight, velocity)

    def shape(self, torque: Array) -> TorqueShape:
        """Return what explains a torque, by windows and joints [N·m], nan where unknown."""
        found = np.full((len(TorqueShape._fields), torque.shape[1]), np.nan)
        for i, y in enumerate(torque.T):
            x, y = self._columns(i, y)
            if len(y) < _FEWEST:
                continue
            value, rest, errors = _solved(x, y)
            if rest.dot(rest) > _UNEXPLAINED * np.square(y - y.mean()).sum():
                continue
            speed = float(np.sqrt(np.square(x[:, 3]).mean()))
            found[:, i] = (value[0], value[1], errors[0], errors[1], value[2] + value[3] * speed,
                           np.hypot(errors[2], errors[3] * speed), np.sqrt(np.square(y).mean()),
                           np.sqrt(np.square(x[:, 0]).mean()))
        return TorqueShape(*found)

    def check_order(self, torque: Array, joints: Sequence[str]) -> None:
        """Raise `CtcError` if the columns of a torque fit other joints better."""
        moving = [i for i in range(len(joints))
                  if len(self._columns(i, torque[:, i])[1]) >= _FEWEST
                  and np.nanstd(torque[:, i]) > 0.0]
        left = np.array([[self._left(i, torque[:, column]) for i in moving]
                         for column in moving])
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

    def _columns(self, i: int, y: Array) -> tuple[Array, Array]:
        """Return the columns of joint i, shape (rows, 5), and y where it slides and y is known."""
        used = np.flatnonzero((self.way[:, i] != 0.0) & np.isfinite(y))
        used = used[::len(used) // _MOST + 1]
        return np.column_stack([
            self.weight[used, i], self.inertia[used, i], self.way[used, i],
            self.velocity[used, i], np.ones(len(used))]), y[used]

    def _left(self, i: int, y: Array) -> float:
        """Return which part of the variance of y the columns of joint i leave."""
        x, y = self._columns(i, y)
        whole = float(np.square(y - y.mean()).sum()) if len(y) else 0.0
        if len(y) < _FEWEST or whole <= 0.0:
            return 1.0
        _, rest, _ = _solved(x, y)
        return max(_ALL, float(rest.dot(rest)) / whole)


def _solved(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return coefficients, residuals and standard errors; an error is inf where none is told."""
    present = np.linalg.norm(x, axis=0) > np.array([_NOTHING, _NOTHING, 0.0, 0.0, 0.0]) * (
        np.linalg.norm(y))
    x, scale = scaled(x * present)
    u, s, vt = np.linalg.svd(x, full_matrices=False)
    kept = s > 1e-6 * s[0]
    value = vt[kept].T @ ((u[:, kept].T @ y) / s[kept])
    rest = y - x @ value
    variance = float(rest.dot(rest)) / len(y) * max(1.0, correlation_length(rest))
    errors = np.sqrt(variance * np.square(vt[kept].T / s[kept]).sum(axis=1))
    # What a direction without data contains is not told.
    told = present & (np.square(vt[~kept]).sum(axis=0) < 1e-6)
    return value / scale, rest, np.where(told, errors / scale, np.inf)


def weak_torques(parts: Sequence[Stretch], rows: Sequence[Rows], phi: TestFunction, source: str
                 ) -> Array | None:
    """Return a signal over all windows, shape (J, n) [N·m], nan for unknown; None without it."""
    found = []
    for part, mine in zip(parts, rows):
        values = has(part, source)
        found.append(np.full_like(mine.base, np.nan) if values is None
                     else phi.sums(values, phi.over, mine.centres))
    torque = np.concatenate(found)
    return torque if np.isfinite(torque).any() else None


#: Sides of a measured effort.
MOTOR, LINK, CURRENT = 'motor', 'link', 'current'
#: Friction of an effort behind the gear, as a part of that of the commands.
_BEHIND_GEAR = 0.5
#: Least ratio of the frictions of two signals that both show all of it.
_SAME_FRICTION = 0.8
#: Friction is told by this many standard errors, and this part of the torque.
_CLEAR, _SOME = 5.0, 0.005
#: Factors between effort and command, and between a torque and the model, of another unit.
_OTHER_UNIT, _OTHER_UNIT_THAN_MODEL = 1.5, 2.0
#: Standard error of a part of weight or inertial torque that is exact.
_EXACT = 0.06
#: Difference of an echo, as a part of the largest command; samples of delay; part that is equal.
_EQUAL, _DELAYS, _MOSTLY = 1e-5, 20, 0.9
#: Part that is equal after another delay, above which commands are in wrong places.
_ELSEWHERE = 0.005


class TorqueSides(NamedTuple):
    """
    Which signal is used, and why.

    Attributes
    ----------
    source : {'', 'command', 'effort'}
        The signal to use; empty for the one that explains more.
    findings : tuple of Finding

    """

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
        If commands are in another order than `joints`, have no weight or another unit, or if
        there are none and the effort is not declared as that of the motor.

    """
    windows = TorqueWindows.of(rows)
    command, effort = (weak_torques(parts, rows, phi, kind) for kind in (COMMAND, EFFORT))
    theirs = None
    if command is not None and source != EFFORT:
        windows.check_order(command, joints)
        theirs = windows.shape(command)
        check_commands(theirs)
    if effort is None:
        return TorqueSides(source)
    if theirs is not None:
        delay = _echo(parts)
        if delay is not None:
            return TorqueSides(source, (Finding(
                Kind.NOTE, ALL_JOINTS, 'the effort is the command, '
                f'{delay} samples later: it is not measured, but it has stamps'),))
    if theirs is not None:
        return _of_both(declared, windows.shape(effort), theirs, source)
    if declared != MOTOR:
        raise CtcError(
            'torques would be those of the effort: if it is the torque of the motors, in N*m at '
            'the joint, give --effort motor; if it is a current, --effort current '
            '--torque-constant K1,K2,... with N*m at the joint per ampere; behind the gear it '
            'shows no friction: record the commanded torques, too')
    return TorqueSides(source)


def check_commands(shape: TorqueShape) -> None:
    """Raise `CtcError` if commands have no weight, or are no torques."""
    weight = _exact(shape.weight, shape.weight_error, shape.load)
    if not np.isfinite(weight) or _same(weight, _OTHER_UNIT_THAN_MODEL):
        return
    inertia = _exact(shape.inertia, shape.inertia_error, shape.size)
    raise CtcError(
        f'the commands have {weight:.2f} of the weight that the model has, and {inertia:.2f} of '
        'its inertial torque: if this is 1, the robot compensates its weight itself; give '
        '--gravity 0; else they are no torques in N*m, or the model is another robot')


def _of_both(declared: str, effort: TorqueShape, command: TorqueShape, source: str
             ) -> TorqueSides:
    """Return what follows from effort and commands: only an effort like these may be taken."""
    clear = command.friction > np.maximum(
        _CLEAR * command.friction_error, _SOME * command.size)
    part = _median(np.where(clear, effort.friction / command.friction, np.nan))
    exact = effort.weight_error < _EXACT * np.maximum(1.0, np.abs(effort.weight))
    weight = _median(np.where(exact, effort.weight / command.weight, np.nan))
    other_unit = np.isfinite(weight) and not _same(weight, _OTHER_UNIT)
    if declared not in (LINK, CURRENT) and _same(part, 1.0 / _SAME_FRICTION) and not other_unit:
        return TorqueSides(source)
    doubt = declared == MOTOR and (abs(part) < _BEHIND_GEAR or other_unit)
    return TorqueSides(COMMAND, (Finding(
        Kind.DOUBT if doubt else Kind.NOTE, ALL_JOINTS,
        f'the effort shows {part:.2f} of the friction of the commands, and {weight:.2f} of their '
        'weight (nan: not known); friction is taken from these', '' if declared and not doubt else
        '--effort says what it is: of the motor, the link, or a current'),))


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
