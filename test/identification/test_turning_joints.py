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

"""Recordings of joints whose driver reports angles within a window."""

from __future__ import annotations

import dataclasses

from ctc_chattering.identification.findings import Reason
from ctc_chattering.identification.identified_robot import IdentifiedRobot, identify
from ctc_chattering.identification.recording import RecordedMotion
from ctc_chattering.numerics.angles import within_turn
from identified_bags import short
import numpy as np
import pytest

#: Where the window begins: within the range of both joints.
LEAST = -0.3


def identified(*, wrapped: bool, continuous: list[str]) -> IdentifiedRobot:
    """Return what is found of a run, with the positions as a driver may report them."""
    made = short()
    recording, controller = made.recording, made.controller
    if wrapped:
        q = np.vectorize(within_turn)(recording.q, LEAST)
        assert (np.abs(np.diff(q, axis=0)).max(axis=0) > 6.0).all()
        recording = dataclasses.replace(recording, q=q)
    return identify([RecordedMotion(
        recording.checked(), '', controller.changed({'continuous_joints': continuous}))])


def test_turns_are_counted_before_anything_is_identified() -> None:
    names = ['joint1', 'joint2']
    expected = identified(wrapped=False, continuous=['']).results.found
    found = identified(wrapped=True, continuous=names).results.found
    assert [x.coulomb.value for x in found.friction] == pytest.approx(
        [x.coulomb.value for x in expected.friction], rel=1e-6)
    assert np.ptp(found.positions.ends, axis=0) == pytest.approx(
        np.ptp(expected.positions.ends, axis=0), rel=1e-9)


def test_jumps_of_joints_that_are_not_known_to_turn_are_counted_and_named() -> None:
    found = identified(wrapped=True, continuous=['']).results
    assert np.ptp(found.found.positions.ends, axis=0).max() < 5.0
    turning = [x.joint for x in found.found.findings if x.reason == Reason.TURNS_COUNTED]
    assert turning == [0, 1]
