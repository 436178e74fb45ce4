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
Search for delay, lag and rate limit of each drive.

`timing.py` asks for the values that recorded commands allow. Delays, lags and rate limits are
scanned, and for each the regression is solved for all else. The sum of squares that remains, over
the variance and the correlation length of a residual, is twice the logarithm of a likelihood.
Values are possible where it is near its minimum.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from functools import cached_property
from typing import NamedTuple

from ctc_chattering.identification.drives import Drive, find_complete, iterate_lags, known_torque
from ctc_chattering.identification.regression import correlation_length, Observations
from ctc_chattering.identification.stretches import Stretch
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import join_windows, Windows
from ctc_chattering.numerics.linear_algebra import Array, Flags
import numpy as np
from scipy.interpolate import CubicSpline  # type: ignore[import-untyped]

#: Lags that are computed [s]. The sum of squares is a smooth function between them.
LAGS = (0.0, *(0.0003 * 1.5 ** k for k in range(13)))
#: Lags that are compared [s].
_LAG_GRID = LAGS[-1] * np.linspace(0.0, 1.0, 600) ** 2
#: Values are possible if twice their log likelihood is within this of the largest.
_MAX_LIKELIHOOD_LOSS = 9.0


class Profile:
    """
    Torque of each joint that remains with all else fitted.

    Only windows in which a joint slides one way count. At a reversal, static friction has a timing
    of its own.

    Parameters
    ----------
    stretches : sequence of Stretch
        Stretches with the torque.
    windows : sequence of Windows
        Windows of each stretch.
    source : str
        `COMMAND` or `EFFORT`.
    phi : TestFunction
        φ.

    """

    def __init__(
            self,
            stretches: Sequence[Stretch],
            windows: Sequence[Windows],
            source: str,
            phi: TestFunction) -> None:
        self.stretches = stretches
        self.windows = windows
        self.source = source
        self.phi = phi
        self.joint_count = stretches[0].q.shape[1]

    @cached_property
    def data(self) -> Observations:
        """All windows, of which those that slide one way are used."""
        torque = self.torque(Drive.ideal(self.joint_count))
        data = Observations.of(join_windows(self.windows), torque)
        slides = np.abs(data.windows.direction) > 1.0 - 1e-9
        return dataclasses.replace(data, used=data.used & slides)

    @cached_property
    def moving(self) -> Flags:
        """Joints with at least 30 windows, shape (n,)."""
        return np.asarray(self.data.used.sum(axis=0) >= 30)

    @cached_property
    def bases(self) -> list[Array]:
        """Orthonormal basis of each joint's model and friction."""
        windows = self.data.windows
        bases = []
        for joint, used in enumerate(self.data.used.T):
            columns = np.column_stack((
                windows.direction[used, joint],
                windows.velocity[used, joint],
                np.ones(int(used.sum())),
                windows.stribeck[used, joint, ::3],
                windows.bodies[used, joint]))
            bases.append(_orthonormal_basis(columns))
        return bases

    def torque(self, drive: Drive) -> Array:
        """Return the weak torque or nan, shape (J, n)."""
        return np.concatenate([
            known_torque(stretch, windows.centres, self.source, self.phi, drive)
            for stretch, windows in zip(self.stretches, self.windows)])

    def squares(self, delay: float) -> Array:
        """Return the sums of squares without a lag, shape (n,) [(N·m)²]."""
        torque = self.torque(Drive.ideal(self.joint_count, delay))
        target = np.nan_to_num(torque - self.data.windows.model_torque)
        sums = []
        for joint, (used, basis) in enumerate(zip(self.data.used.T, self.bases)):
            values = target[used, joint]
            residual = values - basis @ (basis.T @ values)
            sums.append(np.square(residual).sum())
        return np.array(sums)


def _orthonormal_basis(columns: Array) -> Array:
    """Return a basis of the span of columns, without rounding."""
    length = np.sqrt(np.square(columns).sum(axis=0))
    scaled = columns / np.where(length > 0.0, length, 1.0)
    u, s, _ = np.linalg.svd(scaled, full_matrices=False)
    return u[:, s > 1e-7 * s.max(initial=1.0)]


def unlimited_rates(n: int) -> Array:
    """Return the rate limits of unknown drives, shape (3, n) [N·m/s]."""
    return np.tile(np.array([[0.0], [np.inf], [np.inf]]), n)


class _Scan(NamedTuple):
    """
    Remaining torque for one rate limit of each joint.

    Attributes
    ----------
    squares : ndarray, shape (n, delays, lags)
        [(N·m)²], inf where nothing is computed, 0 for a joint that rests.
    residuals : list of ndarray, shape (rows,)
        Residual at the best delay and lag of each joint in motion [N·m].

    """

    squares: Array
    residuals: list[Array]


