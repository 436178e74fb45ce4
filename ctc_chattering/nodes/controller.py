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
The controller as a node.

It answers joint states with torques. Its inputs are states and reference, the parameters of
`ControllerNodeConfig`, and two services. `controller/loop.py` decides without ROS if a torque is
sent, and `control/controller.py` computes it. `cli/node.py` makes the node by its name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import inf
import time
from typing import Any

from ctc_chattering.compiled.machine_code import HOW_TO_COMPILE
from ctc_chattering.configuration.loop_setup import Values
from ctc_chattering.configuration.node_parameters import ControllerNodeConfig
from ctc_chattering.configuration.topics import (
    CLOCK,
    COMMANDS,
    FILTER,
    JOINT_STATES,
    REFERENCE,
    ROBOT_DESCRIPTION,
    select,
    TORQUES,
    TRACKING,
)
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.control.laws.registry import LAWS
from ctc_chattering.control.recommended_gains import (
    gain_owner,
    GainChoice,
    GAINS,
    model_torque,
)
from ctc_chattering.controller.loop import Answer, ControlLoop
from ctc_chattering.controller.positions import JointSample
from ctc_chattering.controller.rehearsal import Rehearsal
from ctc_chattering.controller.stamps import STALE
from ctc_chattering.controller.state_machine import Input, Mode
from ctc_chattering.controller.status import loop_status
from ctc_chattering.controller.trips import check_change, missing_limits
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError, RejectedMessage
from ctc_chattering.numerics.time_grid import seconds
from ctc_chattering.ros.loop_node import LoopNode
from ctc_chattering.ros.messages import (
    effort_writer,
    LATEST,
    LoopMessage,
    raw_sender,
    state_reader,
    state_writer,
    trajectory_reader,
    Writer,
)
from ctc_chattering.ros.reports import ERROR, MODE, Status
from ctc_chattering.ros.spinning import TICK
from ctc_chattering.ros.subscription import qos, ValidatedSubscription
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

#: Shortest wait for a message: with a wait of 0 EventsExecutor hangs [s].
_SHORTEST_WAIT_S = 1e-5
#: Terms of the torque on the topic `TORQUES`, in the order of `_publish_terms`.
_TORQUE_TERMS = 'nominal', 'compensation', 'robust', 'commanded'


