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

"""A reference that learns, with a robot and its controller as real processes."""

from __future__ import annotations

import time

from builtin_interfaces.msg import Duration
from faults import Diagnostics
import numpy as np
from processes import probe
import pytest
from rclpy.action import ActionClient
from ros_messages import ns
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

pytestmark = pytest.mark.ros
LEARNING = ('-p', 'learning:=true', '-p', 'frequency:=[4.0, 4.0]', '-p', 'amplitude:=[0.05, 0.05]',
            '-p', 'control_period:=0.005')
ROBOT = ('-p', 'control_period:=0.005', '-p', 'initial_position:=[3.14159, 1.5708]')
GOAL = JointTrajectory(joint_names=['joint1', 'joint2'], points=[
    JointTrajectoryPoint(
        positions=q, velocities=[0.0, 0.0], time_from_start=Duration(nanosec=t))
    for t, q in ((400_000_000, [3.3, 1.7]), (800_000_000, [3.14, 1.57]))])
LAW = ('-p', 'control_period:=0.005', '-p', 'law:=pd_gravity')


def test_services_freeze_and_reset_and_another_law_forgets_what_was_learned() -> None:
    with probe() as it:
        reports = Diagnostics(it)
        it.start('reference', *LEARNING)
        it.start('controller', *LAW)
        it.start('plant', *ROBOT, '-p', 'pacing:=lockstep')
        it.until_said('pass 2: the RMS error of the worst joint is')
        frozen = it.call(SetBool, '/reference/freeze_learning', SetBool.Request(data=True))
        assert frozen.success and frozen.message == 'What was learned stays as it is.'
        it.until_said('pass ', 'rad; frozen')
        report = reports.next('reference')
        assert report.values['learning'] == 'frozen' and int(report.values['pass']) >= 2
        assert 0.0 < float(report.values['pass error']) < 0.1
        thawed = it.call(SetBool, '/reference/freeze_learning', SetBool.Request(data=False))
        assert thawed.success and thawed.message == 'Learning goes on with the next pass.'
        reports.until('reference', lambda r: r.values['learning'] == 'learning', 'learning')

        assert it.set('controller', 'error_limit', [5.0, 5.0]).successful
        assert it.set('controller', 'kp', [150.0, 150.0]).successful
        it.until_said('the law of the controller has changed; what was learned is forgotten')
        assert len([x for x in it.lines if 'is forgotten' in x]) == 1
        assert len([x for x in it.lines if 'pass 1: ' in x]) <= 2
        it.until(lambda: len([x for x in it.lines if 'pass 1: ' in x]) == 2, 'a first pass')
        reset = it.call(Trigger, '/reference/reset_learning', Trigger.Request())
        assert reset.success
        assert reset.message == 'What was learned is forgotten, and its correction fades out.'
        it.until(lambda: len([x for x in it.lines if 'pass 1: ' in x]) == 3, 'a first pass')

        assert it.set('controller', 'state_decimation', 100).successful
        it.until_said('learning: with state_decimation 100, errors come too rarely')
        assert not any('Traceback' in line for line in it.lines)


def test_a_motion_goes_on_without_its_controller() -> None:
    """
    Its chunks follow each other.

    A busy computer makes gaps between a few. `test_learning_schedule.py` tests how long one is
    held back.
    """
    with probe() as it:
        chunks = it.listen(JointTrajectory, 'reference')
        it.start('reference', *LEARNING)
        controller = it.start('controller', *LAW, '-p', 'least_answered:=0.0')
        it.start('plant', *ROBOT)
        it.until_said('pass 1: ')
        controller.process.kill()
        it.until_said('the controller has reported no errors of the pass')
        end = ns(chunks[-1].header.stamp)
        it.until(lambda: ns(chunks[-1].header.stamp) > end + 2 * 10 ** 9, 'the motion')
        begins = sorted({x for m in chunks if (x := ns(m.header.stamp)) >= end})
        length = ns(chunks[0].points[-1].time_from_start)
        assert np.median(np.diff(begins)) == length + 5_000_000
        it.start('controller', *LAW, '-p', 'least_answered:=0.0')
        count = len(it.lines)
        it.until(lambda: any('pass ' in line for line in it.lines[count:]), 'the next pass')


def test_the_same_goal_again_is_another_pass() -> None:
    """In real time: a busy computer may spoil a pass, and the goal is sent once more."""
    with probe() as it:
        sent = it.node.create_publisher(JointTrajectory, 'reference/joint_trajectory', 10)
        it.start('reference', *LEARNING, '-p', 'amplitude:=[0.0, 0.0]')
        it.start('controller', *LAW, '-p', 'least_answered:=0.0')
        it.start('plant', *ROBOT)
        it.until_said('no pass yet: learning: no joint moves')
        it.until(sent.get_subscription_count, 'the reference')
        due = time.monotonic()

        def third_pass() -> bool:
            nonlocal due
            if time.monotonic() > due:
                sent.publish(GOAL)
                due = time.monotonic() + 1.5
            return any('pass 3: ' in line for line in it.lines)

        it.until(third_pass, 'the third pass')
        errors = [float(line.split(' is ')[1].split(' rad')[0])
                  for line in it.lines if ' RMS error ' in line]
        assert errors[-1] < 0.7 * errors[0]


@pytest.mark.control_msgs
def test_a_goal_is_judged_by_the_error_from_the_desired_motion() -> None:
    """That from the corrected one stays as large as the correction."""
    from control_msgs.action import FollowJointTrajectory
    with probe() as it:
        tracking = it.listen(JointState, 'controller/tracking')
        client = ActionClient(it.node, FollowJointTrajectory, 'reference/follow_joint_trajectory')
        it.start('reference', *LEARNING, '-p', 'amplitude:=[0.0, 0.0]', '-p', 'goal_time:=0.2',
                 '-p', 'stopped_velocity_tolerance:=0.0', '-p', 'goal_tolerance:=[0.01, 0.01]')
        it.start('controller', *LAW, '-p', 'least_answered:=0.0')
        it.start('plant', *ROBOT, '-p', 'coulomb_friction:=[9.0, 4.0]')
        it.until(client.server_is_ready, 'the action')
        it.until(lambda: tracking, 'the motion')
        codes = []
        for _ in range(4):
            sent = client.send_goal_async(FollowJointTrajectory.Goal(trajectory=GOAL))
            it.until(sent.done, 'the goal')
            result = sent.result().get_result_async()
            it.until(result.done, 'the result')
            codes.append(result.result().result.error_code)
        assert codes[0] == FollowJointTrajectory.Result.GOAL_TOLERANCE_VIOLATED
        assert codes[-1] == FollowJointTrajectory.Result.SUCCESSFUL, it.lines
        assert max(map(abs, tracking[-1].position[2:])) > 0.012
