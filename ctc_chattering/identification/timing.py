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
When a torque acts: whole samples of delay and the first-order lag of each drive.

Both are scanned: for each delay and lag the regression is solved for all else, and the sum of
squares that is left is the profile of the likelihood.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from functools import cached_property
from math import nan

from ctc_chattering.bags.recording import Stretch
from ctc_chattering.identification.drives import (
    COMMAND,
    complete,
    DriveProfile,
    has,
    LAGS,
    weak_torque,
)
from ctc_chattering.identification.findings import (
    ALL_JOINTS,
    Estimate,
    Finding,
    Reason,
    Severity,
)
from ctc_chattering.identification.regression import Data
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import joined, SETTLING_S, Windows
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt

Flags = npt.NDArray[np.bool_]
#: Longest delay that is looked for [samples], and [s].
_MOST, _LONGEST = 20, 0.05
#: Longest part of the recordings that delay and lag are taken from [s].
_ENOUGH = 70.0
#: Alignments of a measured effort: that of the period after the sample, at its instant, of the
#: period before, and later ones, as of filtered efforts [samples].
_ALIGNMENTS = tuple(-0.5 * k for k in range(13))
#: Samples by which commands may be late without a change of their shape, and times as much as
#: that they may seem to be beyond.
_UNEVEN, _FARTHER = 0.03, 2.0
#: Width of a set of lags from which on they are not identified [s].
_WIDE = 0.01
#: Fewest windows of a joint.
FEWEST_ROWS = 30
#: Mean direction above which a joint slides one way over a whole window.
SLIDING = 1.0 - 1e-9
#: Every which Stribeck velocity has a column here.
STRIBECK_STEP = 3
#: Singular value, of columns of length 1, below which columns are not independent.
INDEPENDENT = 1e-7


@dataclasses.dataclass(frozen=True)
class Timing:
    """
    How the torque reaches the joints.

    Attributes
    ----------
    source : str
        `command` or `effort`: what the torque was taken from.
    delay : float
        Samples; of an effort the alignment, from -1 to 0.
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
    def acting(self) -> tuple[float, Array, Array]:
        """Return delay [samples], lag [s] and rate [N·m/s] of the torque that is used."""
        return self.delay, self.lag, self.rate[1]

    @property
    def of_commands(self) -> Timing | None:
        """Return that of the commands; None without commands."""
        return self if self.source == COMMAND else self.commands

    @property
    def drive(self) -> tuple[float, Array]:
        """Return delay [samples] and lag [s] from the command on; nan and 0 if not known."""
        known = self.of_commands
        return (nan, np.zeros_like(self.lag)) if known is None else (known.delay, known.lag)


class Profile:
    """
    Sums of squares of each joint over delay and lag, with all else fitted.

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
        self._parts, self._windows, self._source, self._phi = parts, windows, source, phi
        self.period = parts[0].period

    @cached_property
    def data(self) -> Data:
        """All windows with the torques as they are; those used slide one way."""
        n = self._parts[0].q.shape[1]
        torque = self.torque(0.0, np.zeros(n), np.full(n, np.inf))
        data = Data.of(joined(self._windows), torque)
        sliding = np.abs(data.windows.direction) > SLIDING
        return dataclasses.replace(data, used=data.used & sliding)

    @cached_property
    def moving(self) -> Flags:
        """Joints with enough windows, shape (n,)."""
        return np.asarray(self.data.used.sum(axis=0) >= FEWEST_ROWS)

    @cached_property
    def _bases(self) -> list[Array]:
        """Orthonormal basis of what explains the torque of each joint in its windows."""
        windows, bases = self.data.windows, []
        for joint, used in enumerate(self.data.used.T):
            columns = np.column_stack((
                windows.direction[used, joint], windows.velocity[used, joint],
                np.ones(int(used.sum())), windows.stribeck[used, joint, ::STRIBECK_STEP],
                windows.bodies[used, joint]))
            bases.append(orthonormal(columns))
        return bases

    def torque(self, delay: float, lag: Array, rate: Array) -> Array:
        """Return the weak torque of all windows, shape (J, n); nan where it is not known."""
        return np.concatenate([
            known_torque(part, windows, self._source, self._phi, delay, lag, rate)
            for part, windows in zip(self._parts, self._windows)])

    def unexplained(self, torque: Array, joint: int) -> Array:
        """Return what is left of torques of a joint in its windows, shape (rows, ...) [N·m]."""
        basis = self._bases[joint]
        return np.asarray(torque - basis @ (basis.T @ torque))

    def squares(self, delay: float) -> Array:
        """Return the sum of squares of each joint without a lag, shape (n,) [(N·m)²]."""
        n = len(self.moving)
        torque = self.torque(delay, np.zeros(n), np.full(n, np.inf))
        target = np.nan_to_num(torque - self.data.windows.model_torque)
        return np.array([np.square(self.unexplained(target[used, joint], joint)).sum()
                         for joint, used in enumerate(self.data.used.T)])


