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
What stops the robot in real time, and what starts it again: the controller alone, the plant alone.

The matrix of stamps, silences, owners, modes and trips is proved without ROS, in `controller`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import time
from typing import TypeVar

from controller_process import ControllerUnderTest
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.ros.subscription import qos
from faults import CONTESTED, Diagnostics, ERROR, JOINTS, OK, Report, WARN
from processes import Probe, probe
import pytest
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_parameters
from ros_messages import COMMANDS, MS, reference, stamp, state, torques
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

pytestmark = pytest.mark.ros
T = TypeVar('T')
ZERO = [0.0, 0.0]
#: Sample period of both [s].
PERIOD = 0.02
#: So long that states are not stale on a machine on which all take seconds [s].
STATE_TIMEOUT = 2.0
STATE, TORQUE, OTHER = ([0.1, -0.3], [0.2, 0.1]), [5.25, -5.25], [7.0, -7.0]


def running(report: Report) -> bool:
    return report.level <= WARN and report.message.startswith('running')


class Robot(ControllerUnderTest):
    """The test as the robot before a controller: a state each period, while it is not silent."""

    def __init__(self, it: Probe) -> None:
        self.silent = True
        self.diagnostics = Diagnostics(it)
        super().__init__(it, *(x for name, value in {
            'control_period': PERIOD, 'state_timeout': STATE_TIMEOUT, 'reference_timeout': 0.25,
            'restart_duration': 0.0, 'predicted_periods': 0}.items()
            for x in ('-p', f'{name}:={value}')), simulated=False)
        it.node.create_timer(PERIOD, self._send)

    def _send(self) -> None:
        if not self.silent:
            self.states.publish(self.state(time.time_ns()))

    def state(self, t: int, q: list[float] = STATE[0]) -> JointState:
        return state(t, **dict(zip(JOINTS, zip(q, STATE[1]))))

    def refer(self, velocity: float) -> None:
        """Send a desired motion of 20 ms that begins now."""
        chunk = reference([*JOINTS], [
            [[0.1 + velocity * 1e-3 * k, -0.3], [velocity, 0.0], ZERO] for k in range(20)])
        chunk.header.stamp = stamp(time.time_ns())
        self.references.publish(chunk)

    def until_well(self) -> None:
        """Send states and a motion at rest until torques answer."""
        self.silent = False
        self.refer(0.0)
        self.diagnostics.until('controller', running, 'health')
        self.commands.clear()
        self.probe.until(lambda: any(any(m.data) for m in self.commands), 'torques')

    def until_error(self, words: str) -> Report:
        return self.diagnostics.until(
            'controller', lambda r: r.level == ERROR and words in r.message, words)

    def assert_silent(self) -> None:
        """Check that one torque of 0 comes, and none after it, for a second."""
        self.probe.until(lambda: list(self.commands[-1].data) == ZERO, 'a torque of 0')
        sent = len(self.commands)
        self.diagnostics.next('controller')
        self.diagnostics.next('controller')
        assert len(self.commands) == sent and any(self.commands[-2].data)

    def switch(self, on: bool) -> None:
        assert self.probe.call(
            SetBool, '/controller/enable', SetBool.Request(data=on)).success


def left_running(kind: Callable[[Probe], T]) -> Iterator[T]:
    """Yield a node that every test leaves running."""
    with probe() as it:
        yield kind(it)
        assert [child.status for child in it.children] == [None]
        assert not any('Traceback' in line for line in it.lines)


@pytest.fixture(scope='module')
def robot() -> Iterator[Robot]:
    yield from left_running(Robot)


def test_without_states_the_torque_ends_and_the_law_restarts(robot: Robot) -> None:
    """One torque of 0, an error; then the law without a jump, by stamps on no grid."""
    robot.until_well()
    before = robot.diagnostics.next('controller')
    robot.silent = True
    report = robot.until_error('no state for ')
    robot.assert_silent()
    for count in ('timeouts, state', 'restarts'):
        assert report.count(count) == before.count(count) + (count != 'restarts')
    law = Controller(ControllerConfig(control_period=PERIOD))
    law.reset(bumpless=True)
    begin = time.time_ns()
    for k in range(5):
        t, q = begin + (20 * k + k * k % 3 - 1) * MS, [0.1 + 0.01 * k, -0.3]
        sample = law.step(q, STATE[1], [0.1, -0.3], ZERO, ZERO, t=t, at=law.instant(t))
        assert robot.answer(robot.state(t, q)) == list(sample.tau)
        assert k or list(sample.tau) == list(sample.nominal)
    robot.until_well()
    robot.probe.until_said('states again, after')
    assert robot.diagnostics.next('controller').count('restarts') > before.count('restarts')


