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
Weighted least squares over all joints at once: friction of each joint, errors of the model.

A column of friction is in the rows of its joint only, one of a model's error in the rows of all.
Rows of a joint are weighted by the inverse variance of its residuals.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from enum import Enum
from typing import NamedTuple

from ctc_chattering.identification.regression.rows import Rows, STRIBECK
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Iterations in which weights follow from residuals.
_ITERATIONS = 3
#: Part of the friction and errors of a joint that its torque is trusted to.
_FLOOR = 1e-4


class TermKind(Enum):
    """What a column of the regression stands for."""

    FORWARDS = 'forwards'
    BACKWARDS = 'backwards'
    VISCOUS = 'viscous'
    STRIBECK = 'stribeck'
    STRIBECK_SLOPE = 'stribeck slope'
    LOAD = 'load'
    LAG_SLOPE = 'lag slope'
    MODEL = 'model'
    SCALE = 'torque scale'
    DEAD_BAND = 'dead band'
    FADING = 'fading torque'


#: Kinds of what a drive makes of a command, those with a column in `Data.bent`.
BENT = (TermKind.DEAD_BAND, TermKind.FADING)


class Term(NamedTuple):
    """
    A column: what it stands for, its joint, and which one of several.

    The joint of an error of the model is -1, and `which` its index; a torque scale of all joints
    has -1 as well, and its coefficient is the part by which torques are larger. `which` of a load
    is 0 for what gears transmit, and 1 for the torque of motors. That of the Stribeck terms is the
    place of the velocity among `STRIBECK`, between two of them as well; the slope is the
    derivative of the column by that, and that of the lag the derivative of the torque by the lag.
    """

    kind: TermKind
    joint: int
    which: float = 0


@dataclasses.dataclass(frozen=True)
class Data:
    """
    All windows of all stretches; J windows, n joints.

    Attributes
    ----------
    t, velocity, way, more, stribeck
        As in `Rows`.
    load : ndarray, shape (J, n)
        Magnitude of the model's torque without friction: what gears transmit [N·m].
    late : ndarray, shape (J, n)
        Derivative of the torque by the lag of the drive; 0 without a lag [N·m/s].
    residual : ndarray, shape (J, n)
        Torque less the model's without friction, 0 where it is not known [N·m].
    starts : tuple of int
        First window of each stretch.
    torque : ndarray, shape (J, n)
        Weak torque, 0 where it is not known [N·m].
    floor : ndarray, shape (n,)
        Least deviation that a torque is trusted to [N·m].
    motor : ndarray, shape (J, n)
        Magnitude of the torque by the model and Coulomb friction: that of motors [N·m].
    bent : ndarray, shape (J, n, 2)
        Weak sgn(tau), and weak tau |tau| [(N·m)²]: what a dead band of the drive takes, and a
        torque constant that falls with the torque.

    """

    t: Array
    velocity: Array
    way: Array
    more: Array
    stribeck: Array
    load: Array
    late: Array
    residual: Array
    starts: tuple[int, ...]
    torque: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    floor: Array = dataclasses.field(default_factory=lambda: np.zeros(1))
    motor: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    bent: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 0, 2)))

    @classmethod
    def of(cls, rows: Sequence[Rows], torques: Sequence[Array],
           late: Sequence[Array] | None = None, bent: Sequence[Array] | None = None) -> Data:
        """
        Return the rows of stretches.

        Parameters
        ----------
        rows : sequence of Rows
            One for each stretch.
        torques : sequence of ndarray, shape (J, n)
            Weak torque, nan where it is not known [N·m].
        late : sequence of ndarray, shape (J, n), optional
            Derivative of the weak torque by the lag [N·m/s].
        bent : sequence of ndarray, shape (J, n, 2), optional
            Weak sgn(tau) and tau |tau|.

        """
        torque = np.concatenate(list(torques))
        columns = {name: np.concatenate([getattr(part, name) for part in rows])
                   for name in ('t', 'velocity', 'way', 'more', 'stribeck', 'base', 'load')}
        known, base = np.isfinite(torque), columns.pop('base')
        columns['way'] = np.where(known, columns['way'], 0.0)
        counts = np.cumsum([0, *(len(part.t) for part in rows)])
        slope = np.zeros_like(torque) if late is None else np.concatenate(list(late))
        residual = np.where(known, torque - base, 0.0)
        sizes = np.sqrt(np.square(residual * (columns['way'] != 0.0)).sum(axis=0)
                        / np.maximum((columns['way'] != 0.0).sum(axis=0), 1))
        slope = np.where(known & np.isfinite(slope), slope, 0.0)
        return cls(**columns, late=slope, residual=residual, starts=tuple(counts[:-1].tolist()),
                   torque=np.where(known, torque, 0.0), floor=_FLOOR * sizes,
                   bent=np.zeros((*torque.shape, 2)) if bent is None else np.where(
                       known[:, :, None], np.concatenate(list(bent)), 0.0))

    def loaded(self, levels: Array) -> Data:
        """
        Return it with the load of motors that also overcome Coulomb friction, shape (n,) [N·m].

        It is the model's: a measured torque would explain itself.
        """
        base = self.torque - self.residual
        return dataclasses.replace(self, motor=np.abs(base + self.way * levels))

    def mixed(self, mixing: Array) -> Data:
        """Return it with combinations of the errors' columns, mixing of shape (m, k)."""
        return dataclasses.replace(self, more=self.more @ mixing)

    def columns(self, terms: Sequence[Term]) -> Array:
        """Return the design, shape (J, n, terms); 0 in rows that are not used."""
        found = np.zeros((*self.way.shape, len(terms)))
        for k, (kind, i, which) in enumerate(terms):
            if kind == TermKind.MODEL:
                found[:, :, k] = self.more[:, :, int(which)] * (self.way != 0.0)
            elif kind == TermKind.SCALE:
                mine = slice(None) if i < 0 else slice(i, i + 1)
                found[:, mine, k] = -self.torque[:, mine] * (self.way[:, mine] != 0.0)
            elif kind in BENT:
                found[:, i, k] = self.bent[:, i, BENT.index(kind)] * (self.way[:, i] != 0.0)
            elif kind in (TermKind.STRIBECK, TermKind.STRIBECK_SLOPE):
                weights = interpolation(which, kind == TermKind.STRIBECK_SLOPE)
                found[:, i, k] = self.stribeck[:, i] @ weights * (self.way[:, i] != 0.0)
            elif kind == TermKind.LOAD:
                found[:, i, k] = self.way[:, i] * (self.motor if which else self.load)[:, i]
            elif kind == TermKind.LAG_SLOPE:
                found[:, i, k] = self.late[:, i] * (self.way[:, i] != 0.0)
            elif kind == TermKind.VISCOUS:
                found[:, i, k] = self.velocity[:, i] * (self.way[:, i] != 0.0)
            else:
                sign = 1.0 if kind == TermKind.FORWARDS else -1.0
                found[:, i, k] = np.where(self.way[:, i] == sign, sign, 0.0)
        return found

    def used(self) -> Array:
        """Return which rows are used, shape (J, n)."""
        found: Array = self.way != 0.0
        return found


