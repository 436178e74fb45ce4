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

"""What stops the robot when a publisher falls silent, and what starts it again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import itertools
import math
import signal
from typing import Any

from ctc_chattering.launch import child_process
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from faults import Diagnostics, ERROR, OK, WARN
from processes import PATIENCE, Probe, probe
import pytest
from ros_messages import COMMANDS, ns
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

pytestmark = pytest.mark.ros
ZERO = [0.0, 0.0]
#: For the silence that stops the controller and brakes the plant, so that a loaded machine does
#: not [s].
STATE_TIMEOUT, COMMAND_TIMEOUT, REFERENCE_TIMEOUT = 0.25, 0.1, 0.25
#: Of the graph in real time, which most tests share and others run beside [s].
PERIOD = 0.004


class Graph:
    """Plant, controller and reference in real time, and all that is said on their topics."""

    def __init__(self, it: Probe) -> None:
        self.probe = it
        self.diagnostics = Diagnostics(it)
        self.states = it.listen(JointState, 'joint_states', 10_000)
        self.commands = it.listen(Float64MultiArray, COMMANDS, 10_000)
        self.chunks = it.listen(JointTrajectory, 'reference', 10_000)
        self.tracking = it.listen(JointState, 'controller/tracking')
        self.children: dict[str, child_process.Child] = {}
        self._begun: dict[str, int] = {}
        for name in ('plant', 'controller', 'reference'):
            self.start(name)
        self.until_well()

    def start(self, name: str) -> None:
        more = {'controller': ('-p', f'state_timeout:={STATE_TIMEOUT}',
                               '-p', f'reference_timeout:={REFERENCE_TIMEOUT}'),
                # Drives with a limit, as in the paper's files: where the machine leaves the loop
                # without torques for most of the time, the motion must not grow without bound.
                'plant': ('-p', f'command_timeout:={COMMAND_TIMEOUT}',
                          '-p', 'torque_saturation:=[5100.0, 850.0]')}.get(name, ())
        period = () if name == 'reference' else ('-p', f'control_period:={PERIOD}')
        self._begun[name] = len(self.probe.lines)
        self.children[name] = self.probe.start(name, *period, *more)

    def kill(self, name: str) -> None:
        self.children[name].signal(signal.SIGKILL)
        self.children[name].process.wait(PATIENCE)

    def until_well(self) -> None:
        """Wait until all say that they run, and the plant feels torques."""
        latest = self.diagnostics.latest
        latest.clear()
        self.probe.until(lambda: len(latest) == 3 and all(
            r.level in (OK, WARN)  # One killed is counted as a publisher for a while.
            and r.message.startswith('running') for r in latest.values()), 'health')
        self.states.clear()
        self.probe.until(lambda: any(any(m.effort) for m in self.states), 'torques')

    def until_silent(self) -> None:
        """Wait for the last command, which is zero, and see that no other one comes."""
        last = -1
        while last != len(self.commands):  # A machine that is late may stop it for a moment.
            self.probe.until(lambda: self.commands and list(self.commands[-1].data) == ZERO,
                             'a command of zero')
            last = len(self.commands)
            self.diagnostics.next('controller')
        assert any(self.commands[-2].data)

    def clear(self) -> None:
        for heard in (self.states, self.commands, self.tracking):
            heard.clear()

    def log(self, name: str, text: str) -> list[str]:
        """Return the lines of a node since its last start that have `text` in them."""
        return [x for x in self.probe.lines[self._begun[name]:]
                if x.startswith(f'[{name}]') and text in x]


def paper_motion_after(chunk: Sequence[Any]) -> tuple[list[float], list[float]]:
    """Return position and velocity at the end of the chunk that follows one of the sinusoid."""
    passed = 2.0 * math.pi * 1e-9 * sum(
        sign * (10**9 * p.time_from_start.sec + p.time_from_start.nanosec)
        for sign, p in ((1, chunk[-1]), (-1, chunk[0]))) * len(chunk) / (len(chunk) - 1)
    c, s = math.cos(passed), math.sin(passed)
    end = chunk[-1]
    offsets = [q - center for q, center in zip(end.positions, (math.pi, 0.5 * math.pi))]
    rates = [dq / (2.0 * math.pi) for dq in end.velocities]
    return ([q + x * (c - 1.0) + y * s for q, x, y in zip(end.positions, offsets, rates)],
            [2.0 * math.pi * (c * y - s * x) for x, y in zip(offsets, rates)])


@pytest.fixture(scope='module')
def graph() -> Iterator[Graph]:
    """Yield a running graph; every test leaves it running."""
    with probe() as it:
        yield Graph(it)
        assert not any('Traceback' in line for line in it.lines)


@pytest.fixture(autouse=True)
def no_other_node_ends(request: pytest.FixtureRequest) -> Iterator[None]:
    yield
    if 'graph' in request.fixturenames:
        children = request.getfixturevalue('graph').children
        assert [name for name, child in children.items() if child.status is not None] == []


def test_without_states_the_torque_stops_and_the_law_restarts(graph: Graph) -> None:
    """One torque of zero, silence, an error; by which torque it restarts is in test_outages."""
    before = graph.diagnostics.next('controller')
    plant = graph.children['plant']
    plant.signal(signal.SIGSTOP)
    try:
        report = graph.diagnostics.until(
            'controller', lambda r: r.level == ERROR and 'no state' in r.message, 'the error')
        graph.probe.until(lambda: graph.commands and list(graph.commands[-1].data) == ZERO,
                          'a command of zero')
        assert any(graph.commands[-2].data)
        # No longer than that: after its lease a stopped publisher must be discovered again.
    finally:
        graph.clear()
        plant.signal(signal.SIGCONT)
    assert report.count('timeouts, state') > before.count('timeouts, state')
    # After two seconds, which a machine that is late may take, the publisher's lease has run out.
    graph.probe.until(lambda: graph.log('controller', 'states again, after'), 'the line')
    graph.probe.until(lambda: len(graph.commands) > 10 and len(graph.states) > 10, 'torques')
    graph.until_well()
    after = graph.diagnostics.next('controller')
    assert after.count('restarts') > before.count('restarts')


def test_without_a_reference_the_position_is_held(graph: Graph) -> None:
    before = graph.diagnostics.next('controller')
    graph.kill('reference')
    report = graph.diagnostics.until(
        'controller', lambda r: r.level == ERROR and 'no reference for 0.25 s' in r.message,
        'the error')
    assert 'holding the position' in report.message
    count = report.count('timeouts, reference')  # A machine that is late may have its own.
    assert count > before.count('timeouts, reference')
    graph.probe.until(lambda: graph.log('controller', 'holding the position'), 'the line')
    graph.clear()
    # After a pause of the machine, also one shortly before, the desired motion leads to the held
    # position within `restart_duration`, and stays there: only the last messages are sure of it.
    graph.probe.until(lambda: len(graph.tracking) > 5 and not any(
        any(m.velocity[:2]) for m in graph.tracking[-5:]), 'the hold')
    # Killed between two sends, the reference may have sent the controller one chunk more.
    last = graph.chunks[-1].points
    held = [[q + REFERENCE_TIMEOUT * dq for q, dq in zip(*end)]
            for end in ((last[-1].positions, last[-1].velocities), paper_motion_after(last))]
    positions = {tuple(message.position[:2]) for message in graph.tracking[-5:]}
    assert len(positions) == 1
    assert any(list(*positions) == pytest.approx(it, abs=1e-9) for it in held)
    assert any(any(m.data) for m in graph.commands)
    graph.start('reference')
    graph.until_well()
    graph.clear()
    graph.probe.until(lambda: any(any(m.velocity[:2]) for m in graph.tracking), 'motion')


def test_without_commands_the_plant_brakes(graph: Graph) -> None:
    def said() -> int:
        return len([x for x in graph.log('plant', 'no command for') if '[ERROR]' in x])

    before, lines = graph.diagnostics.next('plant'), said()
    graph.kill('controller')
    report = graph.diagnostics.until(
        'plant', lambda r: r.level == ERROR and 'no command for 0.1 s' in r.message, 'the error')
    assert 'torque 0, brakes on' in report.message
    assert report.count('timeouts, command') > before.count('timeouts, command')
    graph.probe.until(lambda: said() == lines + 1, 'the line')
    graph.probe.until(  # What is reported may be heard before the states are.
        lambda: len(graph.states) > 50 and not any(
            any(m.effort) for m in itertools.islice(reversed(graph.states), 50)), 'brakes')
    driven = max((i for i, m in enumerate(graph.states) if list(m.effort) != ZERO), default=-1)
    idle = graph.states[driven + 1:]
    begin = idle[0]
    # Of the brakes' first samples some may be made good in one tick and published as one.
    robot = Plant(PlantConfig(control_period=PERIOD, initial_position=tuple(begin.position),
                              initial_velocity=tuple(begin.velocity)))
    robot.brake(True)
    for message in idle[1:50]:
        passed = 1e-9 * (ns(message.header.stamp) - ns(begin.header.stamp))
        for _ in range(round(passed / PERIOD) - robot.k):
            robot.step(ZERO)
        assert list(message.effort) == ZERO
        assert list(message.position) == pytest.approx(robot.q, abs=1e-9)
        assert list(message.velocity) == pytest.approx(robot.dq, abs=1e-9)
    graph.start('controller')
    graph.until_well()
    assert graph.log('plant', 'commands again, after')


def test_an_error_beyond_its_limit_trips_until_reset(graph: Graph) -> None:
    it = graph.probe
    assert it.set('controller', 'error_limit', [1e-9, 1e-9]).successful
    graph.until_silent()
    report = graph.diagnostics.until(
        'controller', lambda r: r.level == ERROR and 'tripped' in r.message, 'the trip')
    assert 'the position error of joint1, ' in report.message
    assert 'rad, exceeded error_limit; call ~/reset' in report.message
    assert len(graph.log('controller', 'exceeded error_limit')) == 1
    assert it.set('controller', 'error_limit', [float('inf')] * 2).successful
    silent = len(graph.commands)
    assert 'tripped' in graph.diagnostics.next('controller').message
    assert len(graph.commands) == silent
    answer = it.call(Trigger, '/controller/reset', Trigger.Request())
    assert answer.success and answer.message == 'reset'
    graph.until_well()
    answer = it.call(Trigger, '/controller/reset', Trigger.Request())
    assert answer.success and answer.message == 'was not tripped'


def test_a_disabled_controller_publishes_nothing(graph: Graph) -> None:
    it = graph.probe
    assert it.call(SetBool, '/controller/enable', SetBool.Request(data=False)).success
    graph.until_silent()
    graph.tracking.clear()
    silent = len(graph.commands)
    report = graph.diagnostics.next('controller')
    assert report.level == WARN and 'disabled' in report.message
    assert len(graph.commands) == silent
    assert graph.tracking == []
    assert it.call(SetBool, '/controller/enable', SetBool.Request(data=True)).success
    graph.until_well()
    assert len(graph.commands) > silent


def test_torques_at_their_limit_are_counted(graph: Graph) -> None:
    it = graph.probe
    before = graph.diagnostics.next('controller').count('saturated samples')
    assert it.set('controller', 'effort_limit', [5.0, 4.0]).successful
    graph.diagnostics.until(
        'controller', lambda r: r.count('saturated samples') > before + 50, 'a count')
    graph.commands.clear()
    it.until(lambda: len(graph.commands) > 50 and all(
        abs(x) <= most for m in graph.commands[-50:] for x, most in zip(m.data, (5.0, 4.0))),
        'limited torques')
    assert it.set('controller', 'effort_limit', [float('inf')] * 2).successful
    graph.until_well()
