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
Messages of real robots that ROS does not bring along, defined as far as tests need them.

The fields have the order and the types that the packages control_msgs (ROS 2 Jazzy) and
franka_msgs have; of franka_msgs, what stands behind those that are read is left out, except for
one field.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

TRAJECTORY_STATE = 'control_msgs/msg/JointTrajectoryControllerState'
FRANKA_STATE = 'franka_msgs/msg/FrankaRobotState'
LBR_STATE = 'lbr_fri_idl/msg/LBRState'
_DEFINITIONS = {
    TRAJECTORY_STATE: """
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint reference
trajectory_msgs/JointTrajectoryPoint feedback
trajectory_msgs/JointTrajectoryPoint error
trajectory_msgs/JointTrajectoryPoint output
string[] multi_dof_joint_names
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_reference
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_feedback
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_error
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_output
float64 speed_scaling_factor
""",
    'franka_msgs/msg/CollisionIndicators': """
bool is_cartesian_linear_collision
bool[7] is_joint_collision
""",
    FRANKA_STATE: """
std_msgs/Header header
franka_msgs/CollisionIndicators collision_indicators
sensor_msgs/JointState measured_joint_state
sensor_msgs/JointState desired_joint_state
float64[7] ddq_d
uint8 ROBOT_MODE_MOVE=2
uint8 robot_mode
""",
    LBR_STATE: """
int8 session_state
float64[7] measured_joint_position
float64[7] measured_torque
float64[7] commanded_torque
uint32 time_stamp_sec
""",
}
STORE = get_typestore(Stores.ROS2_JAZZY)
for _name, _text in _DEFINITIONS.items():
    STORE.register(get_types_from_msg(_text, _name))
_DURATION = STORE.types['builtin_interfaces/msg/Duration'](sec=0, nanosec=0)


def header(t: int) -> Any:
    """Return a header with the stamp t [ns]."""
    stamp = STORE.types['builtin_interfaces/msg/Time'](sec=t // 10 ** 9, nanosec=t % 10 ** 9)
    return STORE.types['std_msgs/msg/Header'](stamp=stamp, frame_id='base')


def _state(t: int, names: Sequence[str], q: Array, dq: Array, effort: Array) -> Any:
    return STORE.types['sensor_msgs/msg/JointState'](
        header=header(t), name=list(names), position=np.array(q, float),
        velocity=np.array(dq, float), effort=np.array(effort, float))


def _point(q: Array | None = None, dq: Array | None = None, effort: Array | None = None) -> Any:
    q, dq, effort = (np.zeros(0) if x is None else np.array(x, float) for x in (q, dq, effort))
    return STORE.types['trajectory_msgs/msg/JointTrajectoryPoint'](
        positions=q, velocities=dq, accelerations=np.zeros(0), effort=effort,
        time_from_start=_DURATION)


def trajectory_state(t: int, names: Sequence[str], q: Array, dq: Array, effort: Array | None
                     ) -> Any:
    """Return the state of a joint_trajectory_controller, whose output is an effort or nothing."""
    none = STORE.types['trajectory_msgs/msg/MultiDOFJointTrajectoryPoint'](
        transforms=[], velocities=[], accelerations=[], time_from_start=_DURATION)
    return STORE.types[TRAJECTORY_STATE](
        header=header(t), joint_names=list(names), reference=_point(q, dq),
        feedback=_point(q, dq), error=_point(q, dq), output=_point(effort=effort),
        multi_dof_joint_names=[], multi_dof_reference=none, multi_dof_feedback=none,
        multi_dof_error=none, multi_dof_output=none, speed_scaling_factor=1.0)


def franka_state(t: int, names: Sequence[str], q: Array, dq: Array, measured: Array,
                 desired: Array) -> Any:
    """Return the state of a Franka robot with its measured and its desired torque."""
    contact = STORE.types['franka_msgs/msg/CollisionIndicators'](
        is_cartesian_linear_collision=False, is_joint_collision=np.zeros(7, bool))
    return STORE.types[FRANKA_STATE](
        header=header(t), collision_indicators=contact,
        measured_joint_state=_state(t, names, q, dq, measured),
        desired_joint_state=_state(t, names, q, dq, desired), ddq_d=np.zeros(7), robot_mode=2)


def lbr_state(t: int, q: Array, measured: Array, commanded: Array) -> Any:
    """Return the state of a KUKA arm, which has seven joints without names."""
    return STORE.types[LBR_STATE](
        session_state=4, measured_joint_position=np.array(q, float),
        measured_torque=np.array(measured, float), commanded_torque=np.array(commanded, float),
        time_stamp_sec=t // 10 ** 9)
