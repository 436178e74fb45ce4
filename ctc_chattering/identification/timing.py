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
Timing of the torque: whole samples of delay, and lag and rate limit of each drive.

Delays, lags and rate limits are scanned, and for each the regression is solved for all else. The
sum of squares that is left, over the variance and the correlation length of a residual, is twice
the logarithm of a likelihood. Values are possible where it is near its least.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from functools import cached_property
from math import ceil, nan
from typing import NamedTuple

from ctc_chattering.identification.drives import (
    COMMAND,
    complete,
    Drive,
    driven_by_lags,
    has,
    known_torque,
)
from ctc_chattering.identification.findings import Estimate, Finding, Gap, Reason, Severity
from ctc_chattering.identification.regression import correlation_length, Observations
from ctc_chattering.identification.stretches import Stretch
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import joined, SETTLING_S, Windows
from ctc_chattering.numerics.linear_algebra import Array, Flags
import numpy as np
from scipy.interpolate import CubicSpline  # type: ignore[import-untyped]

#: Longest delay that is looked for [samples].
MOST_SAMPLES = 20
#: Longest delay that is looked for [s].
LONGEST_DELAY_S = 0.05
#: Delays below the best one, without a rate limit, that are looked at with one.
FEWER_SAMPLES = 5
#: Delays above it.
MORE_SAMPLES = 3
#: Longest part of the recordings that delay and lag are taken from [s].
ENOUGH_S = 70.0
#: Fewest half samples by which a measured effort may be late. It may be that of the period after
#: the sample, at its instant, of the period before, or, if it is filtered, a later one.
LEAST_ALIGNMENTS = 13
#: How many of them are those of an effort that is not filtered.
USUAL_ALIGNMENTS = 3
#: Longest time by which a filtered effort may be late [s].
LATEST_EFFORT_S = 0.02
#: Part of the squared torque that is left, in the mean of all joints, which a filter must explain.
LEAST_FILTER_GAIN = 0.1
#: Samples by which commands may be late without a change of their shape.
UNEVEN = 0.03
#: Fewest windows of a joint.
FEWEST_ROWS = 30
#: Mean direction above which a joint slides one way over a whole window.
SLIDING = 1.0 - 1e-9
#: Every which Stribeck velocity has a column here.
STRIBECK_STEP = 3
#: Singular value, of columns of length 1, below which columns are not independent.
INDEPENDENT = 1e-7
#: Lags for which torques are computed [s].
LAGS = (0.0, *(0.0003 * 1.5 ** k for k in range(13)))
#: Lags that are compared: torques are interpolated between the former [s].
LAG_GRID = LAGS[-1] * np.linspace(0.0, 1.0, 600) ** 2
#: Fewest lags for which torques are computed.
FEWEST_LAGS = 5
#: Part of the torque that no model is better than: noise has a floor there.
NOISE_FLOOR = 1e-4
#: Excess of the sum of squares, over the variance of a residual, up to which a value is possible.
POSSIBLE = 9.0
#: Cost of a lag beside that: the logarithm of some hundred independent windows.
LAG_COST = 7.0
#: Part by which a lag that shows may be another one: drives are no exact lags of first order, and
#: a delay of one joint alone looks like a lag.
LAG_DOUBT = 0.1
#: First rate limit that is tried, in fastest changes of the commands: within a period, a limit
#: shows beyond these.
FIRST_RATE = 2.0
#: Ratio of the rate limits that are tried one after the other.
RATE_RATIO = 2.0 ** -0.3
#: Most of these.
MOST_RATES = 30
#: Rate limits that are excluded before no lower one is tried.
EXCLUDED_RATES = 2
#: How often rate limits are tried between those that are possible.
REFINEMENTS = 3
#: Rate limits of each refinement.
FINER_RATES = 7


