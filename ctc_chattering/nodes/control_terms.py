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

"""What a torque was made of: the topics under ``~/`` of the controller."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from ctc_chattering.control.controller import Controller
from ctc_chattering.controller.loop import Answer
from ctc_chattering.errors import CtcError
from ctc_chattering.ros.messages import joint_state, message_type, stamp
from ctc_chattering.ros.node import qos
from ctc_chattering.ros.topics import CONTROLLER_STATE, FILTER, TORQUES, TRACKING
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint


class ControlTerms:
    """
    Publishes the terms of every Nth sample, and its `CONTROLLER_STATE` to those who subscribe.

    Parameters
    ----------
    node : Node
        Who publishes.
    names : sequence of str
        The joints.

    Attributes
    ----------
    publishers : list of Publisher
        Of tracking, filter and torques, and of `CONTROLLER_STATE` where control_msgs is installed:
        it is not on PyPI, and no node of this package reads the topic.
    count : int
        Samples so far; with 0 the next one is published.

    """

    def __init__(self, node: Node, names: Sequence[str]) -> None:
        self.publishers: list[Any] = [node.create_publisher(JointState, f'~/{name}', qos())
                                      for name in (TRACKING, FILTER, TORQUES)]
        with suppress(CtcError):
            self._kind = message_type('control_msgs/msg/JointTrajectoryControllerState')
            self.publishers.append(
                node.create_publisher(self._kind, f'~/{CONTROLLER_STATE}', qos()))
        self._names = list(names)
        self._desired = [f'{j}/{x}' for x in ('desired', 'error') for j in names]
        self._terms = [*(f'{j}/{x}' for x in ('nominal', 'compensation', 'robust')
                         for j in names), 'V']
        self.count = 0

    def publish(self, answer: Answer, decimation: int, law: Controller) -> None:
        """
        Count a sample of the law, and publish its terms if it is due.

        Parameters
        ----------
        answer : Answer
            Its state, desired point and terms.
        decimation : int
            Of so many samples one is published.
        law : Controller
            Gives the value of the Lyapunov function.

        """
        due = self.count % decimation == 0
        self.count += 1
        if not due:
            return
        state, point, s = answer
        messages = [
            joint_state(state.t, self._desired, position=[*point[0], *s.e],
                        velocity=[*point[1], *s.de]),
            joint_state(state.t, self._names, velocity=s.v),
            joint_state(state.t, self._terms, effort=[
                *s.nominal, *(-x for x in s.compensation), *(-x for x in s.robust),
                law.lyapunov(state.q, s.v)])]
        if len(self.publishers) > len(messages) and self.publishers[-1].get_subscription_count():
            message = self._kind(
                joint_names=self._names, reference=JointTrajectoryPoint(
                    positions=point[0], velocities=point[1], accelerations=point[2]),
                feedback=JointTrajectoryPoint(positions=state.q, velocities=state.dq),
                error=JointTrajectoryPoint(positions=s.e, velocities=s.de),
                output=JointTrajectoryPoint(effort=s.tau), speed_scaling_factor=1.0)
            message.header.stamp = stamp(state.t)
            messages.append(message)
        for publisher, message in zip(self.publishers, messages):
            publisher.publish(message)
