"""Two who want to command: the first one keeps control, the other one is refused and named."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import itertools
import signal
import time
from typing import Any

from faults import Diagnostics, ERROR, JOINTS, Report, WARN
import pytest
import rclpy
from rclpy.node import Node
from ros import Probe, probe
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from test_ros_nodes import COMMANDS, ControllerUnderTest, MS, reference, state, torques
from test_ros_watchdogs import ns

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.graph import JOINT_STATES

pytestmark = pytest.mark.ros
ZERO = [0.0, 0.0]
#: What the intruder sends, below friction; no law would, for so round a number.
TORQUE = [5.25, -5.25]
#: So much at the most from the second controller, and far more from the first [N·m].
LITTLE = 1e-3


@contextmanager
def intruder(it: Probe) -> Iterator[Node]:
    """Yield a second node, which is gone afterwards."""
    node = rclpy.create_node('intruder', context=it.context)
    try:
        yield node
    finally:
        node.destroy_node()


class Torques:
    """Sends `TORQUE`, 200 times a second at the most, so that its numbers meet nobody's."""

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(Float64MultiArray, COMMANDS, 10)
        self._sent = 0.0
        self.count = 0

    def send(self) -> bool:
        if time.monotonic() - self._sent > 0.005:
            self._sent = time.monotonic()
            self._publisher.publish(torques(TORQUE))
            self.count += 1
        return True


def running(it: Probe, pacing: str) -> tuple[Diagnostics, list[Any], dict[str, Any]]:
    """Start the loop and wait for motion; return what it says, its states and processes."""
    diagnostics = Diagnostics(it)
    children = {'plant': it.start(
                    'plant', '-p', f'pacing:={pacing}', '-p', 'command_timeout:=0.1'),
                'controller': it.start('controller', '-p', 'state_timeout:=0.25'),
                'reference': it.start('reference')}
    states = it.listen(JointState, JOINT_STATES, 200)
    it.until(lambda: any(any(m.effort) for m in states), 'motion')
    return diagnostics, states, children


def alone(report: Report, topic: str, owner: str) -> bool:
    """Return whether nothing is said of a second publisher, and none is there."""
    return 'beside' not in report.message and report.values[f'{topic}: publishers'] == owner


def contested(report: Report, topic: str, owner: str, other: str, before: int = 0) -> bool:
    """Return whether a second publisher is named and refused, more often than `before`."""
    return (report.level >= WARN and report.refused(topic).get('second_publisher', 0) > before + 50
            and f'{topic} has publishers beside {owner}: {other}' in report.message)


@pytest.mark.parametrize(
    'pacing', [pytest.param('lockstep', marks=pytest.mark.slow), 'real_time'])
def test_the_first_publisher_of_torques_moves_the_robot_until_it_is_silent(pacing: str) -> None:
    with probe() as it:
        diagnostics, states, children = running(it, pacing)
        report = diagnostics.until(
            'plant', lambda r: alone(r, COMMANDS, '/controller') and r.level < ERROR, 'health')
        assert 'second_publisher' not in report.refused(COMMANDS)
        with intruder(it) as node:
            second = Torques(node)
            diagnostics.latest.clear()
            states.clear()
            it.until(lambda: second.send() and 'plant' in diagnostics.latest and contested(
                diagnostics.latest['plant'], COMMANDS, '/controller', '/intruder'), 'a warning')
            assert second.count > 50
            assert len(states) > 50
            assert not any(list(m.effort) == TORQUE for m in states)
            if pacing == 'real_time':
                states.clear()
                children['controller'].signal(signal.SIGSTOP)
                it.until(lambda: second.send() and states
                         and list(states[-1].effort) == TORQUE, 'the change of control')
                times = [ns(m.header.stamp) for m in states if any(m.effort)]
                # The last torque is held for 0.1 s, then the brakes are on for the rest.
                assert max(b - a for a, b in itertools.pairwise(times)) > 350 * MS
                states.clear()
                children['controller'].signal(signal.SIGCONT)
                it.until(lambda: second.send() and len(states) > 500, 'states')
                driven = [list(m.effort) for m in states if any(m.effort)]
                assert driven and all(x == TORQUE for x in driven)
                it.until(lambda: second.send() and contested(
                    diagnostics.latest['plant'], COMMANDS, '/intruder', '/controller'),
                    'who has control now')
        states.clear()
        it.until(lambda: any(any(m.effort) and list(m.effort) != TORQUE for m in states),
                 'the first again')
        report = diagnostics.until('plant', lambda r: alone(r, COMMANDS, '/controller')
                                   and r.level < ERROR, 'health')

        children['second'] = it.start(
            'controller', '-r', '__node:=second', '-p', f'effort_limit:=[{LITTLE}, {LITTLE}]')
        before = report.refused(COMMANDS)['second_publisher']
        states.clear()
        report = diagnostics.until('plant', lambda r: contested(
            r, COMMANDS, '/controller', '/second', before), 'a warning')
        assert report.values[f'{COMMANDS}: publishers'] == '/controller, /second'
        assert any(any(m.effort) for m in states)
        for message in states:
            assert not 0.0 < max(abs(x) for x in message.effort) <= LITTLE
        assert not any(x.status is not None for x in children.values())
        assert not any('Traceback' in line for line in it.lines)


def test_a_second_source_of_states_is_not_answered() -> None:
    law = Controller(ControllerConfig())
    with probe() as it, intruder(it) as node:
        diagnostics = Diagnostics(it)
        controller = ControllerUnderTest(it)
        controller.references.publish(reference(list(JOINTS), [[[1.0, -0.5], ZERO, ZERO]]))
        k = 0

        def answered() -> None:
            """Send the next state; the answer must be the law's."""
            nonlocal k
            q, dq = [0.1, 0.2 + 0.001 * (k % 7)], [0.3, -0.1]
            assert controller.answer(state(
                k * MS, joint1=(q[0], dq[0]), joint2=(q[1], dq[1]))) == list(
                    law.step(q, dq, [1.0, -0.5], ZERO, ZERO).tau)
            k += 1

        def until(done: Any, what: str) -> Report:
            """Go on until a new report is as wanted."""
            diagnostics.latest.clear()

            def told() -> bool:
                answered()
                report = diagnostics.latest.get('controller')
                return report is not None and bool(done(report))

            it.until(told, what)
            return diagnostics.latest['controller']

        until(lambda r: alone(r, JOINT_STATES, '/probe') and r.count('restarts') == 0, 'health')
        other = node.create_publisher(JointState, JOINT_STATES, 1000)
        it.until(other.get_subscription_count, 'the controller')
        for _ in range(200):
            other.publish(state(k * MS, joint1=(1.5, 0.0), joint2=(-2.5, 0.0)))
            answered()
        report = until(lambda r: contested(r, JOINT_STATES, '/probe', '/intruder')
                       and r.refused(JOINT_STATES)['second_publisher'] == 200, 'a warning')
        assert report.level == WARN
        assert report.values[f'{JOINT_STATES}: publishers'] == '/probe, /intruder'
        assert set(report.refused(JOINT_STATES)) == {'second_publisher'}
        report = until(lambda r: 'beside' not in r.message, 'silence')
        assert report.count('restarts') == 0
        assert len(controller.commands) == k
