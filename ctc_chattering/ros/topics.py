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

"""Names, types and readers of the topics; all names are relative, so that remaps work."""

from __future__ import annotations

import dataclasses

JOINT_STATES = 'joint_states'
COMMANDS = 'effort_controller/commands'
REFERENCE = 'reference'
CLOCK = 'clock'
#: Topic under ``~/`` of the reference: waypoints to go through.
JOINT_TRAJECTORY = 'joint_trajectory'
#: Where every node of a system says how it is; an absolute name, as ROS has it.
DIAGNOSTICS = '/diagnostics'
#: Where a robot's URDF (or MJCF) is published once for all; the controller says again under
#: ``~/`` which one it uses.
ROBOT_DESCRIPTION = 'robot_description'
#: Topics under ``~/`` of the controller.
TRACKING, FILTER, TORQUES = 'tracking', 'filter', 'torques'
#: Another one, of control_msgs, where that is installed; no node of ours reads or records it.
CONTROLLER_STATE = 'controller_state'
#: Topic under ``~/`` of plant, controller and reference: the parameters in force.
PARAMETERS = 'parameters'


@dataclasses.dataclass(frozen=True)
class Topic:
    """
    One topic as the recorder sees it.

    Attributes
    ----------
    name, kind : str
        Name, relative but for /diagnostics, and message type.
    readers : tuple of str
        Our own nodes that subscribe to it.
    latched : bool
        Whether a late subscriber gets the messages sent before.

    """

    name: str
    kind: str
    readers: tuple[str, ...]
    latched: bool = False


#: Every topic of the graph by name.
TOPICS = {topic.name: topic for topic in (
    Topic(JOINT_STATES, 'sensor_msgs/msg/JointState', ('controller', 'recorder')),
    Topic(COMMANDS, 'std_msgs/msg/Float64MultiArray', ('plant', 'recorder')),
    Topic(REFERENCE, 'trajectory_msgs/msg/JointTrajectory', ('controller', 'recorder')),
    Topic(CLOCK, 'rosgraph_msgs/msg/Clock', ('reference', 'bringup', 'recorder')),
    Topic(f'reference/{JOINT_TRAJECTORY}', 'trajectory_msgs/msg/JointTrajectory',
          ('reference', 'recorder')),
    *(Topic(f'controller/{name}', 'sensor_msgs/msg/JointState', ('recorder',))
      for name in (TRACKING, FILTER, TORQUES)),
    *(Topic(f'{node}/{PARAMETERS}', 'rcl_interfaces/msg/ParameterEvent', ('recorder',), True)
      for node in ('plant', 'controller', 'reference')),
    *(Topic(name, 'std_msgs/msg/String', ('recorder',), True)
      for name in (ROBOT_DESCRIPTION, f'controller/{ROBOT_DESCRIPTION}')),
    Topic(DIAGNOSTICS, 'diagnostic_msgs/msg/DiagnosticArray', ('recorder',)),
)}