@dataclasses.dataclass(frozen=True)
class Timing:
    """
    Timing of the torque of n joints.

    Attributes
    ----------
    source : str
        `command` or `effort`: what the torque was taken from.
    delay : float
        Samples; of an effort the alignment, at most 0.
    lag : ndarray, shape (n,)
        T of each drive [s]; 0 where none shows.
    delays : dict of int to ndarray, shape (3, n)
        The delays that the data allow, each with the lowest, the best and the highest lag of each
        drive [s]; one delay if it is identified.
    rate : ndarray, shape (3, n)
        Lowest, best and highest rate limit of each drive [N·m/s]; inf where none shows.
    moving : ndarray of bool, shape (n,)
        Joints that have enough windows.
    commands : Timing or None
        That of the commands, where the source is the effort; None without commands.

    """

    source: str
    delay: float
    lag: Array
    delays: dict[int, Array]
    rate: Array
    moving: Flags
    commands: Timing | None = None

    @property
    def acting(self) -> Drive:
        """Drives between the torque that is used and the robot."""
        return Drive(self.delay, self.lag, self.rate[1])

    @property
    def of_commands(self) -> Timing | None:
        """Return the timing of the commands; None without commands."""
        return self if self.source == COMMAND else self.commands

    @property
    def drive(self) -> Drive:
        """Drives from the command on; a delay of nan and no lag if they are not known."""
        commands = self.of_commands
        return Drive.ideal(len(self.lag), nan) if commands is None else commands.acting


class Profile:
    """
    Torque of each joint that is left with all else fitted.

    Only windows in which a joint slides one way count: at a reversal, static friction has a
    timing of its own.

    Parameters
    ----------
    parts : sequence of Stretch
        With the torque.
    windows : sequence of Windows
        Of each stretch.
    source : str
        `COMMAND` or `EFFORT`.
    phi : TestFunction
        φ.

    """

    def __init__(self, parts: Sequence[Stretch], windows: Sequence[Windows], source: str,
                 phi: TestFunction) -> None:
        self.parts, self.windows, self.source, self.phi = parts, windows, source, phi
        self.joint_count = parts[0].q.shape[1]

    @cached_property
    def data(self) -> Observations:
        """All windows with the torques as they are; those used slide one way."""
        data = Observations.of(
            joined(self.windows), self.torque(Drive.ideal(self.joint_count)))
        sliding = np.abs(data.windows.direction) > SLIDING
        return dataclasses.replace(data, used=data.used & sliding)

    @cached_property
    def moving(self) -> Flags:
        """Joints with enough windows, shape (n,)."""
        return np.asarray(self.data.used.sum(axis=0) >= FEWEST_ROWS)

    @cached_property
    def bases(self) -> list[Array]:
        """Orthonormal basis of what explains the torque of each joint in its windows."""
        windows, bases = self.data.windows, []
        for joint, used in enumerate(self.data.used.T):
            columns = np.column_stack((
                windows.direction[used, joint], windows.velocity[used, joint],
                np.ones(int(used.sum())), windows.stribeck[used, joint, ::STRIBECK_STEP],
                windows.bodies[used, joint]))
            bases.append(orthonormal(columns))
        return bases

    def torque(self, drive: Drive) -> Array:
        """Return the weak torque of all windows, shape (J, n); nan where it is not known."""
        return np.concatenate([
            known_torque(part, windows.centres, self.source, self.phi, drive)
            for part, windows in zip(self.parts, self.windows)])

    def unexplained(self, torque: Array, joint: int) -> Array:
        """Return what is left of torques of a joint in its windows, shape (rows, ...) [N·m]."""
        basis = self.bases[joint]
        return np.asarray(torque - basis @ (basis.T @ torque))

    def squares(self, delay: float) -> Array:
        """Return the sum of squares of each joint without a lag, shape (n,) [(N·m)²]."""
        torque = self.torque(Drive.ideal(self.joint_count, delay))
        target = np.nan_to_num(torque - self.data.windows.model_torque)
        return np.array([np.square(self.unexplained(target[used, joint], joint)).sum()
                         for joint, used in enumerate(self.data.used.T)])


def orthonormal(columns: Array) -> Array:
    """Return a basis of what columns span, but for directions that are rounding."""
    length = np.sqrt(np.square(columns).sum(axis=0))
    u, s, _ = np.linalg.svd(columns / np.where(length > 0.0, length, 1.0), full_matrices=False)
    return u[:, s > INDEPENDENT * s.max(initial=1.0)]


