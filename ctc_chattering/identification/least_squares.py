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
from math import sqrt
from typing import NamedTuple

from ctc_chattering.identification.windows import BUILD_UP, joined, Rows, STRIBECK
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.interpolate import make_interp_spline  # type: ignore[import-untyped]
from scipy.special import stdtrit  # type: ignore[import-untyped]

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


#: Kinds of friction.
FRICTION = (TermKind.FORWARDS, TermKind.BACKWARDS, TermKind.VISCOUS, TermKind.STRIBECK,
            TermKind.LOAD)
#: Weights of the Stribeck columns for a velocity between theirs, and their derivatives.
BETWEEN = make_interp_spline(np.arange(len(STRIBECK)), np.eye(len(STRIBECK)), 5)


class Term(NamedTuple):
    """
    A column: what it stands for, its joint, and which one of several.

    The joint of an error of model or drives is -1, and `which` its index. That of Stribeck
    friction is the index of its velocity among `STRIBECK`, between two of them as well; that of
    the load is 0 for the torque through the gear, and 1 for that of the drive, in which friction
    is. The slope is the derivative of the column by that, and that of the lag the derivative of
    the torque by the lag: both are 0 in a fit, and there for the sake of intervals.
    """

    kind: TermKind
    joint: int
    which: float = 0


@dataclasses.dataclass(frozen=True)
class Data(Rows):
    """
    All windows of all stretches, with their torques; J windows, n joints.

    Attributes
    ----------
    torque, residual : ndarray, shape (J, n)
        Weak torque, and that less the model's without friction, 0 where it is not known [N·m]; the
        direction is 0 there.
    late : ndarray, shape (J, n)
        Derivative of the torque by the lag of the drive; 0 without a lag [N·m/s].
    bent : ndarray, shape (J, n, 2)
        Weak sgn(tau), and weak tau |tau| [(N·m)²]: what a dead band of the drive takes, and a
        torque constant that falls with the torque.
    starts : tuple of int
        First window of each stretch.
    floor : ndarray, shape (n,)
        Least deviation that a torque is trusted to [N·m].

    """

    torque: Array
    residual: Array
    late: Array
    bent: Array
    starts: tuple[int, ...]
    floor: Array

    @classmethod
    def with_torques(cls, rows: Sequence[Rows], torques: Sequence[Array], late: Sequence[Array],
                     bent: Sequence[Array]) -> Data:
        """
        Return the rows of stretches with their torques.

        Parameters
        ----------
        rows : sequence of Rows
            One for each stretch.
        torques : sequence of ndarray, shape (J, n)
            Weak torque, nan where it is not known [N·m].
        late : sequence of ndarray, shape (J, n)
            Derivative of the weak torque by the lag [N·m/s].
        bent : sequence of ndarray, shape (J, n, 2)
            Weak sgn(tau) and tau |tau|.

        """
        whole = {**vars(joined(rows))}
        torque = np.concatenate(list(torques))
        known = np.isfinite(torque)
        whole['way'] = np.where(known, whole['way'], 0.0)
        residual, used = np.where(known, torque - whole['base'], 0.0), whole['way'] != 0.0
        sizes = np.sqrt(np.square(residual * used).sum(axis=0) / np.maximum(used.sum(axis=0), 1))
        first = np.cumsum([0, *(len(part.t) for part in rows)])[:-1]
        return cls(**whole, torque=np.where(known, torque, 0.0), residual=residual,
                   late=np.nan_to_num(np.concatenate(list(late))) * known,
                   bent=np.concatenate(list(bent)) * known[:, :, None],
                   starts=tuple(first.tolist()), floor=_FLOOR * sizes)

    @classmethod
    def at(cls, way: Array, velocity: Array, torque: Array, more: Array) -> Data:
        """
        Return states instead of windows; S states.

        Parameters
        ----------
        way, velocity, torque : ndarray, shape (S, n)
            Direction, velocity [rad/s], and torque of the drives [N·m].
        more : ndarray, shape (S, n, m)
            Torque of each column of the model's errors [N·m].

        """
        zero, load = np.zeros_like(way), np.abs(torque)
        slow = way[:, :, None] * np.exp(-np.square(velocity[:, :, None] / STRIBECK))
        return cls(
            t=zero[:, 0], centres=np.arange(len(way)), way=way, base=zero, gravity=zero, load=load,
            velocity=velocity, position=zero, acceleration=zero, stribeck=slow,
            build_up=np.zeros((*way.shape, len(BUILD_UP))), more=more, torque=torque,
            residual=zero, late=zero, bent=np.stack((np.sign(torque), torque * load), axis=2),
            starts=(0,), floor=np.zeros(way.shape[1]))

    def errors(self, i: int) -> Array:
        """Return the columns of errors of the model, and three of drive i, shape (J, m + 3)."""
        return np.column_stack((self.more[:, i], -self.torque[:, i], self.bent[:, i]))

    def mixed(self, design: Array) -> Data:
        """Return it with combinations of `errors` in place of `more`; design (n, m + 3, k)."""
        return dataclasses.replace(self, more=np.stack(
            [self.errors(i) @ x for i, x in enumerate(design)], axis=1))

    def columns(self, terms: Sequence[Term], i: int) -> Array:
        """Return the columns of joint i, shape (J, terms); 0 in rows that are not used."""
        way, found = self.way[:, i], np.zeros((len(self.way), len(terms)))
        for k, (kind, joint, which) in enumerate(terms):
            if joint not in (i, -1):
                continue
            if kind == TermKind.MODEL:
                column = self.more[:, i, int(which)]
            elif kind in (TermKind.STRIBECK, TermKind.STRIBECK_SLOPE):
                column = self.stribeck[:, i] @ BETWEEN(which, int(kind == TermKind.STRIBECK_SLOPE))
            elif kind == TermKind.LOAD:
                column = way * (np.abs(self.torque) if which else self.load)[:, i]
            elif kind in (TermKind.LAG_SLOPE, TermKind.VISCOUS):
                column = (self.late if kind == TermKind.LAG_SLOPE else self.velocity)[:, i]
            else:
                column = way * (way == (1.0 if kind == TermKind.FORWARDS else -1.0))
            found[:, k] = column * (way != 0.0)
        return found

    def of_joint(self, terms: Sequence[Term], i: int) -> tuple[Array, Array]:
        """Return which windows joint i slides in, shape (J,), and its own columns there."""
        used = self.way[:, i] != 0.0
        return used, self.columns([term for term in terms if term.joint == i], i)[used]

    def used(self) -> Array:
        """Return which rows are used, shape (J, n)."""
        return np.asarray(self.way != 0.0)


