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
"""Faults that recorders put into states are repaired, or named."""

from __future__ import annotations

import dataclasses

from ctc_chattering.errors import CtcError
from ctc_chattering.identification.findings import ALL_JOINTS, Reason, Severity
from ctc_chattering.identification.recorder_faults import repair
from ctc_chattering.identification.recording import Recording, RecordingFault
import numpy as np
import pytest
from refusals import refused

H = 0.008
T = np.asarray(H * np.arange(3000), float)
Q = np.stack((np.sin(T), 0.5 * np.cos(1.7 * T)), axis=1)
SMOOTH = Recording('run', ('a', 'b'), T, Q, np.gradient(Q, H, axis=0), 3.0 * Q)


def held(count: int, recording: Recording = SMOOTH) -> Recording:
    """Return what a broadcaster records that is so many times as fast as its robot."""
    rows = np.repeat(np.arange(len(recording.t)), count)
    t = np.linspace(recording.t[0], recording.t[-1] + H, len(rows), endpoint=False)
    assert recording.dq is not None and recording.effort is not None
    return dataclasses.replace(recording, t=t, q=recording.q[rows], dq=recording.dq[rows],
                               effort=recording.effort[rows])


def test_a_recording_without_faults_stays() -> None:
    recording, findings = repair(SMOOTH)
    assert recording.q is SMOOTH.q and recording.t is SMOOTH.t and findings == ()


@pytest.mark.parametrize('count', [2, 3, 8])
def test_states_that_a_broadcaster_repeats_are_left_out(count: int) -> None:
    recording, (finding,) = repair(held(count))
    assert np.array_equal(recording.q, Q)
    assert recording.dq is not None and len(recording.dq) == len(T)
    assert recording.period == pytest.approx(H, rel=1e-3)
    assert (finding.reason, finding.severity) == (Reason.REPETITIONS, Severity.NOTE)
    assert finding.values['mean'] == pytest.approx(count, rel=0.01)


def test_uneven_repetitions_are_left_out() -> None:
    """A broadcaster of 250 Hz over a robot of 100 Hz repeats a state two or three times."""
    counts = np.where(np.arange(len(T)) % 2, 2, 3)
    rows = np.repeat(np.arange(len(T)), counts)
    t = np.asarray(0.004 * np.arange(len(rows)), float)
    recording, (finding,) = repair(dataclasses.replace(
        SMOOTH, t=t, q=Q[rows], dq=None, effort=3.0 * Q[rows]))
    assert np.array_equal(recording.q, Q)
    assert finding.values['mean'] == pytest.approx(2.5, rel=0.01)


@pytest.mark.parametrize('step', [1e-3, 2e-2])
def test_a_coarse_encoder_and_a_robot_at_rest_repeat_nothing(step: float) -> None:
    """Positions stay for any number of states; the effort of a robot at rest, too."""
    coarse = dataclasses.replace(SMOOTH, q=step * np.round(Q / step), effort=None,
                                 command=np.ones_like(Q))
    assert repair(coarse).findings == ()
    still = np.where((T > 5.0)[:, None], Q[600], Q)
    assert repair(dataclasses.replace(SMOOTH, q=still, effort=still)).findings == ()


def test_turns_that_a_driver_does_not_count_are_counted_and_named() -> None:
    turning = np.stack((0.9 * T, Q[:, 1]), axis=1)
    wrapped = (turning + np.pi) % (2.0 * np.pi) - np.pi
    assert (np.abs(np.diff(wrapped[:, 0])) > 6.0).sum() == 3
    recording, (finding,) = repair(dataclasses.replace(SMOOTH, q=wrapped))
    assert recording.q == pytest.approx(turning, abs=1e-12)
    assert (finding.reason, finding.severity, finding.joint) == (
        Reason.TURNS_COUNTED, Severity.NOTE, 0)
    assert finding.values['count'] == 3


@pytest.mark.parametrize('every', [2, 12, 60])
def test_a_second_source_of_states_is_named(every: int) -> None:
    """A joint_state_publisher says 0 for all joints, beside the robot."""
    q, effort = SMOOTH.q.copy(), 3.0 * Q
    q[::every] = 0.0
    with refused(RecordingFault.SOURCES):
        repair(dataclasses.replace(SMOOTH, q=q, effort=effort))


def test_single_wrong_positions_and_a_coarse_encoder_that_flickers_are_no_second_source() -> None:
    q = SMOOTH.q.copy()
    q[500:2500:500] = 0.0
    assert np.array_equal(repair(dataclasses.replace(SMOOTH, q=q)).recording.q, q)
    flicker = 0.01 * np.round(Q / 0.01 + 0.4 * np.random.default_rng(0).normal(size=Q.shape))
    repair(dataclasses.replace(SMOOTH, q=flicker))


def test_a_pause_in_which_a_joint_moves_far_is_no_turn() -> None:
    t = np.where(T > 12.0, T + 5.0, T)
    q = Q + np.where(t > 12.0, 4.0, 0.0)[:, None]
    assert repair(dataclasses.replace(SMOOTH, t=t, q=q)).recording.q is q


def test_stamps_of_reception_need_care() -> None:
    late = 0.9 * H * np.random.default_rng(0).random(len(T))
    _, (finding,) = repair(dataclasses.replace(SMOOTH, t=T + late))
    assert (finding.reason, finding.severity, finding.joint) == (
        Reason.STAMPS, Severity.CARE, ALL_JOINTS)
    assert finding.values['period_ms'] == pytest.approx(1e3 * H, rel=0.05)


def test_stamps_that_are_coarser_than_the_period_are_refused() -> None:
    """Whole 10 ms at 8 ms."""
    coarse = dataclasses.replace(SMOOTH, t=np.round(T, 2))
    with pytest.raises(CtcError, match='of the states share the stamp of another state, because '
                       'stamps have a resolution of 10 ms, coarser than the period'):
        coarse.checked()


@pytest.mark.parametrize(('dropped', 'severity'), [(2, Severity.NOTE), (161, Severity.CARE)])
def test_dropped_messages_are_the_first_reason(dropped: int, severity: Severity) -> None:
    _, findings = repair(dataclasses.replace(held(2), dropped=dropped))
    assert findings[0].reason is Reason.DROPPED and findings[0].severity == severity
    assert findings[0].values['count'] == dropped
