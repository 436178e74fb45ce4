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

"""Two publishers where only one may command: none is obeyed, and both are named."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import signal
import time

from controller_process import ControllerUnderTest
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.ros.topics import JOINT_STATES
from faults import Diagnostics, ERROR, JOINTS, Report, WARN
from processes import PATIENCE, Probe, probe
import pytest
import rclpy
from rclpy.node import Node
from ros_messages import COMMANDS, MS, ns, reference, state, torques
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

pytestmark = pytest.mark.ros
ZERO = [0.0, 0.0]
#: What the intruder sends, below friction; no law would, for so round a number.
TORQUE = [5.25, -5.25]
#: So much at the most from the second controller, and far more from the first [N·m].
LITTLE = 1e-3
#: Sample period [s].
PERIOD = 0.004


@contextmanager
def intruder(it: Probe) -> Iterator[Node]:
    """Yield a second node, which is gone afterwards."""
    node = rclpy.create_node('intruder', context=it.context)
    try:
        yield node
    finally:
        node.destroy_node()


def contested(topic: str, *names: str) -> Callable[[Report], bool]:
    """Return whether a report says that several publish on a topic, and who."""
    def said(report: Report) -> bool:
        return report.level == ERROR and report.message.endswith(
            f'{topic} has several publishers, none is obeyed: {", ".join(names)}')
    return said


def healthy(report: Report) -> bool:
    return report.level <= WARN and report.message.startswith('running')


class Loop:
    """Plant, controller and reference, and all states of the plant."""

    def __init__(self, it: Probe, pacing: str) -> None:
        self.probe, self.lockstep = it, pacing == 'lockstep'
        self.diagnostics = Diagnostics(it)
        period = '-p', f'control_period:={PERIOD}'
        self.children = [
            it.start('plant', *period, '-p', f'pacing:={pacing}', '-p', 'command_timeout:=0.1'),
            it.start('controller', *period, '-p', 'state_timeout:=0.25'), it.start('reference')]
        self.states = it.listen(JointState, JOINT_STATES, 1000)
        self.until_driven()

    def until_driven(self) -> None:
        """Wait until new states are driven by torques, and the plant says that all is well."""
        seen = len(self.states)
        self.probe.until(
            lambda: len([m for m in self.states[seen:] if any(m.effort)]) > 50, 'motion')
        self.diagnostics.until('plant', healthy, 'health')

    def until_refused(self, names: tuple[str, ...], send: Callable[[], None]) -> None:
        """Wait until both publishers are named, and see that commands are refused and counted."""
        said = contested(COMMANDS, *names)
        before = self.diagnostics.until('plant', said, 'a report of both')
        line = f'{COMMANDS} has several publishers, none is obeyed: {", ".join(names)}'
        self.probe.until(lambda: any(line in x for x in self.probe.lines), 'the line')

        def refused(report: Report) -> bool:
            send()
            return report.refused(COMMANDS).get('second_publisher', 0) > (
                before.refused(COMMANDS).get('second_publisher', 0) + 20)

        report = self.diagnostics.until('plant', refused, 'that it is refused')
        assert said(report)
        assert self.lockstep or 'torque 0, brakes on' in report.message

    def assert_safe(self) -> None:
        """Check states that are sent from now on."""
        if self.lockstep:  # Time stands still: the state is sent again and again.
            self.probe.until(lambda: len({ns(m.header.stamp) for m in self.states[-5:]}) == 1,
                             'the same state, five times')
            last, seen = self.states[-1], len(self.states)
            self.probe.until(lambda: len(self.states) > seen + 5, 'states')
            assert all(m == last for m in self.states[seen:])
        else:  # After command_timeout the brakes are on.
            begin = time.time_ns() + 150 * MS
            self.probe.until(lambda: ns(self.states[-1].header.stamp) > begin + 50 * MS, 'states')
            assert all(list(m.effort) == ZERO for m in self.states
                       if ns(m.header.stamp) > begin)

    def end(self) -> None:
        """See that nothing else has happened."""
        assert [x.status for x in self.children] == [None] * 3
        assert not any('Traceback' in line for line in self.probe.lines)


@pytest.mark.parametrize(
    'pacing', ['lockstep', pytest.param('real_time', marks=pytest.mark.slow)])
def test_with_two_publishers_of_torques_none_is_obeyed_until_one_has_left(pacing: str) -> None:
    with probe() as it:
        loop = Loop(it, pacing)
        with intruder(it) as node:
            publisher = node.create_publisher(Float64MultiArray, COMMANDS, 1000)

            def send() -> None:
                for _ in range(20):
                    publisher.publish(torques(TORQUE))

            it.until(publisher.get_subscription_count, 'the plant')
            loop.until_refused(('/controller', '/intruder'), send)
            loop.assert_safe()
            send()  # It leaves right after.
        loop.until_driven()
        it.until(lambda: any('obeyed again: /controller' in x for x in it.lines), 'the line')
        assert not any(list(m.effort) == TORQUE for m in loop.states)
        loop.end()


def test_a_second_controller_stops_the_robot_until_its_lease_has_run_out() -> None:
    """It is killed: for the middleware it goes on publishing until its lease has run out."""
    with probe() as it:
        loop = Loop(it, 'real_time')
        second = it.start('controller', '-r', '__node:=second', '-p',
                          f'effort_limit:=[{LITTLE}, {LITTLE}]')
        loop.until_refused(('/controller', '/second'), lambda: None)
        loop.assert_safe()
        second.signal(signal.SIGKILL)
        second.process.wait(PATIENCE)
        loop.diagnostics.until('plant', contested(COMMANDS, '/controller', '/second'), 'the dead')
        loop.until_driven()
        for message in loop.states:
            assert not 0.0 < max(abs(x) for x in message.effort) <= LITTLE
        loop.end()


class States:
    """The test as the only source of states in simulated time, and the law that answers."""

    def __init__(self, it: Probe) -> None:
        self.probe = it
        self.diagnostics = Diagnostics(it)
        self.law = Controller(ControllerConfig())
        self.controller = ControllerUnderTest(it)
        self.controller.references.publish(reference(list(JOINTS), [[[1.0, -0.5], ZERO, ZERO]]))
        self.k = 0

    def message(self) -> JointState:
        q = [0.1, 0.2 + 0.001 * (self.k % 7)]
        return state(self.k * MS, joint1=(q[0], 0.3), joint2=(q[1], -0.1))

    def answered(self, message: JointState) -> None:
        """Take the next torque as the answer to a state, which must be the law's."""
        before = self.k
        self.probe.until(lambda: len(self.controller.commands) > before, 'a torque')
        expected = self.law.step(message.position, message.velocity, [1.0, -0.5], ZERO, ZERO)
        assert list(self.controller.commands[before].data) == list(expected.tau)
        self.k += 1

    def go(self, count: int) -> None:
        """Send states, each answered before the next."""
        for _ in range(count):
            message = self.message()
            self.controller.states.publish(message)
            self.answered(message)


