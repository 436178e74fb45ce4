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
The action of the reference, by a client in another process than the node.

The test has the time of the graph, and reports the errors of a controller.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from typing import Any

from builtin_interfaces.msg import Duration
from controller_process import ReferenceUnderTest
from ctc_chattering.trajectory.goal import GoalCode
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import numpy as np
from processes import Probe, probe
import pytest
from rclpy.action import ActionClient
from ros_messages import MS, stamp
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

pytestmark = [pytest.mark.ros, pytest.mark.control_msgs]
S = 1000 * MS
ABORTED, CANCELED, SUCCEEDED = 6, 5, 4
JOINTS = ('joint1', 'joint2')
START = (np.pi, 0.5 * np.pi)


class ActionUnderTest:
    """The reference with its action, and the controller that the test plays."""

    def __init__(self, it: Probe, *ros_args: str) -> None:
        from control_msgs.action import FollowJointTrajectory
        self.action = FollowJointTrajectory
        self.probe = it
        self.tracking = it.node.create_publisher(JointState, 'controller/tracking', 10)
        self.reports = it.node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.client = ActionClient(
            it.node, FollowJointTrajectory, 'reference/follow_joint_trajectory')
        self.node = ReferenceUnderTest(
            it, '-p', 'control_period:=0.01', '-p', 'amplitude:=[0.0, 0.0]', *ros_args)
        self.feedback: list[Any] = []
        it.until(self.client.server_is_ready, 'the action')
        self.node.run_to(2 * S)

    def goal(self, *points: tuple[float, Sequence[float]], names: Sequence[str] = JOINTS,
             begin: int = 0, **fields: Any) -> Any:
        """Return a goal at rest, by times [s] and positions [rad]."""
        trajectory = JointTrajectory(joint_names=names, points=[
            JointTrajectoryPoint(
                positions=array('d', q), velocities=array('d', [0.0] * len(q)),
                time_from_start=Duration(sec=int(t), nanosec=round(t % 1 * S)))
            for t, q in points])
        trajectory.header.stamp = stamp(begin)
        return self.action.Goal(trajectory=trajectory, **fields)

    def send(self, goal: Any) -> Any:
        """Return the handle of a goal."""
        self.feedback.clear()
        future = self.client.send_goal_async(goal, lambda x: self.feedback.append(x.feedback))
        self.probe.until(future.done, 'the goal')
        assert future.result().accepted
        return future.result()

    def run(self, future: Any, error: Callable[[int], Sequence[float]] = lambda _: (0.0, 0.0)
            ) -> Any:
        """Track the motion with errors until a future is done, and return its result."""
        names = [f'{name}/{x}' for x in ('desired', 'error') for name in JOINTS]
        self.probe.until(self.tracking.get_subscription_count, 'the reader of the errors')
        for _ in range(100):
            self.node.run_to(self.node.now + 200 * MS)
            point = self.node.points[self.node.now]
            message = JointState(name=names)
            message.header.stamp = stamp(self.node.now)
            message.position = array('d', [*point.positions, *error(self.node.now)])
            message.velocity = array('d', [*point.velocities, 0.0, 0.0])
            self.tracking.publish(message)
            self.probe.executor.spin_once(timeout_sec=0.05)
            if future.done():
                return future.result()
        raise AssertionError(f'the goal has not ended: {self.probe.lines}')

    def result(self, handle: Any, *args: Any) -> tuple[int, GoalCode, str]:
        """Return status, code and text of a goal that is tracked."""
        end = self.run(handle.get_result_async(), *args)
        return end.status, GoalCode(end.result.error_code), end.result.error_string

    def report(self, mode: str, text: str) -> None:
        """Report the mode of the controller."""
        self.reports.publish(DiagnosticArray(status=[DiagnosticStatus(
            name='/controller', message=text, values=[KeyValue(key='mode', value=mode)])]))

    def rests_at(self) -> list[float]:
        """Return the position of the last published point, which is at rest."""
        self.node.run_to(self.node.now + 2 * S)
        last = self.node.points[max(self.node.points)]
        assert not any(last.velocities)
        return list(last.positions)


