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
Matching of recorded commands with the states that they answer.

A command has no stamp, only the time at which it was recorded. `match_commands` is called with the
columns of a bag, by `bags/reader.py` for runs and `identification/bag_motion.py` for any robot.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from ctc_chattering.numerics.linear_algebra import Array, Flags, Indices
import numpy as np
from scipy.ndimage import median_filter  # type: ignore[import-untyped]


@dataclasses.dataclass(frozen=True)
class MatchingLimits:
    """
    Limits within which a command is matched with a state.

    Attributes
    ----------
    counting_window : int
        Commands on each side whose median tells how many are missing.
    count_tolerance : float
        Largest relative difference of the numbers of commands and of samples that are counted one
        by one.
    max_contradicting_fraction : float
        Largest fraction of commands whose times contradict the count.
    max_lead_periods : float
        A command may be recorded this long before its state.
    sure_distance_periods : float
        Largest distance from the usual time after a state at which the state is sure.
    negligible_fraction : float
        Fraction of doubtful commands, or mean age in samples, that does not matter.
    min_direction_length : float
        Least length of the mean direction of the times after a state, on a circle of one period.
        Below it there is no usual time.
    log_offset_states : int
        Our recorder may log a command with the stamp of a state so far before or after its own.
    max_hold_periods : float
        A command is held at most so long. The robot had another torque later.
    extra_hold_periods : float
        A command is held for twice the usual time to the next one, and this.
    equal_nm : float
        Largest difference of two commands that are the same [N·m].

    """

    counting_window: int = 200
    count_tolerance: float = 0.02
    max_contradicting_fraction: float = 0.35
    max_lead_periods: float = 0.02
    sure_distance_periods: float = 0.35
    negligible_fraction: float = 0.002
    min_direction_length: float = 0.3
    log_offset_states: int = 1
    max_hold_periods: float = 20.0
    extra_hold_periods: float = 2.0
    equal_nm: float = 1e-9


MATCHING_LIMITS = MatchingLimits()


class Answers(NamedTuple):
    """
    Commands in the rows of the states that they answer.

    Attributes
    ----------
    command : ndarray, shape (N, n)
        Torque in force after each state [N·m], nan where it is unknown.
    late : tuple of (float, float)
        Least and largest delay of the commands beyond their rows [samples].
    is_own : ndarray of bool, shape (N,)
        A single command answers this state, or several that are equal.

    """

    command: Array
    late: tuple[float, float]
    is_own: Flags

    def select(self, rows: Indices) -> Answers:
        """Return the commands of some states."""
        return self._replace(command=self.command[rows], is_own=self.is_own[rows])


class _Matches(NamedTuple):
    """
    Commands in the order of time, each with the number of its state.

    Attributes
    ----------
    values : ndarray, shape (M, n)
        Commands [N·m].
    state : ndarray, shape (M,)
        Number of the state that each answers. It may be none of the recorded ones.
    doubtful : float
        Fraction of the commands that may answer the state before or after.

    """

    values: Array
    state: Array | Indices
    doubtful: float = 0.0


def match_commands(values: Array, times: Indices, stamps: Indices, received: Indices) -> Answers:
    """
    Return the commands in the rows of the states that they answer.

    A command answers the state that it follows by about the usual time, less than a period.
    Where each sample has one command, they are matched one by one. Single late messages then do
    not matter, nor how long answers take in lockstep. The times only tell the first state.
    Several commands for one state, of a faster controller, are averaged. A state without a command
    has the last one.

    Parameters
    ----------
    values : ndarray, shape (M, n)
        Commands [N·m].
    times : ndarray, shape (M,)
        Times at which they were recorded [ns].
    stamps : ndarray, shape (N,)
        Stamps of the states, increasing [ns].
    received : ndarray, shape (N,)
        Times at which the states were recorded [ns].

    """
    numbers = _number_states(stamps)
    return _place(_match(values, times, stamps, received, numbers), numbers)


def _number_states(stamps: Indices) -> Indices:
    """Return the numbers of the states, shape (N,), including those that were not recorded."""
    step = np.diff(stamps)
    period = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    counts = np.maximum(np.rint(step / period), 1.0)
    return np.append(0, np.cumsum(counts)).astype(int)


