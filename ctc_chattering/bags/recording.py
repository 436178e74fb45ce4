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
A recorded run as arrays, checked: stamps, commands without stamps, and parts without gaps.

Late messages are put in order; stamps that have no one period are refused (`ordered`). Commands
find the states that they answer (`answers`). What remains is put on a regular grid of time
(`stretches`).
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

#: States of which most must be closer than this part of two periods to the second one after them
#: to be those of two series.
_CROWD, _CLOSE = 21, 0.625
#: Longest step between two states that stand together [periods], and the fewest of these.
_FEW = 20


def ordered(name: str, t: Array, *contents: Array, period: float | None = None) -> Indices:
    """
    Return the indices of the states that are used, in the order of time, each stamp once.

    Late messages are put where they belong. Few states that are far from all others, as with a
    wrong stamp, are left out.

    Parameters
    ----------
    name : str
        Of the recording.
    t : ndarray, shape (N,)
        Stamps in the order of arrival [s].
    contents : ndarray, each of shape (N, m)
        What the states say; those that repeat a stamp and say the same are dropped.
    period : float, optional
        Between two states [s]; without it, the one that most of them have.

    Raises
    ------
    CtcError
        If the stamps are those of two series, as of two publishers, or after a clock was set back.

    """
    found: Indices = np.argsort(t, kind='stable')
    repeated = np.diff(t[found]) == 0.0
    for column in (column for values in contents for column in values.T):
        repeated &= column[found[1:]] == column[found[:-1]]
    found = found[np.append(True, ~repeated)]
    usual = period or _usual_step(t[found])
    each = np.unique(t)
    found = found[~np.isin(t[found], each[alone(each, usual)])]
    stamps = t[found]
    two = stamps[2:] - stamps[:-2]
    crowded = median_filter(two, _CROWD) < 2.0 * _CLOSE * usual
    if period is None:
        crowded |= _alternating(np.diff(stamps), two)
    if crowded.any():
        raise CtcError(
            f'{name}: {stamps[int(crowded.argmax())] - stamps[0]:.4g} s after the first, states '
            f'stand closer than the period of {usual:.3g} s: was a clock set back, are there two '
            'publishers of joint states, or are stamps coarser than the period? Record it again')
    return found[np.diff(stamps, prepend=-np.inf) > 0.0]


def _usual_step(stamps: Array) -> float:
    """Return the median step of sorted stamps, without those that repeat; inf for none."""
    step = np.diff(stamps)
    return float(np.median(step[step > 0.0])) if (step > 0.0).any() else np.inf


def _alternating(step: Array, two: Array) -> npt.NDArray[np.bool_]:
    """
    Return where states are those of two series with the period h, if these are the most.

    Their steps are a, h - a, a, h - a, ...

    Parameters
    ----------
    step, two : ndarray, shape (N - 1,) and (N - 2,)
        From each state to the next one, and to the one after it [s].

    """
    often: npt.NDArray[np.bool_] = two <= 2.0 * _CLOSE * np.median(two)
    changes = (np.abs(np.diff(step)) > 0.1 * two)[often]
    is_even = np.ptp(np.percentile(two[often], (10.0, 90.0))) < 0.4 * np.median(two)
    return often & bool(changes.mean() > 0.8 and is_even)


def alone(t: npt.NDArray[Any], period: float) -> npt.NDArray[np.bool_]:
    """Return which of sorted stamps are few, with long steps before and after them."""
    edges = [0, *(np.flatnonzero(np.diff(t) > _FEW * period) + 1).tolist(), len(t)]
    found = np.zeros(len(t), bool)
    for first, last in pairwise(edges):
        found[first:last] = len(edges) > 2 and last - first < _FEW
    return found


#: Commands on each side over which their count is taken, part by which their number may differ
#: from that of the samples for that, and part of all whose times may tell another state.
_COUNTED, _ONE_FOR_ONE, _DOUBTFUL = 200, 0.02, 0.35
#: Part of a period by which a command may be received before its state, part from the usual time
#: after a state beyond which it is not sure which one it answers, and part of all for which that
#: does not matter.
_EARLY, _SURE, _NEGLIGIBLE = 0.02, 0.35, 0.002
#: Length of the mean direction of the times after a state, on a circle, below which there is no
#: usual one.
_USUAL = 0.3
#: Periods after which a command is no longer held, and difference of two that are alike [N·m].
_HELD, _ALIKE = 20, 1e-9


