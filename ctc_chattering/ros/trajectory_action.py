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
The action by which MoveIt sends motions: control_msgs/action/FollowJointTrajectory.

The reference node has one `TrajectoryAction` where control_msgs is installed. It reads a goal,
hands its waypoints to the node, and ends it by what the controller reports. `trajectory/goal.py`
has the rules. Without ROS of apt there is no control_msgs, and no action.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
import dataclasses
from math import inf
from typing import Any

from ctc_chattering.configuration.node_parameters import ReferenceNodeConfig
from ctc_chattering.configuration.topics import REFERENCE
from ctc_chattering.controller.state_machine import Mode
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.time_grid import NANOSECONDS, nanoseconds, seconds
from ctc_chattering.ros.controller_reports import TrackingError
from ctc_chattering.ros.messages import stamp
from ctc_chattering.trajectory.goal import (
    Goal,
    GoalCode,
    GoalEnd,
    GoalTolerances,
    JointTolerance,
)
from ctc_chattering.trajectory.motion_plan import Followed
from ctc_chattering.trajectory.schedule import MotionSchedule
from ctc_chattering.trajectory.waypoints import check_names, PastWaypointsError, Route
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.task import Future
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

try:
    from control_msgs.action import FollowJointTrajectory
except ImportError:
    FollowJointTrajectory = None

__all__ = ['FollowJointTrajectory', 'TrajectoryAction', 'read_route', 'read_tolerances']

#: Time without an error from the controller after which a goal ends [s]. It covers the discovery
#: of its topic and a busy machine.
_MAX_SILENCE_S = 2.0


def read_route(message: JointTrajectory) -> Route:
    """Return the waypoints of a message, with times since its stamp."""
    times = [nanoseconds(x.time_from_start) for x in message.points]
    points = [(x.positions, x.velocities, x.accelerations) for x in message.points]
    return Route(tuple(message.joint_names), times, points)


@dataclasses.dataclass
class _ActiveGoal:
    """A goal that is followed, and the client that waits for its result."""

    goal: Goal
    handle: Any
    #: Completed with the result.
    result: Future
    #: Path time at which the motion began [ns].
    begin: int
    #: Replacements of the motion, up to that for this goal.
    replacements: int
    #: Time of the last report of the controller, by the motion [ns].
    heard: int
    #: Time at which the next feedback is due, by the motion [ns].
    feedback_due: int = 0