def _match(values: Array, times: Indices, stamps: Indices, received: Indices, numbers: Indices
           ) -> _Matches:
    """Match the commands by their times, and by their count where times are doubtful."""
    limits = MATCHING_LIMITS
    arrival = np.maximum.accumulate(received - received[0])
    wall_period = max(float(np.median(np.diff(arrival, append=arrival[-1] + 1))), 1.0)
    order = np.argsort(times, kind='stable')
    sent = times[order] - received[0]
    is_during = (sent > -0.5 * wall_period) & (sent < arrival[-1] + 2.0 * wall_period)
    values, sent = values[order[is_during]], sent[is_during]
    is_own_recorder = np.array_equal(received, stamps)  # It logs by stamps.
    if is_own_recorder and len(sent) > len(arrival):
        repeats = np.append(False, (values[1:] == values[:-1]).all(axis=1))
        if len(sent) - len(arrival) == repeats.sum():  # The answers that lockstep repeats.
            values, sent = values[~repeats], sent[~repeats]
    count = np.arange(len(sent))
    if is_own_recorder and len(sent) == len(arrival):
        offset = np.searchsorted(arrival, sent, side='right') - 1 - count
        if np.abs(offset).max() <= limits.log_offset_states:
            return _Matches(values, numbers)
    # The time of each command, in numbers of states.
    heard = np.interp(sent, np.r_[-wall_period, arrival, arrival[-1] + wall_period],
                      np.r_[-1, numbers, numbers[-1] + 1])
    usual_phase = _usual_phase(heard)
    phase = 0.5 if usual_phase is None else usual_phase
    state = np.floor(heard - phase + 0.5)
    is_doubtful = np.abs(heard - phase - state) > limits.sure_distance_periods
    is_doubtful |= np.diff(state, prepend=-np.inf) < 1.0
    doubtful = 1.0 if usual_phase is None else float(is_doubtful.mean())
    if doubtful <= limits.negligible_fraction:
        return _Matches(values, state)
    sample_count = numbers[-1] + 1
    if is_own_recorder and 0 < len(sent) <= sample_count:
        return _match_batches(values, sent, arrival, numbers)
    if abs(len(sent) / sample_count - 1.0) >= limits.count_tolerance:
        return _Matches(values, state, doubtful)
    missing = _smooth(state - count)
    if usual_phase is not None and not np.ptp(missing):  # No command is missing.
        contradicting = (state != count + missing).mean()
        doubtful = float(contradicting > limits.max_contradicting_fraction)
    return _Matches(values, count + missing, doubtful)


def _usual_phase(heard: Array) -> float | None:
    """Return the usual time of a command after its state [periods]; None without any."""
    direction = complex(np.exp(2j * np.pi * heard).sum()) / max(len(heard), 1)
    if abs(direction) <= MATCHING_LIMITS.min_direction_length:
        return None
    lead = MATCHING_LIMITS.max_lead_periods
    return float((np.angle(direction) / (2.0 * np.pi) + lead) % 1.0 - lead)


def _smooth(excess: Array) -> Array:
    """Return the running median of the numbers of missing commands, shape (M,)."""
    window = MATCHING_LIMITS.counting_window
    ends = (np.median(excess[:window]), np.median(excess[-window:]))
    padded = np.pad(excess, window, constant_values=ends)
    smooth: Array = median_filter(padded, 2 * window + 1)[window:-window]
    return smooth


def _match_batches(values: Array, sent: Indices, arrival: Indices, numbers: Indices) -> _Matches:
    """
    Match commands that our recorder took in batches, states first.

    It logs by the stamp of the last received state. So no command is logged before the state that
    it answers, and each leaves room for those after it. That limits the number of states without a
    command before it. Where commands of a batch were lost, those in doubt are left out.
    """
    count = np.arange(len(sent))
    next_state = np.searchsorted(arrival, sent, side='right')
    latest = np.append(numbers, numbers[-1] + 1)[next_state] - 1
    excess = latest - count
    window = MATCHING_LIMITS.counting_window
    first, last = (int(np.median(x)) for x in (excess[:window], excess[-window:]))
    if first == last:  # No command is missing.
        return _Matches(values, count + first)
    missing = np.minimum.accumulate(excess[::-1])[::-1]
    is_exact = excess == missing
    is_step = np.append(False, np.diff(missing) > 0)
    # A doubt begins with a step and ends where the time leaves no choice.
    batch = np.cumsum(np.append(False, is_exact[:-1]))
    is_certain = is_exact | ~np.isin(batch, batch[is_step])
    return _Matches(values[is_certain], (count + missing)[is_certain])


def _place(matches: _Matches, numbers: Indices) -> Answers:
    """Return for each state the mean of its commands, or the last one before."""
    limits = MATCHING_LIMITS
    row = np.searchsorted(numbers, matches.state).clip(0, len(numbers) - 1)
    is_recorded = numbers[row] == matches.state
    row = row[is_recorded]
    command = np.zeros((len(numbers), matches.values.shape[1]))
    count = np.bincount(row, minlength=len(numbers))
    spread = np.zeros(len(numbers))
    last = np.maximum.accumulate(np.where(count > 0, np.arange(len(numbers)), -1))
    age = numbers - numbers[last]
    usual_age = float(np.percentile(age[last >= 0], 90.0)) if (last >= 0).any() else 0.0
    oldest = min(limits.max_hold_periods, 2.0 * usual_age + limits.extra_hold_periods)
    is_known = (last >= 0) & (age <= oldest)
    # Joint by joint, for long series.
    for mean, column in zip(command.T, matches.values.T):
        np.add.at(mean, row, column[is_recorded])
        mean /= np.maximum(count, 1)
        np.maximum.at(spread, row, np.abs(column[is_recorded] - mean[row]))
        mean[:] = np.where(is_known, mean[last], np.nan)
    mean_age = float(age[is_known].mean()) if is_known.any() else 0.0
    if mean_age <= limits.negligible_fraction:
        mean_age = 0.0
    late = (-matches.doubtful - mean_age, matches.doubtful)
    return Answers(command, late, (count > 0) & (spread < limits.equal_nm))
