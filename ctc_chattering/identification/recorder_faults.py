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
Repair of recorded states: turns that are not counted, states that repeat, stamps that jitter.

A driver may report the angle of a joint within a turn: where it jumps by a turn, turns are
counted. A broadcaster that is faster than its robot repeats each state: repetitions are left out.
States of another source between those of the robot are refused.
Stamps of reception jitter, which shifts states in time and makes torque out of motion. Stamps that
are coarser than the period are refused where a bag is read.
"""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses
from typing import NamedTuple

from ctc_chattering.bags.recording import Indices, Recording
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.findings import ALL_JOINTS, Finding, note, Reason, Severity
from ctc_chattering.numerics.angles import TURN
import numpy as np
import numpy.typing as npt

Flags = npt.NDArray[np.bool_]
#: Time between two states, in periods, within which no joint turns by half a turn.
NEXT_STATE = 1.5
#: Part of the messages that may be dropped without care.
MOST_DROPPED = 1e-3
#: Part of a period by which stamps may jitter without care.
MOST_JITTER = 0.2


@dataclasses.dataclass(frozen=True)
class RepetitionLimits:
    """
    Signs of a broadcaster that repeats states.

    Attributes
    ----------
    mean_run : float
        Least mean number of equal states that follow each other in motion.
    resting_run : int
        Number from which on a robot rests.
    alike : float
        Least part of these numbers that differ by at most one from the usual one.
    runs : int
        Fewest runs that are judged.

    """

    mean_run: float = 1.5
    resting_run: int = 20
    alike: float = 0.9
    runs: int = 50


LIMITS = RepetitionLimits()


@dataclasses.dataclass(frozen=True)
class SourceLimits:
    """
    Signs of a second source of states.

    Attributes
    ----------
    jump : float
        Least jump of a position to another source and back [rad].
    motions : float
        The same over the usual change in two states.
    back : float
        Difference of the positions before and after, as a part of the jump.
    part : float
        Least part of the states that jump.
    fewest : int
        Fewest such states.

    """

    jump: float = 0.02
    motions: float = 10.0
    back: float = 0.3
    part: float = 0.003
    fewest: int = 10


SOURCES = SourceLimits()


class RepairedStates(NamedTuple):
    """A repaired recording, and what was noticed."""

    recording: Recording
    findings: tuple[Finding, ...] = ()


def repair(recording: Recording) -> RepairedStates:
    """
    Return a recording with turns counted and without repeated states, and findings.

    Raises
    ------
    CtcError
        If states of another source are between those of the robot.

    """
    dropped = tuple(_dropped_findings(recording))
    counted = count_turns(recording)
    check_source(counted.recording)
    single = leave_out_repetitions(counted.recording)
    jitter = tuple(_jitter_findings(single.recording))
    findings = (*dropped, *counted.findings, *single.findings, *jitter)
    return RepairedStates(single.recording, findings)


def count_turns(recording: Recording) -> RepairedStates:
    """Return a recording in which no joint jumps by a turn from a state to the next one."""
    step = np.diff(recording.t)
    follows = step < NEXT_STATE * np.median(step)
    position, findings = recording.q, []
    for joint, name in enumerate(recording.joints):
        change = np.diff(recording.q[:, joint])
        turns = np.where(follows, np.rint(change / TURN), 0.0)
        if not turns.any():
            continue
        if position is recording.q:
            position = recording.q.copy()
        position[1:, joint] -= TURN * np.cumsum(turns)
        findings.append(note(
            f'{recording.name}: the position of {name} jumps by a turn '
            f'{np.count_nonzero(turns)} times; its turns are counted'))
    return RepairedStates(dataclasses.replace(recording, q=position), tuple(findings))


def check_source(recording: Recording) -> None:
    """Raise `CtcError` if positions often jump and come back: a second source publishes states."""
    q = recording.q
    change = np.diff(q, axis=0)
    over_two = np.abs(q[2:] - q[:-2])
    smaller = np.minimum(np.abs(change[1:]), np.abs(change[:-1]))
    least = np.maximum(SOURCES.jump, SOURCES.motions * np.median(over_two, axis=0))
    jumps = (smaller > least) & (over_two < SOURCES.back * smaller)
    count = int(jumps.any(axis=1).sum())
    if count >= max(SOURCES.fewest, SOURCES.part * len(q)):
        joint = int(np.argmax(np.where(jumps, smaller, 0.0).max(axis=0)))
        raise CtcError(
            f'{recording.name}: {count} of {len(q)} states jump and come back, those of '
            f'{recording.joints[joint]} by {smaller[jumps[:, joint], joint].max():.3g} rad. A '
            'second source, as a joint_state_publisher, publishes joint states beside the robot. '
            "Stop it, or record the robot's own topic, and give --states")


def leave_out_repetitions(recording: Recording) -> RepairedStates:
    """Return a recording without the repetitions of a broadcaster."""
    repeats = repeats_the_state_before(recording)
    count = repetition_count(repeats)
    if count == 1.0:
        return RepairedStates(recording)
    finding = note(
        f'{recording.name}: each state is recorded about {count:.3g} times; '
        f'{int(repeats.sum())} of {len(repeats)} that repeat the one before are left out')
    return RepairedStates(select(recording, np.flatnonzero(~repeats)), (finding,))


def repeats_the_state_before(recording: Recording) -> Flags:
    """Return which states say the same as the one before, shape (N,)."""
    equal = np.ones(len(recording.t) - 1, bool)
    for values in (recording.q, recording.effort):
        if values is not None:
            equal &= (values[1:] == values[:-1]).all(axis=1)
    return np.append(False, equal)


def repetition_count(repeats: Flags) -> float:
    """
    Return how often a state is recorded in motion; 1 for a recording without repetitions.

    A broadcaster repeats all states equally often, but for one time. Positions that change slowly,
    in steps of an encoder, are equal for any number of times.
    """
    starts = np.flatnonzero(~repeats)
    runs = np.diff(np.append(starts, len(repeats)))
    runs = runs[runs < LIMITS.resting_run]
    if len(runs) < LIMITS.runs:
        return 1.0
    usual, count = int(np.median(runs)), float(np.mean(runs))
    shorter = usual - int(count < usual)
    alike = float(((runs == shorter) | (runs == shorter + 1)).mean())
    return count if alike > LIMITS.alike and count >= LIMITS.mean_run else 1.0


def select(recording: Recording, rows: Indices) -> Recording:
    """Return a recording with some of its states."""
    dq, effort, command = recording.dq, recording.effort, recording.command
    return dataclasses.replace(
        recording, t=recording.t[rows], q=recording.q[rows],
        dq=None if dq is None else dq[rows[rows < len(dq)]],
        effort=None if effort is None else effort[rows],
        command=None if command is None else command[rows])


def _dropped_findings(recording: Recording) -> Iterator[Finding]:
    """Yield that the recorder lost messages."""
    if not recording.dropped:
        return
    share = recording.dropped / (recording.dropped + 2 * len(recording.t))
    yield Finding(
        Reason.DROPPED, Severity.CARE if share > MOST_DROPPED else Severity.NOTE, ALL_JOINTS,
        f'The recorder of {recording.name} dropped {recording.dropped} messages with states or '
        'torques. Windows without them are left out',
        'Record again with less load on the computer')


def _jitter_findings(recording: Recording) -> Iterator[Finding]:
    """Yield that the stamps jitter."""
    step = np.diff(recording.t)
    period = float(np.median(step))
    near = step[np.abs(step - period) < period]
    jitter = float(near.std()) / np.sqrt(2.0)
    if jitter > MOST_JITTER * period:
        yield Finding(
            Reason.STAMPS, Severity.CARE, ALL_JOINTS, f'The stamps of {recording.name} jitter by '
            f'{1e3 * jitter:.2g} ms at a period of {1e3 * period:.3g} ms: they are those of '
            'reception', 'Record the stamps that the driver gives the states')
