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

"""A recording is checked and put in order before anything is computed from it."""

from __future__ import annotations

from ctc_chattering.errors import CtcError
from ctc_chattering.identification.recording import Recording, RecordingFault
import numpy as np
import pytest
from refusals import refused

H = 1e-3
TIMES = H * np.arange(3000)
Q = np.stack((np.sin(TIMES), np.cos(2.0 * TIMES)), axis=1)
TAU = np.stack((TIMES, -TIMES), axis=1)


def recording(t: np.ndarray = TIMES, q: np.ndarray = Q, tau: np.ndarray | None = TAU) -> Recording:
    return Recording('run', ('a', 'b'), t, q, None, None, tau)


def test_positions_that_are_not_finite_are_refused_by_joint_and_time() -> None:
    q = Q.copy()
    q[1234, 1] = np.nan
    with pytest.raises(CtcError, match=r'1 of 3000 states .* the first of b at 1\.234 s'):
        recording(q=q).checked()


def test_two_publishers_with_the_same_stamps_are_refused() -> None:
    t = np.repeat(TIMES, 2)
    q = np.repeat(Q, 2, axis=0)
    q[1::2] += 0.1
    with pytest.raises(CtcError, match='two publishers of joint states'):
        recording(t, q, np.repeat(TAU, 2, axis=0)).checked()


@pytest.mark.parametrize('phase', [0.05, 0.1, 0.3, 0.42])
def test_two_publishers_side_by_side_are_refused(phase: float) -> None:
    t = np.sort(np.concatenate((TIMES, TIMES + phase * H)))
    with pytest.raises(CtcError, match='two publishers of joint states'):
        recording(t, np.repeat(Q, 2, axis=0), np.repeat(TAU, 2, axis=0)).checked()


def test_jitter_is_no_second_publisher() -> None:
    t = TIMES + np.random.default_rng(0).normal(0.0, 0.1 * H, len(TIMES))
    assert recording(t).checked().period == pytest.approx(H, rel=1e-3)


def test_repeated_states_are_counted_once_and_order_is_restored() -> None:
    order = np.r_[0:100, 50:60, 100:3000]
    order[[500, 501]] = order[[501, 500]]
    found = recording(TIMES[order], Q[order], TAU[order]).checked()
    assert np.array_equal(found.t, TIMES)
    assert np.array_equal(found.q, Q)


def test_a_run_without_torque_or_with_few_samples_is_refused() -> None:
    with refused(RecordingFault.TORQUE):
        recording(tau=None).checked()
    with refused(RecordingFault.TORQUE):
        recording(tau=np.full_like(TAU, np.nan)).checked()
    with refused(RecordingFault.STATES):
        recording(TIMES[:50], Q[:50], TAU[:50]).checked()