class ControllerNode(LoopNode[ControllerNodeConfig]):
    """
    Answers every joint state with a torque of the law.

    A state waits for its reference. In real time the node stops sending when states stop, and
    restarts the law with the next one. Simulated time can wait. All of that is in `ControlLoop`.
    """

    def __init__(self, values: Values | None = None) -> None:
        super().__init__('controller', values)
        config = self.config
        self._names = config.joint_names
        self._commands = self.create_publisher(Float64MultiArray, COMMANDS, qos())
        #: Publishers of the terms of every Nth sample.
        self._terms = [self.create_publisher(JointState, f'~/{name}', qos())
                       for name in (TRACKING, FILTER, TORQUES)]
        self._term_writers = _term_writers(self._names)
        #: Samples since the clock last restarted.
        self._samples = 0
        self._gains = GainChoice()
        #: The gains that came with the law of the last request, until `check` has taken them.
        self._of_law: dict[str, Any] = {}
        writer, send = effort_writer(self._names), raw_sender(self._commands)
        self._loop = ControlLoop(
            config, config.state_timeout, config.reference_timeout, config.enabled,
            lambda tau: send(writer.write(tau)), self.get_logger())
        self._reported_mode = self._loop.mode
        self.on_change()
        self.tick = min(TICK, seconds(self._loop.watchdog.timeout) / 2)
        #: Whether all subscribers of the torques are matched, and whether there is a clock.
        self._matched = self._clock_published = False
        self.urgent = [self.create_service(SetBool, '~/enable', self._on_enable),
                       self.create_service(Trigger, '~/reset', self._on_reset),
                       self.create_service(SetBool, '~/guide', self._on_guide)]
        self.find_description()

    def begin(self, description: str) -> None:
        """Make the law for a robot, and begin to listen."""
        model = model_of(self.config, description)
        law = self._loop.law = Controller(self.config, model)
        torque = model_torque(self.config, model)
        self._gains.torque = lambda: torque
        self._take_recommended_gains()
        self._loop.rehearsal = Rehearsal(
            Controller(self.config, model), self._loop.period, self._loop.watchdog.timeout)
        step = law.compiled_step()
        if step is not None and not all(code.compiled for code in step.codes):
            self.get_logger().info(f'law {self.config.law}: {HOW_TO_COMPILE}')
        if missing := missing_limits(self.config, law.model.effort_limits):
            self.get_logger().warning(f'{missing}; set it to the limits of the drives')
        if description:
            self._described = self.create_publisher(
                String, f'~/{ROBOT_DESCRIPTION}', qos(1, latched=True))
            self._described.publish(String(data=description))
        self.inputs = [ValidatedSubscription(
            self, JointState, JOINT_STATES, self._on_state, qos(), state_reader(), newest=False)]
        self._listen_to_reference()

    def _listen_to_reference(self) -> None:
        """
        Subscribe to the reference, once the loop has been measured.

        The reference starts only when this node subscribes, so motion and torques start together.
        """
        if len(self.inputs) == 1 and not self._loop.rehearses:
            self.inputs.append(ValidatedSubscription(
                self, JointTrajectory, REFERENCE, self._on_reference, qos(), trajectory_reader()))

    @property
    def in_real_time(self) -> bool:
        """Return whether states come in real time."""
        return self._loop.last is not None and not self._loop.simulated

    def introduction(self) -> str:
        """Return the law, and the awaited messages."""
        waits = self.problem or f'waits for {JOINT_STATES} and {REFERENCE}'
        return f'law {self.config.law}, {1 / self.config.control_period:g} Hz; {waits}'

    def _on_reference(self, chunk: LoopMessage, now: int) -> None:
        rows: list[tuple[float, ...]] = []
        if chunk.rows or chunk.names:
            rows = select(self._names, chunk.names, *chunk.rows)
        if any(second <= first for first, second in pairwise([-1, *chunk.offsets])):
            raise RejectedMessage('times', (
                'the times of its points do not increase, or one is negative'))
        times = [chunk.t + offset for offset in chunk.offsets]
        self._loop.take_reference(times, list(zip(rows[::3], rows[1::3], rows[2::3])))
        self._answer(now)

    def _on_state(self, state: LoopMessage, now: int) -> None:
        q, dq = select(self._names, state.names, *state.rows[:2])
        if state.t > LATEST:
            raise RejectedMessage('stamp', (
                f'its stamp of {seconds(state.t):.9f} s is too late; allowed: at most '
                f'{seconds(LATEST):.0f} s'))
        loop, states = self._loop, self.inputs[0]
        if loop.last is None:
            self._clock_published = self.count_publishers(CLOCK) > 0
        simulated = self.lockstep = self._clock_published
        states.newest = not simulated
        unanswered = states.skipped + states.rejected.get(STALE, 0)
        if loop.take_state(JointSample(state.t, q, dq), now, simulated, unanswered):
            self._samples = 0
            self.parameters.changed = True
            self.get_logger().info(
                f'the first state is of {seconds(state.t):.3f} s', throttle_duration_sec=1.0)
        self._answer(now)

    def idle(self) -> None:
        """Answer a pending state, and stop the torque if states stop."""
        self._clock_published = self.count_publishers(CLOCK) > 0
        if self._clock_published:
            self._loop.rehearsal = None
        if self.inputs:
            self._listen_to_reference()
        if self._loop.mode is not self._reported_mode:
            self._reported_mode = self._loop.mode
            self.report_soon()
        now = time.monotonic_ns()
        if self.in_real_time:
            self._loop.check_silence(now)
        self._answer(now)

    def patience(self) -> float:
        """Return the time until a predicted state is answered [s]."""
        due = self._loop.due()
        return inf if due is None else max(seconds(due - time.monotonic_ns()), _SHORTEST_WAIT_S)

    def overdue(self) -> None:
        """Answer a predicted state where none has come."""
        due, now = self._loop.due(), time.monotonic_ns()
        if due is not None and now >= due:
            try:
                self._loop.predict(now)
            except RejectedMessage as rejected:
                self.inputs[0].reject(rejected)

    def _answer(self, now: int) -> None:
        """Answer the pending state, and publish the torque's terms."""
        loop = self._loop
        if loop.rehearsal is not None and loop.rehearse(now):
            loop.note_answer(time.monotonic_ns())
            return
        self._matched = self._matched or self.matched(self._commands, *self._terms)
        begin = 0 if loop.simulated else time.thread_time_ns()
        try:
            answer = loop.answer(self._matched, now)
        except RejectedMessage as rejected:
            self.inputs[0].reject(rejected)
            return
        if answer is None:
            self._note_no_answer()
            return
        if not loop.simulated:
            loop.computing_times.append(time.thread_time_ns() - begin)
        if self._samples % self._decimation == 0 and any(
                publisher.get_subscription_count() for publisher in self._terms):
            self._publish_terms(answer)
        self._samples += 1
        if self.parameters.changed:
            self.parameters.announce(answer.state.t)
        end = time.monotonic_ns()
        self.statistics.sample(now, end)
        if not loop.simulated:
            loop.note_answer(end)
            self.statistics.misses += end - now > loop.period

    def _note_no_answer(self) -> None:
        """Announce parameters, and end a run that tripped."""
        loop = self._loop
        if not loop.mode.sends_torque:
            self.statistics.pause()
            if loop.last is not None:  # Parameters that are set are for the next torque.
                self.parameters.announce_change(loop.last.t + 1)
        if (loop.mode is Mode.TRIPPED and loop.simulated
                and 'bringup' in self.config.wait_for and not self.done.done()):
            self.failure = f'tripped: {loop.tripped}'  # Time would wait for a reset.
            self.done.set_result(None)

    def _publish_terms(self, answer: Answer) -> None:
        """Publish error, v and torque terms of an answer."""
        assert self._loop.law is not None
        state, (q_d, dq_d, _), sample = answer
        # The law subtracts both, and the topic has the terms that add up to the torque.
        subtracted = [-x for x in (*sample.compensation, *sample.robust)]
        torques = [*sample.nominal, *subtracted, *sample.tau,
                   self._loop.law.lyapunov(state.q, sample.v)]
        rows = ([*q_d, *sample.e], [*dq_d, *sample.de], ()), (sample.v, ()), (torques,)
        for publisher, writer, row in zip(self._terms, self._term_writers, rows):
            publisher.publish(writer.write(*row, t=state.t))

    def finish(self) -> None:
        """Leave no torque behind."""
        self._loop.end_torque()

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response
                   ) -> SetBool.Response:
        word = 'enabled' if request.data else 'disabled'
        response.success = True
        changed = self._loop.request(Input.ENABLE if request.data else Input.DISABLE)
        verb = 'is' if changed else 'was already'
        response.message = f'the controller {verb} {word}'
        if request.data and self._loop.mode is Mode.TRIPPED:
            response.message += ', but it has tripped; call ~/reset'
        return response

    def _on_guide(self, request: SetBool.Request, response: SetBool.Response
                  ) -> SetBool.Response:
        """Begin or end guiding by hand."""
        try:
            response.message = self._loop.guide(request.data)
            response.success = True
        except CtcError as error:
            response.message = str(error)
        return response

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response
                  ) -> Trigger.Response:
        response.success = True
        response.message = (
            'the controller is reset' if self._loop.request(Input.RESET)
            else 'the controller had not tripped')
        return response

    def check(self, config: ControllerConfig) -> None:
        """Refuse a law or a change that is not allowed."""
        values = config.as_mapping()
        of_law, self._of_law = self._of_law, {}
        check_change(self.config.changed({  # Those of the law itself may be any.
            name: gain for name, gain in of_law.items() if values[name] == gain}), config)
        if self._loop.law is not None:
            self._loop.law.check(config)

    def completed(self, values: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the gains of a law set without any."""
        law = values.get('law')
        named = {*values, *self.parameter_service.names}
        allowed = (*LAWS, self.given.get('law'))  # No other class is imported.
        if law is not None and law in allowed and named.isdisjoint(GAINS):
            self._of_law = self._gains.of_law(str(law), self.config)
            if self._of_law:
                self.get_logger().info(
                    f'law {law} was set without gains; it takes its own gains instead of those of '
                    f'{self.config.law}')
        return self._of_law

    def _take_recommended_gains(self) -> None:
        """Set the recommended gains of the law at the start."""
        law = self.config.law
        if gain_owner(law) and self.given.keys().isdisjoint(GAINS):
            self._of_law = self._gains.suitable(law, self.config)
            self.parameters.assign(self._of_law)

    def on_change(self) -> None:
        """Have loop and law take the parameters that were set."""
        config, loop = self.config, self._loop
        self._decimation = config.state_decimation
        loop.motion.restart_duration = config.restart_duration
        loop.lost_states.predicted_periods = config.predicted_periods
        loop.least_answered = config.least_answered
        if loop.law is not None:
            loop.law.configure(config)

    def status(self) -> Status:
        """Return the state of the controller, and its reason."""
        config, loop = self.config, self._loop
        cause = self.statistics.too_slow(loop.period)
        level, message = ERROR, self.problem
        if not self.problem:
            states = self.inputs[0]
            level, message = loop_status(
                loop, time.monotonic_ns(), states.rejected, states.skipped, cause)
        return Status(level, message, {
            MODE: loop.mode.name,
            'law': config.law, **({'switching': config.switching}
                                  if config.takes('switching') else {}),
            'computed by': loop.law.computed_by if loop.law else '',
            'points of the reference': len(loop.motion),
            'saturated samples': loop.health.saturated, 'restarts': loop.health.restarts,
            'states answered in time': '{1} of {0}'.format(*loop.answered),
            'timeouts, state': loop.watchdog.outages,
            'timeouts, reference': loop.reference_outages,
            'time': 'simulated' if loop.simulated else 'real'})


def _term_writers(names: Sequence[str]) -> list[Writer]:
    """Return the writers for `TRACKING`, `FILTER` and `TORQUES`."""
    n = len(names)
    tracking = [f'{joint}/{x}' for x in ('desired', 'error') for joint in names]
    torques = [f'{joint}/{term}' for term in _TORQUE_TERMS for joint in names]
    return [state_writer(tracking, position=2 * n, velocity=2 * n),
            state_writer(names, velocity=n),
            state_writer([*torques, 'V'], effort=len(torques) + 1)]
