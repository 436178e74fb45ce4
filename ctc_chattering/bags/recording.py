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
A recorded run as arrays, checked: the order of its stamps, and its parts without gaps.

Late messages, clocks set back and changes of the period are put in order or left out (`ordered`);
what remains is put on a regular grid of time (`stretches`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from itertools import pairwise
from typing import Any, NamedTuple

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.interpolation import interpolated
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt
from scipy.ndimage import median_filter  # type: ignore[import-untyped]

Indices = npt.NDArray[np.intp]

#: Samples around one over which its clock and its period are taken.
_AROUND = 41
#: Difference from the clock around it beyond which a stamp is of no use, step back of the clock
#: that splits [periods], and part by which a period may differ.
_FAR, _BACK, _OTHER = 100.0, 1.5, 0.25
#: Most breaks, and part of all stamps that may be of no use; with more, all are.
_MOST_BREAKS, _MOST_FAR = 20, 0.01
#: Time that is put in the place of a break [s], and periods of it at least.
_PAUSE, _PERIODS = 0.1, 20.0


class StampBreak(NamedTuple):
    """
    Where stamps do not go on as they should.

    Attributes
    ----------
    time : float
        Of the last stamp before it, since the first one [s].
    length : float
        By how much the stamps run back, or how long the part is that is left out [s].
    samples : int
        That are left out.
    reason : str
        In words.

    """

    time: float
    length: float
    samples: int
    reason: str


class StampOrder(NamedTuple):
    """
    States in the order of time.

    Attributes
    ----------
    keep : ndarray, shape (K,)
        Indices of the states that are used.
    t : ndarray, shape (K,)
        Their times [s], rising; after a break they go on with a pause.
    breaks : tuple of StampBreak
        In the order of time.

    """

    keep: Indices
    t: Array
    breaks: tuple[StampBreak, ...]


def ordered(name: str, t: Array, *contents: Array) -> StampOrder:
    """
    Return states in the order of time.

    Single late messages are put where they belong. Where a clock was set back, the states after
    it are a part of their own. A part with another period is left out.

    Parameters
    ----------
    name : str
        Of the recording.
    t : ndarray, shape (N,)
        Stamps in the order of arrival [s].
    contents : ndarray, each of shape (N, m)
        What the states say; those that repeat a stamp and say the same are dropped.

    Raises
    ------
    CtcError
        If the stamps are those of two publishers, or run back too often.

    """
    finite = np.flatnonzero(np.isfinite(t))
    by_time = finite[np.argsort(t[finite], kind='stable')]
    repeated = np.diff(t[by_time]) == 0.0
    twice = np.flatnonzero(repeated)
    for values in contents:
        repeated[twice] &= (values[by_time[twice + 1]] == values[by_time[twice]]).all(axis=1)
    arrived = np.sort(by_time[np.append(True, ~repeated)]) if len(by_time) else by_time
    stamps = t[arrived]
    if len(stamps) < 2:
        return StampOrder(arrived, stamps, ())
    step = np.diff(stamps)
    _check_one_publisher(name, step)
    period = float(np.median(step[step > 0.0])) if (step > 0.0).any() else 0.0
    # Medians do not change by single messages that are late or have a wrong stamp.
    clock = stamps - period * np.arange(len(stamps))
    far = np.abs(clock - median_filter(clock, _AROUND)) > _FAR * period
    keep = np.flatnonzero(~far)
    others = _other_periods(stamps[keep], period)
    left_out = [keep[first:last] for first, last in others]
    keep = np.delete(keep, np.r_[tuple(slice(*x) for x in others)] if others else [])
    cuts = [int(keep[k]) for k in _set_back(stamps[keep], period)] if len(keep) else []
    if not period or 2 * len(keep) < len(stamps) or len(cuts) > _MOST_BREAKS or (
            far.sum() > max(1.0, _MOST_FAR * len(stamps))):
        raise CtcError(f'{name}: the stamps stand still or run back {len(cuts)} times, and '
                       f'{len(stamps) - len(keep)} stamps stand in two states or in no order: are '
                       'there two publishers of joint states, or are stamps coarser than the '
                       'period?')
    breaks, begin = [], float(stamps[keep].min())
    for cut, end in pairwise([*cuts, len(stamps)]):
        before = float(stamps[keep[keep < cut]].max())
        after = float(stamps[keep[(cut <= keep) & (keep < end)]].min())
        back = before + period - after
        breaks.append(StampBreak(before - begin, back, 0, f'the stamps run back by {back:.3g} s'))
        stamps[cut:] += before + max(_PAUSE, _PERIODS * period) - after
    if far.any():
        breaks.append(StampBreak(
            float(np.flatnonzero(far)[0]) * period, 0.0, int(far.sum()),
            f'{far.sum()} stamps are far from those before and after them'))
    for part in left_out:
        length, inside = float(np.ptp(stamps[part])), np.diff(stamps[part])
        # Two series at once have uneven steps; their mean says more.
        typical = min(float(inside.mean()), float(np.median(inside)))
        breaks.append(StampBreak(
            float(stamps[part[0]] - begin), length, len(part),
            f'{length:.3g} s have a state every {typical:.3g} s, all else every {period:.3g} s: '
            'another period, or two clocks at once'))
    keep = keep[np.argsort(stamps[keep], kind='stable')]
    keep = keep[np.diff(stamps[keep], prepend=-np.inf) > 0.0]
    return StampOrder(arrived[keep], stamps[keep], tuple(sorted(breaks)))


def _check_one_publisher(name: str, step: Array) -> None:
    """Raise `CtcError` if steps are those of two interleaved series."""
    # Two series with the period h and a phase: the steps a, h - a, a, h - a, ...
    two = 0.5 * (step[:-1] + step[1:])
    uneven = np.abs(step[:-1] - step[1:]) > 0.2 * two
    if len(two) and uneven.mean() > 0.8 and np.ptp(np.percentile(two, (10.0, 90.0))) < (
            0.4 * np.median(two)):
        low, high = np.percentile(step, (25.0, 75.0))
        raise CtcError(f'{name}: the stamps have no period: steps of {low:.2e} s and {high:.2e} s '
                       'in turn; are there two publishers of joint states?')


def _regions(mask: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return where a mask is set, as first and last plus one of each run of indices."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(int)))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]


def _other_periods(t: Array, period: float) -> list[tuple[int, int]]:
    """Return first and last plus one of the states of each part that has another period."""
    step = np.diff(t)
    if len(step) < 4 * _AROUND:
        return []
    slow = median_filter(step, _AROUND) > (1.0 + _OTHER) * period
    # Two series at once have uneven steps, two of which are a period.
    fast = median_filter(t[2:] - t[:-2], _AROUND) < 2.0 * (1.0 - _OTHER) * period
    other = np.zeros(len(t), bool)
    other[:-1] |= slow
    other[1:] |= slow
    other[1:-1] |= fast
    return _regions(other)


def _set_back(t: Array, period: float) -> list[int]:
    """Return the first states after which the clock is behind what it was."""
    clock = median_filter(t - period * np.arange(len(t)), _AROUND)
    at, half = np.arange(1, len(t)), _AROUND // 2
    ahead = clock[np.minimum(at + half, len(t) - 1)] - clock[np.maximum(at - 1 - half, 0)]
    step = np.diff(t)
    return [first + 1 + int(np.argmin(step[first:last]))
            for first, last in _regions(ahead < -_BACK * period)]


def alone(t: npt.NDArray[Any], gap: float, few: int) -> npt.NDArray[np.bool_]:
    """Return which of sorted stamps are less than `few` between steps of more than `gap`."""
    edges = [0, *(np.flatnonzero(np.diff(t) > gap) + 1).tolist(), len(t)]
    found = np.zeros(len(t), bool)
    for first, last in pairwise(edges):
        found[first:last] = len(edges) > 2 and last - first < few
    return found


#: Most samples missing at a stretch that are interpolated.
BRIDGED = 5
#: Mean age of commands that does not matter [samples].
_NEGLIGIBLE = 0.002
#: Jitter of stamps that does not matter [periods].
_EVEN = 0.02
#: Part of a period by which stamps may drift from a grid, and samples over which that is seen.
_DRIFT, _SMOOTH = 0.3, 101
#: Fewest samples of a run.
_FEWEST = 200


@dataclasses.dataclass(frozen=True)
class Recording:
    """
    What was recorded of a robot's motion; N samples, n joints.

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
    late : tuple of (float, float)
        Samples by which commands may be later than they stand here, at least and at most.
    breaks : tuple of StampBreak
        Where the stamps do not go on; known of a checked one.

    Raises
    ------
    CtcError
        If an array has another type or shape.

    """

    name: str
    joints: tuple[str, ...]
    t: Array
    q: Array
    dq: Array | None = None
    effort: Array | None = None
    command: Array | None = None
    late: tuple[float, float] = (0.0, 0.0)
    breaks: tuple[StampBreak, ...] = ()

    def __post_init__(self) -> None:
        """Check the shapes."""
        shape = (*self.t.shape, len(self.joints))
        for name in ('q', 'dq', 'effort', 'command'):
            x = getattr(self, name)
            if x is not None and (self.t.ndim != 1 or x.shape != shape):
                raise CtcError(f'{name}: an array of shape {x.shape} is not allowed; allowed: '
                               f'{shape}, a row a sample, a column a joint')

    def checked(self) -> Recording:
        """
        Return it sorted by time, each stamp once, as `ordered` does it.

        Raises
        ------
        CtcError
            If positions are not finite, two publishers seem to have sent states, stamps run back
            too often, there is no torque, or there are too few samples.

        """
        bad = ~np.isfinite(self.q)
        if bad.any():
            k, i = np.argwhere(bad)[0]
            raise CtcError(
                f'{self.name}: {int(bad.any(axis=1).sum())} of {len(self.t)} states have a '
                f'position that is not finite, the first of {self.joints[i]} at '
                f'{self.t[k]:.3f} s')
        order = ordered(self.name, self.t, self.q, *([] if self.dq is None else [self.dq]))
        keep = order.keep
        if len(keep) < _FEWEST:
            raise CtcError(f'{self.name}: {len(keep)} states; at least {_FEWEST} are needed')
        found = dataclasses.replace(
            self, t=order.t, q=_taken(self.q, keep), dq=_known(self.dq, keep),
            effort=_known(self.effort, keep), command=_known(self.command, keep),
            breaks=order.breaks)
        if found.effort is None and found.command is None:
            raise CtcError(f'{self.name}: no torque: neither effort in the states nor commands')
        return found

    @property
    def period(self) -> float:
        """Median step of the stamps, without gaps [s]."""
        step = np.diff(self.t)
        median = float(np.median(step))
        return float(np.mean(step[np.abs(step - median) < 0.5 * median]))


@dataclasses.dataclass(frozen=True)
class RecordedMotion:
    """
    A recorded motion of a robot, with what is known of it.

    Attributes
    ----------
    recording : Recording
        Checked.
    description : str
        Text of the URDF; empty for none.
    controller : ControllerConfig or None
        Of the first sample, in bags of this package.
    notes : sequence of str
        What was chosen, or left out.

    Raises
    ------
    ParameterError
        If an argument is of another type.

    """

    recording: Recording
    description: str = ''
    controller: ControllerConfig | None = None
    notes: Sequence[str] = ()


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
    late : tuple of (float, float)
        Samples by which commands may be later than they stand here, at least and at most.

    """

    t0: float
    period: float
    q: Array
    effort: Array | None
    command: Array | None
    late: tuple[float, float] = (0.0, 0.0)

    def cut(self, first: int, last: int) -> Stretch:
        """Return its samples from `first` to before `last`."""
        effort, command = (None if x is None else x[first:last]
                           for x in (self.effort, self.command))
        return dataclasses.replace(self, t0=self.t0 + self.period * first,
                                   q=self.q[first:last], effort=effort, command=command)

    @property
    def t(self) -> Array:
        """Return the times of the samples, shape (N,) [s]."""
        return np.asarray(self.t0 + self.period * np.arange(len(self.q)), float)


def stretches(recording: Recording, period: float) -> Iterator[Stretch]:
    """
    Yield the parts of a checked recording without gaps, on a grid with the step `period` [s].

    Up to `BRIDGED` missing samples are interpolated; torques hold their last value there. Stamps
    that drift away from the grid, as while a clock is adjusted, are moved back.
    """
    t = recording.t
    ends = np.flatnonzero(np.diff(t) > (BRIDGED + 1.5) * period) + 1
    for part in np.split(np.arange(len(t)), ends):
        if len(part) < 4:
            continue
        at = _without_drift(t[part], period)
        count = round(float(at[-1] - at[0]) / period) + 1
        grid = at[0] + period * np.arange(count)
        # As near to the stamps as one grid comes.
        near = np.rint((at - at[0]) / period)
        grid += float(np.median(at - at[0] - period * near))
        held = np.clip(np.searchsorted(at, grid + 0.5 * period) - 1, 0, len(at) - 1)
        effort, command = (None if x is None else _taken(x, part[held])
                           for x in (recording.effort, recording.command))
        # Where a state is missing, an older command stands.
        older = float(np.mean(np.clip(np.rint((grid - at[held]) / period), 0.0, None)))
        yield Stretch(float(grid[0]), period, _at(grid, at, _taken(recording.q, part)), effort,
                      command,
                      (recording.late[0] - (older if older > _NEGLIGIBLE else 0.0),
                       recording.late[1]))


def _at(grid: Array, t: Array, q: Array) -> Array:
    """
    Return positions on a grid of times, shape (N, n) [rad].

    Stamps may jitter because states are taken at uneven times, or because they are stamped late;
    the positions are smoother with what is true.
    """
    period = grid[1] - grid[0]
    place, first = np.unique(np.rint((t - grid[0]) / period), return_index=True)
    found = interpolated(t, q, grid)
    if np.std(t[first] - grid[0] - period * place) < _EVEN * period:
        return found
    even = interpolated(grid[0] + period * place, q[first], grid)
    # Joint by joint, for long recordings.
    less = [np.median(np.abs(np.diff(y, 3))) < np.median(np.abs(np.diff(x, 3)))
            for x, y in zip(found.T, even.T)]
    return even if sum(less) > 0.5 * len(less) else found


def _without_drift(t: Array, period: float) -> Array:
    """Return stamps [s] less what they slowly drift away from a grid, if that is much."""
    turns = np.exp(2j * np.pi * (t - t[0]) / period)
    kernel = np.ones(min(_SMOOTH, len(t)))
    phase = np.unwrap(np.angle(np.convolve(turns, kernel, 'same'))) / (2.0 * np.pi)
    found = t - period * (phase - phase[0])
    return found if np.ptp(phase) > _DRIFT and (np.diff(found) > 0.0).all() else t
