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

"""A recorded run as arrays, checked, and its parts without gaps on a regular grid of time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses

from ctc_chattering.analysis.time_stamps import Indices, ordered, StampBreak
from ctc_chattering.arguments import checked
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.spline import interpolated
import numpy as np

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


@checked(name=str, joints=Sequence, t=np.ndarray, q=np.ndarray,
         **dict.fromkeys(('dq', 'effort', 'command'), (np.ndarray, type(None))), late=Sequence,
         breaks=Sequence)
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


@checked(recording=Recording, description=str, controller=(ControllerConfig, type(None)),
         notes=Sequence)
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
