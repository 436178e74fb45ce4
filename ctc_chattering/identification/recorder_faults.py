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
What recorders do to states: messages that repeat, and stamps that jitter.

A broadcaster that is faster than its robot repeats each state; the repetitions are left out.
Stamps of reception jitter: they shift states in time by a part of the period, which makes torque
out of motion. (Stamps that are coarser than the period are refused where a bag is read.)
"""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses
from typing import NamedTuple

from ctc_chattering.bags.recording import Indices, Recording
from ctc_chattering.identification.findings import ALL_JOINTS, Finding, note, Reason, Severity
import numpy as np
import numpy.typing as npt

Flags = npt.NDArray[np.bool_]
#: Mean number of equal states that follow each other, in motion, from which on states repeat.
REPEATED = 1.5
#: Equal states that follow each other beyond which a robot rests.
RESTING_RUN = 20
#: Part of the states that are recorded alike often where a broadcaster repeats them.
ALIKE = 0.9
#: Jitter of stamps, as a part of the period, that needs care.
MOST_JITTER = 0.2
#: Fewest runs of equal states that are judged.
FEWEST_RUNS = 50


class Repaired(NamedTuple):
    """A recording without repetitions, and what was noticed."""

    recording: Recording
    findings: tuple[Finding, ...]


def repair(recording: Recording) -> Repaired:
    """Return a recording without repeated states, and findings on its stamps."""
    findings: list[Finding] = []
    repeats = equal_to_the_one_before(recording)
    count = repetition(repeats)
    if count > 1.0:
        kept = np.flatnonzero(~repeats)
        findings.append(note(
            f'{recording.name}: each state is recorded about {count:.3g} times; '
            f'{int(repeats.sum())} of {len(repeats)} that repeat the one before are left out'))
        recording = select(recording, kept)
    findings += jitter_findings(recording)
    return Repaired(recording, tuple(findings))


def equal_to_the_one_before(recording: Recording) -> Flags:
    """Return which states say the same as the one before, shape (N,) of bool."""
    equal = np.ones(len(recording.t) - 1, bool)
    for values in (recording.q, recording.effort):
        if values is not None:
            equal &= (values[1:] == values[:-1]).all(axis=1)
    return np.append(False, equal)


def repetition(repeats: Flags) -> float:
    """
    Return how often a state is recorded in motion; 1 for a recording without repetitions.

    A broadcaster repeats all states equally often, but for one. Positions that change slowly, in
    steps of an encoder, are equal for all kinds of times.
    """
    starts = np.flatnonzero(~repeats)
    runs = np.diff(np.append(starts, len(repeats)))
    runs = runs[runs < RESTING_RUN]
    if len(runs) < FEWEST_RUNS:
        return 1.0
    shortest = int(np.median(runs)) - int(np.mean(runs) < np.median(runs))
    alike = ((runs == shortest) | (runs == shortest + 1)).mean()
    count = float(np.mean(runs))
    return count if alike > ALIKE and count >= REPEATED else 1.0


def select(recording: Recording, kept: Indices) -> Recording:
    """Return a recording with some of its states."""
    dq = recording.dq
    return dataclasses.replace(
        recording, t=recording.t[kept], q=recording.q[kept],
        dq=None if dq is None else dq[kept[kept < len(dq)]],
        effort=None if recording.effort is None else recording.effort[kept],
        command=None if recording.command is None else recording.command[kept])


def jitter_findings(recording: Recording) -> Iterator[Finding]:
    """Yield that the stamps jitter."""
    step = np.diff(recording.t)
    period = float(np.median(step))
    near = step[np.abs(step - period) < period]
    jitter = float(near.std()) / np.sqrt(2.0)
    if jitter > MOST_JITTER * period:
        yield Finding(
            Reason.STAMPS, Severity.CARE, ALL_JOINTS, f'the stamps of {recording.name} jitter by '
            f'{1e3 * jitter:.2g} ms at a period of {1e3 * period:.3g} ms: they are those of '
            'reception', 'record the stamps that the driver gives the states')