def test_with_two_sources_of_states_none_is_answered_until_one_has_left() -> None:
    """The run goes on as if nothing had been: a state that is sent again gets its torque."""
    with probe() as it:
        source = States(it)
        source.go(100)
        with intruder(it) as node:
            other = node.create_publisher(JointState, JOINT_STATES, 1000)
            it.until(other.get_subscription_count, 'the controller')
            source.diagnostics.until('controller', contested(JOINT_STATES, '/intruder', '/probe'),
                                     'a report of both')
            for k in range(200):  # Meanwhile their numbers are equal now and then.
                other.publish(state((100 + k) * MS, joint1=(1.5, 0.0), joint2=(-2.5, 0.0)))
                source.controller.states.publish(source.message())
            report = source.diagnostics.until(
                'controller', lambda r: r.refused(JOINT_STATES).get('second_publisher') == 400,
                'that all are refused')
            assert set(report.refused(JOINT_STATES)) == {'second_publisher'}
            assert len(source.controller.commands) == 100
        report = source.diagnostics.until('controller', healthy, 'health')
        message = source.message()

        def again() -> bool:
            """Send the state again, as a plant in lockstep does."""
            source.controller.states.publish(message)
            time.sleep(0.01)
            return len(source.controller.commands) > 100

        it.until(again, 'a torque')
        source.answered(message)
        report = source.diagnostics.next('controller')
        assert report.count('restarts') == 0
