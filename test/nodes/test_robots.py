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

"""Robots other than the paper's, and sources of states other than the plant of ours."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from contextlib import closing
import math
from pathlib import Path
import sys
import time
from typing import Any

from builtin_interfaces.msg import Duration
from controller_process import ReferenceUnderTest
from ctc_chattering.analysis.result import simulate
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.launch.child_process import Child
from ctc_chattering.trajectory.buffer import Trajectory
from ctc_chattering.trajectory.reference import ReferenceConfig, Sinusoid
from faults import Diagnostics, ERROR, OK, Report, WARN
from mujoco_plant import simulated_by_mujoco
import numpy as np
from processes import CONFIG, Probe, probe
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from recorded_runs import assert_equal, record
from ros_messages import COMMANDS, MS, ns, stamp
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from urdfs import link, PANDA, panda, two_links, ur5

pytestmark = pytest.mark.ros
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DESCRIPTION = 'robot_description'
EXAMPLE = CONFIG.parent / 'examples' / 'mujoco_plant.py'
ARM = ['-p', 'model:=urdf', '-p', 'joint_names:=[a,b]']
S = 10 ** 9


# Robots, in lockstep.

def test_a_robot_over_ros_equals_the_simulation_and_the_bag_says_all(tmp_path: Path) -> None:
    """To the last bit; the bag is read when the files are gone."""
    robot, file, bag = tmp_path / 'robot.urdf', tmp_path / 'params.yaml', tmp_path / 'bag'
    robot.write_text(panda(), encoding='utf-8')
    text = (CONFIG / 'panda.yaml').read_text(encoding='utf-8')
    where = next(x for x in text.split() if x.startswith('package://'))
    file.write_text(text.replace(where, str(robot)))
    expected = simulate(parameter_file.load(file, {'plant': {'duration': 0.5}}))
    record(bag, '--params-file', str(file), '--duration', '0.5')
    robot.unlink()
    file.unlink()
    result = read_bag(bag)
    assert_equal(result, expected)
    assert len(result.run.t) == 501
    assert result.joint_names == tuple(PANDA)
    assert (result.experiment, result.config.switching) == ('panda', 'implicit_observer')
    assert np.abs(result.terms.robust).max() > 0.0
    with closing(open_bag(bag)) as reader:
        told = [reader.deserialize(data, connection.msgtype).data
                for connection, _, data in reader.messages() if DESCRIPTION in connection.topic]
    assert told == [panda()]


def test_the_example_node_of_mujoco_is_a_robot() -> None:
    """
    Every fourth sample is there once, and the motion is the one that the oracle of the tests has.

    The controller comes later than the first state, which is repeated. What it publishes fits into
    the histories of writer and reader, however late this process takes it.
    """
    file, urdf = CONFIG / 'friction.yaml', CONFIG / 'two_link.urdf'
    arguments = ('--params-file', str(file), '-p', 'model:=urdf', '-p', f'description:={urdf}')
    law = {'switching': 'implicit_observer', 'state_decimation': 4}
    start = {'duration': 2.0, 'initial_position': [3.1, 1.5]}

    with probe() as it:
        states = it.listen(JointState, 'joint_states')
        tracking = it.listen(JointState, 'controller/tracking')
        robot = Child('mujoco', [
            sys.executable, str(EXAMPLE), '--ros-args', *arguments, *(
                x for name, value in start.items() for x in ('-p', f'plant:{name}:={value}'))],
            it.lines.append)
        it.children.append(robot)
        it.until(lambda: len(states) > 1, 'the first state, which is repeated')
        it.start('controller', *arguments, *(
            x for name, value in law.items() for x in ('-p', f'{name}:={value}')))
        Diagnostics(it).next('controller')  # It knows all that we listen to, and can go on.
        it.start('reference', *arguments)
        it.until(lambda: robot.status is not None and len(tracking) == 501, 'the end')
        assert robot.status == 0, it.lines
    assert [ns(m.header.stamp) for m in tracking] == [k * MS for k in range(0, 2001, 4)]
    described = {'model': 'urdf', 'description': str(urdf)}
    run = simulated_by_mujoco(parameter_file.load(
        file, {'/**': described, 'plant': start, 'controller': law})).run
    error = run.q_d - run.q
    np.testing.assert_allclose([m.position[2:] for m in tracking], error[::4], atol=1e-9)
    assert np.abs(error)[-1].max() < 0.005


# The description from a topic, and its limits.

def test_a_description_that_comes_later_and_is_wrong_at_first() -> None:
    """All wait for it and say so once; what is refused is named, and the next one taken."""
    massless = two_links().replace(link('lower', 1.5, (0, 0, -0.25), (0.05, 0.05, 0.01)),
                                   link('lower'))
    assert massless != two_links()
    with probe() as it:
        reports = Diagnostics(it)
        commands = it.listen(Float64MultiArray, COMMANDS)
        told = it.listen(String, f'controller/{DESCRIPTION}', LATCHED)
        # So fast that the limits are always reached; in lockstep, so that no delay makes a motion
        # with such torques diverge.
        it.start('controller', *ARM)
        it.start('plant', *ARM, '-p', 'initial_position:=[0.2, -0.3]', '-p', 'pacing:=lockstep')
        it.start('reference', '-p', 'joint_names:=[a,b]', '-p', 'amplitude:=[1.5, 0.5]',
                 '-p', 'frequency:=[6.0, 6.0]')
        nodes = ('controller', 'plant')
        for node in nodes:
            report = reports.until(node, lambda r: r.level == ERROR, 'the error')
            assert report.message == f'waiting for {DESCRIPTION}'
        topic = it.node.create_publisher(String, DESCRIPTION, LATCHED)
        for text, words in (
                ('', ['model urdf needs']), ('<robot', ['the description is not XML']),
                (ur5(), ["joint_names: ['a', 'b'] is not allowed", 'shoulder_pan_joint']),
                (massless, ['M is singular', 'moved by b '])):
            topic.publish(String(data=text))
            for node in nodes:
                it.until(lambda: any(
                    x.startswith(f'[{node}] [ERROR]') and f']: {DESCRIPTION}: ' in x
                    and all(word in x for word in words) for x in it.lines), words[0])
        for node in nodes:
            report = reports.until(node, lambda r: 'singular' in r.message, 'the reason')
            assert report.level == ERROR
        assert commands == told == []
        topic.publish(String(data=two_links()))
        it.until(lambda: len(commands) > 100, 'torques')
        for node in nodes:
            well = reports.until(node, lambda r: r.message.startswith('running'), 'health')
            assert well.level in (OK, WARN)
            mine = [x for x in it.lines if x.startswith(f'[{node}]')]
            assert len([x for x in mine if x.endswith(f': waiting for {DESCRIPTION}')]) == 1
            assert len([x for x in mine if f'{DESCRIPTION} has come' in x]) == 1
        assert [m.data for m in told] == [two_links()]

        # Its limits bound the torques, 40 N·m and none, until there are others.
        def greatest(joint: int) -> float:
            return max((abs(m.data[joint]) for m in commands[-400:]), default=0.0)
        it.until(lambda: greatest(0) == 40.0, 'the limit of the description')
        assert it.set('controller', 'effort_limit', [55.0, 3.0]).successful
        commands.clear()
        it.until(lambda: (greatest(0), greatest(1)) == (55.0, 3.0), 'the other limits')
        assert it.set('controller', 'effort_limit', [math.inf, math.inf]).successful
        commands.clear()
        it.until(lambda: greatest(0) == 40.0 and greatest(1) > 3.0, 'the first limit')
        assert not any('Traceback' in line for line in it.lines)


def test_bad_descriptions_and_missing_extras_end_the_start_in_one_line(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot, broken, stubs = (tmp_path / x for x in ('arm.urdf', 'broken.urdf', 'stubs'))
    robot.write_text(two_links())
    broken.write_text('<robot name="r"><link')
    good = ('-p', f'description:={robot}')
    cases = [
        ('controller', (*ARM, '-p', 'description:=no.urdf'),
         'description: no.urdf: No such file or directory'),
        ('plant', (*ARM, '-p', f'description:={broken}'), 'the description is not XML'),
        ('controller', ('-p', 'model:=nowhere:Arm'),
         "there is no model nowhere:Arm: ModuleNotFoundError: No module named 'nowhere'")]
    missing = [
        (node, (*ARM, *good), 'the model urdf needs Pinocchio (not here): pip install pin, or ')
        for node in ('controller', 'plant')]
    package = stubs / 'pinocchio'
    package.mkdir(parents=True)
    (package / '__init__.py').write_text("raise ImportError('not here')\n")
    with probe() as it:
        children = [(it.start(node, *arguments), words) for node, arguments, words in cases]
        monkeypatch.setenv('PYTHONPATH', str(stubs), prepend=':')
        children += [(it.start(node, *arguments), words) for node, arguments, words in missing]
        for child, words in children:
            it.until(lambda: child.status is not None, f'the end: {words}')
            child.exit_report()
            assert (child.status, len(child.tail)) == (1, 1), child.tail
            assert child.tail[0].startswith(f'{child.name}: ')
            assert words in child.tail[0]


# Sources of states that are not ours.

class Broadcaster:
    """Plays the joint_state_broadcaster of ros2_control: no clock, all joints that there are."""

    #: The order is that of the hardware, with joints that are none of the controller's business.
    ORDER = ('gripper', 'joint2', 'wheel', 'joint1')

    def __init__(self, it: Probe) -> None:
        self.probe = it
        self.reports = Diagnostics(it)
        self.commands = it.listen(Float64MultiArray, COMMANDS)
        self.states = it.node.create_publisher(JointState, 'joint_states', 10)

    def publish(self, t: int, q: Sequence[float], dq: Sequence[float]) -> None:
        """Publish positions and velocities of joint1 and joint2; no efforts."""
        positions = {'joint1': q[0], 'joint2': q[1], 'gripper': 0.04}
        velocities = {'joint1': dq[0], 'joint2': dq[1], 'wheel': 7.0}
        message = JointState(name=list(self.ORDER))
        message.header.stamp = stamp(t)
        message.header.frame_id = 'base_link'
        message.position = array('d', [positions.get(x, math.nan) for x in self.ORDER])
        message.velocity = array('d', [velocities.get(x, math.nan) for x in self.ORDER])
        self.states.publish(message)

    def answer(self, t: int, q: Sequence[float], dq: Sequence[float]) -> list[float]:
        """Publish a state and return the torque that answers it."""
        before = len(self.commands)
        self.publish(t, q, dq)
        self.probe.until(lambda: len(self.commands) > before, 'a torque')
        return list(self.commands[-1].data)

    def until(self, node: str, done: Callable[[Report], bool], publish: Callable[[], None],
              what: str) -> Report:
        """Publish states until a node reports what is waited for."""
        self.reports.latest.pop(node, None)

        def found() -> bool:
            publish()
            return node in self.reports.latest and done(self.reports.latest[node])
        self.probe.until(found, f'{what} of {node}')
        return self.reports.latest[node]


def test_a_broadcaster_of_ros2_control_is_answered_by_the_law() -> None:
    """
    Other order, more joints, no efforts, no clock, stamps on no grid.

    States that come at another period than `control_period` are answered by the same law, and a
    warning says that its filter takes them for something else.
    """
    period = 2 * MS
    law = Controller(ControllerConfig(control_period=2e-3))
    motion = Sinusoid(ReferenceConfig())
    rows = [motion.at(k * period) for k in range(100)]
    rows.append((rows[-1][0], (0.0, 0.0), (0.0, 0.0)))
    with probe() as it:
        source = Broadcaster(it)
        references = it.node.create_publisher(JointTrajectory, 'reference', 10)
        it.start('controller', '-p', 'control_period:=0.002', '-p', 'state_timeout:=20.0',
                 '-p', 'predicted_periods:=0')
        it.until(lambda: source.states.get_subscription_count()
                 and references.get_subscription_count(), 'the controller')
        start, known = time.time_ns(), Trajectory()
        known.extend([start + k * period for k in range(len(rows))], rows)
        for k in range(3):
            source.publish(start + k * period, (0.1 * k, 0.2), (0.0, 0.3))
        report = source.reports.until('controller', lambda r: 'waiting for ref' in r.message,
                                      'that it waits')
        assert report.level == WARN
        assert report.values['time'] == 'real'
        assert source.commands == []
        references.publish(JointTrajectory(
            header=JointState().header, joint_names=['joint2', 'joint1'],
            points=[JointTrajectoryPoint(
                positions=array('d', q[::-1]), velocities=array('d', dq[::-1]),
                accelerations=array('d', ddq[::-1]),
                time_from_start=Duration(sec=t // S, nanosec=t % S))
                for t, (q, dq, ddq) in zip(
                    (start + k * period for k in range(len(rows))), rows)]))
        it.until(lambda: source.commands, 'the torque')
        point = known.at(start + 2 * period)
        assert point is not None
        tau = law.step((0.2, 0.2), (0.0, 0.3), *point, t=start + 2 * period).tau
        assert list(source.commands[0].data) == list(tau)
        t = start
        for k in range(3, 30):
            t = start + k * period + (k * 7919) % 701 * 1000 - 350_000  # ± 0.35 ms
            q, dq = (0.1 * k, 0.2 - 0.01 * k), (0.3, -0.4)
            at = law.instant(t)
            point = known.at(at)
            assert point is not None
            assert source.answer(t, q, dq) == list(law.step(q, dq, *point, t=t, at=at).tau)
        assert 'states come every' not in source.reports.next('controller').message

        def publish(step: int) -> Callable[[], None]:
            def one() -> None:
                nonlocal t
                t += step
                source.publish(t, (0.0, 0.0), (0.0, 0.0))
            return one
        report = source.until('controller', lambda r: 'states come' in r.message,
                              publish(5 * MS), 'the warning')
        assert report.level == WARN
        assert report.message.startswith(
            'running, but states come every 5 ms; control_period is 2 ms')
        assert report.count('restarts') == 0
        source.until('controller', lambda r: 'states come' not in r.message, publish(period),
                     'health')


def test_states_of_another_clock_have_a_reference_in_its_time() -> None:
    """A simulator that publishes no clock, at 500 Hz: it begins where the robot is."""
    with probe() as it:
        source = Broadcaster(it)
        tracking = it.listen(JointState, 'controller/tracking')
        period = ('-p', 'control_period:=0.002')
        it.start('controller', *period, '-p', 'state_decimation:=1', '-p', 'state_timeout:=1.0')
        it.start('reference', *period, '-p', 'start_duration:=2.0')
        source.reports.until('controller', lambda r: r.values['reference: publishers']
                             == '/reference', 'that it knows the reference')
        begin = time.monotonic_ns()
        it.node.create_timer(0.002, lambda: source.publish(
            5 * S + time.monotonic_ns() - begin, (0.4, -0.3), (0.0, 0.0)))
        it.until(lambda: tracking and tracking[-1].position[0] > 0.5, 'motion')
        assert source.reports.next('controller').message.startswith('running')
        report = source.reports.next('reference')
        assert report.level != ERROR  # A busy computer is a warning.
        assert report.values['time'] == 'real'
        assert all(5 * S < ns(m.header.stamp) < 60 * S for m in tracking)
        assert list(tracking[0].position[:2]) == pytest.approx([0.4, -0.3], abs=0.02)
        count = len(tracking)  # Of one sample, what is sent last may be heard first.
        it.until(lambda: len(source.commands) >= count, 'a command for each')


# Waypoints, as MoveIt sends them.

def route(names: Sequence[str], *points: tuple[float, Sequence[float], Sequence[float] | None,
                                               Sequence[float] | None]) -> JointTrajectory:
    """Return waypoints: time [s], positions, velocities and accelerations, or None."""
    return JointTrajectory(joint_names=list(names), points=[
        JointTrajectoryPoint(
            positions=array('d', q), velocities=array('d', dq or ()),
            accelerations=array('d', ddq or ()),
            time_from_start=Duration(sec=int(t), nanosec=round(t % 1 * S)))
        for t, q, dq, ddq in points])


def test_waypoints_are_gone_through_and_held_at_the_end() -> None:
    """
    The first point is where the robot is, at time 0, as MoveIt has it.

    The desired position goes through every waypoint and never jumps; it rests at the last one.
    A refused trajectory is counted, and nothing moves.
    """
    zero, fast, period = (0.0, 0.0), (0.3, -0.6), 10 * MS
    kinds: list[tuple[Any, Any]] = [(fast, zero), (fast, None), (None, None)]
    with probe() as it:
        reports = Diagnostics(it)
        topic = it.node.create_publisher(JointTrajectory, 'reference/joint_trajectory', 10)
        node = ReferenceUnderTest(it, '-p', 'control_period:=0.01', '-p', 'center:=[0.0, 0.0]',
                                  '-p', 'amplitude:=[0.0, 0.0]')
        it.until(topic.get_subscription_count, 'the reference')
        node.run_to(S)
        here: Sequence[float] = zero
        for i, (moving, resting) in enumerate(kinds):
            a, b, c = (0.3 + 0.2 * i, -0.2), (0.5, -0.5 + 0.1 * i), (0.1 * i, 0.2 - 0.3 * i)
            begun, still = node.now, moving and zero
            topic.publish(route(
                ('joint2', 'joint1'), *[
                    (t, q[::-1], v and v[::-1], resting) for t, q, v in (
                        (0.0, here, still), (0.55, a, moving), (0.75, b, moving),
                        (1.0, c, still))]))

            def passed() -> bool:
                """Return whether the motion has ended there, while time goes on."""
                node.run_to(node.now + 200 * MS)
                return tuple(node.points[max(node.points)].positions) == c

            it.until(passed, f'the end of trajectory {i}')
            node.run_to(node.now + S)
            points = {t: p for t, p in sorted(node.points.items()) if t >= begun}
            times = list(points)
            assert times == list(range(times[0], times[-1] + 1, period))
            desired = np.array([p.positions for p in points.values()])
            speed = max(abs(v) for p in points.values() for v in p.velocities)
            assert np.abs(np.diff(desired, axis=0)).max() <= 1.5 * speed * 1e-9 * period + 1e-6
            end = next(k for k in range(len(desired)) if (desired[k:] == c).all())
            assert not any(any(p.velocities) for p in list(points.values())[end:])
            for back, q in ((25, b), (45, a)):  # Before the end.
                assert desired[end - back] == pytest.approx(q, abs=1e-6)
            here = c

        good = (0.2, (1.0, 1.0), None, None)
        wrong = [route(('joint1', 'elbow'), good), route(('joint1',), (0.2, (1.0,), None, None)),
                 route(('joint1', 'joint2'), good, good),
                 route(('joint1', 'joint2'), (0.2, (1.0, math.nan), None, None)),
                 route(('joint1', 'joint2'), (0.2, (1.0, 1.0), (1.0,), None)),
                 route(('joint1', 'joint2'))]
        begun = node.now
        for message in wrong:
            topic.publish(message)
        report = reports.until('reference', lambda r: sum(r.refused(
            '~/joint_trajectory').values()) == len(wrong), 'the refusals')
        assert report.refused('~/joint_trajectory') == {'waypoints': len(wrong)}
        node.run_to(node.now + S)
        assert {tuple(p.positions) for t, p in node.points.items() if t > begun} == {tuple(here)}
