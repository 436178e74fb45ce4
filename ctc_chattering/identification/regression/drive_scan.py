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
What is left of the torque over delay, lag and rate limit of the drives.

For each delay and each of a few lags the torque is computed and what explains it is taken out;
between these lags the rest is interpolated, so that a sum of squares is a product of weights with
a small matrix.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from typing import NamedTuple, Protocol

from ctc_chattering.analysis.recording import Stretch
from ctc_chattering.identification.regression.least_squares import Data
from ctc_chattering.identification.regression.rows import Rows
from ctc_chattering.identification.regression.torque import COMMAND, driven_by_lags, has
from ctc_chattering.identification.regression.weak_form import TestFunction
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.interpolate import CubicSpline  # type: ignore[import-untyped]

#: Blocks of time, at least and at most, and windows of one.
_FEWEST_BLOCKS, _MOST_BLOCKS, _LENGTH = 12, 60, 30
#: Part of the torque that no model is better than; the noise has a floor there.
_FLOOR = 1e-4
#: Difference of sums of squares, over the variance of a residual, that may be chance.
_WORSE = 2.5


@dataclasses.dataclass(frozen=True)
class DriveSet:
    """
    Delays, lags and rate limits that the data allow; n joints.

    Attributes
    ----------
    delays : dict of int to ndarray, shape (3, n)
        Lowest, best and highest lag of each drive for each delay [s].
    best : int
        Most likely delay [samples].
    rate : ndarray, shape (3, n)
        Lowest, best and highest rate limit [N·m/s]; inf where none shows.
    misfit : ndarray, shape (n,)
        Mean square of what is left [(N·m)²].

    """

    delays: dict[int, Array]
    best: int
    rate: Array
    misfit: Array


class Explained(Protocol):
    """What the torques of a joint are compared with."""

    @property
    def data(self) -> Data:
        """Return all windows."""

    @property
    def count(self) -> Array:
        """Return the number of rows of each joint, shape (n,)."""

    def unexplained(self, torque: Array, i: int) -> Array:
        """Return what is left of torques of joint i in its rows, shape (rows, ...) [N·m]."""


class Level(NamedTuple):
    """
    What is left for one vector of rate limits; C columns are delays times lags.

    Attributes
    ----------
    rate : ndarray, shape (n,)
        R [N·m/s].
    rest : list of ndarray, length n, each of shape (rows, C)
        Of the rows of a joint [N·m].
    products : list of ndarray, length n, each of shape (C, C)
        restᵀ rest [(N·m)²].

    """

    rate: Array
    rest: list[Array]
    products: list[Array]