class Fit(NamedTuple):
    """
    A solution. The columns are made joint by joint where they are used: all together are large.

    Attributes
    ----------
    data : Data
        The windows, with the columns of the model's errors that the terms are about.
    terms : tuple of Term
        Columns.
    value : ndarray, shape (terms,)
        Their coefficients.
    weight : ndarray, shape (n,)
        Of the rows of each joint [1/(N·m)²].
    residual : ndarray, shape (J, n)
        What is left, 0 in rows that are not used [N·m].

    """

    data: Data
    terms: tuple[Term, ...]
    value: Array
    weight: Array
    residual: Array

    def of(self, term: Term) -> float:
        """Return the coefficient of a term, 0 if it is none of the fit."""
        return float(self.value[self.terms.index(term)]) if term in self.terms else 0.0

    def columns(self, i: int) -> Array:
        """Return the columns of joint i, shape (J, terms)."""
        return self.data.columns(self.terms, i)


def solve(data: Data, terms: Sequence[Term]) -> Fit:
    """Return the weighted least-squares fit of these columns, which must be independent."""
    used, joints = data.used(), range(data.way.shape[1])
    y = data.residual * used
    counts = np.maximum(used.sum(axis=0), 1.0)
    scale = np.square(y).sum(axis=0) / counts
    weight = 1.0 / np.where(scale > 0.0, scale, 1.0)
    normals, rights = map(np.array, zip(*(
        (x.T @ x, x.T @ y[:, i]) for i in joints for x in [data.columns(terms, i)])))
    for _ in range(_ITERATIONS):
        value = inverted(np.tensordot(weight, normals, 1)) @ (weight @ rights)
        residual = y - np.stack([data.columns(terms, i) @ value for i in joints], axis=1)
        scale = np.square(residual).sum(axis=0) / counts + np.square(data.floor)
        weight = 1.0 / np.where(scale > 0.0, scale, np.inf)
        weight = np.where(weight > 0.0, weight, 1.0)
    return Fit(data, tuple(terms), value, weight, residual)


def scaled(columns: Array) -> tuple[Array, Array]:
    """Return columns of length 1, and their lengths; columns of zeros as they are, with 1."""
    length = np.sqrt(np.square(columns).sum(axis=0))
    length = np.where(length > 0.0, length, 1.0)
    return columns / length, length


def orthonormal(columns: Array, least: float = 1e-9) -> Array:
    """Return a basis of what columns of length 1 span but for singular values below `least`."""
    u, s, _ = np.linalg.svd(scaled(columns)[0], full_matrices=False)
    return u[:, s > least * s.max(initial=1.0)]


def without(columns: Array, y: Array, least: float = 1e-9) -> Array:
    """Return what columns leave of y, shape (rows,) or (rows, k)."""
    basis = orthonormal(columns, least)
    return np.asarray(y - basis @ (basis.T @ y))


def coefficients(columns: Array, y: Array) -> Array:
    """Return the coefficients of columns that leave least of y, shape (columns,)."""
    return np.asarray(inverted(columns.T @ columns) @ (columns.T @ y))


def inverted(normal: Array) -> Array:
    """Return the inverse of a normal matrix, its columns scaled to the same length."""
    length = np.sqrt(np.where(normal.diagonal() > 0.0, normal.diagonal(), 1.0))
    sizes = np.outer(length, length)
    return np.asarray(np.linalg.pinv(normal / sizes, 1e-13, True) / sizes)


