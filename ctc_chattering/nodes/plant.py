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
The simulated robot as a node.

It takes the torques on `COMMANDS` and the parameters of `PlantNodeConfig`, and publishes joint
states. The motion is that of `simulation/plant.py`.
"""

from __future__ import annotations

from math import inf
import time

from ctc_chattering.configuration.loop_setup import Values
from ctc_chattering.configuration.node_parameters import PlantNodeConfig
from ctc_chattering.configuration.topics import CLOCK, COMMANDS, JOINT_STATES, select, TOPICS
from ctc_chattering.controller.health import FaultCount, FaultKind, FaultRates
from ctc_chattering.controller.lockstep_exchange import LockstepExchange
from ctc_chattering.controller.watchdog import Watchdog
from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.numerics.angles import within_turn
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS, period_ns, samples, seconds
from ctc_chattering.ros.loop_node import LoopNode
from ctc_chattering.ros.messages import (
    effort_reader,
    LoopMessage,
    raw_sender,
    stamp,
    state_writer,
)
from ctc_chattering.ros.reports import ERROR, OK, Status, WARN
from ctc_chattering.ros.subscription import qos, ValidatedSubscription
from ctc_chattering.simulation.plant import limits_of, make_plant, Plant
from ctc_chattering.trajectory.joint_limits import describe_violations
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

#: Largest number of periods that one tick of the real-time clock makes good.
_MAX_CATCH_UP = 100
#: Lockstep: simulated time between two messages on clock [ns].
_CLOCK_PERIOD_NS = NANOSECONDS // 100
#: Lockstep: time without an answer after which it is logged, and between two such lines [s].
_WAITING_REPORT_S = 3.0
#: State of the robot without commands.
_BRAKING = 'the torque is 0 and the brakes are on'


class PlantNode(LoopNode[PlantNodeConfig]):
    """
    Publishes joint states, and holds the torques that come.

    In lockstep a state is followed by the next one as soon as its answer has come, and time is
    simulated. In real time the node's clock paces it. The robot stands still until the first
    torque comes, and is braked when no more come.
    """

    def __init__(self, values: Values | None = None) -> None:
        super().__init__('plant', values)
        config = self.config
        if config.pacing == 'real_time' and self.get_parameter('use_sim_time').value:
            raise UsageError('use_sim_time: true contradicts pacing real_time, because the '
                             'plant itself publishes the time on clock in lockstep')
        self._robot: Plant  # Made in `begin`.
        self._period = period_ns(config.control_period)
        self._last = samples(config.duration, self._period)
        self._clock_every = max(1, _CLOCK_PERIOD_NS // self._period)
        self._names = config.joint_names
        self._latest: Vector = (0.0,) * len(self._names)
        self._begun = False
        #: Whether simulated time stands still, until `hold_at` is moved on.
        self._held = False
        #: Time of sample 0 [ns], or 0 in lockstep and before the first tick.
        self._start = 0
        self._exchange = LockstepExchange(time.monotonic_ns())
        #: Real time: when the first state was sent that no torque has followed [ns].
        self._unanswered_since: int | None = None
        self._watchdog = Watchdog(COMMANDS, 'command', _BRAKING, self.get_logger())
        self._rates = FaultRates(FaultKind('{:.2g} outages per second', 0.0, 1.0))
        self.on_change()
        n = len(self._names)
        self._writer = state_writer(self._names, position=n, velocity=n, effort=n)
        lockstep = self.lockstep = config.pacing == 'lockstep'
        # The clock first: its subscribers know that a state can wait.
        self._ticker = self.create_publisher(
            Clock, CLOCK, qos(TOPICS[CLOCK].depth)) if lockstep else None
        self._states = self.create_publisher(JointState, JOINT_STATES, qos())
        self._send_state = raw_sender(self._states)
        self.find_description()

    def begin(self, description: str) -> None:
        """Make the robot, and begin to listen."""
        self._robot = make_plant(self.config, description)
        self._limits = limits_of(self.config, description)
        continuous = self.config.which_are_continuous(self._robot.model.continuous)
        self._wraps = continuous if self.config.least_angle < inf else ()
        self.inputs = [ValidatedSubscription(
            self, Float64MultiArray, COMMANDS,
            self._on_command if self.in_real_time else self._on_answer, qos(), effort_reader(),
            newest=True if self.in_real_time else None)]
        if self.in_real_time:
            self._timer = self.create_timer(seconds(self._period), self._on_tick)

    def introduction(self) -> str:
        """Return the pacing, and the messages that are waited for."""
        first = COMMANDS if self._ticker is None else f'the subscribers to {JOINT_STATES}'
        return f'simulated robot, {self.config.pacing}; {self.problem or f"waits for {first}"}'

    @property
    def in_real_time(self) -> bool:
        """Return whether the node's clock paces it."""
        return self._ticker is None

    def idle(self) -> None:
        """Begin once all nodes are matched. Repeat unanswered states."""
        if self._ticker is None or not self.inputs:
            return
        now = time.monotonic_ns()
        if not self._begun:
            if self._states.get_subscription_count() and self.matched(
                    self._states, self._ticker):
                self._begun = True
                self._publish_sample()
        elif not self._held and self._exchange.repeat_due(now):
            self._publish_clock()
            self._publish_state()
        if not self._held and seconds(now - self._exchange.sent_at) > _WAITING_REPORT_S:
            self.get_logger().info(
                f'waiting for {self._awaited()}', throttle_duration_sec=_WAITING_REPORT_S)

    def _awaited(self) -> str:
        """Return the messages or nodes that simulated time waits for."""
        if not self._begun:
            return f'the subscribers to {JOINT_STATES}'
        publishers = ', '.join(self.inputs[0].publishers())
        return (f'the answer on {COMMANDS} to the state at t = {self._robot.t:g} s; '
                + (f'{publishers} publishes there' if publishers else 'nobody publishes there'))

    def status(self) -> Status:
        """Return the state of the plant, and its reason."""
        if not self.inputs:
            return Status(ERROR, self.problem, {})
        plant = self._robot
        values: dict[str, object] = {
            'pacing': plant.config.pacing, 'time of the run [s]': plant.t,
            'computed by': plant.computed_by}
        level, message = (self._real_time_status(values) if self.in_real_time
                          else self._lockstep_status())
        if self._limits and (beyond := describe_violations(
                self._limits, [(plant.q, plant.dq, ())])):
            level, message = max(level, WARN), f'{message}; {beyond}'
        return Status(level, message, values)

    def _lockstep_status(self) -> tuple[int, str]:
        waiting = time.monotonic_ns() - self._exchange.sent_at
        if self._held:
            return OK, f'the simulated time is held at t = {self._robot.t:g} s'
        if waiting > NANOSECONDS:
            return WARN, f'waiting for {self._awaited()}, for {waiting / NANOSECONDS:.0f} s'
        return OK, 'running'

    def _real_time_status(self, values: dict[str, object]) -> tuple[int, str]:
        """Return level and text, and add outages to `values`."""
        watchdog = self._watchdog
        problems = self._rates.report(self.statistics.too_slow(self._period), FaultCount(
            watchdog.outages, seconds(time.monotonic_ns())))
        values['timeouts, command'] = watchdog.outages
        if self._robot.braking:
            return ERROR, f'no command for {seconds(watchdog.timeout):g} s; {_BRAKING}'
        if not self._begun:
            return WARN, f'waiting for {COMMANDS}'
        return next(((level, f'running, but {text}') for level, text in problems), (OK, 'running'))

    def on_change(self) -> None:
        """Take new parameters, and go on where time was held."""
        config = self.config
        self._watchdog.timeout = max(
            round(config.command_timeout * NANOSECONDS), 3 * self._period)
        self._hold_at = config.hold_at or inf
        if self.inputs:
            self._robot.configure(config)
        if self._held:
            self._held = False
            self._publish_sample()

    def _on_answer(self, efforts: LoopMessage, now: int) -> None:
        tau, = select(self._names, efforts.names or self._names, *efforts.rows)
        if not self._begun or self._held or not self._exchange.accept(tau):
            return
        self._latest = tau
        self.statistics.answer(self._exchange.sent_at, now)
        if not self._is_at_end() and self._step():
            self.statistics.sample(now, time.monotonic_ns())
            self._publish_sample()

    def _publish_sample(self) -> None:
        """Send the next state, unless time is held."""
        robot = self._robot
        while robot.t < self._hold_at:
            k, is_sent = robot.k, not robot.lost
            if is_sent:
                self._exchange.sent_at = time.monotonic_ns()
                self._publish_state()
            if k % self._clock_every == 0 or k == self._last:
                self._publish_clock()
            if is_sent and self.parameters.changed:
                self.parameters.announce(k * self._period)
            if is_sent or not self._step():
                return
        self._held = True
        self._publish_clock()

    def _publish_clock(self) -> None:
        assert self._ticker is not None
        self._ticker.publish(Clock(clock=stamp(self._robot.k * self._period)))

    def _on_command(self, efforts: LoopMessage, now: int) -> None:
        self._latest, = select(self._names, efforts.names or self._names, *efforts.rows)
        self._watchdog.feed(now)
        if self._unanswered_since is not None:
            self.statistics.answer(self._unanswered_since, now)
            self._unanswered_since = None
        if not self._begun:
            self._begun = True
            if not self._start:
                self._anchor()
            self.parameters.announce(self._start)
        self._robot.brake(False)

    def _on_tick(self) -> None:
        begin = time.monotonic_ns()
        if not self._begun:
            self._anchor()
        elif not self._catch_up(begin):
            return
        self._publish_state()
        end = time.monotonic_ns()
        self.statistics.sample(begin, end)
        if self._unanswered_since is None and self._begun and not self._robot.braking:
            self._unanswered_since = end

    def _catch_up(self, begin: int) -> bool:
        """Go on by the periods due, and return whether any were."""
        robot, now = self._robot, self.get_clock().now().nanoseconds
        if self._watchdog.check(begin):
            robot.brake(True)
            self._latest, self._unanswered_since = (0.0,) * len(self._names), None
        due = (now - self._start) // self._period - robot.k
        self.statistics.misses += max(0, due - 1)
        for _ in range(min(due, _MAX_CATCH_UP)):
            if self._is_at_end() or not self._step():
                return False
        if abs(due) > _MAX_CATCH_UP:  # The process stood still, or the clock leapt.
            self._anchor()
        if self.parameters.changed:
            self.parameters.announce(self._start + robot.k * self._period)
        return due >= 1 and not robot.lost

    def _anchor(self) -> None:
        """
        Set the present sample to the last tick due.

        A tick comes when it is due or a little later, never earlier. On a grid of another phase
        some would come before their period, and the next would have two periods to make good.
        """
        now, remaining = self.get_clock().now().nanoseconds, self._timer.time_until_next_call()
        last_tick = now - (self._period - remaining) % self._period
        self._start = last_tick - self._robot.k * self._period

    def _step(self) -> bool:
        """Go on by one period, and return whether that worked."""
        if self.failure is not None:
            return False
        try:
            self._robot.step(self._latest)
        except CtcError as error:
            self.failure = str(error)
            self.get_logger().fatal(self.failure)
            self.done.set_result(None)
        return self.failure is None

    def _publish_state(self) -> None:
        robot = self._robot
        q, dq = robot.measured
        if self._wraps:
            least_angle = self.config.least_angle
            q = [within_turn(x, least_angle) if wraps else x for x, wraps in zip(q, self._wraps)]
        self._send_state(self._writer.write(q, dq, robot.applied, t=self._start + robot.stamp))

    def _is_at_end(self) -> bool:
        """Return whether the experiment is over, and end if so."""
        k = self._robot.k
        if k != self._last or not k:
            return False
        if not self.done.done():
            text = f'the experiment has ended at t = {self._robot.t:g} s after {k + 1} samples'
            self.get_logger().info(text)
            self.done.set_result(text)
        return True
