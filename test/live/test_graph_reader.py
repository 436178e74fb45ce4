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

"""Messages of a graph as signals, and the samples that pages get."""

from __future__ import annotations

from functools import partial
import json
from typing import Any

from ctc_chattering.configuration.topics import JOINT_STATES, PARAMETERS
from ctc_chattering.live.graph_reader import GraphReader, Track
from ctc_chattering.ros.parameters import CHANGES
from ctc_chattering.ros.subscription import qos
import numpy as np
from processes import probe
import pytest
from rcl_interfaces.msg import ParameterEvent
import rclpy
from rclpy.parameter import Parameter
from ros_messages import MS, state
from sensor_msgs.msg import JointState


@pytest.mark.ros
def test_continuous_joints_go_on_where_the_driver_begins_a_turn_again() -> None:
    """Joint 1 turns endlessly by the parameters, joint 2 does not: its jump is shown."""
    t = np.arange(0.0, 4.0, 0.01)
    angles = 3.0 + 2.0 * t
    reported = (angles + np.pi) % (2.0 * np.pi) - np.pi
    with probe() as it:
        rclpy.init()
        try:
            reader = GraphReader()

            def heard(count: int) -> bool:
                reader.poll()
                return bool(reader.names) and len(reader.tracks[JOINT_STATES].rows) >= count

            event = ParameterEvent(node='/controller', new_parameters=[
                Parameter('joint_names', value=['joint1', 'joint2']).to_parameter_msg(),
                Parameter('continuous_joints', value=['joint1']).to_parameter_msg()])
            it.node.create_publisher(
                ParameterEvent, f'controller/{PARAMETERS}', qos(CHANGES, latched=True)
            ).publish(event)
            states = it.node.create_publisher(JointState, JOINT_STATES, 10)
            it.until(partial(heard, 0), 'the joints')
            it.until(states.get_subscription_count, 'the reader')
            for k, q in enumerate(reported):
                states.publish(state((k + 1) * 10 * MS, joint1=(q, 2.0), joint2=(q, 2.0)))
                it.until(partial(heard, k + 1), 'the state')
            shown = np.array([row for _, row in reader.tracks[JOINT_STATES].rows])
            reader.destroy_node()
        finally:
            rclpy.shutdown()
    np.testing.assert_allclose(np.diff(shown[:, 0]), 0.02, atol=1e-9)
    assert np.abs(np.diff(shown[:, 1])).max() > 6.0


def unpacked(message: bytes) -> tuple[dict[str, Any], dict[str, list[list[float]]]]:
    """Return head and columns of a message as plots.js reads it."""
    size = int.from_bytes(message[:4], 'little')
    head = json.loads(message[4:4 + size])
    at = -(-(4 + size) // 8) * 8
    columns: dict[str, list[list[float]]] = {}
    for name, _, length in head['columns']:
        values = np.frombuffer(message, f'<f{length}', head['count'], at)
        columns.setdefault(name, []).append(values.tolist())
        at += -(-length * head['count'] // 8) * 8
    assert at == len(message)
    return head, columns


def test_pages_get_each_sample_once_and_all_where_time_begins_again() -> None:
    track = Track(q=2, e=1)
    got = []
    for k in range(25):
        track.add(1e9 + k / 1000, np.array([k, 3.0 + 1e-9 * k, 1e-9 * k]))
        track.add(1e9 + k / 1000, np.full(3, 9.0))  # The same sample again.
        if k % 10 == 4:
            head, columns = unpacked(track.packed(1e9))
            assert head['fresh'] == (k == 4)
            got += columns['t'][0]
            assert columns['q'][1][-1] == 3.0 + 1e-9 * k
            assert columns['e'][0][-1] == pytest.approx(1e-9 * k, rel=1e-6)
            assert track.packed(1e9) == b''
    assert got == pytest.approx(np.arange(25) / 1000, abs=2e-7)
    assert unpacked(track.packed(1e9 - 5.0))[0] == {
        'count': 25, 'columns': [['t', 0, 8], ['q', 0, 8], ['q', 1, 8], ['e', 0, 4]], 'run': 0,
        'fresh': True}


def test_keeps_no_more_rows_than_it_may_and_begins_again_where_time_does() -> None:
    track = Track(max_rows=100, q=1)
    assert track.packed(0.0) == b''
    for k in range(12345):
        track.add(k, np.array([float(k)]))
    expected = list(map(float, range(12245, 12345)))
    for fresh in (False, True):  # Pages that missed some, and a new one.
        assert unpacked(track.packed(0.0, fresh))[1] == {'t': [expected], 'q': [expected]}
    track.clear()
    assert track.packed(0.0) == b''
    for t in (5.0, 6.0, 0.0, 0.5):
        track.add(t, np.array([t]))
    head, columns = unpacked(track.packed(0.0))
    assert head['fresh']
    assert columns['t'] == [[0.0, 0.5]]
