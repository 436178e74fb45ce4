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

"""``~/controller_state`` as joint_trajectory_controller has it, where control_msgs is."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from ctc_chattering.controller.loop import Answer
from ctc_chattering.errors import CtcError
from ctc_chattering.ros.messages import message_type
from ctc_chattering.ros.node import qos
from ctc_chattering.ros.serialization import ControllerStateWriter
from ctc_chattering.ros.topics import CONTROLLER_STATE
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectoryPoint


class ControllerState:
    """
    Publishes reference, state, error and torque of a sample to those who subscribe.

    Without control_msgs it publishes nothing. No node of this package reads the topic.

    Parameters
    ----------
    node : Node
        Who publishes.
    names : sequence of str
        The joints.

    Attributes
    ----------
    publishers : tuple of Publisher
        One, or none without control_msgs.

    """

    def __init__(self, node: Node, names: Sequence[str]) -> None:
        self.publishers: tuple[Any, ...] = ()
        with suppress(CtcError):  # It is not on PyPI.
            kind = message_type('control_msgs/msg/JointTrajectoryControllerState')
            self.publishers = (node.create_publisher(kind, f'~/{CONTROLLER_STATE}', qos()),)
            self._writer = ControllerStateWriter(_message(kind, names))

    def publish(self, answer: Answer) -> None:
        """Publish the sample of the law that answers a state."""
        state, point, s = answer
        for publisher in self.publishers:
            if publisher.get_subscription_count():
                publisher.publish(self._writer.write(
                    state.t, (*point, state.q, state.dq, s.e, s.de, s.tau)))


def _message(kind: Any, names: Sequence[str]) -> Any:
    """Return a message with zeros in the fields that are published."""
    zeros = [0.0] * len(names)
    motion = {'positions': zeros, 'velocities': zeros}
    message = kind(
        joint_names=list(names),
        reference=JointTrajectoryPoint(**motion, accelerations=zeros),
        feedback=JointTrajectoryPoint(**motion), error=JointTrajectoryPoint(**motion),
        output=JointTrajectoryPoint(effort=zeros))
    if hasattr(message, 'speed_scaling_factor'):
        message.speed_scaling_factor = 1.0
    return message
