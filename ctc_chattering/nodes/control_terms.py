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

from ctc_chattering.control.controller import Sample
from ctc_chattering.controller.loop import Answer
from ctc_chattering.errors import CtcError
from ctc_chattering.ros.messages import joint_state, message_type, stamp
from ctc_chattering.ros.node import qos
from ctc_chattering.ros.topics import CONTROLLER_STATE, FILTER, TORQUES, TRACKING
from ctc_chattering.trajectory.buffer import Point
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint


class ControlTerms:
    """
    Publishes the terms of every Nth sample.

    Parameters
    ----------
    node : Node
        Who publishes.
    names : sequence of str
        The joints.

    Attributes
    ----------
    publishers : tuple of Publisher
        Of tracking, filter and torques.

    """

    def __init__(self, node: Node, names: Sequence[str]) -> None:
        self.publishers = tuple(
            node.create_publisher(JointState, f'~/{name}', qos())
            for name in (TRACKING, FILTER, TORQUES))
        self._names = names
        self._desired = [f'{j}/{x}' for x in ('desired', 'error') for j in names]
        self._terms = [*(f'{j}/{x}' for x in ('nominal', 'compensation', 'robust')
                         for j in names), 'V']
        self._count = 0

    def restart(self) -> None:
        """Count from the next sample again."""
        self._count = 0

    def due(self, decimation: int) -> bool:
        """Count a sample; return whether its terms are to be published."""
        due = self._count % decimation == 0
        self._count += 1
        return due

    def publish(self, t: int, point: Point, s: Sample, lyapunov: float) -> None:
        """
        Publish the terms of a sample.

        Parameters
        ----------
        t : int
            Stamp of the state [ns].
        point : tuple of sequence of float, each of shape (n,)
            Desired position [rad], velocity [rad/s] and acceleration [rad/s²].
        s : Sample
            Of the law.
        lyapunov : float
            Value of the Lyapunov function [J].

        """
        messages = (
            joint_state(t, self._desired, position=[*point[0], *s.e],
                        velocity=[*point[1], *s.de]),
            joint_state(t, self._names, velocity=s.v),
            joint_state(t, self._terms, effort=[
                *s.nominal, *(-x for x in s.compensation), *(-x for x in s.robust), lyapunov]))
        for publisher, message in zip(self.publishers, messages):
            publisher.publish(message)


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
            self._message = kind(joint_names=names)
            if hasattr(self._message, 'speed_scaling_factor'):
                self._message.speed_scaling_factor = 1.0

    def publish(self, answer: Answer) -> None:
        """Publish the sample of the law that answers a state."""
        state, point, s = answer
        for publisher in self.publishers:
            if publisher.get_subscription_count():
                message = self._message
                message.header.stamp = stamp(state.t)
                message.reference = JointTrajectoryPoint(
                    positions=point[0], velocities=point[1], accelerations=point[2])
                message.feedback = JointTrajectoryPoint(positions=state.q, velocities=state.dq)
                message.error = JointTrajectoryPoint(positions=s.e, velocities=s.de)
                message.output = JointTrajectoryPoint(effort=s.tau)
                publisher.publish(message)
