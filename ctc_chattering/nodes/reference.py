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

from functools import partial
from math import inf, isfinite
from pathlib import Path
import time
from typing import Any

from ctc_chattering.configuration.collision import SelfCollision
from ctc_chattering.configuration.loop_setup import Values
from ctc_chattering.configuration.node_parameters import ReferenceNodeConfig
from ctc_chattering.configuration.topics import (
    CLOCK,
    DESIRED,
    JOINT_STATES,
    JOINT_TRAJECTORY,
    REFERENCE,
    TOPICS,
)
from ctc_chattering.configuration.trajectory_file import read_trajectory
from ctc_chattering.controller.state_machine import Mode
from ctc_chattering.errors import CtcError, RejectedMessage
from ctc_chattering.learning.learned_file import read_correction
from ctc_chattering.learning.learning_schedule import LearningSchedule
from ctc_chattering.learning.motion import motion_of
from ctc_chattering.numerics.time_grid import NANOSECONDS, nanoseconds, period_ns
from ctc_chattering.ros.controller_law import ControllerLaw
from ctc_chattering.ros.controller_reports import ControllerReports, TrackingError
from ctc_chattering.ros.loop_node import LoopNode
from ctc_chattering.ros.messages import LATEST, read_stamp, TrajectoryWriter
from ctc_chattering.ros.reports import ERROR, OK, Status, WARN
from ctc_chattering.ros.subscription import qos, ValidatedSubscription
from ctc_chattering.ros.trajectory_action import (
    FollowJointTrajectory,
    read_route,
    TrajectoryAction,
)
from ctc_chattering.trajectory.joint_limits import read_limits
from ctc_chattering.trajectory.motion_plan import Followed, MotionPlan
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig
from ctc_chattering.trajectory.schedule import MotionSchedule
from ctc_chattering.trajectory.transitions import Transition
from ctc_chattering.trajectory.waypoints import Route
import numpy as np
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

