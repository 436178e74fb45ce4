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
from ctc_chattering.ros.messages import ControllerStateWriter, message_type, StateWriter
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
        self._writers = (
            StateWriter([f'{j}/{x}' for x in ('desired', 'error') for j in names],
                        ('position', 'velocity')),
            StateWriter(names, ('velocity',)),
            StateWriter([
                *(f'{j}/{x}' for x in ('nominal', 'compensation', 'robust')
                  for j in names), 'V'], ('effort',)))
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
        rows = (((*point[0], *s.e), (*point[1], *s.de)), (s.v,), ((
            *s.nominal, *(-x for x in s.compensation), *(-x for x in s.robust),
            lyapunov),))
        for publisher, writer, row in zip(self.publishers, self._writers, rows):
            publisher.publish(writer.write(t, *row))


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
