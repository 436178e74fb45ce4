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

"""A controller or a reference between messages of the test, in its time."""

from __future__ import annotations

from processes import Probe
from ros_messages import COMMANDS, MS, ns, stamp
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint


class ControllerUnderTest:
    """
    A controller process between our states and references, and its torques.

    Time is ours, or real time where it is not `simulated`. It then answers at once, unless
    `least_answered` is among the arguments.
    """

    def __init__(self, it: Probe, *ros_args: str, simulated: bool = True) -> None:
        self.probe = it
        if simulated:
            self.clock = it.node.create_publisher(Clock, 'clock', 1000)
        self.states = it.node.create_publisher(JointState, 'joint_states', 1000)
        self.references = it.node.create_publisher(JointTrajectory, 'reference', 1000)
        self.commands = it.listen(Float64MultiArray, COMMANDS)
        at_once = () if simulated else ('-p', 'least_answered:=0.0')
        self.child = it.start('controller', *at_once, *ros_args)
        it.until(lambda: self.states.get_subscription_count()
                 and self.references.get_subscription_count()
                 and it.node.count_publishers(COMMANDS), 'the controller')

    def answer(self, message: JointState) -> list[float]:
        before = len(self.commands)
        self.states.publish(message)
        self.probe.until(lambda: len(self.commands) > before, 'a torque')
        return list(self.commands[-1].data)


class ReferenceUnderTest:
    """A reference process in our time, and the points that it publishes."""

    def __init__(self, it: Probe, *ros_args: str) -> None:
        self.probe = it
        self.chunks = it.listen(JointTrajectory, 'reference')
        self.clock = it.node.create_publisher(Clock, 'clock', 10)
        it.start('reference', *ros_args)
        it.until(self.clock.get_subscription_count, 'the reference')
        self.now = -200 * MS
        self._points: dict[int, JointTrajectoryPoint] = {}
        self._taken = 0

    @property
    def points(self) -> dict[int, JointTrajectoryPoint]:
        """Return the points by their instants [ns]; of two, the one sent later."""
        for m in self.chunks[self._taken:]:
            start = ns(m.header.stamp)
            self._points.update({start + ns(p.time_from_start): p for p in m.points})
            self._taken += 1
        return self._points

    def run_to(self, end: int, ahead: int = 400 * MS) -> None:
        """Publish times up to `end`, and wait for the motion ahead [ns]."""
        while self.now < end:
            self.now += 200 * MS
            self.clock.publish(Clock(clock=stamp(self.now)))
            self.probe.until(
                lambda: self.chunks and max(self.points) >= self.now + ahead, 'the motion ahead')
