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
The drives: the torque over a window, and what is left of it over delay, lag and rate limit.

For each delay and each of a few lags the torque is computed and what explains it is taken out;
between these lags the rest is interpolated. The smallest rest is compared with all others by
blocks of time: a delay, lag or rate limit is possible whose rest is not clearly larger.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product
from typing import NamedTuple

from ctc_chattering.bags.recording import Indices, Stretch
from ctc_chattering.identification.regression import correlation_length, Data
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import Windows
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
import numpy.typing as npt
from scipy.interpolate import CubicSpline  # type: ignore[import-untyped]

Flags = npt.NDArray[np.bool_]
#: Sources of the torque.
COMMAND, EFFORT = 'command', 'effort'
#: Samples that are computed one by one, all parts of a stretch at once, at least, and parts at
#: most; time before [s], and the fewest samples, after which it does not matter where they began.
_CHUNK, _CHUNKS, _BEFORE, _FEWEST_BEFORE = 400, 1000, 0.5, 60
#: Torques that are computed at once.
_AT_ONCE = 1e6
#: In place of no rate limit [N·m/s].
_UNLIMITED = 1e12


def driven(values: Array, lag: Array, rate: Array | float, period: float) -> Array:
    """
    Return the mean torque over each period of drives with a lag and a rate limit, (..., N, n).

    A command is held for a period h, and the torque follows it with the lag T, by (DM1); without a
    rate limit and with a = exp(-h/T) the mean over a period is c[k] + (T/h) (1 - a) (τ[k] - c[k]),
    and τ[k+1] = a τ[k] + (1 - a) c[k].

    Parameters
    ----------
    values : ndarray, shape (N, n)
        Commands c [N·m]; nan counts as 0.
    lag : ndarray, shape (..., n)
        T [s]; several are computed at once.
    rate : ndarray, shape (n,), or float
        R [N·m/s], inf for none.
    period : float
        h [s].

    """
    if not lag.any() and not np.isfinite(rate).any():
        return np.broadcast_to(np.nan_to_num(values), (*lag.shape[:-1], *values.shape))
    n = values.shape[1]
    warm = max(_FEWEST_BEFORE, round(_BEFORE / period))
    length = max(_CHUNK, len(values) // _CHUNKS)
    chunks = -(-len(values) // length)
    last = np.repeat(values[-1:], chunks * length - len(values), axis=0)
    padded = np.nan_to_num(
        np.concatenate((np.repeat(values[:1], warm, axis=0), values, last)), copy=False)
    # All chunks at once, each from so long before that the drives have caught up.
    pieces = sliding_window_view(padded, warm + length, axis=0)[::length].transpose(2, 0, 1)
    # Of one shape without gaps, for the speed of the loop.
    full = (*lag.shape[:-1], chunks, n)
    rate = np.broadcast_to(np.minimum(rate, _UNLIMITED), full).copy()
    lag = np.broadcast_to(np.maximum(lag, 1e-9 * period)[..., None, :], full).copy()
    mean = np.empty((*full[:-1], length, n))
    tau = np.broadcast_to(pieces[0], full)
    for k, command in enumerate(pieces):
        gap = command - tau
        ramp = np.minimum(np.maximum(np.abs(gap) / rate - lag, 0.0), period)
        risen = np.copysign(rate * ramp, gap)
        left = gap - risen
        end = left * np.exp((ramp - period) / lag)
        if k >= warm:
            mean[..., k - warm, :] = command - (
                ramp * (gap - 0.5 * risen) + lag * (left - end)) / period
        tau = command - end
    return mean.reshape(*full[:-2], -1, n)[..., :len(values), :]


def driven_by_lags(values: Array, lags: Array, rate: Array, period: float) -> Iterator[Array]:
    """Yield `driven` for each lag of shape (K,) [s], the same of all joints."""
    several = max(1, int(_AT_ONCE / values.size))
    for part in np.split(lags, range(several, len(lags), several)):
        yield from driven(values, np.repeat(part[:, None], len(rate), axis=1), rate, period)


def has(stretch: Stretch, source: str) -> Array | None:
    """Return the torques of a source in a stretch, shape (N, n); None without."""
    return stretch.command if source == COMMAND else stretch.effort


def complete(values: Array, centres: Indices, before: int, after: int) -> Flags:
    """Return at which centres values, (N, n), are known from so many samples before to after."""
    low, high = (np.clip(centres + x, 0, len(values) - 1) for x in (-before - 1, after))
    # Joint by joint, for long series.
    gone = (np.cumsum(~np.isfinite(x)) for x in values.T)
    return np.stack([x[low] == x[high] for x in gone], axis=1)


def weak_torque(values: Array, delay: float, lag: Array, period: float, phi: TestFunction,
                centres: Indices, rate: Array | float = np.inf) -> Array:
    """
    Return ∫ φ tau dt over each window, shape (J, n) [N·m].

    Parameters
    ----------
    values : ndarray, shape (N, n)
        Torque of each sample [N·m]; nan counts as 0.
    delay : float
        Samples after which a torque acts: over the period from sample k + `delay` on. An effort
        that shows the torque of the period before has -1, one at the instant between both -0.5.
    lag : ndarray, shape (n,)
        T [s].
    period : float
        h [s].
    phi, centres
        Test function, and samples at the centres of the windows.
    rate : ndarray, shape (n,)
        R [N·m/s], inf for none.

    """
    n, whole = values.shape[1], int(np.floor(delay))
    lag, rate, found = np.broadcast_to(lag, n), np.broadcast_to(rate, n), []
    for i in range(n):  # One by one, for long series.
        one = slice(i, i + 1)
        filtered = driven(values[:, one], lag[one], rate[one], period)
        found.append(phi.sums(filtered, phi.over, centres - whole))
        if delay != whole:
            found[-1] = 0.5 * (found[-1] + phi.sums(filtered, phi.over, centres - whole - 1))
    return np.concatenate(found, axis=1)


Short = npt.NDArray[np.float32]
#: Lags for which torques are computed, and those between them that are compared [s].
LAGS = (0.0, *(0.0003 * 1.5 ** k for k in range(13)))
_GRID = LAGS[-1] * np.linspace(0.0, 1.0, 1000) ** 2
#: Weights of the former for each of the latter.
_SPLINE = CubicSpline(LAGS, np.eye(len(LAGS)))(_GRID)
#: Blocks of time, at least and at most, and windows of one.
_FEWEST_BLOCKS, _MOST_BLOCKS, _LENGTH = 12, 60, 30
#: Part of the torque that no model is better than; the noise has a floor there.
_FLOOR = 1e-4
#: Difference of sums of squares, over the variance of a residual, that may be chance, and
#: deviations beyond which a point is excluded.
_WORSE, _CLEAR = 2.5, 2.5
#: Delays on both sides of the best one, without a rate limit, that are looked at.
_BELOW, _ABOVE = 5, 3
#: Part of a lag by which a delay that looks like it differs, and by which that is known.
_ALIKE, _NEAR = 0.5, 0.02
#: What a lag costs, as the logarithm of some hundred independent windows.
_PER_LAG = 7.0
#: Coarse rate limits, at most, the first one in fastest changes of the commands (within a period a
#: limit shows beyond these), their ratio, and how many are excluded before no lower one is tried.
_COARSE, _FIRST, _RATIO, _EXCLUDED = 30, 2.0, 2.0 ** 0.3, 4
#: How often rate limits are tried between those that are possible, and how many.
_FINER, _WITHIN = 5, 7


class DriveSet(NamedTuple):
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

    """

    delays: dict[int, Array]
    best: int
    rate: Array


class _Point(NamedTuple):
    """What the best lag of a joint leaves with a delay, a shift and a rate limit."""

    rest: Short
    lag: float
    squares: float


#: A delay, and by how many samples commands are later than the recording has them.
_Place = tuple[int, float]


class DriveProfile:
    """
    The rest of each joint's torque over delay, lag and rate limit.

    Parameters
    ----------
    parts, windows
        Stretches with commands, and their windows.
    data : Data
        All windows.
    unexplained : callable
        Returns what is left of torques, shape (rows, ...), of joint i in its rows [N·m].
    phi : TestFunction
        φ.
    delays : sequence of int
        Delays for which torques are computed [samples], in steps of 1.
    moving : ndarray of bool, shape (n,)
        Joints that have enough windows.
    shifts : sequence of float
        Samples by which commands may be later than the recording has them.
    uneven : bool
        Whether commands stand in wrong places here and there: what that makes of a torque looks
        like a lag, and is taken out.

    """

    def __init__(self, parts: Sequence[Stretch], windows: Sequence[Windows], data: Data,
                 unexplained: Callable[[Array, int], Array], phi: TestFunction,
                 delays: Sequence[int], moving: Flags, shifts: Sequence[float] = (0.0,),
                 uneven: bool = False) -> None:
        self._parts, self._windows, self._phi, self._uneven = parts, windows, phi, uneven
        self._unexplained, self._used, self._delays = unexplained, data.used, list(delays)
        self._known = np.concatenate([
            complete(np.asarray(has(part, COMMAND)), mine.centres, phi.half + self._delays[-1],
                     phi.half - self._delays[0]) for part, mine in zip(parts, windows)])
        self._n, self._joints = len(moving), [int(i) for i in np.flatnonzero(moving)]
        count = len(self._used)
        edges = np.linspace(0, count, int(np.clip(
            count // _LENGTH, _FEWEST_BLOCKS, _MOST_BLOCKS)), endpoint=False).astype(int)
        before = np.concatenate((np.zeros((1, self._n), int), np.cumsum(self._used, axis=0)))
        self._blocks = [np.unique(x[x < x_all[-1]]) for x, x_all in zip(before[edges].T, before.T)]
        self._floor = _FLOOR ** 2 * np.square(data.torque * self._used).sum(
            axis=0) / np.maximum(before[-1], 1)
        self._places: list[_Place] = [
            (d, s) for d, s in product(self._delays, shifts) if d >= 0 and all(
                self._delays[0] <= d + x <= self._delays[-1] for x in shifts)]
        self._rates: list[Array] = []
        self._points: dict[tuple[int, _Place], list[_Point]] = {
            key: [] for key in product(self._joints, self._places)}
        self._noise, self._allowed = np.ones(self._n), self._places
        self._unlimited = self._add(np.full(self._n, np.inf))
        # Delay with lag by which each joint alone acts [s].
        self._own = {i: min((self._points[i, x][0].squares, phi.period * x[0] + self._points[
            i, x][0].lag) for x in self._places)[1] for i in self._joints}
        best = min(self._places, key=self._cost)[0]
        near = range(best - _BELOW, best + _ABOVE + 1)
        self._places = [x for x in self._places if x[0] in near]
        self._allowed = self._now_allowed()
        # Beside the first and the last one for the sake of shifts.
        kept = [k for k, d in enumerate(self._delays) if d + 1 in near or d - 1 in near]
        self._delays = [self._delays[k] for k in kept]
        self._unlimited = {i: x[kept] for i, x in self._unlimited.items()}

    def _rests(self, rate: Array) -> dict[int, Array]:
        """Return what is left of each joint for rate limits, (delays, lags, rows) [N·m]."""
        whole, first = np.empty((len(LAGS), len(self._delays), *self._known.shape)), 0
        for part, rows in zip(self._parts, self._windows):
            values = np.asarray(has(part, COMMAND))
            mine = slice(first, first := first + len(rows.centres))
            for k, mean in enumerate(driven_by_lags(values, np.array(LAGS), rate, part.period)):
                for j, d in enumerate(self._delays):
                    whole[k, j, mine] = self._phi.sums(
                        mean, self._phi.over, rows.centres - d) - rows.model_torque
        whole *= self._known
        found = {}
        for i in self._joints:
            y = whole[:, :, self._used[:, i], i].swapaxes(0, 1)
            rest = self._unexplained(y.reshape(-1, y.shape[2]).T, i).T.reshape(y.shape)
            if self._uneven and len(rest) > 2:
                # How the torque without a lag bends over the delay, where it fits best.
                k = int(np.clip(np.argmin(np.square(rest[:, 0]).sum(axis=1)), 1, len(rest) - 2))
                bend = np.array([1.0, -2.0, 1.0]) @ rest[k - 1:k + 2, 0]
                along = bend / max(float(np.linalg.norm(bend)), 1e-300)
                rest = rest - (rest @ along)[..., None] * along
            found[i] = rest
        return found

    def _columns(self, rest: Array, place: _Place) -> Array:
        """Return the rest of a joint after delay and shift for each of `LAGS`, (lags, rows)."""
        share, low = np.modf(sum(place) - self._delays[0])
        return np.asarray(rest[int(low)] if not share else (1.0 - share) * rest[int(low)]
                          + share * rest[int(low) + 1])

    def _add(self, rate: Array) -> dict[int, Array]:
        """Add a vector of rate limits, shape (n,) [N·m/s], and return what is left of joints."""
        rests = self._rests(rate)
        self._rates.append(rate)
        for i, place in product(self._joints, self._places):
            columns = self._columns(rests[i], place)
            k = int(np.argmin((_SPLINE @ (columns @ columns.T) * _SPLINE).sum(axis=1)))
            rest = _SPLINE[k] @ columns
            self._points[i, place].append(_Point(
                rest.astype(np.float32), float(_GRID[k]), float(rest @ rest)))
        for i in self._joints:
            best = self._best(i, self._places)
            mean = max(best.squares / len(best.rest), self._floor[i], 1e-300)
            self._noise[i] = mean * correlation_length(best.rest.astype(float))
        self._allowed = self._now_allowed()
        return rests

    def _best(self, i: int, places: Sequence[_Place], which: slice = slice(None)) -> _Point:
        """Return what is best of joint i, of some rate limits."""
        return min((point for place in places for point in self._points[i, place][which]),
                   key=lambda x: x.squares)

    def _cost(self, place: _Place) -> float:
        """Return the sum of squares of all joints over their noise."""
        return float(sum(self._best(i, [place]).squares / self._noise[i] for i in self._joints))

    def _excess(self, i: int, best: Short, other: Short) -> tuple[float, float, float]:
        """Return δ·δ and r0·δ over the noise of joint i, and the variance of the latter."""
        delta = other.astype(float) - best
        along = np.add.reduceat(best * delta, self._blocks[i]) / self._noise[i]
        return float(delta @ delta / self._noise[i]), float(along.sum()), float(along @ along)

    def _now_allowed(self) -> list[_Place]:
        """Return the delays with shifts that are possible."""
        first = min(self._places, key=self._cost)
        found = []
        for place in self._places:
            sums = np.array([self._excess(i, self._best(i, [first]).rest,
                                          self._best(i, [place]).rest) for i in self._joints])
            if deviations(*sums.sum(axis=0).tolist()) <= _CLEAR:
                found.append(place)
        return found

    def _lags(self, i: int, places: Sequence[_Place], levels: Sequence[dict[int, Array]]
              ) -> tuple[float, float, float]:
        """
        Return the lowest, best and highest lag of joint i at some places [s].

        Those that are excluded next to them count as the ends.
        """
        # Without a rate limit, points without one.
        which = slice(None) if len(levels) > 1 else slice(1)
        best, lags = self._best(i, places, which), []
        for place, rests in product(places, levels):
            point, columns = self._best(i, [place], which), self._columns(rests[i], place)
            rest, noise = point.rest.astype(float), self._noise[i]
            along = _SPLINE @ np.add.reduceat(rest * columns, self._blocks[i], axis=1)
            along = (along - np.add.reduceat(rest * rest, self._blocks[i])) / noise
            power = ((_SPLINE @ (columns @ columns.T) * _SPLINE).sum(axis=1)
                     - rest @ rest) / noise - 2.0 * along.sum(axis=1)
            lags += np.flatnonzero(deviations(
                np.maximum(power, 0.0), along.sum(axis=1), np.square(along).sum(axis=1)
                ) <= _CLEAR).tolist()
        lags.append(int(np.searchsorted(_GRID, best.lag)))
        low, high = max(min(lags) - 1, 0), min(max(lags) + 1, len(_GRID) - 1)
        return float(_GRID[low]), best.lag if low else 0.0, float(_GRID[high])

    def _rate(self, i: int, fastest: float) -> tuple[float, float, float]:
        """
        Return the lowest, best and highest rate limit of joint i [N·m/s].

        Those that are excluded next to them count as the ends.
        """
        rates = np.array([rate[i] for rate in self._rates])
        order = np.argsort(rates, kind='stable')
        good = np.flatnonzero([self._rate_possible(i, int(k)) for k in order])
        best = rates[min(range(len(rates)), key=lambda k: self._best(
            i, self._allowed, slice(k, k + 1)).squares)]
        rates = rates[order]
        low = float(rates[good[0] - 1]) if good[0] else 0.0
        if low >= fastest or np.isinf(rates[good[-1]]):
            return min(low, fastest), np.inf, np.inf
        return low, float(best), float(rates[good[-1] + 1])

    def _rate_possible(self, i: int, which: int) -> bool:
        """Return whether a rate limit of joint i may be the true one."""
        best = self._best(i, self._allowed).rest
        return any(deviations(*self._excess(i, best, self._points[i, x][which].rest)) <= _CLEAR
                   for x in self._allowed)

    def _rate_table(self, fastest: Array) -> Array:
        """Return the lowest, best and highest rate limit of each joint, shape (3, n) [N·m/s]."""
        found = np.tile(np.array([[0.0], [np.inf], [np.inf]]), self._n)
        for i in self._joints:
            found[:, i] = self._rate(i, float(fastest[i]))
        return found

    def _search_rates(self, fastest: Array) -> list[Array]:
        """Add rate limits until lower ones are excluded, then between; return the last ones."""
        rate, out = np.where(fastest > 0.0, _FIRST * fastest, np.inf), np.zeros(self._n)
        for _ in range(_COARSE):
            self._add(rate)
            out += [i not in self._joints or not self._rate_possible(i, -1)
                    for i in range(self._n)]
            if (out >= _EXCLUDED).all():
                break
            rate = rate / _RATIO
        rates: list[Array] = []
        for turn in range(_FINER):
            low, _, high = self._rate_table(fastest)
            # Where none shows, once, as the true one may be between coarse ones.
            near = (low > 0.0) & (np.isfinite(high) | (turn == 0))
            if not near.any():
                break
            high = np.where(np.isfinite(high), high, _RATIO * low)
            ratio = np.where(near, high, 1.0) / np.where(near, low, 1.0)
            rates = [np.where(near, low * ratio ** part, np.inf)
                     for part in np.linspace(0.0, 1.0, _WITHIN)]
            for rate in rates:
                self._add(rate)
        return rates

    def found(self, fastest: Array | None = None) -> DriveSet:
        """
        Return the set.

        Parameters
        ----------
        fastest : ndarray, shape (n,), optional
            Fastest changes of the commands [N·m/s]; a rate limit beyond it does not show, and
            without it none is looked for.

        """
        last = [] if fastest is None else self._search_rates(fastest)
        rate = self._rate_table(np.full(self._n, np.nan) if fastest is None else fastest)
        limited = np.isfinite(rate[2]) & (rate[0] > 0.0)
        levels = [self._rests(x) for x in last] if limited.any() else []
        delays, cost = {}, {}
        for delay in sorted({d for d, _ in self._allowed}):
            places = [x for x in self._allowed if x[0] == delay]
            delays[delay] = np.zeros((3, self._n))
            for i in self._joints:
                low, lag, high = self._lags(
                    i, places, levels if limited[i] else [self._unlimited])
                # A delay of this joint alone looks like a lag that is about as long.
                own = self._own[i] - self._phi.period * delay
                if abs(own - lag) < _ALIKE * lag:
                    low, high = min(low, (1.0 - _NEAR) * own), max(high, (1.0 + _NEAR) * own)
                delays[delay][:, i] = low, lag, high
            cost[delay] = _PER_LAG * int((delays[delay][1] > 0.0).sum()) + min(
                map(self._cost, places))
        return DriveSet(delays, min(cost, key=lambda d: cost[d], default=0), rate)


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