#: Distances of windows that do not overlap any more, and independent errors that a run has.
_LAGS, _ERRORS = (5, 6, 7, 8), 20.0
#: Blocks of at least so many correlation lengths, and at least so many of them in the data.
_LENGTHS, _FEWEST_BLOCKS = 40.0, 12


@dataclasses.dataclass(frozen=True)
class Spread:
    """
    How far the coefficients of a fit vary.

    Attributes
    ----------
    covariance : ndarray, shape (p, p)
        Of the coefficients.
    factor : float
        Half the interval in standard errors, for as few blocks as there are.

    """

    covariance: Array
    factor: float

    @property
    def error(self) -> Array:
        """Return the standard errors, shape (p,)."""
        return np.sqrt(np.maximum(self.covariance.diagonal(), 0.0))

    def wider(self, off: Array) -> Spread:
        """Return it with intervals that are longer by what coefficients are off, shape (p,)."""
        off = off / self.factor
        return dataclasses.replace(self, covariance=self.covariance + np.outer(off, off))

    def half(self, weights: Array) -> Array:
        """Return half the interval of sums of the coefficients with weights, shape (..., p)."""
        power = (weights @ self.covariance * weights).sum(axis=-1)
        return np.asarray(self.factor * np.sqrt(np.maximum(power, 0.0)))


def correlation_length(x: Array) -> float:
    """
    Return the sum of the autocorrelations of a series, up to where they are noise [samples].

    Parameters
    ----------
    x : ndarray, shape (J,)
        Series; 0 where there is no value.

    """
    count = len(x)
    power = float(x.dot(x))
    if power == 0.0:
        return 1.0
    spectrum = np.fft.rfft(x, 2 * count)
    rho = np.fft.irfft(spectrum * spectrum.conj())[:count] / power
    small = np.flatnonzero(np.abs(rho[1:]) < 2.0 / sqrt(count))
    last = int(small[0]) + 1 if len(small) else count
    return float(max(1.0, 1.0 + 2.0 * rho[1:last].sum()))


def spread(fit: Fit, starts: tuple[int, ...]) -> Spread:
    """
    Return the standard errors of a fit by drawing blocks of windows.

    Parameters
    ----------
    fit : Fit
        Of `solve`.
    starts : tuple of int
        First window of each stretch; no block goes over one.

    """
    scores, normal, lasting = sums_of(fit)
    count, longest = len(scores), max(map(correlation_length, scores.T), default=1.0)
    # A block is long enough for all scores.
    length = int(min(max(_LENGTHS * max(longest, 2.0), count ** (1.0 / 3.0)),
                     max(count // _FEWEST_BLOCKS, 1)))
    before = np.concatenate((np.zeros_like(scores[:1]), np.cumsum(scores, axis=0)))
    first = np.arange(count - length + 1)
    inside = np.all([(first + length <= start) | (first >= start) for start in starts], axis=0)
    first = first[inside] if inside.any() else first
    blocks = max(2, count // length)
    sums = before[first + length] - before[first]
    # Blocks are drawn around their own mean, which takes a share of the variance.
    correction = blocks / (blocks - 1.0)
    inverse = inverted(normal)
    root = (sums - sums.mean(axis=0)) @ inverse
    covariance = correction * blocks * root.T @ root / len(root)
    chance = np.maximum(covariance.diagonal(), 1e-300)
    wider = np.sqrt(np.maximum(1.0, (inverse @ lasting @ inverse).diagonal() / chance))
    return Spread(covariance * np.outer(wider, wider), float(stdtrit(blocks - 1.0, 0.975)))


def sums_of(fit: Fit) -> tuple[Array, Array, Array]:
    """
    Return what intervals come from.

    Returns
    -------
    scores : ndarray, shape (J, p)
        Xᵀ W r of each window, r what is left.
    normal, lasting : ndarray, shape (p, p)
        Xᵀ W X of all windows, and the covariance of the scores that errors beyond an overlap make.

    """
    count, p = len(fit.residual), len(fit.terms)
    scores, normal, lasting = np.zeros((count, p)), np.zeros((p, p)), np.zeros((p, p))
    for i, (y, weight) in enumerate(zip(fit.residual.T, fit.weight)):
        rows = fit.columns(i)
        scores += (weight * y)[:, None] * rows
        square = rows.T @ rows
        normal += weight * square
        used = np.asarray(rows.any(axis=1))
        y, count = np.where(used, y, 0.0), max(int(used.sum()), 1)
        pairs = max(sum(int((used[lag:] & used[:-lag]).sum()) for lag in _LAGS), 1)
        products = sum(float(y[lag:] @ y[:-lag]) for lag in _LAGS)
        chance = 2.0 * float(y @ y) / count / np.sqrt(pairs / 4.0)
        variance = max(0.0, products / pairs - chance)
        lasting += weight ** 2 * variance * count / _ERRORS * square
    return scores, normal, lasting