class Fit(NamedTuple):
    """
    A solution.

    Attributes
    ----------
    terms : tuple of Term
        Columns.
    value : ndarray, shape (terms,)
        Their coefficients.
    weight : ndarray, shape (n,)
        Of the rows of each joint [1/(N·m)²].
    residual : ndarray, shape (J, n)
        What is left, 0 in rows that are not used [N·m].
    design : ndarray, shape (J, n, terms)
        The columns.

    """

    terms: tuple[Term, ...]
    value: Array
    weight: Array
    residual: Array
    design: Array

    def of(self, term: Term) -> float:
        """Return the coefficient of a term, 0 if it is none of the fit."""
        return float(self.value[self.terms.index(term)]) if term in self.terms else 0.0

    def scores(self) -> Array:
        """Return Xᵀ W r of each window, r what is left, shape (J, p)."""
        found: Array = np.einsum('jip,ji->jp', self.design, self.weight * self.residual)
        return found

    def normal(self) -> Array:
        """Return Xᵀ W X of all windows, shape (p, p)."""
        found: Array = sum((weight * self.design[:, i].T @ self.design[:, i]
                            for i, weight in enumerate(self.weight)), np.zeros(()))
        return found


def solve(data: Data, terms: Sequence[Term]) -> Fit:
    """Return the weighted least-squares fit of these columns, which must be independent."""
    design, used = data.columns(terms), data.used()
    y = data.residual * used
    counts = np.maximum(used.sum(axis=0), 1.0)
    scale = np.square(y).sum(axis=0) / counts
    weight = 1.0 / np.where(scale > 0.0, scale, 1.0)
    value = np.zeros(len(terms))
    residual = y
    joints = design.transpose(1, 0, 2)
    normals, rights = (np.array([x.T @ z for x, z in zip(joints, others)])
                       for others in (joints, y.T))
    for _ in range(_ITERATIONS):
        value = solved(np.tensordot(weight, normals, 1), weight @ rights)
        residual = y - design @ value
        scale = np.square(residual).sum(axis=0) / counts + np.square(data.floor)
        weight = 1.0 / np.where(scale > 0.0, scale, np.inf)
        weight = np.where(weight > 0.0, weight, 1.0)
    return Fit(tuple(terms), value, weight, residual, design)


def solved(normal: Array, right: Array) -> Array:
    """Return the solution of normal equations, their columns scaled to the same length."""
    length = np.sqrt(np.where(normal.diagonal() > 0.0, normal.diagonal(), 1.0))
    found: Array = np.linalg.lstsq(
        normal / np.outer(length, length), right / length, rcond=1e-13)[0] / length
    return found


def inverted(normal: Array) -> Array:
    """Return the inverse of a normal matrix, its columns scaled to the same length."""
    length = np.sqrt(np.where(normal.diagonal() > 0.0, normal.diagonal(), 1.0))
    found: Array = np.linalg.pinv(normal / np.outer(length, length), 1e-13, True) / np.outer(
        length, length)
    return found


def stribeck_velocity(which: float) -> float:
    """Return the velocity at a place among `STRIBECK` [rad/s]."""
    ratio = STRIBECK[1] / STRIBECK[0]
    return float(STRIBECK[0] * ratio ** which)


def interpolation(which: float, slope: bool = False) -> Array:
    """Return the weights of the Stribeck columns, by the quintic of six, or those of its slope."""
    count = len(STRIBECK)
    first = int(np.clip(np.floor(which) - 2, 0, count - 6))
    nodes = np.arange(first, first + 6)
    powers = np.linalg.inv(np.vander(nodes - which, 6, increasing=True))
    found = np.zeros(count)
    # Of the quintic in (place - which): its value there, or its slope.
    found[nodes] = powers[1 if slope else 0]
    return found