def timing(parts: Sequence[Stretch], windows: Sequence[Windows], source: str, phi: TestFunction
           ) -> Timing:
    """
    Return when the torque of a source acts.

    Parameters
    ----------
    parts, windows
        Stretches that have it, and their windows.
    source : str
        `command`, or `effort`, which needs no lag: it is that of the drive.
    phi : TestFunction
        φ.

    """
    if source == COMMAND:
        return _of_commands(Profile(*_middle(parts, windows, phi), COMMAND, phi))
    profile = Profile(parts, windows, source, phi)
    n = profile.joint_count
    count = max(LEAST_ALIGNMENTS, round(2.0 * LATEST_EFFORT_S / phi.period) + 1)
    alignments = [-0.5 * k for k in range(count)]
    table = np.array([profile.squares(x) for x in alignments])
    usual, best = (int(np.argmin(_excess(part, profile.moving)))
                   for part in (table[:USUAL_ALIGNMENTS], table))
    if _excess(table, profile.moving)[usual] < LEAST_FILTER_GAIN:
        best = usual
    return Timing(source, alignments[best], np.zeros(n), {}, _any_rate(n), profile.moving)


def _excess(table: Array, moving: Flags) -> Array:
    """Return how much more than its least each row leaves, in the mean of the joints in motion."""
    if not moving.any():
        return np.zeros(len(table))
    least = np.maximum(table[:, moving].min(axis=0), np.finfo(float).tiny)
    return np.asarray((table[:, moving] / least - 1.0).mean(axis=1))


def _middle(parts: Sequence[Stretch], windows: Sequence[Windows], phi: TestFunction
            ) -> tuple[list[Stretch], list[Windows]]:
    """Return what is in the middle of stretches, of long ones, and the windows there."""
    period = parts[0].period
    share = min(ENOUGH_S / (period * sum(len(part.q) for part in parts)), 1.0)
    settled = phi.half + round(SETTLING_S / period)
    middles: list[Stretch] = []
    inside: list[Windows] = []
    for part, rows in zip(parts, windows):
        first = round(0.5 * (1.0 - share) * len(part.q))
        last = len(part.q) - first
        chosen = (rows.centres >= first + settled) & (rows.centres < last - settled)
        if chosen.any():
            middles.append(part.cut(first, last))
            inside.append(rows.select(chosen, first))
    return middles, inside


def _any_rate(n: int) -> Array:
    """Return rate limits of which nothing is known, shape (3, n) [N·m/s]."""
    return np.tile(np.array([[0.0], [np.inf], [np.inf]]), n)


def _of_commands(profile: Profile) -> Timing:
    """Return the timing of commands."""
    n = profile.joint_count
    if not profile.moving.any():
        return Timing(COMMAND, 0.0, np.zeros(n), {}, _any_rate(n), profile.moving)
    late = Late(min(part.late[0] for part in profile.parts),
                max(part.late[1] for part in profile.parts))
    search = DriveSearch(profile)
    if not late.uneven:
        search.try_rates(fastest_changes(profile.parts))
    delays, rate = search.delays(), search.rate_limits(fastest_changes(profile.parts))
    delay = search.best_delay(delays)
    lag = delays[delay][1]
    delays = late.widen(delays, profile.parts[0].period, profile.moving)
    # Where delay and lag may be nearly anything, a rate limit stands for something else.
    lags = np.array(list(delays.values()))
    wide = len(delays) > MOST_DELAYS + 1 or np.ptp(lags, axis=(0, 1)).max() > WIDE_LAG_S
    return Timing(COMMAND, float(delay), lag, delays, _any_rate(n) if wide else rate,
                  profile.moving)


def fastest_changes(parts: Sequence[Stretch]) -> Array:
    """Return the fastest change of the commands of each joint, shape (n,) [N·m/s]."""
    # Joint by joint, for long series.
    return np.asarray(np.max([[
        np.nan_to_num(np.abs(np.diff(x))).max() / part.period
        for x in np.asarray(has(part, COMMAND)).T] for part in parts], axis=0))


class Late(NamedTuple):
    """Samples by which commands may be later than the recording has them, least and most."""

    least: float
    most: float

    @property
    def uneven(self) -> bool:
        """Whether commands stand in wrong places here and there."""
        return self.most - self.least > UNEVEN

    def widen(self, delays: dict[int, Array], period: float, moving: Flags) -> dict[int, Array]:
        """Return possible delays and lags if commands may be later."""
        if not self.uneven:
            return delays
        margin = (self.most - self.least) * period * moving
        wider: dict[int, Array] = {}
        for delay, lags in delays.items():
            for shift in range(-ceil(self.most), ceil(-self.least) + 1):
                if delay + shift < 0:
                    continue
                moved = np.maximum(lags - shift * period * moving, 0.0)
                moved[0] = np.maximum(moved[0] - margin, 0.0)
                moved[2] += margin
                known = wider.get(delay + shift, moved)
                wider[delay + shift] = np.array([
                    np.minimum(known[0], moved[0]), known[1] if shift else moved[1],
                    np.maximum(known[2], moved[2])])
        return wider


