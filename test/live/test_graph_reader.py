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

"""What the page of a graph is told: messages of another process's publishers, read as signals."""

from __future__ import annotations

from functools import partial

from ctc_chattering.configuration.topics import JOINT_STATES, PARAMETERS
from ctc_chattering.live.graph_reader import GraphReader
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

pytestmark = pytest.mark.ros


def test_endless_joints_go_on_where_the_driver_begins_a_turn_again() -> None:
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
