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

"""The topics under ``~/`` of the controller: what a torque was made of."""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.control.controller import Sample
from ctc_chattering.ros.node import qos
from ctc_chattering.ros.serialization import StateWriter
from ctc_chattering.ros.topics import FILTER, TORQUES, TRACKING
from ctc_chattering.trajectory.buffer import Point
from rclpy.node import Node
from sensor_msgs.msg import JointState


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