class DriveScan:
    """
    Sums of squares of each joint over delay, lag and rate limit.

    Parameters
    ----------
    parts, rows
        Stretches with commands, and their windows.
    explained : Explained
        What is fitted beside the drives.
    phi : TestFunction
        φ.
    delays : sequence of int
        Delays of the columns [samples], in steps of 1.
    lags : sequence of float
        Lags of the columns [s], rising.
    uneven : bool
        Whether commands stand in wrong places here and there: what that makes of a torque looks
        like a lag, and is taken out.

    Attributes
    ----------
    noise_floor : ndarray, shape (n,)
        Least mean square that is believed [(N·m)²].
    blocks : list of ndarray, length n
        The first row of each block of time, in the rows of a joint.

    """

    def __init__(self, parts: Sequence[Stretch], rows: Sequence[Rows], explained: Explained,
                 phi: TestFunction, delays: Sequence[int], lags: Sequence[float],
                 uneven: bool = False) -> None:
        self._uneven = uneven and len(delays) > 2
        self._parts, self._rows, self._explained, self._phi = parts, rows, explained, phi
        self.delays, self.lags = list(delays), np.array(lags)
        self.period = parts[0].period
        self._used = explained.data.used()
        self._known = [self._finite(part, row) for part, row in zip(parts, rows)]
        windows = len(self._used)
        edges = np.linspace(0, windows, int(np.clip(
            windows // _LENGTH, _FEWEST_BLOCKS, _MOST_BLOCKS)), endpoint=False).astype(int)
        before = np.concatenate((np.zeros((1, self._used.shape[1]), int),
                                 np.cumsum(self._used, axis=0)))
        self.blocks = [np.unique(x[x < x_all[-1]]) if x_all[-1] else x[:0]
                       for x, x_all in zip(before[edges].T, before.T)]
        self._spline = CubicSpline(self.lags, np.eye(len(self.lags)))
        torque = np.where(self._used, explained.data.residual + np.concatenate(
            [row.base for row in rows]), 0.0)
        self.noise_floor = _FLOOR ** 2 * np.square(torque).sum(axis=0) / np.maximum(
            explained.count, 1)

    def _finite(self, part: Stretch, rows: Rows) -> Array:
        """Return which windows have all commands, also with the longest delay."""
        values = has(part, COMMAND)
        assert values is not None
        missing = (~np.isfinite(values)).astype(float)
        found = np.ones((len(rows.centres), values.shape[1]), bool)
        if missing.any():
            ones = np.ones(2 * self._phi.half + 1)
            for delay in self.delays:
                found &= self._phi.sums(missing, ones, rows.centres - delay) == 0.0
        return found

    def level(self, rate: Array) -> Level:
        """Return the products for rate limits, shape (n,) [N·m/s]."""
        n = self._used.shape[1]
        parts = [list(self._torques(part, rows, rate))
                 for part, rows in zip(self._parts, self._rows)]
        known = np.concatenate(self._known)
        columns = [np.concatenate(pieces, axis=1) * known for pieces in zip(*parts)]
        rests = []
        for i in range(n):
            # Delays are the slow index, lags the fast one.
            y = np.stack([x[:, :, i] for x in columns], axis=1).reshape(-1, len(self._used)).T
            rest = self._explained.unexplained(y[self._used[:, i]], i)
            if self._uneven:
                rest = _without(rest, self._curvature(rest))
            rests.append(rest)
        return Level(np.asarray(rate), rests, [x.T @ x for x in rests])

    def _curvature(self, rest: Array) -> Array:
        """Return how the torque without a lag bends over the delay, shape (rows,)."""
        size, k = len(self.lags), max(len(self.delays) // 2, 1)
        found: Array = (rest[:, (k - 1) * size] - 2.0 * rest[:, k * size]
                        + rest[:, (k + 1) * size])
        return found

    def _torques(self, part: Stretch, rows: Rows, rate: Array) -> Iterator[Array]:
        """Yield torque less the model's for each lag, each of shape (delays, J, n) [N·m]."""
        values = has(part, COMMAND)
        assert values is not None
        filled = np.where(np.isfinite(values), values, 0.0)
        for mean in driven_by_lags(filled, self.lags, rate, self.period):
            yield np.stack([self._phi.sums(mean, self._phi.over, rows.centres - delay) - rows.base
                            for delay in self.delays])

    def weights(self, delay: float, lag: Array) -> Array:
        """
        Return the weights of the columns, shape (len(lag), C).

        Parameters
        ----------
        delay : float
            Samples; between two whole ones, commands are those of the one in a part of the time.
        lag : ndarray
            [s].

        """
        spline, size = self._spline(lag), len(self.lags)
        place = delay - self.delays[0]
        low = int(np.floor(place))
        share = place - low
        found = np.zeros((len(lag), len(self.delays) * size))
        found[:, low * size:(low + 1) * size] = (1.0 - share) * spline
        if share:
            found[:, (low + 1) * size:(low + 2) * size] = share * spline
        return found


def _without(x: Array, column: Array) -> Array:
    """Return columns without what another one explains, shape (rows, C)."""
    power = float(column.dot(column))
    found: Array = x - np.outer(column, column @ x / power) if power > 0.0 else x
    return found


def deviations(power: Array | float, along: Array | float, variance: Array | float) -> Array:
    """
    Return how many deviations a point is away from the best one.

    Parameters
    ----------
    power, along : float or ndarray
        δ·δ and r0·δ, over the variance of a residual.
    variance : float or ndarray
        Of r0·δ; it is at least that of independent residuals.

    """
    power = np.asarray(power, float)
    spread = np.sqrt(np.maximum(variance, power))
    # Beyond chance for independent residuals as well, which also leaves rounding out.
    worse = power + 2.0 * along > _WORSE
    return np.where(worse, (power + along) / np.where(spread > 0.0, spread, 1.0), 0.0)
