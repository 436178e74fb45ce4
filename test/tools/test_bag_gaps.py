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

"""Gaps in the bags of a soak test."""

from __future__ import annotations

from pathlib import Path

from bags import state
from ctc_chattering.bags.writer import BagWriter, offered_qos
from ctc_chattering.numerics.time_grid import NANOSECONDS as S
import pytest
from soak.measurements import examine, Outage

NAMES = ('joint1', 'joint2')
MS = S // 1000


def record(path: Path, stamps: range, until: int) -> Path:
    """Write states, and something else each half second until some time."""
    text = b'\0\1\0\0\1\0\0\0\0'
    rows = [(t, 'joint_states', 'sensor_msgs/msg/JointState',
             state(NAMES, [[0.0, 0.0]] * 3, divmod(t, S))) for t in stamps]
    rows += [(t, 'text', 'std_msgs/msg/String', text) for t in range(0, until, S // 2)]
    recording = BagWriter(path)
    for t, topic, kind, data in sorted(rows):
        recording.write(f'/{topic}', kind, t, bytes(data), offered_qos(10, False))
    recording.close()
    return path


@pytest.mark.parametrize(('until', 'outages', 'gaps', 'unexplained'), [
    (S, [], 0, 0), (9 * S, [], 1, 1), (9 * S, [Outage(S, 2 * S)], 1, 0),
    (9 * S, [Outage(20 * S, 21 * S)], 1, 1)])
def test_states_that_end_before_the_bag_are_a_gap(
        until: int, outages: list[Outage], gaps: int, unexplained: int, tmp_path: Path) -> None:
    found = examine([record(tmp_path / 'bag', range(0, S, MS), until)], outages)
    assert (found['states'], found['gaps'], found['unexplained_gaps']) == (1000, gaps, unexplained)
    assert found['messages'] == 1000 + until // (S // 2)