class Answers(NamedTuple):
    """
    Commands in the places of the states.

    Attributes
    ----------
    command : ndarray, shape (N, n)
        In force after each state [N·m], nan where it is unknown.
    late : tuple of (float, float)
        Samples by which they may be later than they stand here, at least and at most.
    own : ndarray of bool, shape (N,)
        Whether just one answers this state, or several that are alike.

    """

    command: Array
    late: tuple[float, float]
    own: npt.NDArray[np.bool_]

    def where(self, rows: Indices) -> Answers:
        """Return the commands of some states."""
        return self._replace(command=self.command[rows], own=self.own[rows])


def answers(values: Array, times: Indices, stamps: Indices, received: Indices) -> Answers:
    """
    Return the commands in the places of the states that they answer.

    A command has no stamp. It answers the state after which it is received by about the usual
    time, which is less than a period. Where there is one for each sample they answer one by one,
    so that it does not matter by how much single messages are late, nor, in lockstep, how long
    answers take; the times tell only which is the first. Several for one state, of a controller
    that is faster, are averaged; where there is none for a state, the last one is held.

    Parameters
    ----------
    values : ndarray, shape (M, n)
        Commands [N·m].
    times : ndarray, shape (M,)
        At which they were received [ns].
    stamps, received : ndarray, shape (N,)
        Stamps of the states, and times at which they were received, in this order [ns].

    """
    values, place, numbers, unsure = _matched(values, times, stamps, received)
    return _placed(values, place, numbers, unsure if unsure > _NEGLIGIBLE else 0.0)


def _matched(values: Array, times: Indices, stamps: Indices, received: Indices
             ) -> tuple[Array, Array, Indices, float]:
    """Return commands in order, the number of the state of each, those of states, and a doubt."""
    step = np.diff(stamps)
    period = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    # Numbers of the states, counting those that were not recorded.
    numbers = np.append(0, np.cumsum(np.maximum(np.rint(step / period), 1.0))).astype(int)
    got = np.maximum.accumulate(received - received[0])
    wall = max(float(np.median(np.diff(got, append=got[-1] + 1))), 1.0)
    order = np.argsort(times, kind='stable')
    sent = times[order] - received[0]
    inside = (sent > -0.5 * wall) & (sent < got[-1] + 2.0 * wall)
    values, sent = _taken(values, order[inside]), sent[inside]
    again = np.append(False, (values[1:] == values[:-1]).all(axis=1))
    if 0 < len(sent) - len(got) == again.sum() and np.array_equal(received, stamps):
        values, sent = values[~again], sent[~again]  # Of lockstep, repeated.
    heard = np.interp(sent, np.r_[-wall, got, got[-1] + wall], np.r_[-1, numbers, numbers[-1] + 1])
    turn = complex(np.exp(2j * np.pi * heard).sum()) / max(len(heard), 1)
    is_usual = abs(turn) > _USUAL
    phase = (np.angle(turn) / (2.0 * np.pi) + _EARLY) % 1.0 - _EARLY if is_usual else 0.5
    place = np.floor(heard - phase + 0.5)
    far = (np.abs(heard - phase - place) > _SURE) | (np.diff(place, prepend=-np.inf) < 1.0)
    unsure = float(far.mean()) if is_usual and len(far) else 1.0
    count = np.arange(len(place))
    if len(sent) == len(got) and np.array_equal(received, stamps):
        # Of our recorder, which logs by stamps: one may have that of the state before, or after.
        place, unsure = numbers, 0.0
    elif unsure > _NEGLIGIBLE and abs(len(place) / (numbers[-1] + 1) - 1.0) < _ONE_FOR_ONE:
        ahead = place - count
        ends = tuple(np.median(x) for x in (ahead[:_COUNTED], ahead[-_COUNTED:]))
        first = median_filter(np.pad(ahead, _COUNTED, constant_values=ends), 2 * _COUNTED + 1
                              )[_COUNTED:-_COUNTED]
        by_time, place = place, count + first
        if is_usual and not np.ptp(first):  # None is missing.
            unsure = float((by_time != place).mean() > _DOUBTFUL)
    return values, place, numbers, unsure


def _placed(values: Array, place: Array, numbers: Indices, unsure: float) -> Answers:
    """
    Return for each state the mean of its commands, or those before if it has none.

    Parameters
    ----------
    values : ndarray, shape (M, n)
        Commands [N·m].
    place : ndarray, shape (M,)
        Number of the state that each answers; it may be none of them.
    numbers : ndarray, shape (N,)
        Of the states.
    unsure : float
        Part of the commands that may answer the state before or after.

    """
    which = np.searchsorted(numbers, place).clip(0, len(numbers) - 1)
    is_there = numbers[which] == place
    which = which[is_there]
    found = np.zeros((len(numbers), values.shape[1]))
    count, unlike = np.bincount(which, minlength=len(numbers)), np.zeros(len(numbers))
    last = np.maximum.accumulate(np.where(count > 0, np.arange(len(numbers)), -1))
    age = numbers - numbers[last]
    known = (last >= 0) & (age <= _HELD)
    # Joint by joint, for long series.
    for mean, column in zip(found.T, values.T):
        np.add.at(mean, which, column[is_there])
        mean /= np.maximum(count, 1)
        np.maximum.at(unlike, which, np.abs(column[is_there] - mean[which]))
        mean[:] = np.where(known, mean[last], np.nan)
    # Where a command was not recorded, one that is older stands in its place.
    older = float(age[known].mean()) if known.any() else 0.0
    return Answers(found, (-unsure - (older if older > _NEGLIGIBLE else 0.0), unsure),
                   (count > 0) & (unlike < _ALIKE))


