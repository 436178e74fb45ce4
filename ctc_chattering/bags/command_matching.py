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
Matching of recorded commands with their states.

A command has no stamp, only the time at which it was recorded. `bags/recorded_law.py` calls
`match_commands` with the columns of a bag for runs, `identification/bag_motion.py` for any robot.
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
    Limits of matching a command with a state.

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
    Commands in the rows of their states.

    Attributes
    ----------
    command : ndarray, shape (N, n)
        Torque in force after each state [N·m], nan where it is unknown.
    late : tuple of (float, float)
        Bounds on the delay of the commands relative to their rows [samples].
    is_own : ndarray of bool, shape (N,)
        A single command answers this state, or several that are equal.

    """

    command: Array
    late: tuple[float, float]
    is_own: Flags


class _Matches(NamedTuple):
    """
    Commands by time, with the numbers of their states.

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
    Return the commands in the rows of their states.

    A command answers the state that it follows by about the usual time, less than a period.
    Where each sample has one command, they are matched one by one. The times only tell the first
    state. Single late messages then do not matter, nor the time of an answer in lockstep, for
    which simulated time waits.
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
    matches = _match(values, times, stamps, received, numbers)
    return _place(matches, numbers)


def find_single(values: Array, states: int) -> Flags:
    """
    Return which commands do not repeat the one before, shape (M,).

    A plant in lockstep has answers repeated. Those are not single if, without them, there are as
    many commands as states. Otherwise all are taken for single.

    Parameters
    ----------
    values : ndarray, shape (M, n)
        Commands in the order of their reception [N·m].
    states : int
        Number of states.

    """
    is_single = np.ones(len(values), bool)
    repeats = (values[1:] == values[:-1]).all(axis=1)
    if repeats.sum() == len(values) - states:
        is_single[1:] = ~repeats
    return is_single


def _number_states(stamps: Indices) -> Indices:
    """Return the states' numbers, counting those not recorded, shape (N,)."""
    step = np.diff(stamps)
    positive = step[step > 0]
    period = float(np.median(positive)) if len(positive) else 1.0
    counts = np.rint(step / period)
    counts = np.maximum(counts, 1.0)
    numbers = np.append(0, np.cumsum(counts))
    return numbers.astype(int)


def _match(
        values: Array,
        times: Indices,
        stamps: Indices,
        received: Indices,
        numbers: Indices) -> _Matches:
    """Match commands by their times, or else their count."""
    limits = MATCHING_LIMITS
    arrival = np.maximum.accumulate(received - received[0])
    end = arrival[-1]
    wall_step = np.diff(arrival, append=end + 1)
    wall_period = max(float(np.median(wall_step)), 1.0)
    order = np.argsort(times, kind='stable')
    sent = times[order] - received[0]
    is_during = sent > -0.5 * wall_period
    is_during &= sent < end + 2.0 * wall_period
    order = order[is_during]
    values = values[order]
    sent = sent[is_during]
    is_own_recorder = np.array_equal(received, stamps)  # Our recorder logs by stamps.
    if is_own_recorder:
        is_single = find_single(values, len(arrival))
        values = values[is_single]
        sent = sent[is_single]
    command_index = np.arange(len(sent))
    surplus = len(sent) - len(arrival)
    if is_own_recorder and not surplus:
        last_state = np.searchsorted(arrival, sent, side='right') - 1
        offset = np.abs(last_state - command_index)
        if offset.max() <= limits.log_offset_states:
            return _Matches(values, numbers)
    sample_count = numbers[-1] + 1
    # The time of each command, in numbers of states.
    instants = np.r_[-wall_period, arrival, end + wall_period]
    counted = np.r_[-1, numbers, sample_count]
    heard = np.interp(sent, instants, counted)
    usual_phase = _usual_phase(heard)
    phase = 0.5 if usual_phase is None else usual_phase
    answered = heard - phase
    state = np.floor(answered + 0.5)
    distance = np.abs(answered - state)
    is_doubtful = distance > limits.sure_distance_periods
    step = np.diff(state, prepend=-np.inf)
    is_doubtful |= step < 1.0
    doubtful = 1.0 if usual_phase is None else float(is_doubtful.mean())
    if doubtful <= limits.negligible_fraction:
        return _Matches(values, state)
    if is_own_recorder and 0 < len(sent) <= sample_count:
        return _match_batches(values, sent, arrival, numbers)
    relative_surplus = len(sent) / sample_count - 1.0
    if abs(relative_surplus) >= limits.count_tolerance:
        return _Matches(values, state, doubtful)
    usual_offset = _running_median(state - command_index)
    counted_state = command_index + usual_offset
    if usual_phase is not None and not np.ptp(usual_offset):  # No command is missing.
        contradicting = (state != counted_state).mean()
        doubtful = float(contradicting > limits.max_contradicting_fraction)
    return _Matches(values, counted_state, doubtful)


