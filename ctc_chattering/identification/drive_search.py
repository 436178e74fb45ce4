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

from ctc_chattering.bags.recording import Stretch
from ctc_chattering.identification.drive_torque import COMMAND, driven_by_lags, has
from ctc_chattering.identification.least_squares import correlation_length, Data
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import Rows
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt
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


#: Deviations beyond which a lag or a rate limit, and a delay, is excluded.
_CLEAR, _CLEAR_DELAY = 2.5, 2.5
#: Lags of a search.
_FINE = 160
#: What a lag costs, as the logarithm of some hundred independent windows.
_PER_LAG = 7.0
#: Ratio of the first rate limits, how many are excluded before no lower one is tried, and steps
#: of the search beside the best ones of how many delays.
_RATIO, _EXCLUDED = 2.0 ** 0.5, 3
_STEPS = ((2.0 ** 0.125, 3), (2.0 ** 0.03125, 2))
#: Rate limits among those that are possible.
_WITHIN = 7
#: Coarse rate limits, at most, and the first one, in fastest changes of the commands: within a
#: period a limit shows beyond these.
_COARSE, _FIRST = 20, 2.0

Flags = npt.NDArray[np.bool_]
Short = npt.NDArray[np.float32]


@dataclasses.dataclass(frozen=True)
class _Point:
    """The best lag of a joint with a delay, a shift and a rate limit, and what it leaves."""

    rest: Short
    lag: float

    @property
    def squares(self) -> float:
        """Return the sum of squares [(N·m)²]."""
        return float(np.square(self.rest, dtype=float).sum())