def known_torque(part: Stretch, windows: Windows, source: str, phi: TestFunction, delay: float,
                 lag: Array, rate: Array | float = np.inf) -> Array:
    """Return the weak torque of the windows of a stretch, (J, n) [N·m]; nan where not known."""
    values = np.asarray(has(part, source))
    torque = weak_torque(values, delay, lag, part.period, phi, windows.centres, rate)
    known = complete(values, windows.centres, phi.half, phi.half)
    return np.where(known, torque, np.nan)


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
        return _of_commands(*_middle(parts, windows, phi), phi)
    profile = Profile(parts, windows, source, phi)
    n, table = len(profile.moving), np.array([profile.squares(x) for x in _ALIGNMENTS])
    scale = np.where(profile.moving, table.min(axis=0), np.inf)
    best = int(np.argmin((table / scale).sum(axis=1)))
    return Timing(source, _ALIGNMENTS[best], np.zeros(n), {}, _any_rate(n), profile.moving)


def _middle(parts: Sequence[Stretch], windows: Sequence[Windows], phi: TestFunction
            ) -> tuple[list[Stretch], list[Windows]]:
    """Return what is in the middle of stretches, of long ones, and the windows there."""
    period = parts[0].period
    share = min(_ENOUGH / (period * sum(len(part.q) for part in parts)), 1.0)
    settled = phi.half + round(SETTLING_S / period)
    found: list[tuple[Stretch, Windows]] = []
    for part, mine in zip(parts, windows):
        first = round(0.5 * (1.0 - share) * len(part.q))
        last = len(part.q) - first
        use = (mine.centres >= first + settled) & (mine.centres < last - settled)
        if use.any():
            found.append((part.cut(first, last), mine.select(use, first)))
    return [part for part, _ in found], [mine for _, mine in found]


def _any_rate(n: int) -> Array:
    """Return rate limits of which nothing is known, shape (3, n) [N·m/s]."""
    return np.tile(np.array([[0.0], [np.inf], [np.inf]]), n)


def _of_commands(parts: Sequence[Stretch], windows: Sequence[Windows], phi: TestFunction
                 ) -> Timing:
    """Return the timing of commands."""
    profile = Profile(parts, windows, COMMAND, phi)
    moving, n = profile.moving, len(profile.moving)
    if not moving.any():
        return Timing(COMMAND, 0.0, np.zeros(n), {}, _any_rate(n), moving)
    late = [min(part.late[0] for part in parts), max(part.late[1] for part in parts)]
    uneven = late[1] - late[0] > _UNEVEN
    # What commands in wrong places do to the torque is not a shift alone.
    far = _FARTHER if uneven else 1.0
    shifts = sorted({max(far * late[0], -1.0), 0.0, min(far * late[1], 1.0)})
    most = min(_MOST, int(_LONGEST / profile.period))
    profiles = DriveProfile(parts, windows, profile.data, profile.unexplained, phi,
                            range(-1, most + 2), moving, shifts, uneven)
    found = profiles.found(None if uneven else _fastest(parts))
    if uneven:
        for lags_of in found.delays.values():
            margin = far * (late[1] - late[0]) * profile.period * moving
            lags_of[0] = np.maximum(lags_of[0] - margin, 0.0)
            lags_of[2] += margin
    # Where delay and lag may be nearly anything, a rate limit stands for something else.
    wide = max(found.delays) - min(found.delays) > MOST_DELAYS or max(
        float(np.ptp(x[:, moving], axis=0).max()) for x in found.delays.values()) > _WIDE
    return Timing(COMMAND, float(found.best), found.delays[found.best][1], found.delays,
                  _any_rate(n) if wide else found.rate, moving)