def _usual_phase(heard: Array) -> float | None:
    """
    Return the usual delay of a command [periods].

    It is None where commands have no usual delay.
    """
    directions = np.exp(2j * np.pi * heard)
    total = complex(directions.sum())
    mean = total / max(len(heard), 1)
    if abs(mean) <= MATCHING_LIMITS.min_direction_length:
        return None
    lead = MATCHING_LIMITS.max_lead_periods
    phase = np.angle(mean) / (2.0 * np.pi)
    delay = (phase + lead) % 1.0 - lead
    return float(delay)


def _running_median(offset: Array) -> Array:
    """Return the running median of an offset, shape (M,)."""
    window = MATCHING_LIMITS.counting_window
    first = np.median(offset[:window])
    last = np.median(offset[-window:])
    padded = np.pad(
        offset,
        window,
        constant_values=(first, last))
    smooth: Array = median_filter(padded, 2 * window + 1)
    return smooth[window:-window]


def _match_batches(values: Array, sent: Indices, arrival: Indices, numbers: Indices) -> _Matches:
    """
    Match commands that were recorded in batches, states first.

    Our recorder logs a command by the stamp of the last received state. So no command is logged
    before the state that it answers, and each leaves room for those after it. That limits the
    number of states without a command before it. Where commands of a batch were lost, those in
    doubt are left out.
    """
    command_index = np.arange(len(sent))
    next_state = np.searchsorted(arrival, sent, side='right')
    following = np.append(numbers, numbers[-1] + 1)
    offset = following[next_state] - 1 - command_index
    window = MATCHING_LIMITS.counting_window
    first = int(np.median(offset[:window]))
    last = int(np.median(offset[-window:]))
    if first == last:  # No command is missing.
        return _Matches(values, command_index + first)
    least_offset = np.minimum.accumulate(offset[::-1])[::-1]
    is_exact = offset == least_offset
    step = np.diff(least_offset, prepend=least_offset[0])
    is_step = step > 0
    # Doubt starts at a change of the offset and ends where the time leaves no choice.
    batch = np.cumsum(np.append(False, is_exact[:-1]))
    is_in_doubt = np.isin(batch, batch[is_step])
    is_certain = is_exact | ~is_in_doubt
    state = command_index + least_offset
    return _Matches(values[is_certain], state[is_certain])


def _place(matches: _Matches, numbers: Indices) -> Answers:
    """Return each state's mean command, or the last before."""
    limits = MATCHING_LIMITS
    states = len(numbers)
    row = np.searchsorted(numbers, matches.state)
    row = row.clip(0, states - 1)
    is_recorded = numbers[row] == matches.state
    row = row[is_recorded]
    count = np.bincount(row, minlength=states)
    divisor = np.maximum(count, 1)
    is_answered = count > 0
    answered = np.where(is_answered, np.arange(states), -1)
    last = np.maximum.accumulate(answered)
    has_command = last >= 0
    age = numbers - numbers[last]
    usual_age = float(np.percentile(age[has_command], 90.0)) if is_answered.any() else 0.0
    oldest = min(
        limits.max_hold_periods,
        2.0 * usual_age + limits.extra_hold_periods)
    is_known = has_command & (age <= oldest)
    command = np.zeros((states, matches.values.shape[1]))
    spread = np.zeros(states)
    # Joint by joint, for long series.
    for mean, column in zip(command.T, matches.values.T):
        answers = column[is_recorded]
        np.add.at(mean, row, answers)
        mean /= divisor
        difference = np.abs(answers - mean[row])
        np.maximum.at(spread, row, difference)
        mean[:] = mean[last]
    command[~is_known] = np.nan
    mean_age = float(age[is_known].mean()) if is_known.any() else 0.0
    if mean_age <= limits.negligible_fraction:
        mean_age = 0.0
    # A doubtful command is a sample early or late, so their fraction is a mean delay in samples.
    late = (-matches.doubtful - mean_age, matches.doubtful)
    is_single = spread < limits.equal_nm
    return Answers(command, late, is_answered & is_single)