class TrajectoryAction:
    """
    Server of `FollowJointTrajectory`.

    rclpy refuses a goal without a reason. A goal that is not allowed is therefore accepted and
    aborted at once with its error code, and the motion goes on as before.

    Parameters
    ----------
    node : Node
        The reference node.
    config : ReferenceNodeConfig
        Its parameters at the start.
    schedule : MotionSchedule
    follow : callable
        Follows waypoints of a stamp [ns], or stops without any. It raises `CtcError`.
    listen : callable
        Has the node pass on the errors of the controller to `judge`.

    """

    def __init__(self, node: Node, config: ReferenceNodeConfig, schedule: MotionSchedule,
                 follow: Callable[[Route, int], Followed], listen: Callable[[], None]) -> None:
        self._node = node
        self._names = config.joint_names
        self._schedule = schedule
        self._follow = follow
        self._listen = listen
        self.config = config
        self._active: _ActiveGoal | None = None
        #: Why the controller would not follow a goal.
        self._refusal = ''
        self._server = ActionServer(
            node, FollowJointTrajectory, f'~/{config.action_name}', self._execute,
            goal_callback=lambda _goal: GoalResponse.ACCEPT,
            cancel_callback=lambda _handle: CancelResponse.ACCEPT)

    async def _execute(self, handle: Any) -> Any:
        """Follow a goal, and return its result once it has ended."""
        request = handle.request
        trajectory = request.trajectory
        try:
            if not trajectory.points or request.multi_dof_trajectory.points:
                raise CtcError('A goal needs points of single joints, and no others.')
            if self._refusal:
                raise CtcError(self._refusal)
            tolerances = read_tolerances(request, self.config)
            route = read_route(trajectory)
            followed = self._follow(route, nanoseconds(trajectory.header.stamp))
        except CtcError as error:
            handle.abort()
            return _result(GoalEnd(_error_code(error), str(error)))
        self._end(GoalEnd(GoalCode.INVALID_GOAL, 'A new goal replaced this one.'))
        self._listen()
        schedule = self._schedule
        now = schedule.now or 0
        self._active = active = _ActiveGoal(
            Goal(self._names, followed.end, tolerances), handle, Future(),
            schedule.path_time, schedule.replacements, now)
        return await active.result

    def update(self) -> None:
        """End a goal that is cancelled, replaced or no longer followed."""
        active, schedule = self._active, self._schedule
        if active is None:
            return
        if active.handle.is_cancel_requested:
            self._stop(GoalEnd(GoalCode.SUCCESSFUL, 'The goal was cancelled, the motion stops.'))
        elif schedule.replacements != active.replacements:
            self._end(GoalEnd(GoalCode.INVALID_GOAL, 'Another motion replaced this goal.'))
        elif self._node.count_publishers(REFERENCE) > 1:
            self._abort(f'{REFERENCE} has several publishers, so that the controller obeys none.')
        elif seconds((schedule.now or 0) - active.heard) > _MAX_SILENCE_S:
            self._abort(f'The controller has reported no error for {_MAX_SILENCE_S:g} s: it sends '
                        'no torque, or does not run.')

    def _abort(self, text: str) -> None:
        """Stop the motion, and end its goal for a reason of the graph."""
        self._stop(GoalEnd(GoalCode.INVALID_GOAL, text))

    def _stop(self, verdict: GoalEnd) -> None:
        """End the active goal, if there is one, and stop its motion."""
        active = self._active
        if active is not None and self._schedule.replacements == active.replacements:
            self._follow(Route((), [], []), 0)
        self._end(verdict)

    def _end(self, verdict: GoalEnd) -> None:
        """End the active goal, if there is one."""
        active, self._active = self._active, None
        if active is None:
            return
        if active.handle.is_cancel_requested:
            active.handle.canceled()
        elif verdict.code is GoalCode.SUCCESSFUL:
            active.handle.succeed()
        else:
            active.handle.abort()
        self._node.get_logger().info(f'goal ended: {verdict.code.name}: {verdict.text}')
        active.result.set_result(_result(verdict))

    def judge(self, sample: TrackingError) -> None:
        """Judge the goal by an error that the controller reports."""
        active, schedule = self._active, self._schedule
        if active is None or schedule.now is None:
            return
        s = schedule.path_time_of(sample.t)
        if s < active.begin:
            return
        active.heard = schedule.now
        self._send_feedback(active, sample)
        verdict = active.goal.judge(s, sample.e, sample.de)
        if verdict is not None:
            end = self._end if verdict.code is GoalCode.SUCCESSFUL else self._stop
            end(verdict)

    def _send_feedback(self, active: _ActiveGoal, sample: TrackingError) -> None:
        """Publish desired and actual state and error, if it is time."""
        if sample.t < active.feedback_due:
            return
        active.feedback_due = sample.t + round(NANOSECONDS / self.config.action_monitor_rate)
        q = [x - e for x, e in zip(sample.q_d, sample.e)]
        dq = [x - e for x, e in zip(sample.dq_d, sample.de)]
        feedback = FollowJointTrajectory.Feedback(joint_names=self._names)
        feedback.header.stamp = stamp(sample.t)
        feedback.desired = _point(sample.q_d, sample.dq_d)
        feedback.actual = _point(q, dq)
        feedback.error = _point(sample.e, sample.de)
        active.handle.publish_feedback(feedback)

    def on_mode(self, mode: Mode, text: str) -> None:
        """Abort where the controller may send no torque, or a hand leads the robot."""
        follows = mode.allows_torque and not mode.ignores_reference
        self._refusal = '' if follows else f'The controller does not follow: {text}'
        if self._refusal:
            self._abort(self._refusal)


def read_tolerances(request: Any, config: ReferenceNodeConfig) -> GoalTolerances:
    """
    Return the tolerances of a goal, by default those of the parameters.

    Raises
    ------
    ParameterError
        If a tolerance is of an unknown joint or not allowed.

    """
    path = dict(zip(config.joint_names, map(_default_tolerance, config.path_tolerance)))
    speed = config.stopped_velocity_tolerance or inf
    goal = {name: _default_tolerance(x, speed)
            for name, x in zip(config.joint_names, config.goal_tolerance)}
    for tolerances, field in (path, 'path_tolerance'), (goal, 'goal_tolerance'):
        for tolerance in getattr(request, field):
            if tolerance.name not in tolerances:
                check_names([tolerance.name], config.joint_names)
            tolerances[tolerance.name] = tolerances[tolerance.name].replaced(
                tolerance.position, tolerance.velocity)
    time = seconds(nanoseconds(request.goal_time_tolerance))
    goal_time = time if time > 0.0 else config.goal_time or inf
    return GoalTolerances(tuple(path.values()), tuple(goal.values()), goal_time)


def _default_tolerance(position: float, velocity: float = inf) -> JointTolerance:
    """Return the tolerance of a parameter, where 0 stands for none."""
    return JointTolerance(position or inf, velocity)


def _error_code(error: CtcError) -> GoalCode:
    """Return the code for waypoints that are refused."""
    if isinstance(error, PastWaypointsError):
        return GoalCode.OLD_HEADER_TIMESTAMP
    if isinstance(error, ParameterError) and error.name == 'joint_names':
        return GoalCode.INVALID_JOINTS
    return GoalCode.INVALID_GOAL


def _result(verdict: GoalEnd) -> Any:
    """Return the message of a verdict."""
    return FollowJointTrajectory.Result(
        error_code=int(verdict.code), error_string=verdict.text)


def _point(q: Sequence[float], dq: Sequence[float]) -> JointTrajectoryPoint:
    return JointTrajectoryPoint(positions=array('d', q), velocities=array('d', dq))