class DriveSearch:
    """
    Sums of squares of each joint over delay, lag and rate limit.

    Parameters
    ----------
    profile : Profile
        Of the commands.

    """

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        period = profile.phi.period
        most = min(MOST_SAMPLES, int(LONGEST_DELAY_S / period))
        self._joints = np.flatnonzero(profile.moving).tolist()
        self._samples = list(range(most + 1))
        self._lag_count = len(LAGS)
        self._rows = [used & self._known for used in profile.data.used.T]
        unlimited = np.full(profile.joint_count, np.inf)
        squares, residuals = self._squares(unlimited)
        self._noise = self._noise_of(squares, residuals)
        best = self._samples[int(np.argmin(self._cost(squares)))]
        near = [k for k, delay in enumerate(self._samples)
                if best - FEWER_SAMPLES <= delay <= best + MORE_SAMPLES]
        self._samples = [self._samples[k] for k in near]
        #: Least sum of squares of all rate limits, shape (n, delays, lags).
        self._least = squares[:, near]
        self._rates = [unlimited]
        #: Least sum of squares of all lags for each of these, shape (n, delays).
        self._by_rate = [self._least.min(axis=2)]
        # With a rate limit drives have no longer lags than they seem to have without.
        longest = max((lags[2].max() for lags in self.delays().values()), default=LAGS[-1])
        self._lag_count = max(FEWEST_LAGS, int(np.searchsorted(LAGS, longest)) + 1)

    @cached_property
    def _known(self) -> Flags:
        """Windows with commands at all delays, shape (J,)."""
        half, profile = self._profile.phi.half, self._profile
        return np.concatenate([
            complete(np.asarray(has(part, COMMAND)), windows.centres,
                     half + self._samples[-1], half).all(axis=1)
            for part, windows in zip(profile.parts, profile.windows)])

    def _squares(self, rate: Array) -> tuple[Array, list[Array]]:
        """
        Return what is left for rate limits.

        Returns
        -------
        squares : ndarray, shape (n, delays, lags)
            [(N·m)²]; inf where nothing is computed, 0 for a joint that rests.
        residuals : list of ndarray, shape (rows,)
            Of the best delay and lag of each joint in motion [N·m].

        """
        profile, phi = self._profile, self._profile.phi
        count = len(profile.data.torque)
        computed = np.array(LAGS[:self._lag_count])
        compared = LAG_GRID[computed[-1] >= LAG_GRID]
        spline = CubicSpline(computed, np.eye(len(computed)))(compared)
        torque = np.empty((len(computed), len(self._samples), count, profile.joint_count))
        first = 0
        for part, windows in zip(profile.parts, profile.windows):
            here = slice(first, first := first + len(windows.centres))
            values = np.asarray(has(part, COMMAND))
            for k, mean in enumerate(driven_by_lags(values, computed, rate, part.period)):
                for j, delay in enumerate(self._samples):
                    torque[k, j, here] = phi.sums(mean, phi.over, windows.centres - delay)
        torque -= profile.data.windows.model_torque
        squares = np.full((profile.joint_count, len(self._samples), len(LAG_GRID)), np.inf)
        squares[~profile.moving] = 0.0
        residuals = []
        for joint in self._joints:
            rows = self._rows[joint]
            target = torque[:, :, rows, joint].reshape(-1, int(rows.sum()))
            basis = profile.bases[joint][rows[profile.data.used[:, joint]]]
            left = target - (target @ basis) @ np.linalg.pinv(basis)
            left = left.reshape(len(computed), len(self._samples), -1)
            for j in range(len(self._samples)):
                gram = left[:, j] @ left[:, j].T
                sums = ((spline @ gram) * spline).sum(axis=1)
                squares[joint, j, :len(compared)] = np.maximum(sums, 0.0)
            best = np.unravel_index(int(np.argmin(squares[joint])), squares[joint].shape)
            residuals.append(spline[best[1]] @ left[:, best[0]])
        return squares, residuals

    def _noise_of(self, squares: Array, residuals: list[Array]) -> Array:
        """Return variance times correlation length of what is left, shape (n,) [(N·m)²]."""
        noise = np.ones(len(squares))
        for joint, residual in zip(self._joints, residuals):
            rows = self._rows[joint]
            torque = self._profile.data.torque[rows, joint]
            floor = NOISE_FLOOR ** 2 * float(np.square(torque).mean())
            series = np.zeros(len(rows))
            series[rows] = residual
            variance = float(squares[joint].min()) / len(residual)
            noise[joint] = max(variance, floor, 1e-300) * correlation_length(series)
        return noise

    def _cost(self, squares: Array) -> Array:
        """Return the sum over all joints for each delay, in units of the noise."""
        best = squares[self._joints].min(axis=2)
        return np.asarray((best / self._noise[self._joints, None]).sum(axis=0))

    def _add(self, rate: Array) -> None:
        """Add rate limits, shape (n,) [N·m/s]."""
        squares, residuals = self._squares(rate)
        self._rates.append(rate)
        self._by_rate.append(squares.min(axis=2))
        self._least = np.minimum(self._least, squares)
        better = self._noise_of(self._least, residuals)
        self._noise = np.minimum(self._noise, better)

    @property
    def _possible_samples(self) -> Flags:
        """Delays that are possible, shape (delays,)."""
        cost = self._cost(self._least)
        return np.asarray(cost - cost.min() < POSSIBLE)

    def _possible_rates(self) -> Flags:
        """Return which rate limits are possible, shape (rates, n)."""
        squares = np.array(self._by_rate)[:, :, self._possible_samples].min(axis=2)
        return np.asarray(squares - squares.min(axis=0) < POSSIBLE * self._noise)

    def try_rates(self, fastest: Array) -> None:
        """Add rate limits from beyond the fastest changes of commands on, (n,) [N·m/s]."""
        rate = np.where(fastest > 0.0, FIRST_RATE * fastest, np.inf)
        excluded = np.zeros(len(fastest))
        for _ in range(MOST_RATES):
            self._add(rate)
            excluded += ~self._possible_rates()[-1] | ~self._profile.moving
            if (excluded >= EXCLUDED_RATES).all():
                break
            rate = rate * RATE_RATIO
        for _ in range(REFINEMENTS):
            low, _, high = self.rate_limits(fastest)
            near = (low > 0.0) & np.isfinite(high)
            if not near.any():
                break
            for share in np.linspace(0.0, 1.0, FINER_RATES + 2)[1:-1]:
                between = np.where(near, low, 1.0) ** (1.0 - share) * np.where(
                    near, high, 1.0) ** share
                self._add(np.where(near, between, np.inf))

    def rate_limits(self, fastest: Array) -> Array:
        """
        Return the lowest, best and highest rate limit of each joint, shape (3, n) [N·m/s].

        Those that are excluded next to possible ones count as the ends.
        """
        limits = _any_rate(len(fastest))
        rates, possible = np.array(self._rates), self._possible_rates()
        squares = np.array(self._by_rate)[:, :, self._possible_samples].min(axis=2)
        for joint in self._joints:
            order = np.argsort(rates[:, joint], kind='stable')
            sorted_rates = rates[order, joint]
            inside = np.flatnonzero(possible[order, joint])
            below = float(sorted_rates[inside[0] - 1]) if inside[0] else 0.0
            limits[0, joint] = min(below, float(fastest[joint]))
            shows = np.isfinite(sorted_rates[inside[-1]]) and below < fastest[joint]
            if shows:
                limits[1, joint] = rates[int(np.argmin(squares[:, joint])), joint]
                limits[2, joint] = sorted_rates[inside[-1] + 1]
        return limits

    def delays(self) -> dict[int, Array]:
        """Return the delays that are possible, each with the lags that are possible with it."""
        delays = {}
        for j in np.flatnonzero(self._possible_samples).tolist():
            lags = np.zeros((3, self._profile.joint_count))
            for joint in self._joints:
                lags[:, joint] = self._lags(joint, j)
            delays[self._samples[j]] = lags
        return delays

    def _lags(self, joint: int, j: int) -> tuple[float, ...]:
        """Return the lowest, best and highest lag of a joint with the j-th delay [s]."""
        squares = self._least[joint, j]
        best = int(np.argmin(squares))
        noise = max(self._noise[joint], 1e-300)
        possible = np.flatnonzero(squares - squares[best] < POSSIBLE * noise)
        low, high = max(possible[0] - 1, 0), min(possible[-1] + 1, len(LAG_GRID) - 1)
        if not low:
            return 0.0, 0.0, float(LAG_GRID[high])
        lag = float(LAG_GRID[best])
        return (min(float(LAG_GRID[low]), (1.0 - LAG_DOUBT) * lag), lag,
                min(max(float(LAG_GRID[high]), (1.0 + LAG_DOUBT) * lag), LAGS[-1]))

    def best_delay(self, delays: dict[int, Array]) -> int:
        """Return the most likely of these delays; fewer lags are more likely."""
        cost = self._cost(self._least)
        return min(delays, key=lambda delay: LAG_COST * int((delays[delay][1] > 0.0).sum()) + (
            float(cost[self._samples.index(delay)])))


