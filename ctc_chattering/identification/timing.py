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
from typing import NamedTuple

from ctc_chattering.bags.recording import Indices, Stretch
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.drives import (
    COMMAND,
    DriveProfile,
    EFFORT,
    has,
    LAGS,
    weak_torque,
)
from ctc_chattering.identification.findings import ALL_JOINTS, Estimate, Finding, Kind
from ctc_chattering.identification.least_squares import Data, orthonormal, Term, TermKind
from ctc_chattering.identification.weak_form import position_noise, TestFunction
from ctc_chattering.identification.windows import Rows, SETTLING, STRIBECK
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt
from scipy.stats import median_abs_deviation  # type: ignore[import-untyped]

Flags = npt.NDArray[np.bool_]
#: Longest delay that is looked for [samples], and [s].
_MOST, _LONGEST = 20, 0.05
#: Delays that are looked at above the one that is best without a lag.
_ABOVE = 2
#: Longest part of the recording that delay and lag are taken from, in pieces so long [s].
_ENOUGH, _PIECE = 60.0, 15.0
#: Alignments of a measured effort: of the period before, at the instant, of the period after.
_ALIGNMENTS = (-1.0, -0.5, 0.0)
#: Samples by which commands may be late without a change of their shape, and times as much as
#: that they may seem to be beyond.
_UNEVEN, _FARTHER = 0.03, 2.0
#: Width of a set of lags from which on they are not identified [s].
_WIDE = 0.01
#: Changes of its sign in a second from which on a torque chatters [1/s].
_CHATTERS = 20.0
#: Part of a lag by which it is changed for a derivative.
_LAG_STEP = 0.02
#: Fewest rows of a joint.
_FEWEST = 30


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
    lag_error : ndarray, shape (n,)
        Standard error [s]; inf where the data do not tell.
    delays : dict of int to ndarray, shape (3, n)
        The delays that the data allow, each with the lowest, the best and the highest lag of each
        drive [s]; one delay if it is identified.
    misfit : ndarray, shape (n,)
        Mean square that is left in each joint [(N·m)²].
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
    lag_error: Array
    delays: dict[int, Array]
    misfit: Array
    rate: Array
    moving: Flags
    commands: Timing | None = None

    @property
    def of_commands(self) -> Timing | None:
        """Return that of the commands; None without commands."""
        return self if self.source == COMMAND else self.commands

    @property
    def unsure(self) -> bool:
        """Return whether commands act after delays that lie far apart, as with elastic joints."""
        known = self.of_commands
        return known is not None and bool(known.delays) and (
            max(known.delays) - min(known.delays) > Kind.DELAYS.care)

    @property
    def drive(self) -> tuple[float, Array, Array]:
        """Return delay [samples], lag and its error [s] from the command on; nan if not known."""
        known = self.of_commands
        if known is None:
            return nan, np.zeros_like(self.lag), np.full_like(self.lag, np.inf)
        return known.delay, known.lag, known.lag_error


