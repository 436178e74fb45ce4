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

"""Quality of service that is not ours: what the real tools publish with, and subscribe with."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
import signal
import time

from ctc_chattering.bags.repair import open_bag
from ctc_chattering.ros.subscription import ValidatedSubscription
from processes import interrupt, probe
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from ros_messages import COMMANDS, MS, stamp, state
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory
from urdfs import two_links

pytestmark = pytest.mark.ros
#: As `rclcpp::ClockQoS` and `rclcpp::SensorDataQoS` offer it.
LOSSY = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PLAIN = QoSProfile(depth=1)


def test_a_message_taken_before_its_subscription_was_destroyed_is_ignored() -> None:
    used: list[bytes] = []
    with probe() as it:
        states: ValidatedSubscription[bytes] = ValidatedSubscription(
            it.node, JointState, 'joint_states', lambda data, _: used.append(data), PLAIN, bytes)
        states.receive(b'first', {'received_timestamp': time.time_ns()})
        states.subscription.destroy()
        states.receive(b'second', {'received_timestamp': time.time_ns()})
    assert used == [b'first'] and not states.rejected


def test_all_nodes_hear_best_effort_publishers(tmp_path: Path) -> None:
    """A simulator, or a bag that is played, offers less than we ask for; a listener asks more."""
    bag = tmp_path / 'bag'
    with probe() as it:
        # Never matched by our publisher, which keeps nothing; it must not be waited for.
        it.listen(Float64MultiArray, COMMANDS, LATCHED)
        torques = it.listen(Float64MultiArray, COMMANDS)
        chunks = it.listen(JointTrajectory, 'reference')
        clock = it.node.create_publisher(Clock, 'clock', LOSSY)
        states = it.node.create_publisher(JointState, 'joint_states', LOSSY)
        description = it.node.create_publisher(String, 'robot_description', PLAIN)
        recorder = it.start('recorder', '-p', f'bag:={bag}')
        it.start('reference', '-p', 'joint_names:=[a, b]')
        it.start('controller', '-p', 'model:=urdf', '-p', 'joint_names:=[a, b]')
        t = 0

        def answered() -> bool:
            nonlocal t
            t += MS
            description.publish(String(data=two_links()))
            clock.publish(Clock(clock=stamp(t)))
            states.publish(state(t, a=(0.1, 0.0), b=(0.2, 0.0)))
            return len(torques) >= 10
        it.until(answered, 'torques')
        assert chunks
        # The recorder may find each of the publishers last, and has missed what they sent before.
        file, topics = bag / 'bag_0.mcap', {
            '/clock', '/joint_states', '/robot_description', f'/{COMMANDS}'}
        it.until(lambda: answered() and all(
            topic.encode() in file.read_bytes() for topic in topics), 'all topics in the bag')
        interrupt(recorder, signal.SIGINT)
        assert not any('Traceback' in line for line in it.lines), it.lines
    with closing(open_bag(bag)) as reader:
        assert topics <= {connection.topic for connection, _, _ in reader.messages()}