def test_without_a_reference_the_position_is_held(robot: Robot) -> None:
    robot.until_well()
    tracking = robot.probe.listen(JointState, 'controller/tracking')
    before = robot.diagnostics.next('controller').count('timeouts, reference')
    robot.refer(1.0)
    report = robot.until_error('no reference for 0.25 s')
    assert 'holding the position' in report.message
    assert report.count('timeouts, reference') > before
    tracking.clear()
    robot.probe.until(lambda: len(tracking) > 1, 'what is desired')
    assert list(tracking[-1].velocity[:2]) == ZERO
    assert tracking[-1].position[0] > 0.3
    robot.until_well()


def test_torques_at_their_limit_are_counted_and_an_error_beyond_its_own_trips_until_reset(
        robot: Robot) -> None:
    it = robot.probe
    robot.until_well()
    assert it.set('controller', 'effort_limit', [0.5, 0.5]).successful
    robot.diagnostics.until('controller', lambda r: r.count('saturated samples') > 5, 'a count')
    assert all(abs(x) <= 0.5 for x in robot.commands[-1].data)
    assert it.set('controller', 'effort_limit', [float('inf')] * 2).successful
    assert it.set('controller', 'error_limit', [1e-9, 1e-9]).successful
    robot.refer(1.0)
    report = robot.until_error('tripped')
    assert 'the position error of joint1, ' in report.message
    assert 'rad, exceeded error_limit; call ~/reset' in report.message
    robot.assert_silent()
    assert it.set('controller', 'error_limit', [float('inf')] * 2).successful
    robot.assert_silent()
    robot.switch(True)
    robot.assert_silent()
    answer = it.call(Trigger, '/controller/reset', Trigger.Request())
    assert answer.success and answer.message == 'the controller is reset'
    robot.until_well()
    answer = it.call(Trigger, '/controller/reset', Trigger.Request())
    assert answer.success and answer.message == 'the controller had not tripped'


def law_of(event: ParameterEvent) -> str | None:
    """Return the law that an event has; None without one."""
    return next((x.value.string_value for x in (*event.new_parameters, *event.changed_parameters)
                 if x.name == 'law'), None)


def test_a_law_that_is_set_while_there_is_no_torque_is_announced(robot: Robot) -> None:
    """Tripped, disabled, without states: `ctc live` shows what is announced."""
    it = robot.probe
    robot.until_well()
    events = it.listen(ParameterEvent, 'controller/parameters', qos(100, latched=True))
    it.until(lambda: 'chattering' in map(law_of, events), 'the law in force')
    assert it.set('controller', 'error_limit', [1e-9, 1e-9]).successful
    robot.refer(1.0)
    robot.until_error('tripped')
    for law in ('compensation', 'integral', 'pd_gravity'):
        if law == 'integral':
            robot.switch(False)
        robot.silent = law == 'pd_gravity'
        events.clear()
        assert it.set('controller', 'law', law).successful
        it.until(lambda: events, f'{law} on controller/parameters')
        assert [law_of(x) for x in events] == [law]
        report = robot.diagnostics.next('controller')
        assert report.values['law'] == law and report.level != OK
    for name, value in (('law', 'chattering'), ('error_limit', [float('inf')] * 2)):
        assert it.set('controller', name, value).successful
    assert it.call(Trigger, '/controller/reset', Trigger.Request()).success
    robot.switch(True)
    robot.until_well()