def moveit_points(count: int, duration: float, goal: Sequence[float]
                  ) -> list[tuple[float, Sequence[float]]]:
    """Return as many points from the start to a goal as MoveIt plans, the first one at 0."""
    s = np.linspace(0.0, 1.0, count)
    blend = s ** 3 * (10.0 - 15.0 * s + 6.0 * s * s)
    return [(duration * x, tuple(np.array(START) + w * (np.array(goal) - START)))
            for x, w in zip(s, blend)]


def test_a_planned_trajectory_succeeds_with_feedback_on_the_way() -> None:
    with probe() as it:
        action = ActionUnderTest(it, '-p', 'goal_tolerance:=[0.02, 0.02]')
        handle = action.send(action.goal(*moveit_points(80, 3.0, (2.5, 1.0))))
        assert action.result(handle, lambda _: (0.01, -0.01)) == (
            SUCCEEDED, GoalCode.SUCCESSFUL, 'The joints have reached the goal.')
        assert action.rests_at() == [2.5, 1.0]
        assert len(action.feedback) > 3
        for feedback in action.feedback:
            assert feedback.joint_names == list(JOINTS)
            assert np.allclose(np.array(feedback.desired.positions) - feedback.actual.positions,
                               feedback.error.positions)
            assert list(feedback.error.positions) == [0.01, -0.01]
        desired = [x.desired.positions[0] for x in action.feedback]
        assert desired == sorted(desired, reverse=True) and len(set(desired)) > 3


