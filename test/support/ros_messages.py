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

"""Messages as nodes of others send them."""

from __future__ import annotations

from array import array
from collections.abc import Sequence

from builtin_interfaces.msg import Duration, Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

COMMANDS = 'effort_controller/commands'
MS = 1_000_000


def stamp(t: int) -> Time:
    return Time(sec=t // 10 ** 9, nanosec=t % 10 ** 9)


def state(t: int, **joints: tuple[float, float]) -> JointState:
    """Return a state of joints given as name=(position, velocity), without efforts."""
    message = JointState(name=list(joints))
    message.header.stamp = stamp(t)
    message.position = array('d', [q for q, _ in joints.values()])
    message.velocity = array('d', [dq for _, dq in joints.values()])
    return message


def torques(values: list[float], *labels: str) -> Float64MultiArray:
    message = Float64MultiArray(data=array('d', values))
    message.layout.dim = [MultiArrayDimension(label=x, size=1, stride=1) for x in labels]
    return message


def reference(names: list[str], rows: Sequence[Sequence[Sequence[float]]]) -> JointTrajectory:
    """Return a trajectory from t = 0 in steps of 1 ms: position, velocity, acceleration."""
    return JointTrajectory(joint_names=names, points=[
        JointTrajectoryPoint(
            positions=array('d', q), velocities=array('d', dq), accelerations=array('d', ddq),
            time_from_start=Duration(nanosec=k * MS)) for k, (q, dq, ddq) in enumerate(rows)])


def ns(time: Time | Duration) -> int:
    return int(time.sec) * 10 ** 9 + int(time.nanosec)