#: Most samples missing at a stretch that are interpolated.
BRIDGED = 5
#: Part of a period by which stamps may drift from a grid, and samples over which that is seen.
_DRIFT, _SMOOTH = 0.3, 101
#: Part of a period by which stamps on a grid may differ from it: rounding.
_EVEN = 1e-5
#: Fewest samples of a run, and most velocities that are kept: they tell noise and unit only.
_FEWEST, VELOCITIES = 200, 200_000


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
    dq : ndarray, shape (M, n), or None
        Velocities of the first M ≤ N samples, at least `VELOCITIES` [rad/s]; None without any.
    effort : ndarray, shape (N, n), or None
        Torques of the same messages [N·m]; None if they have none.
    command : ndarray, shape (N, n), or None
        Torque commanded in answer to each state [N·m], nan where it is unknown; None without any.
    late : tuple of (float, float)
        Samples by which commands may be later than they stand here, at least and at most.

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

    def __post_init__(self) -> None:
        """Check the shapes."""
        shape = (*self.t.shape, len(self.joints))
        for x in (self.q, self.dq, self.effort, self.command):
            if x is not None and x.shape != shape and (
                    x is not self.dq or x.shape[1:] != shape[1:] or len(x) < VELOCITIES):
                raise CtcError(f'{self.name}: an array of shape {x.shape} is not allowed; '
                               f'allowed: {shape}, a row a sample, a column a joint')

    def checked(self) -> Recording:
        """
        Return it sorted by time, each stamp once, as `ordered` does it.

        Raises
        ------
        CtcError
            If positions are not finite, `ordered` refuses the stamps, there is no torque, or there
            are too few samples.

        """
        bad = ~np.isfinite(self.q)
        if bad.any():
            k, i = np.argwhere(bad)[0]
            raise CtcError(
                f'{self.name}: {int(bad.any(axis=1).sum())} of {len(self.t)} states have a '
                f'position that is not finite, the first of {self.joints[i]} at '
                f'{self.t[k]:.3f} s')
        keep = np.unique(self.t, return_index=True)[1]
        if len(keep) >= _FEWEST:
            keep = ordered(self.name, self.t, *(
                x for x in (self.q, self.dq) if x is not None and len(x) == len(self.t)))
        if len(keep) < _FEWEST:
            raise CtcError(f'{self.name}: {len(keep)} states; at least {_FEWEST} are needed')
        dq = None if self.dq is None else _known(self.dq, keep[keep < len(self.dq)])
        found = dataclasses.replace(
            self, t=self.t[keep], q=_taken(self.q, keep), dq=dq,
            effort=_known(self.effort, keep), command=_known(self.command, keep))
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
        grid = at[0] + period * np.arange(round(float(at[-1] - at[0]) / period) + 1)
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
    if len(t) == len(grid) and np.abs(t - grid).max() < _EVEN * period:
        return q
    place, first = np.unique(np.rint((t - grid[0]) / period), return_index=True)
    choices, rough = ((t, slice(None)), (grid[0] + period * place, first)), np.zeros(2)
    # Joint by joint, for long series.
    for i in range(q.shape[1]):
        one = q[:, i:i + 1]
        rough += [np.median(np.abs(np.diff(interpolated(at, one[rows], grid), 3, axis=0)))
                  for at, rows in choices]
    at, rows = choices[int(rough[1] < rough[0])]
    return interpolated(at, q[rows], grid)


def _without_drift(t: Array, period: float) -> Array:
    """Return stamps [s] less what they slowly drift away from a grid, if that is much."""
    turns, mean = 2.0 * np.pi * (t - t[0]) / period, np.ones(min(_SMOOTH, len(t)))
    # Not as complex numbers, for long series.
    phase = np.arctan2(*(np.convolve(x(turns), mean, 'same') for x in (np.sin, np.cos)))
    del turns
    phase = np.unwrap(phase) / (2.0 * np.pi)
    found = t - period * (phase - phase[0])
    return found if np.ptp(phase) > _DRIFT and (np.diff(found) > 0.0).all() else t