#: Part of the longest lag that is looked for that counts as it.
END_OF_LAGS = 0.97
#: Lag of a drive from which on it is doubtful [s].
LONGEST_USUAL_LAG_S = 0.008
#: Samples between the shortest and the longest delay that are told apart well enough.
MOST_DELAYS = 2
#: Width of the lags of a drive from which on they are not identified [s].
WIDE_LAG_S = 0.01


def rate_limits(timing: Timing, joints: Sequence[str]) -> list[Estimate]:
    """Return the rate limit of each drive, or what it is at least."""
    commands = timing.of_commands
    if commands is None:
        return [Estimate.unknown(Gap.NO_COMMANDS)] * len(joints)
    estimates = []
    longest = np.max([lags[2] for lags in commands.delays.values()] or [commands.lag], axis=0)
    for (low, _, high), moving, lag in zip(commands.rate.T, commands.moving, longest):
        lag_is_known = lag < END_OF_LAGS * LAGS[-1]
        if lag_is_known and np.isfinite(high):
            estimates.append(
                Estimate(float(0.5 * (low + high)), float(0.5 * (high - low)), 'N*m/s'))
        elif lag_is_known and moving and low > 0.0:
            estimates.append(Estimate(
                None, unit='N*m/s', at_least=float(low),
                gap=Gap.FOLLOWS_COMMANDS))
        else:
            estimates.append(Estimate.unknown(Gap.SLOW_COMMANDS))
    return estimates