class DriveSearch:
    """
    The search for what the data allow.

    Parameters
    ----------
    scan : DriveScan
        What is left.
    moving : ndarray of bool, shape (n,)
        Joints that have enough windows.
    shifts : sequence of float
        Samples by which commands may be later than the recording has them.

    """

    def __init__(self, scan: DriveScan, moving: Flags, shifts: Sequence[float]) -> None:
        self._scan, self._n = scan, len(moving)
        self._shifts = list(shifts)
        self._joints: list[int] = np.flatnonzero(moving).tolist()
        self._rates: list[Array] = []
        last = scan.delays[-1]
        self._delays = [d for d in scan.delays if d >= 0 and all(
            scan.delays[0] <= d + s <= last for s in self._shifts)]
        self._coarse = float(scan.lags[-1]) * np.linspace(0.0, 1.0, _FINE) ** 2
        self._tried: dict[tuple[int, int, float], list[_Point]] = {
            (i, d, s): [] for i in self._joints for d in self._delays for s in self._shifts}
        self._noise: dict[int, float] = {}
        self._allowed: list[tuple[int, float]] = []
        self._unlimited = self._add(np.full(self._n, np.inf))

    def _add(self, rate: Array) -> Level:
        """Add a vector of rate limits, shape (n,) [N·m/s]."""
        level = self._scan.level(rate)
        self._rates.append(level.rate)
        for (i, delay, shift), points in self._tried.items():
            points.append(self._best_lag(level, i, delay + shift))
        for i in self._joints:
            best = min((self._best(i, d, s) for d in self._delays for s in self._shifts),
                       key=lambda p: p.squares)
            mean = max(best.squares / len(best.rest), self._scan.noise_floor[i], 1e-300)
            self._noise[i] = mean * correlation_length(best.rest.astype(float))
        self._allowed = self._now_allowed()
        return level

    def _best_lag(self, level: Level, i: int, delay: float) -> _Point:
        """Return the best lag of joint i with a delay."""
        lags = self._coarse
        for _ in range(2):
            weights = self._scan.weights(delay, lags)
            k = int(np.argmin(np.einsum('tc,cd,td->t', weights, level.products[i], weights)))
            lag = float(lags[k])
            lags = np.linspace(lags[max(k - 1, 0)], lags[min(k + 1, len(lags) - 1)], 40)
        return _Point((level.rest[i] @ weights[k]).astype(np.float32), lag)

    def _best(self, i: int, delay: int, shift: float) -> _Point:
        """Return the best rate limit and lag of joint i."""
        return min(self._tried[i, delay, shift], key=lambda p: p.squares)

    def _excess(self, i: int, best: Short, other: Short) -> tuple[float, float, Array]:
        """Return δ·δ, r0·δ and the latter in blocks, over the noise of joint i."""
        delta = other.astype(float) - best
        product = best * delta
        noise = self._noise[i]
        return (float(delta.dot(delta)) / noise, float(product.sum()) / noise,
                np.add.reduceat(product, self._scan.blocks[i]) / noise)

    def _possible(self, i: int, best: Short, other: Short) -> bool:
        """Return whether a point of joint i may be the true one, given the best one."""
        power, along, blocks = self._excess(i, best, other)
        return bool(deviations(power, along, np.square(blocks).sum()) <= _CLEAR)

    def _now_allowed(self) -> list[tuple[int, float]]:
        """Return the delays with shifts that are possible, the best one first."""
        points = {(d, s): [self._best(i, d, s) for i in self._joints]
                  for d in self._delays for s in self._shifts}
        order = sorted(points, key=lambda at: self._cost(points[at]))
        found = []
        for at in order:
            sums = [self._excess(i, a.rest, b.rest) for i, a, b in zip(
                self._joints, points[order[0]], points[at])]
            power, along = (sum(x[k] for x in sums) for k in range(2))
            variance = sum(float(np.square(blocks).sum()) for _, _, blocks in sums)
            if deviations(power, along, variance) <= _CLEAR_DELAY:
                found.append(at)
        return found

    def _cost(self, points: Sequence[_Point]) -> float:
        """Return the sum of squares of all joints over their noise."""
        return sum(p.squares / self._noise[i] for i, p in zip(self._joints, points))

    def _lags(self, i: int, delay: int, shifts: Sequence[float], levels: Sequence[Level]
              ) -> tuple[float, float, float]:
        """Return the lowest, best and highest lag of joint i with a delay [s]."""
        limited = np.isfinite(levels[-1].rate[i])
        points = [self._best(i, delay, s) if limited else self._tried[i, delay, s][0]
                  for s in shifts]
        best = min(points, key=lambda p: p.squares)
        ends = [best.lag, *(x for shift, point in zip(shifts, points)
                            for level in (levels if limited else levels[:1])
                            for x in self._lag_ends(i, delay + shift, point, level))]
        low = min(ends)
        return low, 0.0 if low == 0.0 else best.lag, max(ends)

    def _lag_ends(self, i: int, delay: float, best: _Point, level: Level) -> list[float]:
        """Return the lowest and the highest possible lag of joint i at a rate limit."""
        rest = best.rest.astype(float)
        blocks = np.add.reduceat(rest[:, None] * level.rest[i], self._scan.blocks[i], axis=0)
        own = np.add.reduceat(np.square(rest), self._scan.blocks[i])
        noise, grid = self._noise[i], self._coarse
        for _ in range(2):
            weights = self._scan.weights(delay, grid)
            along = (weights @ blocks.T - own) / noise
            power = (np.einsum('tc,cd,td->t', weights, level.products[i], weights)
                     - own.sum()) / noise - 2.0 * along.sum(axis=1)
            inside = grid[deviations(np.maximum(power, 0.0), along.sum(axis=1),
                                     np.square(along).sum(axis=1)) <= _CLEAR]
            ends = [float(x) for x in (inside.min(), inside.max())] if len(inside) else [best.lag]
            step = float(np.interp(ends[-1], self._coarse[1:], np.diff(self._coarse)))
            grid = np.linspace(max(ends[0] - 2.0 * step, 0.0), min(
                ends[-1] + 2.0 * step, float(self._coarse[-1])), 2 * _FINE)
        return ends if len(inside) else []

    def _rate_possible(self, i: int, level: int) -> bool:
        """Return whether a rate limit of joint i may be the true one."""
        allowed = self._allowed
        best = min((self._best(i, d, s) for d, s in allowed), key=lambda p: p.squares)
        return any(self._possible(i, best.rest, self._tried[i, d, s][level].rest)
                   for d, s in allowed)

    def search_rates(self, fastest: Array) -> None:
        """
        Try rate limits until lower ones are excluded.

        Parameters
        ----------
        fastest : ndarray, shape (n,)
            Fastest changes of the commands [N·m/s].

        """
        rate = np.where(fastest > 0.0, _FIRST * fastest, np.inf)
        out = np.zeros(self._n)
        for _ in range(_COARSE if self._joints else 0):
            self._add(rate)
            last = len(self._rates) - 1
            out += [i in self._joints and not self._rate_possible(i, last)
                    for i in range(self._n)]
            if (out[self._joints] >= _EXCLUDED).all():
                break
            rate = rate / _RATIO
        for step, several in _STEPS:
            self._refine(step, several)
        low = self._rate_table(fastest)[0]
        for k in (1, 2):  # A lower bound that is nearer.
            self._add(np.where(low > 0.0, low * _RATIO ** (k / 3.0), np.inf))

    def _refine(self, step: float, several: int) -> None:
        """Try rate limits beside the best ones of the most likely delays."""
        costs = {d: min(self._cost([self._best(i, d, s) for i in self._joints])
                        for s in self._shifts) for d in self._delays}
        for delay in sorted(costs, key=lambda d: costs[d])[:several]:
            best = np.full(self._n, np.inf)
            for i in self._joints:
                points = [min((self._tried[i, delay, s][k] for s in self._shifts),
                              key=lambda p: p.squares) for k in range(1, len(self._rates))]
                which = min(range(len(points)), key=lambda k: points[k].squares)
                best[i] = self._rates[1 + which][i]
            for k in (-2, -1, 1, 2):
                self._add(best * step ** k)

    def _rate(self, i: int) -> tuple[float, float, float]:
        """
        Return the lowest, best and highest rate limit of joint i [N·m/s].

        Those that are excluded next to them count as the ends.
        """
        points = [min((self._tried[i, d, s][k] for d, s in self._allowed),
                      key=lambda p: p.squares) for k in range(len(self._rates))]
        rates = np.array([rate[i] for rate in self._rates])
        order = np.argsort(rates, kind='stable')
        good = np.flatnonzero([self._rate_possible(i, int(k)) for k in order])
        best = rates[min(range(len(rates)), key=lambda k: points[k].squares)]
        rates = rates[order]
        low = float(rates[good[0] - 1]) if good[0] else 0.0
        if np.isinf(rates[good[-1]]):
            return low, np.inf, np.inf
        return low, float(best), float(rates[good[-1] + 1])

    def _rate_table(self, fastest: Array | None) -> Array:
        """Return the lowest, best and highest rate limit of each joint, shape (3, n) [N·m/s]."""
        rate = np.tile(np.array([[0.0], [np.inf], [np.inf]]), self._n)
        for i in self._joints if fastest is not None else ():
            rate[:, i] = self._rate(i)
            if fastest is not None and rate[0, i] >= fastest[i]:
                rate[:, i] = fastest[i], np.inf, np.inf
        return rate

    def found(self, fastest: Array | None = None) -> DriveSet:
        """
        Return the set.

        Parameters
        ----------
        fastest : ndarray, shape (n,), optional
            Fastest changes of the commands [N·m/s]; a rate limit beyond it does not show.

        """
        levels = [self._unlimited]
        rate = self._rate_table(fastest)
        if np.isfinite(rate[2]).any():
            low, _, high = rate
            shown = np.isfinite(high) & (low > 0.0)
            levels = [self._add(np.where(
                shown, low * (np.where(shown, high, 1.0) / np.where(shown, low, 1.0)) ** part,
                np.inf))
                      for part in np.linspace(0.0, 1.0, _WITHIN)]
            rate = self._rate_table(fastest)
        delays, cost = {}, {}
        for delay in sorted({d for d, _ in self._allowed}):
            shifts = [s for d, s in self._allowed if d == delay]
            delays[delay] = np.zeros((3, self._n))
            for i in self._joints:
                delays[delay][:, i] = self._lags(i, delay, shifts, levels)
            cost[delay] = _PER_LAG * int((delays[delay][1] > 0.0).sum()) + min(
                self._cost([self._best(i, delay, s) for i in self._joints]) for s in shifts)
        misfit = np.zeros(self._n)
        for i in self._joints:
            rest = min((self._best(i, d, s) for d, s in self._allowed),
                       key=lambda p: p.squares).rest
            misfit[i] = float(np.square(rest, dtype=float).sum()) / len(rest)
        return DriveSet(delays, min(cost, key=lambda d: cost[d], default=0), rate, misfit)
