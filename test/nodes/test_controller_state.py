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

"""``~/controller_state`` is what joint_trajectory_controller publishes, where control_msgs is."""

from __future__ import annotations

from controller_process import ControllerUnderTest
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.trajectory.reference import ReferenceConfig, Sinusoid
from processes import probe
import pytest
from ros_messages import MS, ns, reference, state

pytestmark = [pytest.mark.ros, pytest.mark.control_msgs]


def test_reference_state_error_and_torque_of_a_sample() -> None:
    from control_msgs.msg import JointTrajectoryControllerState

    motion = [Sinusoid(ReferenceConfig()).at(k * MS) for k in range(3)]
    q, dq = (0.1, 0.2), (0.3, -0.4)
    with probe() as it:
        found = it.listen(JointTrajectoryControllerState, 'controller/controller_state')
        controller = ControllerUnderTest(it, '-p', 'state_decimation:=1')
        controller.references.publish(reference(['joint1', 'joint2'], motion))
        torque = controller.answer(state(0, joint1=(q[0], dq[0]), joint2=(q[1], dq[1])))
        it.until(lambda: found, 'the state')
    (message,), expected = found, Controller(ControllerConfig()).step(q, dq, *motion[0])
    assert (ns(message.header.stamp), message.joint_names) == (0, ['joint1', 'joint2'])
    point = message.reference
    assert [list(x) for x in (point.positions, point.velocities, point.accelerations)] == [
        list(x) for x in motion[0]]
    for point, rows in ((message.feedback, (q, dq)), (message.error, (expected.e, expected.de))):
        assert [list(point.positions), list(point.velocities)] == [list(x) for x in rows]
    assert list(message.output.effort) == torque == list(expected.tau)
    assert message.speed_scaling_factor == 1.0
