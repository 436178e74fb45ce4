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
MuJoCo as the robot: a node that publishes joint_states and takes torques, in lockstep.

It stands in for the node ``plant``, beside ``controller`` and ``reference`` with the same file::

    P=$(ros2 pkg prefix --share ctc_chattering)/config
    F="--ros-args --params-file $P/friction.yaml -p model:=urdf -p description:=$P/two_link.urdf"
    ros2 run ctc_chattering controller $F
    ros2 run ctc_chattering reference $F
    python mujoco_plant.py $F

It needs ``pip install mujoco``, and an MJCF or URDF that has the joints in ``joint_names``. Every
simulator is attached like this: torques of the joints named in ``layout.dim`` come, and the state
after one period goes out with its stamp.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from builtin_interfaces.msg import Time
import mujoco
import numpy as np
import numpy.typing as npt
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

Array = npt.NDArray[np.float64]
#: Sent but unanswered, a state is sent again after this [s]: who came late has not heard it.
AGAIN = 1.0


class MujocoPlant(Node):
    """The joints of a description, moved by MuJoCo a period at a time."""

    def __init__(self) -> None:
        super().__init__('plant')
        self.names = list(self.get('joint_names', ['joint1', 'joint2']))
        self.model = mujoco.MjModel.from_xml_path(self.get('description', ''))
        self.data = mujoco.MjData(self.model)
        self.period = round(1e9 * self.get('control_period', 0.001))
        self.last = round(1e9 * self.get('duration', 10.0)) // self.period
        self.joints = [self.model.joint(name) for name in self.names]
        self.q = [int(joint.qposadr[0]) for joint in self.joints]
        self.dq = [int(joint.dofadr[0]) for joint in self.joints]
        zeros = [0.0] * len(self.names)
        self.data.qpos[self.q] = self.get('initial_position', zeros)
        self.set_physics(np.array(self.get('coulomb_friction', [9.9] * len(zeros))),
                         np.array(self.get('viscous_friction', zeros)))
        self.k = 0
        self.torques: dict[str, float] = {}
        #: How often the present state was repeated, and the one before, whose further answers
        #: may still come.
        self.repeats = self.surplus = 0
        self.done = rclpy.Future()
        self.clock = self.create_publisher(Clock, 'clock', 10)
        self.states = self.create_publisher(JointState, 'joint_states', 10)
        self.create_subscription(
            Float64MultiArray, 'effort_controller/commands', self.on_torque, 10)
        self.timer = self.create_timer(AGAIN, self.repeat)

    def get(self, name: str, default: Any) -> Any:
        """Return a parameter of the file."""
        return self.declare_parameter(name, default).value

    def set_physics(self, coulomb: Array, viscous: Array) -> None:
        """Set friction [N·m], [N·m·s/rad], no contacts, and the step; as stiff as they can be."""
        model, h = self.model, 1e-9 * self.period
        model.opt.timestep, model.opt.integrator = h, mujoco.mjtIntegrator.mjINT_RK4
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        model.opt.noslip_iterations, model.opt.noslip_tolerance = 300, 1e-30
        model.dof_frictionloss[self.dq], model.dof_damping[self.dq] = coulomb, viscous
        model.dof_solref[:] = (0.0, -0.9999 / h)  # A joint that can rest does so within a step.
        model.dof_solimp[:] = (0.9999, 0.9999, 1e-3, 0.5, 2.0)

    def on_torque(self, message: Float64MultiArray) -> None:
        """Move on by a period under the torques [N·m] that answer the present state."""
        labels = [dimension.label for dimension in message.layout.dim] or self.names
        torques = dict(zip(labels, message.data))
        if self.surplus and torques == self.torques:
            self.surplus -= 1
            return
        self.torques, self.surplus, self.repeats = torques, self.repeats, 0
        if self.k == self.last:
            self.done.set_result(None)
            return
        self.data.qfrc_applied[self.dq] = [torques[name] for name in self.names]
        mujoco.mj_step(self.model, self.data)
        self.k += 1
        self.publish()

    def repeat(self) -> None:
        """Send a state again that has no answer yet."""
        self.repeats += 1
        self.publish()

    def publish(self) -> None:
        """Send the state at sample `k` with its time."""
        stamp = Time(sec=self.k * self.period // 10 ** 9, nanosec=self.k * self.period % 10 ** 9)
        state = JointState(
            name=self.names, position=self.data.qpos[self.q], velocity=self.data.qvel[self.dq],
            effort=self.data.qfrc_applied[self.dq])
        state.header.stamp = stamp
        self.clock.publish(Clock(clock=stamp))
        self.states.publish(state)
        self.timer.reset()


def main() -> None:
    """Move the robot until `duration` is over."""
    rclpy.init()
    node = MujocoPlant()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin_until_future_complete(node, node.done)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