class Profile:
    """Sums of squares of each joint over delay and lag, with all else fitted."""

    def __init__(self, parts: Sequence[Stretch], rows: Sequence[Rows], source: str,
                 phi: TestFunction) -> None:
        self._parts, self._rows, self._source, self._phi = parts, rows, source, phi
        self.period = parts[0].period

    @cached_property
    def data(self) -> Data:
        """Return all windows with the torques as they are."""
        pairs = list(zip(self._parts, self._rows))
        return Data.of(self._rows, [self.torque(*pair) for pair in pairs],
                       bent=[self.bent(*pair) for pair in pairs])

    @cached_property
    def count(self) -> Array:
        """Return the number of rows of each joint, shape (n,)."""
        return np.asarray(self.data.used().sum(axis=0))

    @cached_property
    def _bases(self) -> list[Array]:
        """Return the basis of each joint."""
        return [self._basis(i) for i in range(self.data.way.shape[1])]

    def _basis(self, i: int) -> Array:
        """Return an orthonormal basis of what explains the torque of joint i."""
        data, used = self.data, self.data.used()[:, i]
        terms = [Term(TermKind.FORWARDS, i), Term(TermKind.BACKWARDS, i),
                 Term(TermKind.VISCOUS, i),
                 *(Term(TermKind.MODEL, -1, k) for k in range(data.more.shape[2]))]
        columns = np.concatenate(
            (data.columns(terms)[used, i], data.stribeck[used, i, ::len(STRIBECK) // 3],
             data.bent[used, i]), axis=1)
        return orthonormal(columns, 1e-7)

    def torque(self, part: Stretch, rows: Rows, delay: float = 0.0, lag: Array | float = 0.0,
               rate: Array | float = np.inf) -> Array:
        """Return the weak torque of a stretch, nan where it is not known."""
        values = has(part, self._source)
        assert values is not None
        known = np.isfinite(values)
        filled = values if known.all() else np.where(known, values, 0.0)
        found = weak_torque(filled, delay, np.asarray(lag), part.period, self._phi, rows.centres,
                            rate)
        if not known.all():
            reach = self._phi.sums((~known).astype(float), np.ones(2 * self._phi.half + 1),
                                   rows.centres)
            found = np.where(reach > 0.0, np.nan, found)
        return found

    def bent(self, part: Stretch, rows: Rows, delay: float = 0.0, lag: Array | float = 0.0
             ) -> Array:
        """Return the weak sgn(tau) and tau |tau| of a stretch, shape (J, n, 2)."""
        values = has(part, self._source)
        assert values is not None
        found = []
        for x, late in zip(values.T, np.broadcast_to(lag, values.shape[1])):  # For long series.
            sign, x = np.sign(np.nan_to_num(x)), np.nan_to_num(x)
            # Of commands that chatter neither shows.
            calm = (np.diff(sign) != 0.0).sum() < _CHATTERS * part.period * len(x)
            found.append(weak_torque(calm * np.column_stack((sign, x * np.abs(x))), delay,
                                     np.asarray(late), part.period, self._phi, rows.centres))
        return np.stack(found, axis=1)

    def windows(self, at: Timing) -> Data:
        """Return all windows with the torques of a timing."""
        pairs = list(zip(self._parts, self._rows))
        rate = at.rate[1]
        torques = [self.torque(part, rows, at.delay, at.lag, rate) for part, rows in pairs]
        step = np.where(at.lag > 0.0, _LAG_STEP * at.lag, 1.0)
        later = at.lag + step * (at.lag > 0.0)
        late = [(self.torque(part, rows, at.delay, later, rate) - tau) / step
                for (part, rows), tau in zip(pairs, torques)] if at.lag.any() else None
        return Data.of(self._rows, torques, late, [
            self.bent(part, rows, at.delay, at.lag) for part, rows in pairs])

    def unexplained(self, torque: Array, i: int) -> Array:
        """Return what is left of torques of joint i in its rows, shape (rows, ...) [N·m]."""
        rest: Array = torque - self._bases[i] @ (self._bases[i].T @ torque)
        return rest

    def squares(self, delay: float) -> Array:
        """Return the sum of squares of each joint without a lag, shape (n,) [(N·m)²]."""
        y = np.concatenate([self.torque(part, rows, delay) - rows.base
                            for part, rows in zip(self._parts, self._rows)])
        y = np.where(np.isfinite(y), y, 0.0)
        return np.array([np.square(self.unexplained(y[used, i], i)).sum()
                         for i, used in enumerate(self.data.used().T)])


def timing(parts: Sequence[Stretch], rows: Sequence[Rows], source: str, phi: TestFunction
           ) -> Timing:
    """
    Return when the torque of a source acts.

    Parameters
    ----------
    parts, rows
        Stretches that have it, and their windows.
    source : str
        `command`, or `effort`, which needs no lag: it is that of the drive.
    phi : TestFunction
        φ.

    """
    if source == COMMAND:
        return _of_commands(*pieces(parts, rows, phi), phi)
    profile = Profile(parts, rows, source, phi)
    moving: Flags = profile.count >= _FEWEST
    table = np.array([profile.squares(delay) for delay in _ALIGNMENTS])
    scale = np.where(moving, table.min(axis=0), 1.0)
    best = int(np.argmin(np.where(moving, table / scale, 0.0).sum(axis=1)))
    n = len(moving)
    return Timing(source, _ALIGNMENTS[best], np.zeros(n), np.full(n, np.inf), {},
                  table[best] / np.maximum(profile.count, 1), _any_rate(n), moving)


def pieces(parts: Sequence[Stretch], rows: Sequence[Rows], phi: TestFunction
           ) -> tuple[list[Stretch], list[Rows]]:
    """Return stretches, or evenly distributed pieces of them, and their windows."""
    period = parts[0].period
    duration = period * sum(len(part.q) for part in parts)
    if duration <= 1.2 * _ENOUGH:
        return list(parts), list(rows)
    found: list[tuple[Stretch, Rows]] = []
    length = round(_PIECE / period)
    settled = phi.half + round(SETTLING / period)
    for part, mine in zip(parts, rows):
        count = max(1, round(_ENOUGH / _PIECE * len(part.q) * period / duration))
        for first in np.linspace(0, max(len(part.q) - length, 0), count).astype(int):
            last = min(first + length, len(part.q))
            use = (mine.centres >= first + settled) & (mine.centres < last - settled)
            if use.any():
                found.append((part.cut(int(first), int(last)), mine.cut(use, int(first))))
    return [part for part, _ in found], [mine for _, mine in found]


def _any_rate(n: int) -> Array:
    """Return rate limits of which nothing is known, shape (3, n) [N·m/s]."""
    return np.tile(np.array([[0.0], [np.inf], [np.inf]]), n)


def _of_commands(parts: Sequence[Stretch], rows: Sequence[Rows], phi: TestFunction) -> Timing:
    """Return the timing of commands."""
    profile = Profile(parts, rows, COMMAND, phi)
    moving: Flags = profile.count >= _FEWEST
    n = len(moving)
    if not moving.any():
        return Timing(COMMAND, 0.0, np.zeros(n), np.full(n, np.inf), {}, np.zeros(n),
                      _any_rate(n), moving)
    late = [min(part.late[0] for part in parts), max(part.late[1] for part in parts)]
    uneven = late[1] - late[0] > _UNEVEN
    # What commands in wrong places do to the torque is not a shift alone.
    far = _FARTHER if uneven else 1.0
    shifts = sorted({max(far * late[0], -1.0), 0.0, min(far * late[1], 1.0)})
    most = min(_MOST, int(_LONGEST / profile.period))
    alone = np.array([profile.squares(delay) for delay in range(most + 1)])
    scale = np.where(moving & (alone.min(axis=0) > 0.0), alone.min(axis=0), np.inf)
    # A lag can only take the place of a part of the delay that is best without one.
    last = min(most, int(np.argmin((alone / scale).sum(axis=1))) + _ABOVE)
    found = DriveProfile(parts, rows, profile.data, profile.unexplained, phi, range(-1, last + 2),
                         moving, shifts, uneven).found(None if uneven else _fastest(parts))
    if uneven:
        for lags_of in found.delays.values():
            margin = far * (late[1] - late[0]) * profile.period * moving
            lags_of[0] = np.maximum(lags_of[0] - margin, 0.0)
            lags_of[2] += margin
    mine = found.delays[found.best]
    error = np.where(moving & (len(found.delays) == 1), 0.25 * (mine[2] - mine[0]), np.inf)
    # Where delay and lag may be nearly anything, a rate limit stands for something else.
    wide = max(found.delays) - min(found.delays) > Kind.DELAYS.care or max(
        float(np.ptp(x[:, moving], axis=0).max()) for x in found.delays.values()) > _WIDE
    return Timing(COMMAND, float(found.best), mine[1], error, found.delays, found.misfit,
                  _any_rate(n) if wide else found.rate, moving)


def _fastest(parts: Sequence[Stretch]) -> Array:
    """Return the fastest change of the commands of each joint, shape (n,) [N·m/s]."""
    # Joint by joint, for long series.
    found: Array = np.max([[np.nan_to_num(np.abs(np.diff(x))).max() / part.period
                            for x in np.asarray(has(part, COMMAND)).T] for part in parts], axis=0)
    return found


#: Part of the longest lag that is looked for that counts as it.
_END = 0.97
#: Up to so many delays each is said with its lags.
_EACH = 2
_EXCITE = 'record a motion of `ctc excite`, longer or faster'


def rate_limits(timing: Timing, joints: Sequence[str]) -> list[Estimate]:
    """Return the rate limit of each drive, or what it is at least."""
    known = timing.of_commands
    if known is None:
        return [Estimate.none('no commanded torque in the bag')] * len(joints)
    found = []
    longest = np.max([lags[2] for lags in known.delays.values()] or [known.lag], axis=0)
    for (low, _, high), moving, lag in zip(known.rate.T, known.moving, longest):
        if lag >= _END * LAGS[-1]:
            found.append(Estimate.none('delay and lag of the drive are not identifiable'))
        elif np.isfinite(high):
            found.append(Estimate(float(0.5 * (low + high)), float(0.5 * (high - low)),
                                  'N*m/s'))
        elif moving and low > 0.0:
            found.append(Estimate.none(f'at least {low:.3g} N*m/s: the drive follows commands '
                                       'that change so fast'))
        else:
            found.append(Estimate.none('no command changes fast enough, or delay and lag are '
                                       'not identified, or commands are missing'))
    return found


def timing_findings(timing: Timing, joints: Sequence[str], late: tuple[float, float]
                    ) -> Iterator[Finding]:
    """
    Yield what is doubtful of delay and lag.

    Parameters
    ----------
    timing : Timing
        As identified.
    joints : sequence of str
        Names.
    late : (float, float)
        Samples by which commands may be later than the recording has them.

    """
    known = timing.of_commands
    if known is None or not known.delays:
        return
    if late[1] > late[0]:
        yield Finding(Kind.NOTE, ALL_JOINTS, 'commands have no stamps, and arrived at the '
                      f'recorder unevenly: by up to {max(-late[0], late[1]):.2g} samples their '
                      'delay is uncertain')
    delays = sorted(known.delays)
    if len(delays) > 1:
        far = known.unsure
        yield Finding(Kind.DELAYS, ALL_JOINTS,
                      f'delay and lag are not told apart: {drives_in_words(known, joints)}' + (
                          '; backlash or an elastic joint looks like that' if far else ''),
                      _EXCITE if far else '', max(delays) - min(delays))
    lags = np.array(list(known.delays.values()))
    for i in np.flatnonzero(known.moving):
        low, high = float(lags[:, 0, i].min()), float(lags[:, 2, i].max())
        if high < _END * LAGS[-1]:
            continue
        if low > 0.0:
            yield Finding(
                Kind.LONGEST_LAG, int(i), f'the lag of the drive is {1e3 * low:.3g} ms or more, '
                f'at the end of what is looked for ({1e3 * LAGS[-1]:.3g} ms): an inertia that the '
                'model lacks, such as that of a rotor, or an elastic joint looks like that',
                'correct the inertia of the model, or measure the torque of the drive',
                low)
        else:
            yield Finding(Kind.LONGEST_LAG, int(i), 'the lag of the drive is not identifiable: up '
                          f'to {1e3 * LAGS[-1]:.3g} ms fit', _EXCITE, low)


def drives_in_words(timing: Timing, joints: Sequence[str]) -> str:
    """Return each delay that is possible with its lags; of many delays what holds them all."""
    if len(timing.delays) > _EACH:
        lags = np.array(list(timing.delays.values()))[:, :, timing.moving]
        return (f'delays of {min(timing.delays)} to {max(timing.delays)} samples, with lags of '
                + milliseconds(np.array((lags[:, 0].min(), 0.0, lags[:, 2].max()))))
    texts = []
    for delay, lags in sorted(timing.delays.items()):
        each = [(name, milliseconds(x)) for name, x, moving in zip(
            joints, lags.T, timing.moving) if moving]
        same = len({text for _, text in each}) == 1
        said = each[0][1] if same else ', '.join(f'{text} ({name})' for name, text in each)
        texts.append(f'delay {delay} with lag {said}')
    return ', or '.join(texts)


def milliseconds(lag: Array) -> str:
    """Return the lowest, best and highest lag, shape (3,) [s], in words."""
    low, high = 1e3 * float(lag[0]), 1e3 * float(lag[2])
    return f'{low:.3g} to {high:.3g} ms'


def lag_in_words(timing: Timing, i: int) -> str:
    """Return the lag of the drive of joint i, with its interval at the most likely delay."""
    known = timing.of_commands
    if known is None or not known.delays or not known.moving[i]:
        return 'not identifiable'
    lag = known.delays[int(known.delay)][:, i]
    one = len(known.delays) == 1
    if lag[1] == 0.0 and one:
        return f'none, at most {1e3 * lag[2]:.2g} ms'
    return milliseconds(lag) + ('' if one else f' with delay {int(known.delay)}')


#: Time on each side of the centre of a window [s].
_HALF = 0.015
#: Poses at which the inertia is looked up.
_POSES = 20


class ShortWindows(NamedTuple):
    """
    P in short windows; K of them, n joints.

    Attributes
    ----------
    perturbation : ndarray, shape (K, n)
        Torque less the model's, whether joints slide or not [N·m]. Where the delay is not sure,
        the larger one of that with and without it.
    nearest : ndarray of int, shape (K,)
        The window of the regression that is nearest.
    noise : ndarray, shape (n,)
        Deviation of P that noise of the sensors makes [N·m]. Vibration is none.

    """

    perturbation: Array
    nearest: Indices
    noise: Array

    @classmethod
    def of(cls, parts: Sequence[Stretch], rows: Sequence[Rows], models: Sequence[Model],
           timing: Timing) -> ShortWindows:
        """Return those of stretches, with the rows of the regression there."""
        period = parts[0].period
        phi = TestFunction(period, period * sum(len(x.q) for x in parts), _HALF)
        short = [Rows.of(part, model, phi) for part, model in zip(parts, models)]
        profile = Profile(parts, short, timing.source, phi)
        found = profile.windows(timing).residual
        if timing.source == COMMAND and timing.unsure:
            at_once = profile.data.residual
            found = np.where(np.abs(at_once) > np.abs(found), at_once, found)
        nearest, before = [], 0
        for row, other in zip(rows, short):
            middle = 0.5 * (row.centres[1:] + row.centres[:-1])
            nearest.append(before + np.searchsorted(middle, other.centres))
            before += len(row.t)
        return cls(found, np.concatenate(nearest),
                   np.max([_noise(part, model, phi, timing.source)
                           for part, model in zip(parts, models)], axis=0))


def _noise(part: Stretch, model: Model, phi: TestFunction, source: str) -> Array:
    """Return the deviation of P that noise of the sensors makes, shape (n,) [N·m]."""
    # As with velocities by differences: of white noise, h φ' twice differentiated.
    weights = np.convolve(phi.slope, (0.5, 0.0, -0.5)) / phi.period
    one = position_noise(part.q, phi.period) * float(np.linalg.norm(weights))
    still = np.zeros(part.q.shape[1])
    some = part.q[::max(1, len(part.q) // _POSES)]
    found: Array = np.max([np.square(model.evaluate(q, still)[0]) @ np.square(one)
                           for q in some], axis=0)
    if source == EFFORT and part.effort is not None:
        # Joint by joint, for long series.
        torque = np.array([median_abs_deviation(np.diff(np.nan_to_num(x), 2), scale='normal')
                           for x in part.effort.T]) / np.sqrt(6.0)
        found = found + np.square(np.linalg.norm(phi.at) * torque)
    return np.asarray(np.sqrt(found))
