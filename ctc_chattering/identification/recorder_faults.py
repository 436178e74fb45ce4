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
Faults of recorders, repaired or refused.

`repair` takes a checked `Recording` before anything is computed from it. A driver may report the
angle of a joint within a turn: turns are counted where it jumps. A broadcaster that is faster than
its robot repeats each state: repetitions are left out. States of another source between those of
the robot are refused. Stamps of reception jitter, which shifts states in time and makes torque out
of motion. Stamps coarser than the period are refused before, in `bags/state_order.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses
from typing import NamedTuple

from ctc_chattering.identification.findings import Finding, Reason, Severity
from ctc_chattering.identification.recording import (
    Recording,
    RecordingError,
    RecordingFault,
)
from ctc_chattering.numerics.angles import TURN
from ctc_chattering.numerics.linear_algebra import Flags
import numpy as np


@dataclasses.dataclass(frozen=True)
class RecorderLimits:
    """
    Limits beyond which a recorder has a fault.

    Attributes
    ----------
    next_state_periods : float
        Within this time no joint turns by half a turn.
    max_dropped_fraction : float
        More dropped messages need care.
    max_jitter_periods : float
        More jitter of the stamps needs care.

    min_mean_repetitions : float
        Least mean number of equal states of a broadcaster that repeats them.
    resting_repetitions : int
        From this number on the robot rests.
    min_even_fraction : float
        Least fraction of these numbers that differ by at most one. A broadcaster repeats evenly,
        slow positions in steps of an encoder do not.
    min_runs : int
        Fewest runs of equal states that are judged.

    min_jump : float
        Least jump of a position to another source and back [rad].
    min_jump_ratio : float
        Least such jump, relative to the usual change in two states.
    max_return_ratio : float
        Largest difference of the positions before and after, relative to the jump.
    min_jumping_fraction : float
        Least fraction of the states that jump.
    min_jumping_states : int
        Least number of the states that jump.

    """

    next_state_periods: float = 1.5
    max_dropped_fraction: float = 1e-3
    max_jitter_periods: float = 0.2

    min_mean_repetitions: float = 1.5
    resting_repetitions: int = 20
    min_even_fraction: float = 0.9
    min_runs: int = 50

    min_jump: float = 0.02
    min_jump_ratio: float = 10.0
    max_return_ratio: float = 0.3
    min_jumping_fraction: float = 0.003
    min_jumping_states: int = 10


LIMITS = RecorderLimits()


class RepairedStates(NamedTuple):
    """Repaired recording, with its findings."""

    recording: Recording
    findings: tuple[Finding, ...] = ()


def repair(recording: Recording) -> RepairedStates:
    """
    Return a recording without the recorder's faults, and findings.

    Raises
    ------
    CtcError
        If states of another source are between those of the robot.

    """
    findings = list(_find_dropped(recording))
    recording, turns = _count_turns(recording)
    _check_source(recording)
    recording, repetitions = _remove_repetitions(recording)
    findings += [*turns, *repetitions, *_find_jitter(recording)]
    return RepairedStates(recording, tuple(findings))


def _count_turns(recording: Recording) -> RepairedStates:
    """Count the turns where a joint jumps by a turn."""
    step = np.diff(recording.t)
    is_next = step < LIMITS.next_state_periods * np.median(step)
    turns = np.rint(np.diff(recording.q, axis=0) / TURN)
    turns[~is_next] = 0.0
    if not turns.any():
        return RepairedStates(recording)
    q = recording.q.copy()
    q[1:] -= TURN * np.cumsum(turns, axis=0)
    findings = []
    for joint, column in enumerate(turns.T):
        count = np.count_nonzero(column)
        if count:
            findings.append(Finding(Reason.TURNS_COUNTED, Severity.NOTE, joint, {
                'recording': recording.name, 'count': count}))
    return RepairedStates(dataclasses.replace(recording, q=q), tuple(findings))


def _check_source(recording: Recording) -> None:
    """
    Raise `CtcError` if a second source publishes states.

    Positions then often jump and come back.
    """
    q = recording.q
    change = np.abs(np.diff(q, axis=0))
    double_change = np.abs(q[2:] - q[:-2])
    jump = np.minimum(change[1:], change[:-1])
    usual = np.median(double_change, axis=0)
    smallest = np.maximum(LIMITS.min_jump, LIMITS.min_jump_ratio * usual)
    is_jump = (jump > smallest) & (double_change < LIMITS.max_return_ratio * jump)
    count = int(is_jump.any(axis=1).sum())
    if count < max(LIMITS.min_jumping_states, LIMITS.min_jumping_fraction * len(q)):
        return
    largest = np.where(is_jump, jump, 0.0).max(axis=0)
    joint = int(np.argmax(largest))
    raise RecordingError(
        RecordingFault.SOURCES,
        f'{recording.name}: {count} of {len(q)} states jump and come back, those of '
        f'{recording.joints[joint]} by {largest[joint]:.3g} rad. A second source, such as a '
        'joint_state_publisher, publishes joint states beside the robot. '
        "Stop it, or record the robot's own topic, and give --states")


def _remove_repetitions(recording: Recording) -> RepairedStates:
    """Return a recording without the repetitions of a broadcaster."""
    repeats = _find_repetitions(recording)
    mean_count = _mean_repetitions(repeats)
    if mean_count == 1.0:
        return RepairedStates(recording)
    finding = Finding(Reason.REPETITIONS, Severity.NOTE, values={
        'recording': recording.name, 'mean': mean_count, 'count': int(repeats.sum()),
        'states': len(repeats)})
    return RepairedStates(recording.select(np.flatnonzero(~repeats)), (finding,))


def _find_repetitions(recording: Recording) -> Flags:
    """Flag states equal to the one before, shape (N,)."""
    is_equal = np.ones(len(recording.t) - 1, bool)
    for values in (recording.q, recording.effort):
        if values is not None:
            is_equal &= (values[1:] == values[:-1]).all(axis=1)
    return np.append(False, is_equal)


def _mean_repetitions(repeats: Flags) -> float:
    """
    Return how often a state is recorded in motion.

    It is 1 for a recording without repetitions.

    A broadcaster repeats all states equally often, but for one time. Positions that change slowly,
    in steps of an encoder, are equal for any number of times.
    """
    starts = np.flatnonzero(~repeats)
    runs = np.diff(np.append(starts, len(repeats)))
    runs = runs[runs < LIMITS.resting_repetitions]
    if len(runs) < LIMITS.min_runs:
        return 1.0
    usual = int(np.median(runs))
    mean = float(np.mean(runs))
    shorter = usual - int(mean < usual)
    is_even = (runs == shorter) | (runs == shorter + 1)
    repeats_evenly = float(is_even.mean()) > LIMITS.min_even_fraction
    return mean if repeats_evenly and mean >= LIMITS.min_mean_repetitions else 1.0


def _find_dropped(recording: Recording) -> Iterator[Finding]:
    """Yield a finding if the recorder lost messages."""
    if not recording.dropped:
        return
    recorded = 2 * len(recording.t)  # States and commands.
    fraction = recording.dropped / (recording.dropped + recorded)
    severity = Severity.CARE if fraction > LIMITS.max_dropped_fraction else Severity.NOTE
    yield Finding(Reason.DROPPED, severity, values={
        'recording': recording.name, 'count': recording.dropped})


def _find_jitter(recording: Recording) -> Iterator[Finding]:
    """Yield a finding if the stamps jitter."""
    step = np.diff(recording.t)
    period = float(np.median(step))
    regular = step[np.abs(step - period) < period]
    jitter = float(regular.std()) / np.sqrt(2.0)
    if jitter > LIMITS.max_jitter_periods * period:
        yield Finding(Reason.STAMPS, Severity.CARE, values={
            'recording': recording.name, 'jitter_ms': 1e3 * jitter, 'period_ms': 1e3 * period})
