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

"""The reference as a node: the desired motion, published ahead of time on the control grid."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
import time
from typing import Any

from ctc_chattering.configuration.loop_setup import Values
from ctc_chattering.configuration.node_parameters import ReferenceNodeConfig
from ctc_chattering.configuration.trajectory_file import read_trajectory
from ctc_chattering.errors import CtcError, ParameterError, RejectedMessage
from ctc_chattering.numerics.time_grid import NANOSECONDS, nanoseconds, period_ns, seconds
from ctc_chattering.ros.loop_node import LoopNode
from ctc_chattering.ros.messages import LATEST, read_stamp, TrajectoryWriter
from ctc_chattering.ros.reports import ERROR, OK, Status, WARN
from ctc_chattering.ros.subscription import qos, ValidatedSubscription
from ctc_chattering.ros.topics import CLOCK, JOINT_STATES, JOINT_TRAJECTORY, REFERENCE, TOPICS
from ctc_chattering.trajectory.joint_limits import read_limits
from ctc_chattering.trajectory.motion_plan import Followed, MotionPlan
from ctc_chattering.trajectory.reference import ReferenceConfig
from ctc_chattering.trajectory.waypoints import Route
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

#: Time between two attempts to begin, where the start is refused [ns].
_RETRY = 5 * NANOSECONDS
#: By how much stamp and arrival of two states may differ in their distance [ns].
_IN_STEP = NANOSECONDS // 4


class ReferenceNode(LoopNode[ReferenceNodeConfig]):
    """
    Publishes chunks of the motion, each before it is needed.

    With a publisher of ``clock``, the motion is a function of that time. Otherwise time is that of
    the states' stamps, of any clock, and goes on with the node's: it begins with the first state
    received while there was a subscriber, if its stamp is as far from the node's clock as that of
    the state before, or near the node's clock; other states are passed over.

    Waypoints on ``~/joint_trajectory`` take the place of the motion, and a sinusoid whose
    parameters are set takes theirs: it passes from one into the other without a jump.
    """

    def __init__(self, values: Values | None = None) -> None:
        super().__init__('reference', values)
        config = self.config
        route = None
        if config.trajectory_file:
            route = read_trajectory(Path(config.trajectory_file), config.joint_names)
        self._plan = MotionPlan(config, route)
        #: Why the motion does not begin, and when to try again [ns].
        self._refusal, self._retry = '', 0
        #: Why the last waypoints were refused; empty once some are accepted.
        self._refused_waypoints = ''
        self._period = period_ns(config.control_period)
        horizon = round(self.config.horizon * NANOSECONDS)
        self._ahead = max(4, horizon // self._period)
        self._piece = self._ahead // 4
        self._writer = TrajectoryWriter(config.joint_names, self._period, self._piece)
        self._publisher = self.create_publisher(
            JointTrajectory, REFERENCE, qos(TOPICS[REFERENCE].depth))
        self._simulated = False
        self._start: int | None = None
        self._now: int | None = None
        #: What the stamps of the states are ahead of the node's clock [ns].
        self._lead = 0
        self._next = 0
        self._subscribers = 0
        self._states: ValidatedSubscription[JointState] | None = None
        self.inputs = [
            ValidatedSubscription(self, Clock, CLOCK, self._on_clock, qos(), read_stamp),
            ValidatedSubscription(
                self, JointTrajectory, f'~/{JOINT_TRAJECTORY}', self._on_route, qos(10))]
        self.find_description()

    def begin(self, description: str) -> None:
        """Know the limits, and make the motion if the robot's state is not needed for it."""
        if description:
            self._plan.limits = read_limits(description, self._plan.config.joint_names)
        self._plan.prepare()

    def check(self, config: ReferenceConfig) -> None:
        """Raise `CtcError` if a set would lead beyond the limits."""
        self._plan.check(config)

    def on_change(self) -> None:
        """Try again to begin, where that was refused; `_extend` sees what else has changed."""
        self._plan.config = self.config
        self._retry = 0
        if self._plan.limits is not None or not self._plan.config.described:
            self._plan.prepare()
            self.problem = self._refusal = ''

    def spin(self, executor: Any) -> None:
        """Take what has come, in batches: the horizon is long enough."""
        self.spin_in_batches(executor)

    def introduction(self) -> str:
        """Return the motion, and what begins it."""
        motion = self._plan.config.trajectory_file or 'sinusoid'
        return f'motion {motion}; waits for {JOINT_STATES} or {CLOCK}'

    def idle(self) -> None:
        """Publish what the node's own clock asks for, and again for a new subscriber."""
        begun = self._start is not None and self._plan.motion is not None
        if self._states is None and not begun:
            self._states = ValidatedSubscription(
                self, JointState, JOINT_STATES, self._on_state, qos(10))
        elif self._states is not None and begun:
            self._states.subscription.destroy()
            self._states = None
        if self._start is not None and not self._simulated:
            self._advance(self.get_clock().now().nanoseconds + self._lead - self._start)
        count = self._publisher.get_subscription_count()
        if count > self._subscribers and self._now is not None:
            self._next = self._now // self._period
        self._subscribers = count
        self._extend()

    def status(self) -> Status:
        """Return what the motion does."""
        if problem := self.problem or self._refusal:
            return Status(ERROR, problem, {})
        if self._now is None or self._plan.motion is None:
            return Status(WARN, f'waiting for {JOINT_STATES} or {CLOCK}', {})
        values = {'time': 'simulated' if self._simulated else 'real'}
        if self._refused_waypoints:
            return Status(WARN, f'running as before, because {JOINT_TRAJECTORY} was refused: '
                          f'{self._refused_waypoints}', values)
        return Status(OK, 'running', values)

    def _on_clock(self, now: int, _arrival: int) -> None:
        if self._start is not None and not self._simulated:
            raise RejectedMessage('real_time', 'the motion follows real time since its start')
        if self._simulated and now == self._now:
            # Time stands still, maybe because what was published has not been taken.
            self._next = now // self._period
        self._simulated, self._start = True, 0
        self._advance(now)
        self._extend()

    def _advance(self, now: int) -> None:
        """Note the time of the motion [ns]; if it went back, start again from there."""
        if self._now is not None and now < self._now:
            self._next = now // self._period
            self._plan.restart()
        self._now = now

    def _on_state(self, state: JointState, _arrival: int) -> None:
        t = nanoseconds(state.header.stamp)
        if self.count_publishers(CLOCK) == 0:
            if not self._publisher.get_subscription_count() or not self.matched(self._publisher):
                return
            before, lead = self._lead, t - self.get_clock().now().nanoseconds
            if self._start is None:
                self._lead = lead
            if abs(lead - before) >= _IN_STEP or not 0 <= t <= LATEST:
                return
            if self._start is None:
                self._start = t
            t -= self._start
        if self._plan.motion is None and not self.problem:
            self._begin_at(state, t)

    def _begin_at(self, state: JointState, t: int) -> None:
        """Begin the motion where the robot is, unless that is beyond the limits."""
        now = time.monotonic_ns()
        if now < self._retry:
            return
        velocities = state.velocity or (0.0,) * len(state.position)
        start = {name: (q, dq) for name, q, dq in zip(
            state.name, state.position, velocities) if isfinite(q + dq)}
        try:
            self._plan.begin(start, t)
            self._refusal = ''
        except CtcError as error:
            self._refusal, self._retry = str(error), now + _RETRY
            self.get_logger().error(self._refusal)

    def _on_route(self, chunk: JointTrajectory, _arrival: int) -> None:
        """Go through waypoints, or stop, after what has been published already."""
        try:
            if self._now is None or self._plan.motion is None:
                raise RejectedMessage('early', 'the motion has not begun')
            self._follow(chunk, self._now)
        except CtcError as error:
            self._refused_waypoints = str(error)
            raise RejectedMessage(getattr(error, 'kind', 'waypoints'), str(error)) from None
        self._refused_waypoints = ''
        self._extend()

    def _follow(self, chunk: JointTrajectory, now: int) -> None:
        """Have the motion follow a message that comes at `now` [ns]; say what becomes of it."""
        begin = self._after_published(now)
        stamp, epoch = nanoseconds(chunk.header.stamp), (self._start or 0) - self._lead
        start = stamp - epoch if stamp else begin
        times = [nanoseconds(x.time_from_start) for x in chunk.points]
        for i, t in enumerate(times):
            if t < 0:
                raise ParameterError(f'points[{i}].time_from_start', seconds(t), '0 s or more')
        points = [(x.positions, x.velocities, x.accelerations) for x in chunk.points]
        followed = self._plan.follow(
            Route(tuple(chunk.joint_names), [start + t for t in times], points), now, begin, epoch)
        self._next = begin // self._period
        self.get_logger().info(
            f'{JOINT_TRAJECTORY}: accepted: {_described(followed)}; at rest in '
            f'{max(seconds(followed.end - now), 0.0):.3g} s')

    def _after_published(self, now: int) -> int:
        """Return an instant that the controller surely hears of in time [ns]."""
        return (now // self._period + self._piece) * self._period

    def _extend(self) -> None:
        """Publish chunks until the motion is known far enough ahead."""
        if self._now is None or self._plan.motion is None or not self._subscribers:
            return
        begin = self._after_published(self._now)
        if self._plan.update(self._now, begin):
            self._next = begin // self._period
        if self.parameters.changed:
            if not self.matched(self._publisher):
                return
            self.parameters.announce((self._start or 0) + self._plan.in_force)
        first = self._now // self._period
        self._next = max(self._next, first)
        while self._next < first + self._ahead:
            self._publisher.publish(self._writer.fill(
                (self._start or 0) + self._next * self._period,
                [self._plan.motion.at((self._next + k) * self._period)
                 for k in range(self._piece)]))
            self._next += self._piece


def _described(followed: Followed) -> str:
    """Return what becomes of waypoints."""
    if not followed.waypoints:
        return 'no waypoint, so that the motion stops'
    text = f'{followed.waypoints} waypoints, {followed.past} of them past'
    return f'{text}, the short way: {", ".join(followed.turned)}' if followed.turned else text
