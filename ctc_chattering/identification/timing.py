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
Timing of the torque: delay, lag and rate limit of drives.

`identify` calls `identify_timing` with all windows. Commands are searched by `drive_search.py`. A
measured effort is that of the drive, so only its alignment with the samples is identified.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from math import ceil, nan
from typing import NamedTuple

from ctc_chattering.identification.drive_search import (
    DriveSearch,
    LAGS,
    Profile,
    unlimited_rates,
)
from ctc_chattering.identification.drives import Drive
from ctc_chattering.identification.findings import Estimate, Finding, Gap, Reason, Severity
from ctc_chattering.identification.stretches import COMMAND, Stretch
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import SETTLING_S, Windows
from ctc_chattering.numerics.linear_algebra import Array, Flags
import numpy as np

#: A lag from here on may be the longest that is searched [s].
_END_OF_LAGS_S = 0.97 * LAGS[-1]
#: Delays further apart than this are not told apart well enough [samples].
_MAX_DELAY_RANGE = 2


@dataclasses.dataclass(frozen=True)
class Timing:
    """
    Timing of the torque of n joints.

    Attributes
    ----------
    source : str
        `COMMAND` or `EFFORT`, from which the torque was taken.
    delay : float
        Delay [samples]. An effort has its alignment, 0 or less.
    lag : ndarray, shape (n,)
        T of each drive [s], 0 where none shows.
    delays : dict of int to ndarray, shape (3, n)
        The delays that the data allow, each with the lowest, the best and the highest lag of each
        drive [s]. An identified delay is the only one.
    rate : ndarray, shape (3, n)
        Lowest, best and highest rate limit of each drive [N·m/s], inf where none shows.
    moving : ndarray of bool, shape (n,)
        Joints that have enough windows.
    commands : Timing or None
        Timing of the commands, where the source is the effort and there are some.

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
        """Return the timing of the commands, or None."""
        return self if self.source == COMMAND else self.commands

    @property
    def drive(self) -> Drive:
        """
        Drives from the command on.

        If they are not known, the delay is nan and there is no lag.
        """
        commands = self.of_commands
        return Drive.ideal(len(self.lag), nan) if commands is None else commands.acting


def identify_timing(
        stretches: Sequence[Stretch],
        windows: Sequence[Windows],
        source: str,
        phi: TestFunction) -> Timing:
    """
    Return when the torque of a source acts.

    Parameters
    ----------
    stretches, windows
        Stretches that have the torque, and their windows.
    source : str
        `COMMAND`, or `EFFORT`, which needs no lag.
    phi : TestFunction
        φ.

    """
    if source == COMMAND:
        return _search_drives(_middle_profile(stretches, windows, phi))
    return _align_effort(Profile(stretches, windows, source, phi))


# Measured efforts.

def _align_effort(profile: Profile) -> Timing:
    """
    Return the timing of a measured effort.

    It may be that of the period after the sample, at its instant, or of the period before. A
    filtered one is later, by up to 20 ms.
    """
    moving = profile.moving
    count = max(13, round(2.0 * 0.02 / profile.phi.period) + 1)
    alignments = [-0.5 * k for k in range(count)]
    squares = np.array([profile.squares(x) for x in alignments])
    excess = _mean_excess(squares, moving)
    best = int(np.argmin(excess))
    unfiltered = int(np.argmin(_mean_excess(squares[:3], moving)))
    # A filter must explain a tenth of the squared torque that remains.
    if excess[unfiltered] < 0.1:
        best = unfiltered
    n = profile.joint_count
    return Timing(
        profile.source,
        alignments[best],
        np.zeros(n),
        {},
        unlimited_rates(n),
        moving)


def _mean_excess(squares: Array, moving: Flags) -> Array:
    """Return the mean excess of each row over the least one."""
    if not moving.any():
        return np.zeros(len(squares))
    squares = squares[:, moving]
    lowest = np.maximum(squares.min(axis=0), np.finfo(float).tiny)
    return np.asarray((squares / lowest - 1.0).mean(axis=1))


# Commands.

def _middle_profile(
        stretches: Sequence[Stretch],
        windows: Sequence[Windows],
        phi: TestFunction) -> Profile:
    """Return the profile of the middle 70 s, at most."""
    period = stretches[0].period
    duration = period * sum(len(stretch.q) for stretch in stretches)
    fraction = min(70.0 / duration, 1.0)
    settled = phi.half + round(SETTLING_S / period)
    middles: list[Stretch] = []
    inner_windows: list[Windows] = []
    for stretch, rows in zip(stretches, windows):
        first = round(0.5 * (1.0 - fraction) * len(stretch.q))
        last = len(stretch.q) - first
        is_inside = (rows.centres >= first + settled) & (rows.centres < last - settled)
        if is_inside.any():
            middles.append(stretch.cut(first, last))
            inner_windows.append(rows.select(is_inside, first))
    return Profile(middles, inner_windows, COMMAND, phi)


def _search_drives(profile: Profile) -> Timing:
    """Return the timing of commands."""
    n = profile.joint_count
    moving = profile.moving
    if not moving.any():
        return Timing(COMMAND, 0.0, np.zeros(n), {}, unlimited_rates(n), moving)
    late = LateCommands(
        min(stretch.late[0] for stretch in profile.stretches),
        max(stretch.late[1] for stretch in profile.stretches))
    search = DriveSearch(profile)
    if not late.is_uneven:
        search.try_rates()
    delays = search.delays()
    delay = search.best_delay(delays)
    lag = delays[delay][1]
    delays = late.widen(delays, profile.phi.period, moving)
    # Where delay and lag may be nearly anything, a rate limit stands for something else.
    lag_range = np.ptp(list(delays.values()), axis=(0, 1)).max()
    is_wide = len(delays) > _MAX_DELAY_RANGE + 1 or lag_range > 0.01
    rate = unlimited_rates(n) if is_wide else search.rate_limits()
    return Timing(COMMAND, float(delay), lag, delays, rate, moving)


class LateCommands(NamedTuple):
    """Earliest and latest delay of commands beyond their rows [samples]."""

    earliest: float
    latest: float

    @property
    def is_uneven(self) -> bool:
        """Return whether some commands stand in wrong rows."""
        return self.latest - self.earliest > 0.03

    def widen(self, delays: dict[int, Array], period: float, moving: Flags) -> dict[int, Array]:
        """Return the delays and lags of commands that may be later."""
        if not self.is_uneven:
            return delays
        margin = (self.latest - self.earliest) * period * moving
        wider: dict[int, Array] = {}
        for delay, lags in delays.items():
            for shift in range(-ceil(self.latest), ceil(-self.earliest) + 1):
                if delay + shift < 0:
                    continue
                shifted = np.maximum(lags - shift * period * moving, 0.0)
                shifted[0] = np.maximum(shifted[0] - margin, 0.0)
                shifted[2] += margin
                earlier = wider.get(delay + shift, shifted)
                best = earlier[1] if shift else shifted[1]
                wider[delay + shift] = np.array([
                    np.minimum(earlier[0], shifted[0]), best, np.maximum(earlier[2], shifted[2])])
        return wider


# Results.

def estimate_rate_limits(timing: Timing) -> list[Estimate]:
    """Return the rate limit of each drive, or its lower bound."""
    commands = timing.of_commands
    if commands is None:
        return [Estimate.unknown(Gap.NO_COMMANDS)] * len(timing.lag)
    highest = np.max([lags[2] for lags in commands.delays.values()] or [commands.lag], axis=0)
    is_lag_known = highest < _END_OF_LAGS_S
    estimates = []
    for joint, (low, _, high) in enumerate(commands.rate.T.tolist()):
        estimate = Estimate.unknown(Gap.SLOW_COMMANDS)
        if is_lag_known[joint] and np.isfinite(high):
            estimate = Estimate(0.5 * (low + high), 0.5 * (high - low), 'N*m/s')
        elif is_lag_known[joint] and commands.moving[joint] and low > 0.0:
            estimate = Estimate(
                None,
                unit='N*m/s',
                at_least=low,
                gap=Gap.FOLLOWS_COMMANDS)
        estimates.append(estimate)
    return estimates


def find_timing_doubts(timing: Timing) -> Iterator[Finding]:
    """Yield doubts about delay and lag."""
    commands = timing.of_commands
    if commands is None or not commands.delays:
        return
    if len(commands.delays) > 1:
        reason, severity = Reason.SEVERAL_DELAYS, Severity.NOTE
        if max(commands.delays) - min(commands.delays) > _MAX_DELAY_RANGE:
            reason, severity = Reason.FAR_DELAYS, Severity.CARE
        yield Finding(reason, severity, values={'drives': describe_drives(commands)})
    lags = np.array(list(commands.delays.values()))
    for joint in np.flatnonzero(commands.moving).tolist():
        lag = float(commands.lag[joint])
        if float(lags[:, 2, joint].max()) >= _END_OF_LAGS_S:
            yield Finding(Reason.UNBOUNDED_LAG, Severity.CARE, joint, {
                'lag_ms': 1e3 * float(lags[:, 0, joint].min()), 'longest_ms': 1e3 * LAGS[-1]})
        elif lag > 0.008:
            yield Finding(Reason.LONG_LAG, Severity.CARE, joint, {'lag_ms': 1e3 * lag})


def describe_drives(timing: Timing) -> str:
    """Return each possible delay with the lags of all drives."""
    words = []
    for delay, lags in sorted(timing.delays.items()):
        low = lags[0, timing.moving].min(initial=np.inf)
        high = lags[2, timing.moving].max(initial=0.0)
        words.append(f'delay {delay} with lag {_in_milliseconds(low, high)}')
    return ', or '.join(words)


def _in_milliseconds(low: float, high: float) -> str:
    return f'{1e3 * low:.3g} to {1e3 * high:.3g} ms'


def describe_lag(timing: Timing, joint: int) -> str:
    """Return the lag of a joint's drive in words, or `-`."""
    commands = timing.of_commands
    if commands is None or not commands.delays or not commands.moving[joint]:
        return '-'
    low, best, high = commands.delays[int(commands.delay)][:, joint]
    if len(commands.delays) > 1:
        return f'{_in_milliseconds(low, high)} with delay {int(commands.delay)}'
    return _in_milliseconds(low, high) if best else f'none, at most {1e3 * high:.2g} ms'