def test_a_stop_overtakes_a_flood_of_requests_for_parameters(robot: Robot) -> None:
    """By what the controller has done before it stopped, not by when its answer came."""
    it, count = robot.probe, 800
    robot.until_well()
    client = it.node.create_client(
        SetParameters, '/controller/set_parameters', qos_profile=qos_profile_parameters)
    it.until(client.service_is_ready, 'the parameters')
    it.lines.clear()
    asked = [client.call_async(SetParameters.Request(parameters=[
        Parameter('lambda', value=10.0 + 1e-3 * (k % 2)).to_parameter_msg()]))
        for k in range(count)]
    # A client that is starved sends them no faster than they are served: then few wait.
    served = sum('lambda: ' in line for line in it.lines)
    robot.switch(False)
    it.until(lambda: all(x.done() for x in asked), 'an answer to each request')
    it.until_said('disable by a service')
    stop = next(i for i, line in enumerate(it.lines) if 'disable by a service' in line)
    served_before_stop = sum('lambda: ' in line for line in it.lines[:stop]) - served
    assert served_before_stop < max((count - served) // 2, 50)
    it.node.destroy_client(client)
    assert it.set('controller', 'lambda', 10.0).successful
    robot.switch(True)
    robot.until_well()


@pytest.mark.parametrize('silent', [False, True])
def test_disabled_it_sends_nothing_until_it_is_enabled(robot: Robot, silent: bool) -> None:
    """Also where it missed states before."""
    robot.until_well()
    robot.silent = silent
    if silent:
        robot.until_error('no state for')
    robot.switch(False)
    report = robot.diagnostics.until('controller', lambda r: 'disabled' in r.message, 'the mode')
    assert report.level == WARN
    robot.assert_silent()
    robot.switch(True)
    robot.until_well()


def test_with_two_sources_of_states_none_is_answered_until_one_has_left(robot: Robot) -> None:
    robot.until_well()
    other = robot.probe.node.create_publisher(JointState, 'joint_states', 10)
    report = robot.until_error(f'joint_states {CONTESTED}: /probe')
    robot.assert_silent()
    refused = robot.diagnostics.next('controller').refused('joint_states')
    assert refused['second_publisher'] > report.refused('joint_states').get('second_publisher', 0)
    robot.probe.node.destroy_publisher(other)
    robot.until_well()
    robot.probe.until_said('joint_states: messages are used again, from /probe')


class Commander:
    """The test as the controller before a plant: a torque each period, while it is not silent."""

    def __init__(self, it: Probe) -> None:
        self.probe, self.silent = it, False
        self.diagnostics = Diagnostics(it)
        self.states = it.listen(JointState, 'joint_states')
        self.commands = it.node.create_publisher(Float64MultiArray, COMMANDS, 10)
        it.start('plant', '-p', f'control_period:={PERIOD}', '-p', 'command_timeout:=0.1')
        it.node.create_timer(PERIOD, self._send)

    def _send(self) -> None:
        if not self.silent:
            self.commands.publish(torques(TORQUE))

    def until_well(self) -> None:
        self.silent = False
        self.diagnostics.until('plant', running, 'health')
        self.probe.until(
            lambda: self.states and list(self.states[-1].effort) == TORQUE, 'torques')

    def until_braked(self, words: str) -> Report:
        """Wait for the error, without torque and at rest; return what is reported."""
        report = self.diagnostics.until(
            'plant', lambda r: r.level == ERROR and 'no command for 0.1 s; the torque is 0'
            in r.message and words in r.message, words)
        self.states.clear()
        self.probe.until(lambda: len(self.states) > 20 and not any(
            any(m.velocity) for m in self.states[-20:]), 'rest')
        assert [m for m in self.states if list(m.effort) != ZERO] == []
        return report


@pytest.fixture(scope='module')
def commander() -> Iterator[Commander]:
    yield from left_running(Commander)


def test_without_commands_the_plant_brakes(commander: Commander) -> None:
    commander.until_well()
    before = commander.diagnostics.next('plant').count('timeouts, command')
    commander.silent = True
    # With 16000 time constants of the brakes in an integration step.
    assert commander.probe.set('plant', 'fault_damping', [1e7, 1e7]).successful
    assert commander.until_braked('').count('timeouts, command') > before
    commander.probe.until_said('[ERROR]', 'no command for')
    commander.until_well()
    commander.probe.until_said('commands again, after')


def test_with_two_publishers_of_torques_none_is_obeyed_until_one_has_left(commander: Commander
                                                                          ) -> None:
    commander.until_well()
    other = commander.probe.node.create_publisher(Float64MultiArray, COMMANDS, 10)
    intrusion = commander.probe.node.create_timer(PERIOD, lambda: other.publish(torques(OTHER)))
    report = commander.until_braked(f'{COMMANDS} {CONTESTED}: /probe')
    before = report.refused(COMMANDS)['second_publisher']
    assert before > 0
    commander.diagnostics.until('plant', lambda r: (
        r.refused(COMMANDS)['second_publisher'] > max(before, 20)), 'refused torques')
    commander.probe.node.destroy_timer(intrusion)
    commander.probe.node.destroy_publisher(other)
    commander.until_well()
    assert not any(list(m.effort) == OTHER for m in commander.states)
