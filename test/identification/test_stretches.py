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

"""Stretches are the parts of a recording without gaps, on a regular grid of time."""

from __future__ import annotations

from ctc_chattering.identification.recording import Recording
from ctc_chattering.identification.stretches import split_recording
import numpy as np
import pytest

H = 1e-3
TIMES = H * np.arange(3000)
Q = np.stack((np.sin(TIMES), np.cos(2.0 * TIMES)), axis=1)
TAU = np.stack((TIMES, -TIMES), axis=1)


def recording(t: np.ndarray, q: np.ndarray, tau: np.ndarray = TAU) -> Recording:
    return Recording('run', ('a', 'b'), t, q, None, None, tau)


def test_a_pause_cuts_a_run_and_missing_samples_are_bridged() -> None:
    keep = np.r_[0:1000, 1003:1500, 2000:3000]
    found = recording(TIMES[keep], Q[keep], TAU[keep]).checked()
    first, second = split_recording(found, H)
    assert (len(first.q), len(second.q)) == (1500, 1000)
    assert first.q == pytest.approx(Q[:1500], abs=1e-9)
    assert second.t == pytest.approx(TIMES[2000:])
    # The torque is held where samples are missing.
    assert first.command is not None
    assert first.command[1000:1003] == pytest.approx(np.tile(TAU[999], (3, 1)))


def test_positions_between_jittering_stamps_are_those_of_the_grid() -> None:
    rng = np.random.default_rng(1)
    t = TIMES + np.clip(rng.normal(0.0, 0.1 * H, len(TIMES)), -0.4 * H, 0.4 * H)
    exact = np.stack((np.sin(t), np.cos(2.0 * t)), axis=1)
    (part,) = split_recording(recording(t, exact).checked(), H)
    middle = slice(2, -2)
    assert part.q[middle] == pytest.approx(np.stack(
        (np.sin(part.t), np.cos(2.0 * part.t)), axis=1)[middle], abs=1e-11)
