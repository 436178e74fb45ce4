"""
When a torque acts: whole samples of delay and the first-order lag of each drive.

Both are scanned: for each delay and lag the regression is solved for all else, and the sum of
squares that is left is the profile of the likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from math import nan

from ctc_chattering.analysis.recording import Stretch
from ctc_chattering.identification.regression.intervals import correlation_length
from ctc_chattering.identification.regression.least_squares import Data, Term, TermKind
from ctc_chattering.identification.regression.rows import Rows, STRIBECK
from ctc_chattering.identification.regression.torque import COMMAND, EFFORT, has, weak_torque
from ctc_chattering.identification.regression.weak_form import TestFunction
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt

Flags = npt.NDArray[np.bool_]
#: Longest delay that is looked for [samples], and [s].
_MOST, _LONGEST = 20, 0.05
#: Lags of the scan [s].
_LAGS = (0.0, *(0.0003 * 1.5 ** k for k in range(12)))
#: Steps of the search between them.
_STEPS = 18
#: Twice the logarithm of the likelihood ratio that a delay or a lag must be better by.
_CLEAR = 12.0
#: What a lag costs in the same measure: the logarithm of some hundred independent windows.
_PER_LAG = 7.0
#: Alignments of a measured effort: of the period before, at the instant, of the period after.
_ALIGNMENTS = (-1.0, -0.5, 0.0)
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
    delays : dict of int to ndarray, shape (n,)
        The delays that the data allow with their lags [s]; one if it is identified.
    misfit : ndarray, shape (n,)
        Mean square that is left in each joint [(N·m)²].
    commands : Timing or None
        That of the commands, where the source is the effort; None without commands.

    """

    source: str
    delay: float
    lag: Array
    lag_error: Array
    delays: dict[int, Array]
    misfit: Array
    commands: Timing | None = None

    @property
    def drive(self) -> tuple[float, Array, Array]:
        """Delay [samples], lag and its error [s] from the command on; nan where not known."""
        known = self if self.source == COMMAND else self.commands
        if known is None:
            return nan, np.zeros_like(self.lag), np.full_like(self.lag, np.inf)
        return known.delay, known.lag, known.lag_error


