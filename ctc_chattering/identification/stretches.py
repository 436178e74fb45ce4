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
Parts of a recording without gaps, on regular grids.

`split_recording` divides a checked `Recording`. The windows and the drives' timing are computed
on the result.
"""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses

from ctc_chattering.bags.command_matching import MATCHING_LIMITS
from ctc_chattering.bags.state_order import STAMP_LIMITS
from ctc_chattering.identification.recording import Recording, take_rows, take_rows_if_any
from ctc_chattering.numerics.interpolation import interpolated
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Fewest samples of a stretch: a cubic spline needs four.
_MIN_SAMPLES = 4
#: Stamps that drift from a grid by more than this are moved back.
_MAX_DRIFT_PERIODS = 0.3
#: Samples over which the drift is averaged, beyond jitter.
_DRIFT_WINDOW = 101
#: Stamps on a grid differ from it by less than this: rounding.
_ROUNDING_PERIODS = 1e-5


#: Sources of the torque: what the controller commanded, or what the drive measured.
COMMAND = 'command'
EFFORT = 'effort'


@dataclasses.dataclass(frozen=True)
class Stretch:
    """
    Part without gaps, sample k at t0 + k h.

    Attributes
    ----------
    t0 : float
        Time of the first sample [s].
    period : float
        h [s].
    q : ndarray, shape (N, n)
        Positions [rad].
    effort, command : ndarray, shape (N, n), or None
        Torques [N·m].
    late : tuple of (float, float)
        Least and largest delay of the commands beyond their rows [samples].

    """

    t0: float
    period: float
    q: Array
    effort: Array | None
    command: Array | None
    late: tuple[float, float] = (0.0, 0.0)

    def torque(self, source: str) -> Array | None:
        """Return the torques of `COMMAND` or `EFFORT`, shape (N, n), or None."""
        return self.command if source == COMMAND else self.effort

    def cut(self, first: int, last: int) -> Stretch:
        """Return its samples from `first` to before `last`."""
        rows = np.arange(len(self.q))[first:last]
        return dataclasses.replace(
            self,
            t0=self.t0 + self.period * first,
            q=take_rows(self.q, rows),
            effort=take_rows_if_any(self.effort, rows),
            command=take_rows_if_any(self.command, rows))

    @property
    def t(self) -> Array:
        """Return the times of the samples, shape (N,) [s]."""
        since = self.period * np.arange(len(self.q))
        return np.asarray(self.t0 + since, float)


def split_recording(recording: Recording, period: float) -> Iterator[Stretch]:
    """
    Yield a recording's parts without gaps, on regular grids.

    The recording is checked, and `period` is the step of a grid [s].

    Short gaps (`STAMP_LIMITS`) are interpolated, and torques hold their last value there. Stamps
    that drift away from the grid, as while a clock is adjusted, are moved back.
    """
    t = recording.t
    longest_step = (STAMP_LIMITS.max_bridged_samples + 1.5) * period
    ends = np.flatnonzero(np.diff(t) > longest_step) + 1
    for rows in np.split(np.arange(len(t)), ends):
        if len(rows) < _MIN_SAMPLES:
            continue
        stamps = _remove_drift(t[rows], period)
        grid = _fit_grid(stamps, period)
        held = np.searchsorted(stamps, grid + 0.5 * period) - 1
        held = np.clip(held, 0, len(stamps) - 1)
        # Where a state is missing, an older command stands.
        age = np.rint((grid - stamps[held]) / period)
        mean_age = float(np.mean(np.maximum(age, 0.0)))
        if mean_age <= MATCHING_LIMITS.negligible_fraction:
            mean_age = 0.0
        earliest, latest = recording.late
        q = take_rows(recording.q, rows)
        yield Stretch(
            float(grid[0]),
            period,
            _on_grid(grid, stamps, q),
            take_rows_if_any(recording.effort, rows[held]),
            take_rows_if_any(recording.command, rows[held]),
            (earliest - mean_age, latest))


def _fit_grid(stamps: Array, period: float) -> Array:
    """Return the grid nearest to stamps [s]."""
    since = stamps - stamps[0]
    count = round(float(since[-1]) / period) + 1
    grid = stamps[0] + period * np.arange(count)
    nearest = period * np.rint(since / period)
    offset = float(np.median(since - nearest))
    return np.asarray(grid + offset, float)


def _on_grid(grid: Array, t: Array, q: Array) -> Array:
    """
    Return positions on a grid, shape (N, n) [rad].

    Stamps may jitter because states are taken at uneven times, or because they are stamped late.
    The positions are smoother with the right assumption.
    """
    period = grid[1] - grid[0]
    rounding = _ROUNDING_PERIODS * period
    if len(t) == len(grid) and np.abs(t - grid).max() < rounding:
        return q
    nearest = np.rint((t - grid[0]) / period)
    index, first = np.unique(nearest, return_index=True)
    even_t = grid[0] + period * index
    even_q = q[first]
    # Joint by joint, for long series.
    stamped = sum(_roughness(t, column, grid) for column in q.T)
    even = sum(_roughness(even_t, column, grid) for column in even_q.T)
    if even < stamped:
        return interpolated(even_t, even_q, grid)
    return interpolated(t, q, grid)


def _roughness(t: Array, column: Array, grid: Array) -> float:
    """Return the median third difference [rad]."""
    values = interpolated(t, column[:, np.newaxis], grid)
    third = np.diff(values, 3, axis=0)
    return float(np.median(np.abs(third)))


def _remove_drift(t: Array, period: float) -> Array:
    """Return stamps [s] without a large slow drift."""
    angle = 2.0 * np.pi * (t - t[0]) / period
    window = np.ones(min(_DRIFT_WINDOW, len(t)))
    # Not as complex numbers, for long series.
    sine = np.convolve(np.sin(angle), window, 'same')
    cosine = np.convolve(np.cos(angle), window, 'same')
    angle = np.unwrap(np.arctan2(sine, cosine))
    phase = angle / (2.0 * np.pi)
    regular = t - period * (phase - phase[0])
    is_large = np.ptp(phase) > _MAX_DRIFT_PERIODS
    is_increasing = (np.diff(regular) > 0.0).all()
    return regular if is_large and is_increasing else t
