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

"""
Topics of the graph with their types and readers, and the joints of a message by name.

Nodes and the live page take the names from here, the recorder all of `TOPICS`. `select` puts the
values of a message into the order of a node's joints.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from math import isfinite

from ctc_chattering.errors import RejectedMessage

JOINT_STATES = 'joint_states'
COMMANDS = 'effort_controller/commands'
REFERENCE = 'reference'
#: The same without the correction that the reference has learned, where it learns.
DESIRED = 'reference/desired'
CLOCK = 'clock'
#: Topic under ``~/`` of the reference, for waypoints.
JOINT_TRAJECTORY = 'joint_trajectory'
#: Reports of all nodes of a system. The name is absolute, as in ROS.
DIAGNOSTICS = '/diagnostics'
#: Description of the robot, URDF or MJCF, published once for all. Under ``~/`` of the controller
#: it is the one in use.
ROBOT_DESCRIPTION = 'robot_description'
#: Topic under ``~/`` of the controller: desired motion and error.
TRACKING = 'tracking'
#: Topic under ``~/`` of the controller: filtered error v.
FILTER = 'filter'
#: Topic under ``~/`` of the controller: terms of the torque.
TORQUES = 'torques'
#: Topic under ``~/`` of plant, controller and reference: parameters in force.
PARAMETERS = 'parameters'


@dataclasses.dataclass(frozen=True)
class Topic:
    """
    Topic as the recorder sees it.

    Attributes
    ----------
    name, kind : str
        Name, relative but for /diagnostics, and message type.
    readers : tuple of str
        Our own nodes that subscribe to it.
    latched : bool
        Whether a late subscriber gets the earlier messages.
    depth : int
        Messages that its publisher keeps for a stopped reader, such as a recorder: a second of
        them and more.

    """

    name: str
    kind: str
    readers: tuple[str, ...]
    latched: bool = False
    depth: int = 1000


#: Every topic of the graph by name.
TOPICS = {topic.name: topic for topic in (
    Topic(JOINT_STATES, 'sensor_msgs/msg/JointState', ('controller', 'recorder')),
    Topic(COMMANDS, 'std_msgs/msg/Float64MultiArray', ('plant', 'recorder')),
    Topic(REFERENCE, 'trajectory_msgs/msg/JointTrajectory', ('controller', 'recorder'),
          depth=100),
    Topic(DESIRED, 'trajectory_msgs/msg/JointTrajectory', ('recorder',), depth=100),
    Topic(CLOCK, 'rosgraph_msgs/msg/Clock', ('reference', 'bringup', 'recorder'), depth=100),
    Topic(f'reference/{JOINT_TRAJECTORY}', 'trajectory_msgs/msg/JointTrajectory',
          ('reference', 'recorder')),
    *(Topic(f'controller/{name}', 'sensor_msgs/msg/JointState', ('recorder',))
      for name in (TRACKING, FILTER, TORQUES)),
    *(Topic(f'{node}/{PARAMETERS}', 'rcl_interfaces/msg/ParameterEvent', ('recorder',), True)
      for node in ('plant', 'controller', 'reference')),
    *(Topic(name, 'std_msgs/msg/String', ('recorder',), True)
      for name in (ROBOT_DESCRIPTION, f'controller/{ROBOT_DESCRIPTION}')),
    Topic(DIAGNOSTICS, 'diagnostic_msgs/msg/DiagnosticArray', ('recorder',), depth=10),
)}


def select(ours: Sequence[str], names: Sequence[str], *rows: Sequence[float]
           ) -> list[tuple[float, ...]]:
    """
    Return our joints' values out of each row of a message.

    Parameters
    ----------
    ours : sequence of str
        Our joints in our order.
    names : sequence of str
        Joints of the message.
    *rows : sequence of float
        A value for each of them.

    Raises
    ------
    RejectedMessage
        If a joint of ours is missing, a name stands there twice, a row has another length, or a
        value of ours is not finite.

    """
    ours, names, n = tuple(ours), tuple(names), len(names)
    same_names = names == ours
    if not same_names and (len(set(names)) != n or not set(names).issuperset(ours)):
        raise RejectedMessage('joints', (
            f'joints {list(names)}; needed: each of {list(ours)} once'))
    for row in rows:
        if len(row) != n:
            lengths = sorted({len(row) for row in rows})
            raise RejectedMessage('length', (
                f'{" or ".join(map(str, lengths))} values for {n} joints'))
    values = list(map(tuple, rows))
    if not same_names:
        order = [names.index(name) for name in ours]
        values = [tuple([row[i] for i in order]) for row in values]
    if not isfinite(sum(map(sum, values))):
        raise RejectedMessage('not_finite', f'{[list(row) for row in values[:3]]}')
    return values