class DriveSearch:
    """
    Sums of squares over delay, lag and rate limit.

    Parameters
    ----------
    profile : Profile
        Torque of the commands.

    """

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._joints = np.flatnonzero(profile.moving).tolist()
        # Delays of up to 20 samples, or 50 ms, are scanned without a rate limit.
        longest_delay = min(20, int(0.05 / profile.phi.period))
        self._delays = list(range(longest_delay + 1))
        self._lag_count = len(LAGS)
        is_known = self._find_known()
        self._rows = [used & is_known for used in profile.data.used.T]
        unlimited = np.full(profile.joint_count, np.inf)
        scan = self._scan(unlimited)
        self._noise = self._estimate_noise(scan.squares, scan.residuals)
        # With a rate limit, the best delay is near the best one without.
        best = int(np.argmin(self._cost(scan.squares)))
        near = slice(max(best - 5, 0), best + 4)
        self._delays = self._delays[near]
        # Least sum of squares of all rate limits, shape (n, delays, lags).
        self._least = scan.squares[:, near]
        self._rates = [unlimited]
        # Least sum of squares of all lags for each of these, shape (n, delays).
        self._by_rate = [self._least.min(axis=2)]
        # With a rate limit drives have no longer lags than they seem to have without.
        longest_lag = max((lags[2].max() for lags in self.delays().values()), default=LAGS[-1])
        self._lag_count = max(5, int(np.searchsorted(LAGS, longest_lag)) + 1)

    def _find_known(self) -> Flags:
        """Flag the windows with commands at all delays, shape (J,)."""
        profile, half = self._profile, self._profile.phi.half
        flags = []
        for stretch, windows in zip(profile.stretches, profile.windows):
            values = np.asarray(stretch.command)
            is_complete = find_complete(values, windows.centres, half + self._delays[-1], half)
            flags.append(is_complete.all(axis=1))
        return np.concatenate(flags)

    def _scan(self, rate: Array) -> _Scan:
        """Return what remains for rate limits, shape (n,) [N·m/s]."""
        profile = self._profile
        lags = np.array(LAGS[:self._lag_count])
        grid = _LAG_GRID[lags[-1] >= _LAG_GRID]
        spline = CubicSpline(lags, np.eye(len(lags)))(grid)
        torque = self._torques(lags, rate)
        torque -= profile.data.windows.model_torque
        shape = (profile.joint_count, len(self._delays), len(_LAG_GRID))
        squares = np.full(shape, np.inf)
        squares[~profile.moving] = 0.0
        residuals = []
        for joint in self._joints:
            rows = self._rows[joint]
            target = torque[:, :, rows, joint].reshape(-1, int(rows.sum()))
            basis = profile.bases[joint][rows[profile.data.used[:, joint]]]
            residual = target - (target @ basis) @ np.linalg.pinv(basis)
            residual = residual.reshape(len(lags), len(self._delays), -1)
            for j in range(len(self._delays)):
                gram = residual[:, j] @ residual[:, j].T
                sums = ((spline @ gram) * spline).sum(axis=1)
                squares[joint, j, :len(grid)] = np.maximum(sums, 0.0)
            delay, lag = np.unravel_index(np.argmin(squares[joint]), shape[1:])
            residuals.append(spline[lag] @ residual[:, delay])
        return _Scan(squares, residuals)

    def _torques(self, lags: Array, rate: Array) -> Array:
        """Return the weak torques, shape (lags, delays, J, n) [N·m]."""
        profile, phi = self._profile, self._profile.phi
        torque = np.empty((len(lags), len(self._delays), *profile.data.torque.shape))
        end = 0
        for stretch, windows in zip(profile.stretches, profile.windows):
            rows = slice(end, end := end + len(windows.centres))
            values = np.asarray(stretch.command)
            for k, mean in enumerate(iterate_lags(values, lags, rate, stretch.period)):
                for j, delay in enumerate(self._delays):
                    torque[k, j, rows] = phi.sums(mean, phi.over, windows.centres - delay)
        return torque

    def _estimate_noise(self, squares: Array, residuals: list[Array]) -> Array:
        """Return variance times correlation length of the residual, shape (n,) [(N·m)²]."""
        noise = np.ones(len(squares))
        for joint, residual in zip(self._joints, residuals):
            rows = self._rows[joint]
            torque = self._profile.data.torque[rows, joint]
            floor = 1e-8 * float(np.square(torque).mean())
            series = np.zeros(len(rows))
            series[rows] = residual
            variance = float(squares[joint].min()) / len(residual)
            noise[joint] = max(variance, floor, 1e-300) * correlation_length(series)
        return noise

    def _cost(self, squares: Array) -> Array:
        """Return the sum for each delay, in units of the noise."""
        best = squares[self._joints].min(axis=2)
        return np.asarray((best / self._noise[self._joints, None]).sum(axis=0))

    def _add(self, rate: Array) -> None:
        """Add rate limits, shape (n,) [N·m/s]."""
        scan = self._scan(rate)
        self._rates.append(rate)
        self._by_rate.append(scan.squares.min(axis=2))
        self._least = np.minimum(self._least, scan.squares)
        noise = self._estimate_noise(self._least, scan.residuals)
        self._noise = np.minimum(self._noise, noise)

    @property
    def _possible_delays(self) -> Flags:
        """Delays that are possible, shape (delays,)."""
        cost = self._cost(self._least)
        return np.asarray(cost - cost.min() < _MAX_LIKELIHOOD_LOSS)

    @property
    def _rate_squares(self) -> Array:
        """Least sums of squares by rate limit, shape (rates, n) [(N·m)²]."""
        squares = np.array(self._by_rate)[:, :, self._possible_delays]
        return np.asarray(squares.min(axis=2))

    def _possible_rates(self) -> Flags:
        """Flag the rate limits that are possible, shape (rates, n)."""
        loss = self._rate_squares - self._rate_squares.min(axis=0)
        return np.asarray(loss < _MAX_LIKELIHOOD_LOSS * self._noise)

    @cached_property
    def _fastest(self) -> Array:
        """Fastest change of the commands of each joint, shape (n,) [N·m/s]."""
        changes = []
        for stretch in self._profile.stretches:
            # Joint by joint, for long series.
            steps = [np.nan_to_num(np.abs(np.diff(column))).max()
                     for column in np.asarray(stretch.command).T]
            changes.append([step / stretch.period for step in steps])
        return np.asarray(np.max(changes, axis=0))

    def try_rates(self) -> None:
        """Add rate limits, downwards from twice the fastest change."""
        fastest = self._fastest
        rate = np.where(fastest > 0.0, 2.0 * fastest, np.inf)
        excluded_count = np.zeros(len(fastest))
        for _ in range(30):
            self._add(rate)
            excluded_count += ~self._possible_rates()[-1] | ~self._profile.moving
            if (excluded_count >= 2).all():
                break
            rate = rate * 2.0 ** -0.3
        for _ in range(3):
            low, _, high = self.rate_limits()
            shows = (low > 0.0) & np.isfinite(high)
            if not shows.any():
                break
            finite_low = np.where(shows, low, 1.0)
            finite_high = np.where(shows, high, 1.0)
            for fraction in np.linspace(0.0, 1.0, 9)[1:-1]:
                between = finite_low ** (1.0 - fraction) * finite_high ** fraction
                self._add(np.where(shows, between, np.inf))

    def rate_limits(self) -> Array:
        """
        Return lowest, best and highest rate limits, (3, n) [N·m/s].

        Those that are excluded next to possible ones count as the ends.
        """
        fastest = self._fastest
        limits = unlimited_rates(len(fastest))
        rates = np.array(self._rates)
        is_possible = self._possible_rates()
        best = np.argmin(self._rate_squares, axis=0)
        for joint in self._joints:
            order = np.argsort(rates[:, joint], kind='stable')
            ascending = rates[order, joint]
            inside = np.flatnonzero(is_possible[order, joint])
            first, last = inside[0], inside[-1]
            low = float(ascending[first - 1]) if first else 0.0
            limits[0, joint] = min(low, float(fastest[joint]))
            if np.isfinite(ascending[last]) and low < fastest[joint]:
                limits[1, joint] = rates[best[joint], joint]
                limits[2, joint] = ascending[last + 1]
        return limits

    def delays(self) -> dict[int, Array]:
        """
        Return the delays that are possible [samples].

        Each has the lowest, best and highest lag that is possible with it, shape (3, n) [s].
        """
        delays = {}
        for j in np.flatnonzero(self._possible_delays).tolist():
            lags = np.zeros((3, self._profile.joint_count))
            for joint in self._joints:
                lags[:, joint] = self._lag_limits(joint, j)
            delays[self._delays[j]] = lags
        return delays

    def _lag_limits(self, joint: int, j: int) -> Array:
        """Return lowest, best and highest lag, shape (3,) [s]."""
        squares = self._least[joint, j]
        best = int(np.argmin(squares))
        noise = max(self._noise[joint], 1e-300)
        possible = np.flatnonzero(squares - squares[best] < _MAX_LIKELIHOOD_LOSS * noise)
        low = max(possible[0] - 1, 0)
        high = min(possible[-1] + 1, len(_LAG_GRID) - 1)
        if not low:
            return np.array([0.0, 0.0, _LAG_GRID[high]])
        lag = _LAG_GRID[best]
        # A lag is not known to better than a tenth.
        lowest = min(_LAG_GRID[low], 0.9 * lag)
        highest = max(_LAG_GRID[high], 1.1 * lag)
        return np.array([lowest, lag, min(highest, LAGS[-1])])

    def best_delay(self, delays: dict[int, Array]) -> int:
        """Return the most likely delay, by likelihood and number of lags."""
        cost = dict(zip(self._delays, self._cost(self._least)))

        def penalized(delay: int) -> float:
            lag_count = int((delays[delay][1] > 0.0).sum())
            return 7.0 * lag_count + float(cost[delay])
        return min(delays, key=penalized)