class Profile:
    """Sums of squares of each joint over delay and lag, with all else fitted."""

    def __init__(self, parts: Sequence[Stretch], rows: Sequence[Rows], source: str,
                 phi: TestFunction) -> None:
        self._parts, self._rows, self._source, self._phi = parts, rows, source, phi
        self.period = parts[0].period
        self.data = data = Data.of(rows, [self.torque(part, row, 0.0, 0.0)
                                          for part, row in zip(parts, rows)])
        self.count = data.used().sum(axis=0)
        self._bases = [self._basis(i) for i in range(data.way.shape[1])]

    def _basis(self, i: int) -> Array:
        """Return an orthonormal basis of what explains the torque of joint i."""
        data, used = self.data, self.data.used()[:, i]
        terms = [Term(TermKind.FORWARDS, i), Term(TermKind.BACKWARDS, i),
                 Term(TermKind.VISCOUS, i),
                 *(Term(TermKind.MODEL, -1, k) for k in range(data.more.shape[2]))]
        columns = np.concatenate(
            (data.columns(terms)[used, i], data.stribeck[used, i, ::len(STRIBECK) // 3]), axis=1)
        length = np.sqrt(np.square(columns).sum(axis=0))
        u, s, _ = np.linalg.svd(columns / np.where(length > 0.0, length, 1.0),
                                full_matrices=False)
        found: Array = u[:, s > 1e-7 * s.max(initial=1.0)]
        return found

    def torque(self, part: Stretch, rows: Rows, delay: float, lag: float | Array) -> Array:
        """Return the weak torque of a stretch, nan where it is not known."""
        values = has(part, self._source)
        assert values is not None
        known = np.isfinite(values)
        filled = np.where(known, values, 0.0)
        found = weak_torque(filled, delay, np.asarray(lag), part.period, self._phi, rows.centres)
        if not known.all():
            reach = self._phi.sums((~known).astype(float), np.ones(2 * self._phi.half + 1),
                                   rows.centres)
            found = np.where(reach > 0.0, np.nan, found)
        return found

    def windows(self, at: Timing) -> Data:
        """Return all windows with the torques of a timing."""
        pairs = list(zip(self._parts, self._rows))
        torques = [self.torque(part, rows, at.delay, at.lag) for part, rows in pairs]
        step = np.where(at.lag > 0.0, _LAG_STEP * at.lag, 1.0)
        late = [(self.torque(part, rows, at.delay, at.lag + step * (at.lag > 0.0)) - tau) / step
                for (part, rows), tau in zip(pairs, torques)] if at.lag.any() else None
        return Data.of(self._rows, torques, late)

    def weak(self, delay: float, lag: float | Array) -> Array:
        """Return the residual torque of all windows, shape (J, n); 0 in rows not used."""
        y = np.concatenate([self.torque(part, rows, delay, lag) - rows.base
                            for part, rows in zip(self._parts, self._rows)])
        return np.where(self.data.used() & np.isfinite(y), y, 0.0)

    def rest(self, y: Array, i: int) -> Array:
        """Return what is left of joint i, in its rows."""
        mine = y[self.data.used()[:, i], i]
        rest: Array = mine - self._bases[i] @ (self._bases[i].T @ mine)
        return rest

    def squares(self, delay: float, lag: float | Array) -> Array:
        """Return the sum of squares of each joint, shape (n,) [(N·m)²]."""
        y = self.weak(delay, lag)
        return np.array([np.square(self.rest(y, i)).sum() for i in range(y.shape[1])])

    def correlation(self, delay: float, lag: Array) -> Array:
        """Return over how many windows the residuals of each joint correlate, shape (n,)."""
        y = self.weak(delay, lag)
        return np.array([correlation_length(self.rest(y, i)) if self.count[i] > 2 else 1.0
                         for i in range(y.shape[1])])


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
    profile = Profile(parts, rows, source, phi)
    n = len(profile.count)
    moving: Flags = profile.count >= _FEWEST
    if source == EFFORT:
        table = np.array([profile.squares(delay, 0.0) for delay in _ALIGNMENTS])
        scale = np.where(moving, table.min(axis=0), 1.0)
        best = int(np.argmin(np.where(moving, table / scale, 0.0).sum(axis=1)))
        return Timing(source, _ALIGNMENTS[best], np.zeros(n), np.full(n, np.inf), {},
                      table[best] / np.maximum(profile.count, 1))
    most = min(_MOST, int(_LONGEST / profile.period))
    alone = np.array([profile.squares(delay, 0.0) for delay in range(most + 1)])
    scale = np.where(moving & (alone.min(axis=0) > 0.0), alone.min(axis=0), np.inf)
    # A lag can only take the place of a part of the delay that is best without one.
    delays = range(min(most, int(np.argmin((alone / scale).sum(axis=1))) + 2) + 1)
    table = np.array([[profile.squares(delay, lag) for delay in delays] for lag in _LAGS])
    return _of_commands(profile, table, moving)


def _of_commands(profile: Profile, table: Array, moving: Flags) -> Timing:
    """Return the timing of commands from sums of squares, shape (lags, delays, n)."""
    least = table.min(axis=(0, 1))
    scale = np.where(moving & (least > 0.0), least, np.inf)
    coarse = (table / scale).min(axis=0).sum(axis=1)
    best = int(np.argmin(coarse))
    found = {d: _lags(profile, d, table[:, d], moving)
             for d in range(max(0, best - 2), min(len(coarse), best + 3))}
    sums = {d: np.where(moving, squares, 0.0) for d, (_, squares) in found.items()}
    best = min(sums, key=lambda d: float((sums[d] / scale).sum()))
    lag, squares = found[best]
    noise = np.where(moving, squares / np.maximum(profile.count, 1), 1.0) * np.where(
        moving, profile.correlation(best, lag), 1.0)
    noise = np.where(noise > 0.0, noise, np.inf)
    shown = {d: moving & ((table[0, d] - squares) / noise > _CLEAR)
             for d, (_, squares) in found.items()}
    # A lag that another delay makes superfluous must explain more than its part in chance.
    cost = {d: float((sums[d] / noise).sum()) + _PER_LAG * int(shown[d].sum()) for d in sums}
    best = min(cost, key=lambda d: cost[d])
    lag, squares = found[best]
    allowed = {d: np.where(shown[d], found[d][0], 0.0)
               for d in cost if cost[d] - cost[best] < _CLEAR}
    error = _lag_errors(profile, best, lag, noise)
    return Timing(COMMAND, float(best), allowed[best],
                  np.where(moving & (len(allowed) == 1), error, np.inf), allowed,
                  squares / np.maximum(profile.count, 1))


def _lags(profile: Profile, delay: int, squares: Array, moving: Flags) -> tuple[Array, Array]:
    """Return the best lag of each joint, shape (n,) [s], and its sum of squares."""
    n = squares.shape[1]
    at = np.argmin(squares, axis=0)
    grid = np.array([*_LAGS, 1.5 * _LAGS[-1]])
    low, high = grid[np.maximum(at - 1, 0)], grid[at + 1]
    golden = 0.5 * (5.0 ** 0.5 - 1.0)
    a, b = high - golden * (high - low), low + golden * (high - low)
    fa, fb = profile.squares(delay, a), profile.squares(delay, b)
    for _ in range(_STEPS):
        left = fa < fb
        low, high = np.where(left, low, a), np.where(left, b, high)
        a_new = np.where(left, high - golden * (high - low), b)
        b_new = np.where(left, a, low + golden * (high - low))
        fresh = profile.squares(delay, np.where(left, a_new, b_new))
        fa, fb = np.where(left, fresh, fb), np.where(left, fa, fresh)
        a, b = a_new, b_new
    lag, best = 0.5 * (low + high), np.minimum(fa, fb)
    none = squares[0] <= best
    return np.where(none | ~moving, 0.0, lag), np.where(none, squares[0], best).reshape(n)


def _lag_errors(profile: Profile, delay: int, lag: Array, noise: Array) -> Array:
    """Return the standard error of each lag from the sensitivity of the torque, shape (n,)."""
    step = np.maximum(0.05 * lag, 2e-5)
    change = (profile.weak(delay, lag + step) - profile.weak(delay, lag)) / step
    power = np.array([np.square(profile.rest(change, i)).sum() for i in range(len(lag))])
    return np.sqrt(np.where(power > 0.0, noise / np.where(power > 0.0, power, 1.0), np.inf))
