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
Reference node: publishes the desired motion ahead of time on the control grid.

The motion is that of its parameters, or of waypoints on ``~/joint_trajectory``. Its time comes
from ``clock`` or ``joint_states``. `MotionPlan` and `MotionSchedule` decide, the node forwards.
"""

from __future__ import annotations

from math import isfinite
from pathlib import Path
import time
from typing import Any

from ctc_chattering.configuration.loop_setup import Values
from ctc_chattering.configuration.node_parameters import ReferenceNodeConfig
from ctc_chattering.configuration.topics import (
    CLOCK,
    JOINT_STATES,
    JOINT_TRAJECTORY,
    REFERENCE,
    TOPICS,
)
from ctc_chattering.configuration.trajectory_file import read_trajectory
from ctc_chattering.errors import CtcError, RejectedMessage
from ctc_chattering.numerics.time_grid import NANOSECONDS, nanoseconds, period_ns, seconds
from ctc_chattering.ros.loop_node import LoopNode
from ctc_chattering.ros.messages import LATEST, read_stamp, TrajectoryWriter
from ctc_chattering.ros.reports import ERROR, OK, Status, WARN
from ctc_chattering.ros.subscription import qos, ValidatedSubscription
from ctc_chattering.trajectory.joint_limits import read_limits
from ctc_chattering.trajectory.motion_plan import Followed, MotionPlan
from ctc_chattering.trajectory.reference import ReferenceConfig
from ctc_chattering.trajectory.schedule import MotionSchedule
from ctc_chattering.trajectory.waypoints import Route
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

#: Time between two attempts to begin, where the start is refused [ns].
_RETRY_NS = 5 * NANOSECONDS


class ReferenceNode(LoopNode[ReferenceNodeConfig]):
    """
    Publisher of chunks of the motion, each before it is needed.

    With a publisher of ``clock`` the motion is a function of that time. Otherwise it begins with
    the first state received while there is a subscriber, and goes on with the node's clock. States
    whose stamps go neither with the node's clock nor with the state before are ignored.

    Waypoints replace the motion, and a sinusoid with other parameters replaces them. One passes
    into the other without a jump.
    """

    def __init__(self, values: Values | None = None) -> None:
        super().__init__('reference', values)
        config = self.config
        route = None
        if config.trajectory_file:
            route = read_trajectory(Path(config.trajectory_file), config.joint_names)
        self._plan = MotionPlan(config, route)
        period = period_ns(config.control_period)
        self._schedule = MotionSchedule(
            self._plan, period, round(config.horizon * NANOSECONDS))
        self._writer = TrajectoryWriter(config.joint_names, period, self._schedule.chunk_size)
        #: Why the motion does not begin, and the monotonic time of the next attempt [ns].
        self._refusal = ''
        self._next_attempt = 0
        #: Why the last waypoints were refused, empty once some are accepted.
        self._refused_waypoints = ''
        self._publisher = self.create_publisher(
            JointTrajectory, REFERENCE, qos(TOPICS[REFERENCE].depth))
        self._subscribers = 0
        self._states: ValidatedSubscription[JointState] | None = None
        self.inputs = [
            ValidatedSubscription(self, Clock, CLOCK, self._on_clock, qos(), read_stamp),
            ValidatedSubscription(
                self, JointTrajectory, f'~/{JOINT_TRAJECTORY}', self._on_waypoints, qos(10))]
        self.find_description()

    def begin(self, description: str) -> None:
        """Take the limits, and make a motion that needs no state."""
        if description:
            self._plan.limits = read_limits(description, self._plan.config.joint_names)
        self._plan.prepare()

    def check(self, config: ReferenceConfig) -> None:
        """Raise `CtcError` if a set would lead beyond the limits."""
        self._plan.check(config)

    def on_change(self) -> None:
        """Take new parameters, and try again to begin."""
        self._plan.config = self.config
        self._next_attempt = 0
        if self._plan.limits is not None or not self._plan.config.described:
            self._plan.prepare()
            self.problem = self._refusal = ''

    def spin(self, executor: Any) -> None:
        """Serve messages in batches: the horizon is long enough."""
        self.spin_in_batches(executor)

    def introduction(self) -> str:
        """Return the motion, and what begins it."""
        motion = self._plan.config.trajectory_file or 'sinusoid'
        return f'motion {motion}; waits for {JOINT_STATES} or {CLOCK}'

    def idle(self) -> None:
        """Publish due chunks, and all again for a new subscriber."""
        started = self._schedule.started
        if self._states is None and not started:
            self._states = ValidatedSubscription(
                self, JointState, JOINT_STATES, self._on_state, qos(10))
        elif self._states is not None and started:
            self._states.subscription.destroy()
            self._states = None
        self._schedule.follow_real_time(self.get_clock().now().nanoseconds)
        subscribers = self._publisher.get_subscription_count()
        if subscribers > self._subscribers:
            self._schedule.repeat()
        self._subscribers = subscribers
        self._publish_chunks()

    def status(self) -> Status:
        """Return whether the motion runs, and why not."""
        if problem := self.problem or self._refusal:
            return Status(ERROR, problem, {})
        if not self._schedule.running:
            return Status(WARN, f'waiting for {JOINT_STATES} or {CLOCK}', {})
        values = {'time': 'simulated' if self._schedule.simulated else 'real'}
        if self._refused_waypoints:
            return Status(WARN, f'the motion continues, because {JOINT_TRAJECTORY} was refused: '
                          f'{self._refused_waypoints}', values)
        return Status(OK, 'running', values)

    def _on_clock(self, now: int, _arrival: int) -> None:
        self._schedule.follow_clock(now)
        self._publish_chunks()

    def _on_state(self, state: JointState, _arrival: int) -> None:
        stamp = nanoseconds(state.header.stamp)
        t: int | None = stamp
        if self.count_publishers(CLOCK) == 0:
            heard = self._publisher.get_subscription_count() and self.matched(self._publisher)
            if not heard or not 0 <= stamp <= LATEST:
                return
            t = self._schedule.follow_states(stamp, self.get_clock().now().nanoseconds)
        if t is not None and self._plan.motion is None and not self.problem:
            self._begin_at(state, t)

    def _begin_at(self, state: JointState, t: int) -> None:
        """Begin the motion where the robot is, within the limits."""
        now = time.monotonic_ns()
        if now < self._next_attempt:
            return
        velocities = state.velocity or (0.0,) * len(state.position)
        samples = zip(state.name, state.position, velocities)
        start = {name: (q, dq) for name, q, dq in samples if isfinite(q + dq)}
        try:
            self._plan.begin(start, t)
            self._refusal = ''
        except CtcError as error:
            self._refusal = str(error)
            self._next_attempt = now + _RETRY_NS
            self.get_logger().error(self._refusal)

    def _on_waypoints(self, message: JointTrajectory, _arrival: int) -> None:
        """Follow waypoints, or stop where there are none."""
        route = Route(
            tuple(message.joint_names), [nanoseconds(x.time_from_start) for x in message.points],
            [(x.positions, x.velocities, x.accelerations) for x in message.points])
        try:
            followed = self._schedule.follow(route, nanoseconds(message.header.stamp))
        except CtcError as error:
            self._refused_waypoints = str(error)
            raise RejectedMessage(getattr(error, 'kind', 'waypoints'), str(error)) from None
        self._refused_waypoints = ''
        remaining = max(seconds(followed.end - (self._schedule.now or 0)), 0.0)
        self.get_logger().info(f'{JOINT_TRAJECTORY} is accepted: {_description(followed)}; '
                               f'the robot is at rest in {remaining:.3g} s')
        self._publish_chunks()

    def _publish_chunks(self) -> None:
        """Publish chunks until the motion is known far enough ahead."""
        if not self._schedule.running or not self._subscribers:
            return
        in_force = self._schedule.update()
        if self.parameters.changed and in_force is not None:
            if not self.matched(self._publisher):
                return
            self.parameters.announce(in_force)
        for begin, points in self._schedule.chunks():
            self._publisher.publish(self._writer.write(begin, points))


def _description(followed: Followed) -> str:
    """Return the outcome of waypoints in words."""
    if not followed.waypoints:
        return 'it has no waypoints, so the motion stops'
    text = f'{followed.waypoints} waypoints, {followed.past} of them past'
    if followed.turned:
        text += f'; these joints turn the short way: {", ".join(followed.turned)}'
    return text