def timing_findings(timing: Timing) -> Iterator[Finding]:
    """Yield what is doubtful of delay and lag."""
    commands = timing.of_commands
    if commands is None or not commands.delays:
        return
    if len(commands.delays) > 1:
        far = max(commands.delays) - min(commands.delays) > MOST_DELAYS
        reason, severity = ((Reason.FAR_DELAYS, Severity.CARE) if far else
                            (Reason.SEVERAL_DELAYS, Severity.NOTE))
        yield Finding(reason, severity, values={'drives': drives_in_words(commands)})
    lags = np.array(list(commands.delays.values()))
    for joint in np.flatnonzero(commands.moving).tolist():
        low, high = float(lags[:, 0, joint].min()), float(lags[:, 2, joint].max())
        lag = float(commands.lag[joint])
        if high >= END_OF_LAGS * LAGS[-1]:
            yield Finding(Reason.UNBOUNDED_LAG, Severity.CARE, joint, {
                'lag_ms': 1e3 * low, 'longest_ms': 1e3 * LAGS[-1]})
        elif lag > LONGEST_USUAL_LAG_S:
            yield Finding(Reason.LONG_LAG, Severity.CARE, joint, {'lag_ms': 1e3 * lag})


def drives_in_words(timing: Timing) -> str:
    """Return each delay that is possible with the lags of all drives."""
    words = []
    for delay, lags in sorted(timing.delays.items()):
        low = lags[0, timing.moving].min(initial=np.inf)
        high = lags[2, timing.moving].max(initial=0.0)
        words.append(f'delay {delay} with lag {milliseconds(low, high)}')
    return ', or '.join(words)


def milliseconds(low: float, high: float) -> str:
    """Return the lowest and highest lag [s], in words."""
    return f'{1e3 * low:.3g} to {1e3 * high:.3g} ms'


def lag_in_words(timing: Timing, joint: int) -> str:
    """Return the lag of a joint's drive at the most likely delay; `-` if it is not known."""
    commands = timing.of_commands
    if commands is None or not commands.delays or not commands.moving[joint]:
        return '-'
    low, best, high = commands.delays[int(commands.delay)][:, joint]
    if len(commands.delays) > 1:
        return f'{milliseconds(low, high)} with delay {int(commands.delay)}'
    return milliseconds(low, high) if best else f'none, at most {1e3 * high:.2g} ms'