def test_a_goal_that_is_not_allowed_says_why_and_moves_nothing() -> None:
    from control_msgs.msg import JointTolerance
    with probe() as it:
        action = ActionUnderTest(it)
        near = (1.0, (3.0, 1.5))
        for goal, code in (
                (action.goal(near, names=('a', 'b')), GoalCode.INVALID_JOINTS),
                (action.goal(near, begin=S // 2), GoalCode.OLD_HEADER_TIMESTAMP),
                (action.goal(near, near), GoalCode.INVALID_GOAL),
                (action.goal((1.0, (np.nan, 1.5))), GoalCode.INVALID_GOAL),
                (action.goal((1.0, (1e308, -1e308)), (2.0, (-1e308, 1e308))),
                 GoalCode.INVALID_GOAL),
                (action.goal((1.0, (3.0, 1.5, 1.0))), GoalCode.INVALID_GOAL),
                (action.goal((1.0, ())), GoalCode.INVALID_GOAL),
                (action.goal(near, names=('joint1', 'joint1')), GoalCode.INVALID_JOINTS),
                (action.goal(), GoalCode.INVALID_GOAL),
                (action.goal(near, path_tolerance=[JointTolerance(name='joint1', position=-0.5)]),
                 GoalCode.INVALID_GOAL),
                (action.goal(near, goal_tolerance=[JointTolerance(name='x', position=0.5)]),
                 GoalCode.INVALID_JOINTS)):
            future = action.send(goal).get_result_async()
            it.until(future.done, 'the result')
            assert (future.result().status, future.result().result.error_code) == (ABORTED, code)
            assert future.result().result.error_string
        assert action.rests_at() == pytest.approx(START)


def test_errors_beyond_a_tolerance_end_a_goal_and_stop_the_motion() -> None:
    from control_msgs.msg import JointTolerance
    with probe() as it:
        action = ActionUnderTest(it, '-p', 'path_tolerance:=[0.5, 0.5]')
        handle = action.send(action.goal((9.0, (2.0, 1.5))))
        begin = action.node.now
        status, code, text = action.result(
            handle, lambda t: (0.6 if t > begin + S else 0.4, 0.0))
        assert (status, code) == (ABORTED, GoalCode.PATH_TOLERANCE_VIOLATED)
        assert text == 'The motion left its path: joint1: position error 0.6, allowed 0.5.'
        assert 2.5 < action.rests_at()[0] < 3.1

        goal = action.goal((1.0, (2.9, 1.5)), goal_time_tolerance=Duration(sec=1), goal_tolerance=[
            JointTolerance(name='joint2', position=0.01)], path_tolerance=[
                JointTolerance(name='joint2', position=-1.0)])
        status, code, text = action.result(action.send(goal), lambda _: (0.0, 0.7))
        assert (status, code) == (ABORTED, GoalCode.GOAL_TOLERANCE_VIOLATED)
        assert 'joint2: position error 0.7, allowed 0.01' in text


def test_a_cancelled_goal_stops_smoothly_and_a_new_one_replaces_the_old() -> None:
    with probe() as it:
        action = ActionUnderTest(it)
        first = action.send(action.goal((9.0, (2.0, 1.5))))
        end_of_first = first.get_result_async()
        action.node.run_to(action.node.now + S)
        second = action.send(action.goal((5.0, (3.5, 1.5))))
        end = action.run(end_of_first)
        assert (end.status, end.result.error_code) == (ABORTED, GoalCode.INVALID_GOAL)
        assert 'A new goal replaced this one.' in end.result.error_string
        end_of_second = second.get_result_async()
        cancelled = second.cancel_goal_async()
        it.until(cancelled.done, 'the cancellation')
        assert len(cancelled.result().goals_canceling) == 1
        assert action.run(end_of_second).status == CANCELED
        assert START[0] - 0.5 < action.rests_at()[0] < 3.5
        q, dq = (np.array([getattr(p, x) for _, p in sorted(action.node.points.items())])
                 for x in ('positions', 'velocities'))
        assert np.abs(np.diff(q, axis=0) / 0.01 - 0.5 * (dq[1:] + dq[:-1])).max() < 0.02


@pytest.mark.parametrize('reason', ['trip', 'topic', 'parameter', 'publisher', 'silence', 'time'])
def test_a_goal_ends_with_an_error_when_something_else_decides(reason: str) -> None:
    with probe() as it:
        action = ActionUnderTest(it)
        handle = action.send(action.goal((30.0, (2.0, 1.5))))
        future = handle.get_result_async()
        it.until(action.reports.get_subscription_count, 'the reader of the reports')
        it.until_said('joint_trajectory is accepted')
        if reason == 'trip':
            action.report('RUNNING', 'running')
            action.node.run_to(action.node.now + S)
            assert not future.done()
            action.report('TRIPPED', 'tripped: joint1 has left its limits')
            text = 'The controller does not follow: tripped: joint1 has left its limits'
        elif reason == 'topic':
            topic = it.node.create_publisher(JointTrajectory, 'reference/joint_trajectory', 10)
            it.until(topic.get_subscription_count, 'the reference')
            topic.publish(action.goal((5.0, (3.0, 1.5))).trajectory)
            text = 'Another motion replaced this goal.'
        elif reason == 'parameter':
            assert it.set('reference', 'amplitude', [0.1, 0.1]).successful
            action.node.run_to(action.node.now + S)
            text = 'Another motion replaced this goal.'
        elif reason == 'time':
            action.node.clock.publish(Clock(clock=stamp(0)))
            text = 'Another motion replaced this goal.'
        elif reason == 'publisher':
            it.node.create_publisher(JointTrajectory, 'reference', 10)
            text = 'reference has several publishers, so that the controller obeys none.'
        else:
            action.node.run_to(action.node.now + 4 * S)
            text = ('The controller has reported no error for 2 s: it sends no torque, or does '
                    'not run.')
        it.until(future.done, 'the result')
        end = future.result()
        assert (end.status, end.result.error_code) == (ABORTED, GoalCode.INVALID_GOAL)
        assert end.result.error_string == text
        if reason == 'trip':
            future = action.send(action.goal((5.0, (3.0, 1.5)))).get_result_async()
            it.until(future.done, 'the refusal')
            assert future.result().result.error_string == text
            assert action.rests_at()[0] > 2.9


def test_a_lower_speed_stretches_a_goal_and_none_holds_it() -> None:
    with probe() as it:
        action = ActionUnderTest(it, '-p', 'speed_scaling:=0.5')
        begin = action.node.now
        handle = action.send(action.goal((1.0, (3.0, 1.5))))
        assert action.result(handle)[:2] == (SUCCEEDED, GoalCode.SUCCESSFUL)
        assert begin + 2 * S < action.node.now < begin + 3 * S


def test_a_goal_whose_client_has_left_is_followed_to_its_end() -> None:
    """As by joint_trajectory_controller: who wants a stop must ask for it."""
    with probe() as it:
        action = ActionUnderTest(it)
        goal_handle = action.send(action.goal((2.0, (2.5, 1.2))))
        begin = action.node.now
        del goal_handle
        action.client.destroy()
        it.until(lambda: it.node.count_clients(
            'reference/follow_joint_trajectory/_action/send_goal') == 0, 'the end of the client')
        action.node.run_to(begin + 3 * S)
        assert list(action.node.points[max(action.node.points)].positions) == [2.5, 1.2]
