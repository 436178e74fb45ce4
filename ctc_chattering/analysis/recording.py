"""A recorded run as arrays, checked, and its parts without gaps on a regular grid of time."""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses

from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.spline import interpolated
import numpy as np
import numpy.typing as npt

Indices = npt.NDArray[np.intp]

#: Most samples missing at a stretch that are interpolated.
BRIDGED = 5
#: Fewest samples of a run.
_FEWEST = 200
#: Part of all samples that may repeat a stamp with other contents.
_CONFLICTS = 0.01


@dataclasses.dataclass(frozen=True)
class Recording:
    """
    What a bag has of a robot's motion.

    Attributes
    ----------
    name : str
        Of the bag, for messages.
    joints : tuple of str, length n
        In the order of the columns.
    t : ndarray, shape (N,)
        Stamps of the states, in the order of their arrival [s].
    q : ndarray, shape (N, n)
        Positions [rad].
    dq, effort : ndarray, shape (N, n), or None
        Velocities [rad/s] and torques [N·m] of the same messages; None if they have none.
    command : ndarray, shape (N, n), or None
        Torque commanded in answer to each state [N·m], nan where it is unknown; None without any.

    """

    name: str
    joints: tuple[str, ...]
    t: Array
    q: Array
    dq: Array | None = None
    effort: Array | None = None
    command: Array | None = None

    def checked(self) -> Recording:
        """
        Return it sorted by time, each stamp once.

        Raises
        ------
        CtcError
            If positions are not finite, two publishers seem to have sent states, there is no
            torque, or there are too few samples.

        """
        bad = ~np.isfinite(self.q)
        if bad.any():
            k, i = np.argwhere(bad)[0]
            raise CtcError(
                f'{self.name}: {int(bad.any(axis=1).sum())} of {len(self.t)} states have a '
                f'position that is not finite, the first of {self.joints[i]} at '
                f'{self.t[k]:.3f} s')
        order = np.argsort(self.t, kind='stable')
        step = np.diff(self.t[order])
        same = step == 0.0
        other = same & (self.q[order][1:] != self.q[order][:-1]).any(axis=1)
        if other.sum() > max(1.0, _CONFLICTS * len(step)):
            raise CtcError(f'{self.name}: {int(other.sum())} stamps stand in two states with '
                           'different positions: are there two publishers of joint states?')
        keep = order[np.append(True, ~same)]
        if len(keep) < _FEWEST:
            raise CtcError(f'{self.name}: {len(keep)} states; at least {_FEWEST} are needed')
        found = Recording(
            self.name, self.joints, self.t[keep], _taken(self.q, keep), _known(self.dq, keep),
            _known(self.effort, keep), _known(self.command, keep))
        if found.effort is None and found.command is None:
            raise CtcError(f'{self.name}: no torque: neither effort in the states nor commands')
        found._check_one_publisher()
        return found

    def _check_one_publisher(self) -> None:
        """Raise `CtcError` if the stamps are those of two interleaved series."""
        step = np.diff(self.t)
        # Two series with the period h and a phase: the steps a, h - a, a, h - a, ...
        two = 0.5 * (step[:-1] + step[1:])
        uneven = np.abs(step[:-1] - step[1:]) > 0.2 * two
        if uneven.mean() > 0.8 and np.std(two) < 0.2 * np.mean(two):
            low, high = np.percentile(step, (25.0, 75.0))
            raise CtcError(f'{self.name}: the stamps have no period: steps of {low:.2e} s and '
                           f'{high:.2e} s in turn; are there two publishers of joint states?')

    @property
    def period(self) -> float:
        """Median step of the stamps, without gaps [s]."""
        step = np.diff(self.t)
        median = float(np.median(step))
        return float(np.mean(step[np.abs(step - median) < 0.5 * median]))


def _known(values: Array | None, keep: Indices) -> Array | None:
    """Return the rows `keep` of a column group; None without a finite value in each column."""
    if values is None or not np.isfinite(values).any(axis=0).all():
        return None
    return _taken(values, keep)


def _taken(values: Array, rows: Indices) -> Array:
    """Return some rows; without a copy where they follow each other."""
    if len(rows) and (np.diff(rows) == 1).all():
        return values[rows[0]:rows[-1] + 1]
    return values[rows]


@dataclasses.dataclass(frozen=True)
class Stretch:
    """
    A part of a recording without gaps, sample k at t0 + k h.

    Attributes
    ----------
    t0, period : float
        Time of the first sample, and h [s].
    q : ndarray, shape (N, n)
        Positions [rad].
    effort, command : ndarray, shape (N, n), or None
        Torques [N·m].

    """

    t0: float
    period: float
    q: Array
    effort: Array | None
    command: Array | None

    @property
    def t(self) -> Array:
        """Return the times of the samples, shape (N,) [s]."""
        return np.asarray(self.t0 + self.period * np.arange(len(self.q)), float)


def stretches(recording: Recording, period: float) -> Iterator[Stretch]:
    """
    Yield the parts of a checked recording between gaps, on a grid with the step `period` [s].

    Up to `BRIDGED` missing samples are interpolated; torques hold their last value there.
    """
    t = recording.t
    ends = np.flatnonzero(np.diff(t) > (BRIDGED + 1.5) * period) + 1
    for part in np.split(np.arange(len(t)), ends):
        if len(part) < 4:
            continue
        at = t[part]
        count = round(float(at[-1] - at[0]) / period) + 1
        grid = at[0] + period * np.arange(count)
        # As near to the stamps as one grid comes.
        near = np.rint((at - at[0]) / period)
        grid += float(np.median(at - at[0] - period * near))
        held = np.clip(np.searchsorted(at, grid + 0.5 * period) - 1, 0, len(at) - 1)
        effort, command = (None if x is None else _taken(x, part[held])
                           for x in (recording.effort, recording.command))
        yield Stretch(float(grid[0]), period, interpolated(at, recording.q[part], grid),
                      effort, command)