def _fastest(parts: Sequence[Stretch]) -> Array:
    """Return the fastest change of the commands of each joint, shape (n,) [N·m/s]."""
    # Joint by joint, for long series.
    return np.asarray(np.max([[
        np.nan_to_num(np.abs(np.diff(x))).max() / part.period
        for x in np.asarray(has(part, COMMAND)).T] for part in parts], axis=0))


#: Part of the longest lag that is looked for that counts as it.
END_OF_LAGS = 0.97
#: Lag of a drive from which on it is doubtful [s].
LONGEST_USUAL_LAG_S = 0.008
#: Samples between the shortest and the longest delay that are told apart well enough.
MOST_DELAYS = 2
EXCITE = 'record a motion of `ctc excite`, longer or faster'


def rate_limits(timing: Timing, joints: Sequence[str]) -> list[Estimate]:
    """Return the rate limit of each drive, or what it is at least."""
    known = timing.of_commands
    if known is None:
        return [Estimate.unknown('no commanded torque in the bag')] * len(joints)
    found = []
    longest = np.max([lags[2] for lags in known.delays.values()] or [known.lag], axis=0)
    for (low, _, high), moving, lag in zip(known.rate.T, known.moving, longest):
        known_lag = lag < END_OF_LAGS * LAGS[-1]
        if known_lag and np.isfinite(high):
            found.append(Estimate(float(0.5 * (low + high)), float(0.5 * (high - low)), 'N*m/s'))
        elif known_lag and moving and low > 0.0:
            found.append(Estimate(None, unit='N*m/s', at_least=float(low), reason='the drive '
                                  'follows commands that change so fast'))
        else:
            found.append(Estimate.unknown('no command changes fast enough, or delay and lag are '
                                       'not identified, or commands are missing'))
    return found


def timing_findings(timing: Timing, joints: Sequence[str]) -> Iterator[Finding]:
    """Yield what is doubtful of delay and lag."""
    known = timing.of_commands
    if known is None or not known.delays:
        return
    delays = sorted(known.delays)
    if len(delays) > 1:
        far = max(delays) - min(delays) > MOST_DELAYS
        yield Finding(
            Reason.DRIVE, Severity.CARE if far else Severity.NOTE, ALL_JOINTS,
            f'delay and lag are not told apart: {drives_in_words(known)}'
            + '; backlash or an elastic joint looks like that' * far, EXCITE if far else '')
    lags = np.array(list(known.delays.values()))
    for joint in np.flatnonzero(known.moving).tolist():
        low, high = float(lags[:, 0, joint].min()), float(lags[:, 2, joint].max())
        lag = float(known.lag[joint])
        if high >= END_OF_LAGS * LAGS[-1]:
            yield Finding(
                Reason.DRIVE, Severity.CARE, joint, f'the lag of the drive is {1e3 * low:.3g} ms '
                f'or more, up to the longest that is looked for, {1e3 * LAGS[-1]:.3g} ms: an '
                'elastic joint looks like that, or no command shows it', EXCITE)
        elif lag > LONGEST_USUAL_LAG_S:
            yield Finding(
                Reason.DRIVE, Severity.CARE, joint, f'the lag of the drive of {joints[joint]} is '
                f'{1e3 * lag:.3g} ms, more than drives of arms have: an elastic joint, backlash '
                'or a delay of this joint looks like that',
                'measure the position behind the gear, or confirm that the drive is that slow')


def drives_in_words(timing: Timing) -> str:
    """Return each delay that is possible with the lags of all drives."""
    return ', or '.join(
        f'delay {delay} with lag {milliseconds(lags[0, timing.moving].min(initial=np.inf), most)}'
        for delay, lags in sorted(timing.delays.items())
        for most in [lags[2, timing.moving].max(initial=0.0)])


def milliseconds(low: float, high: float) -> str:
    """Return the lowest and highest lag [s], in words."""
    return f'{1e3 * low:.3g} to {1e3 * high:.3g} ms'


def lag_in_words(timing: Timing, i: int) -> str:
    """Return the lag of the drive of joint i, with its interval at the most likely delay."""
    known = timing.of_commands
    if known is None or not known.delays or not known.moving[i]:
        return 'not identifiable'
    low, best, high = known.delays[int(known.delay)][:, i]
    one = len(known.delays) == 1
    if best == 0.0 and one:
        return f'none, at most {1e3 * high:.2g} ms'
    return milliseconds(low, high) + ('' if one else f' with delay {int(known.delay)}')