#: Postures on the way home at which links are checked for collisions.
_COLLISION_CHECKS = 201
#: Distance that links keep on the way home [m], or half of that at its ends.
_CLEARANCE_M = 0.02
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
        timing = period, round(config.horizon * NANOSECONDS)
        self._learning: LearningSchedule | None = None
        if config.learning:
            self._law = ControllerLaw(
                self, config, lambda: self._schedule.simulated, self._on_other_law)
            self._learning = LearningSchedule(self._plan, *timing, self._law.filter_of)
        if self._learning is not None and config.learning_file:
            whole = make_motion(config.changed({'start_duration': 0.0}), route)
            motion = motion_of(config, route, whole)
            rows = read_correction(Path(config.learning_file), motion, config, None, '')
            self._learning.learner.remember(motion.name, rows)
            self._law.learned_motion = motion.name
        self._schedule = self._learning or MotionSchedule(self._plan, *timing)
        #: Last report on what is learned in the log.
        self._logged = ''
        self._writer = TrajectoryWriter(config.joint_names, period, self._schedule.chunk_size)
        #: Why the motion does not begin, and the monotonic time of the next attempt [ns].
        self._refusal = ''
        self._next_attempt = 0
        #: Why the last waypoints were refused, empty once some are accepted.
        self._refused_waypoints = ''
        self._publisher = self.create_publisher(
            JointTrajectory, REFERENCE, qos(TOPICS[REFERENCE].depth))
        #: The motion without its correction, if there may be one.
        self._desired = self.create_publisher(
            JointTrajectory, DESIRED, qos(TOPICS[DESIRED].depth)) if config.learning else None
        self._subscribers = 0
        self._states: ValidatedSubscription[JointState] | None = None
        self.inputs = [
            ValidatedSubscription(self, Clock, CLOCK, self._on_clock, qos(), read_stamp),
            ValidatedSubscription(
                self, JointTrajectory, f'~/{JOINT_TRAJECTORY}', self._on_waypoints, qos(10))]
        self._description = ''
        #: Replacement of the motion by a stop, after which it goes home.
        self._stop_before_home: int | None = None
        self.urgent = [self.create_service(Trigger, '~/stop', self._on_stop),
                       self.create_service(Trigger, '~/home', self._on_home)]
        self._reports = ControllerReports(
            self, config.joint_names, self._on_mode, self._on_error)
        if self._learning is not None:
            self._reports.listen()
            self.urgent += [
                self.create_service(SetBool, '~/freeze_learning',
                                    partial(_freeze_learning, self._learning)),
                self.create_service(Trigger, '~/reset_learning',
                                    partial(_reset_learning, self._learning))]
        self._action: TrajectoryAction | None = None
        if FollowJointTrajectory is not None:
            self._action = TrajectoryAction(
                self, config, self._schedule, self._follow, self._reports.listen)
        else:
            self.get_logger().info(
                f'~/{config.action_name} is not served, because control_msgs is not installed')
        self.find_description()

    def begin(self, description: str) -> None:
        """Take the limits, and make a motion that needs no state."""
        self._description = description
        if description:
            self._plan.limits = read_limits(description, self._plan.config.joint_names)
            if self._learning is not None:
                self._learning.learner.limits = self._plan.limits
        self._plan.prepare()

    def check(self, config: ReferenceConfig) -> None:
        """Raise `CtcError` if a set would lead beyond the limits."""
        self._plan.check(config)

    def on_change(self) -> None:
        """Take new parameters, and try again to begin."""
        self._plan.config = self.config
        if self._action is not None:
            self._action.config = self.config
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
        if self._learning is not None and self._learning.repeated is not None:
            refusal = self._law.refusal(self._learning.repeated)
            if refusal and not self._learning.learner.refusal:
                self._learning.reset_learning()
            self._learning.learner.refusal = refusal
        self._log_learning()
        self._publish_chunks()
        if self._action is not None:
            self._action.update()
        if self._stop_before_home not in (None, self._schedule.replacements):
            self._stop_before_home = None
        if self._stop_before_home is not None and self._schedule.at_rest:
            self._go_home()

    def status(self) -> Status:
        """Return whether the motion runs, and why not."""
        if problem := self.problem or self._refusal:
            return Status(ERROR, problem, {})
        if not self._schedule.running:
            return Status(WARN, f'waiting for {JOINT_STATES} or {CLOCK}', {})
        values: dict[str, object] = {
            'time': 'simulated' if self._schedule.simulated else 'real'}
        if self._learning is not None:
            learner = self._learning.learner
            values |= {'learning': learner.outcome, 'pass': len(learner.passes)}
            if learner.passes:
                values['pass error'] = max(learner.passes[-1].rms)
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
            self._schedule.begin(start, t)
            self._refusal = ''
        except CtcError as error:
            self._refusal = str(error)
            self._next_attempt = now + _RETRY_NS
            self.get_logger().error(self._refusal)

    def _on_waypoints(self, message: JointTrajectory, _arrival: int) -> None:
        """Follow waypoints, or stop where there are none."""
        try:
            self._follow(read_route(message), nanoseconds(message.header.stamp))
        except CtcError as error:
            self._refused_waypoints = str(error)
            raise RejectedMessage(getattr(error, 'kind', 'waypoints'), str(error)) from None

    def _on_mode(self, mode: Mode, text: str) -> None:
        """Take the place of a robot that is held, and end a goal that is not followed."""
        if mode is Mode.HELD:
            self._reports.listen()
        if self._action is not None:
            self._action.on_mode(mode, text)

    def _on_error(self, sample: TrackingError) -> None:
        """Learn, rest where the robot is held, and judge a goal."""
        if self._learning is not None and self._learning.running:
            self._learning.learner.add(
                self._learning.path_time_of(sample.t), sample.q_d, sample.e)
            self._log_learning()
        is_held = self._reports.mode is Mode.HELD and not any(sample.dq_d)
        if is_held and self._schedule.running and not (
                self._schedule.was_at(sample.t, sample.q_d)):
            self._schedule.rest_at(sample.q_d)
            self._publish_chunks()
            self.get_logger().info('the robot is held, and the reference rests at its position')
        if self._action is not None:
            self._action.judge(self._without_correction(sample))

    def _without_correction(self, sample: TrackingError) -> TrackingError:
        """Return a sample with the errors from the desired motion."""
        if self._learning is None:
            return sample
        t, *vectors = sample
        q, dq, _ = self._learning.correction(t)
        return TrackingError(t, *np.subtract(vectors, (q, dq, q, dq)).tolist())

    def _log_learning(self) -> None:
        """Log the end of a pass, and a change of what comes of it."""
        if self._learning is not None and self._learning.learner.report != self._logged:
            self._logged = self._learning.learner.report
            self.get_logger().info(self._logged)

    def _on_other_law(self) -> None:
        """Forget what was learned under another law."""
        assert self._learning is not None
        self._learning.reset_learning()
        self.get_logger().warning(
            'the law of the controller has changed; what was learned is forgotten')

    def _follow(self, route: Route, stamp: int) -> Followed:
        """Follow waypoints of the topic or the action."""
        if len(route.points):
            self._check_followed()
        followed = self._schedule.follow(route, stamp)
        self._refused_waypoints = ''
        self.get_logger().info(f'{JOINT_TRAJECTORY} is accepted: {_description(followed)}; '
                               f'the robot is at rest {self._rest_time(followed)}')
        self._publish_chunks()
        return followed

    def _check_followed(self) -> None:
        """Refuse a motion that the controller does not follow."""
        mode = self._reports.mode
        if mode is not None and mode.ignores_reference:
            raise RejectedMessage('held', f'the robot is {mode.text}')

    def _rest_time(self, followed: Followed) -> str:
        """Return in words when the motion comes to rest."""
        remaining = self._schedule.time_until(followed.end)
        return f'in {remaining:.3g} s' if remaining < inf else 'once speed_scaling is above 0'

    def _on_stop(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Bring the motion to rest on its path, and hold there."""
        self._stop_before_home = None
        try:
            followed = self._follow(Route((), [], []), 0)
        except CtcError as error:
            response.message = str(error)
            return response
        response.success = True
        response.message = f'The motion stops. It rests {self._rest_time(followed)}.'
        return response

    def _on_home(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Go to where the configured motion begins, after a stop."""
        mode = self._reports.mode
        if not self._schedule.at_rest and not (mode is not None and mode.ignores_reference):
            self._on_stop(request, response)
            if response.success:
                self._stop_before_home = self._schedule.replacements
                response.message += ' Then it goes home.'
            return response
        response.message = self._go_home()
        response.success = not self._refused_waypoints
        return response

    def _go_home(self) -> str:
        """Begin the way home, and describe the outcome."""
        self._stop_before_home = None
        try:
            self._check_followed()
            checked = self._check_collisions(self._schedule.plan_home())
            self._schedule.follow_real_time(self.get_clock().now().nanoseconds)
            followed = self._schedule.go_home()
        except CtcError as error:
            self._refused_waypoints = str(error)
            self.get_logger().error(f'~/home: {error}')
            return str(error)
        self._refused_waypoints = ''
        text = f'The motion goes home. It rests there {self._rest_time(followed)}. {checked}'
        self.get_logger().info(f'~/home: {text}')
        self._publish_chunks()
        return text

    def _check_collisions(self, way: Transition) -> str:
        """Refuse a way on which links come too near each other, and tell what was checked."""
        instants = np.linspace(way.t0, way.end, _COLLISION_CHECKS)
        t = (instants - way.t0) / NANOSECONDS
        positions = np.array([way.at(round(instant))[0] for instant in instants])
        try:
            links = SelfCollision(
                self._description, self.config.joint_names, {}, positions[[-1, 0]], _CLEARANCE_M)
        except CtcError as error:
            return f'Links were not checked for collisions: {error}.'
        approach = links.nearest(t, positions)
        if approach.spare < 0.0:
            raise CtcError(f'nearest approach of two links on the way home: {approach.text}')
        return f'The nearest approach of two links is {approach.text}.'

    def _publish_chunks(self) -> None:
        """Publish chunks until the motion is known far enough ahead."""
        if not self._schedule.running or not self._subscribers:
            return
        in_force = self._schedule.update()
        if self.parameters.changed and in_force is not None:
            publishers = filter(None, (self._publisher, self._desired))
            if not self.matched(*publishers):
                return
            self.parameters.announce(in_force)
        for begin, points in self._schedule.chunks():
            if self._desired is not None:
                desired = self._schedule.desired(begin)
                self._desired.publish(self._writer.write(begin, desired))
            self._publisher.publish(self._writer.write(begin, points))


def _freeze_learning(learning: LearningSchedule, request: SetBool.Request,
                     response: SetBool.Response) -> SetBool.Response:
    """Keep what was learned as it is, or learn again."""
    learning.freeze(request.data)
    response.success = True
    response.message = ('What was learned stays as it is.' if request.data
                        else 'Learning goes on with the next pass.')
    return response


def _reset_learning(learning: LearningSchedule, _request: Trigger.Request,
                    response: Trigger.Response) -> Trigger.Response:
    """Forget what was learned."""
    learning.reset_learning()
    response.success = True
    response.message = 'What was learned is forgotten, and its correction fades out.'
    return response


def _description(followed: Followed) -> str:
    """Return the outcome of waypoints in words."""
    if not followed.waypoints:
        return 'it has no waypoints, so the motion stops'
    text = f'{followed.waypoints} waypoints, {followed.past} of them past'
    if followed.turned:
        text += f'; these joints turn the short way: {", ".join(followed.turned)}'
    return text
