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

"""A controller process between states and references of the test."""

from __future__ import annotations

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.trajectory.buffer import Point
from processes import Probe
from ros_messages import COMMANDS
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory


class ControllerUnderTest:
    """A controller process between our states and references, in our time, and its torques."""

    def __init__(self, it: Probe, *ros_args: str) -> None:
        self.probe = it
        self.clock = it.node.create_publisher(Clock, 'clock', 1000)
        self.states = it.node.create_publisher(JointState, 'joint_states', 1000)
        self.references = it.node.create_publisher(JointTrajectory, 'reference', 1000)
        self.commands = it.listen(Float64MultiArray, COMMANDS)
        self.child = it.start('controller', *ros_args)
        it.until(lambda: self.states.get_subscription_count()
                 and self.references.get_subscription_count()
                 and it.node.count_publishers(COMMANDS), 'the controller')

    def answer(self, message: JointState) -> list[float]:
        before = len(self.commands)
        self.states.publish(message)
        self.probe.until(lambda: len(self.commands) > before, 'a torque')
        return list(self.commands[-1].data)


def after_an_outage(q: Vector, dq: Vector, point: Point) -> list[float]:
    """Return the first torque of a law after a bumpless reset."""
    law = Controller(ControllerConfig())
    law.reset(bumpless=True)
    sample = law.step(q, dq, *point)
    assert not any(sample.v)
    assert list(sample.tau) == list(sample.nominal)
    return list(sample.tau)
