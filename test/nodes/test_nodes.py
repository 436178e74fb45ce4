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

"""Each node alone on a real graph, with the test as its counterpart."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
import signal
from typing import Any

from controller_process import ControllerUnderTest, ReferenceUnderTest
from ctc_chattering.configuration.node_parameters import NODES as CONFIGS
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig, Sinusoid
from processes import interrupt, probe
import pytest
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import DescribeParameters, ListParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_messages import COMMANDS, MS, reference, stamp, state, torques
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

pytestmark = pytest.mark.ros
NODES = ('plant', 'controller', 'reference', 'recorder')


def test_the_controller_finds_its_joints_by_name_and_says_what_the_torque_is_made_of() -> None:
    """
    Extra joints, any order, no efforts, a reference in another order: the law's torque.

    The first state waits for its reference, bad ones are passed over, and every second sample is
    told.
    """
    motion = [Sinusoid(ReferenceConfig()).at(k * MS) for k in range(20)]
    law = Controller(ControllerConfig())
    with probe() as it:
        heard = {name: it.listen(JointState, f'controller/{name}')
                 for name in ('tracking', 'filter', 'torques')}
        controller = ControllerUnderTest(it, '-p', 'state_decimation:=2')
        good = {'joint1': (0.0, 0.2), 'joint2': (-0.3, 0.0)}
        controller.states.publish(state(0, **good))
        for bad in (state(0, joint1=(0.0, 0.0)), state(0, **{**good, 'joint2': (math.nan, 0.0)}),
                    JointState(name=['joint1', 'joint2'], position=[0.0, 0.0])):
            controller.states.publish(bad)
        it.until(lambda: any('refused' in line for line in it.lines), 'the refusal')
        assert controller.commands == []
        controller.references.publish(reference(
            ['gripper', 'joint2', 'joint1'],
            [[[9.0, *reversed(row)] for row in point] for point in motion]))
        it.until(lambda: controller.commands, 'the torque')
        orders = (('joint1', 'joint2'), ('wheel', 'joint2', 'joint1'), ('joint2', 'x', 'joint1'))
        for k in range(11):
            joints = {'joint1': (0.1 * k, 0.2), 'joint2': (-0.3, 0.01 * k),
                      'wheel': (7.0, math.nan), 'x': (math.inf, 6.0)}
            if k:
                controller.answer(state(k * MS, **{
                    name: joints[name] for name in orders[k % 3]}))
            last = law.step((0.1 * k, -0.3), (0.2, 0.01 * k), *motion[k])
            assert list(controller.commands[-1].data) == list(last.tau)
        assert len(controller.commands) == 11
        assert [x.label for x in controller.commands[-1].layout.dim] == ['joint1', 'joint2']
        it.until(lambda: all(len(x) == 6 for x in heard.values()), 'every second sample')
        for messages in heard.values():
            assert [m.header.stamp for m in messages] == [stamp(k * MS) for k in range(0, 11, 2)]
        tracking, filtered, parts = (heard[x][-1] for x in ('tracking', 'filter', 'torques'))
        assert tracking.name == ['joint1/desired', 'joint2/desired', 'joint1/error',
                                 'joint2/error']
        assert list(tracking.position) == [*motion[10][0], *last.e]
        assert list(tracking.velocity) == [*motion[10][1], *last.de]
        assert list(filtered.velocity) == list(last.v)
        named = dict(zip(parts.name, parts.effort))
        assert named.pop('V') == law.lyapunov((1.0, -0.3), last.v)
        total = [sum(value for name, value in named.items() if name.startswith(joint))
                 for joint in ('joint1/', 'joint2/')]
        assert total == pytest.approx(list(last.tau), rel=1e-12)


#: What may not be set, with a part of the reason.
REFUSED: list[tuple[str, Any, str]] = [
    ('law', 'nonsense', "law: 'nonsense' is not allowed; allowed: compensation | chattering"),
    ('law', 5, 'law: 5 is not allowed'), ('kp', [1.0] * 3, 'kp: [1.0, 1.0, 1.0] is not allowed'),
    ('kp', [1.0, 2.0, 3.0, 1.0], 'symmetric positive definite'),
    ('kv', [-1.0, 1.0], 'kv: [-1.0, 1.0] is not allowed'),
    ('ka', [math.nan, 1.0], 'ka: [nan, 1.0] is not allowed'),
    ('lambda', 0.0, 'lambda: 0.0 is not allowed'), ('lambda', math.nan, 'lambda'),
    ('b', -1.0, 'b'), ('b', 5e-324, 'b: 5e-324 is not allowed'),
    ('b', 1e308, 'b: 1e+308 is not allowed'),
    ('switching', 'magic', "switching: 'magic' is not allowed; allowed: sign"),
    ('effort_limit', [0.0, 1.0], 'effort_limit: [0.0, 1.0] is not allowed'),
    ('model', 'two_link', 'read-only'), ('joint_names', ['a', 'b'], 'read-only')]


def test_a_law_set_in_mid_run_takes_effect_at_the_next_sample_and_a_refused_one_does_not() -> None:
    """As `ros2 param set` would: the chattering term goes and comes, v is preserved."""
    motion = [Sinusoid(ReferenceConfig()).at(k * MS) for k in range(40)]
    law = Controller(ControllerConfig())
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    with probe() as it:
        controller = ControllerUnderTest(it)
        controller.references.publish(reference(['joint1', 'joint2'], motion))
        changes = {10: ('law', 'compensation'), 20: ('kp', [90.0, 80.0]), 25: ('lambda', 7),
                   30: ('law', 'chattering')}
        for k in range(40):
            if k in changes:
                name, value = changes[k]
                assert it.set('controller', name, value).successful
                law.configure(law.config.changed({name: value}))
            if k < len(REFUSED):
                name, value, reason = REFUSED[k]
                before = it.get('controller', name)
                result = it.set('controller', name, value)
                assert not result.successful
                assert reason in result.reason
                assert it.get('controller', name) == before
            q, dq = (0.1 + 0.01 * k, 0.3), (0.2, 0.4)
            expected = law.step(q, dq, *motion[k]).tau
            assert controller.answer(state(
                k * MS, joint1=(q[0], dq[0]), joint2=(q[1], dq[1]))) == list(expected)
        told = it.listen(ParameterEvent, 'controller/parameters', latched)
        it.until(lambda: len(told) == 5, 'the parameters in force')
        assert len(told[0].new_parameters) == len(CONFIGS['controller'].parameters())
        assert [(m.stamp, [p.name for p in m.changed_parameters]) for m in told[1:]] == [
            (stamp(k * MS), [name]) for k, (name, _) in changes.items()]
        assert [line.split(']: ')[1].split(': ')[0] for line in it.lines if ' -> ' in line] == [
            name for name, _ in changes.values()]


def test_one_number_is_for_all_joints_and_every_change_is_logged() -> None:
    """Set vectors at the start and while the node runs, as ros2 param sends numbers."""
    with probe() as it:
        it.start('controller', '-p', 'ka:=12', '-p', 'kp:=90.5')
        assert it.get('controller', 'ka') == [12.0, 12.0]
        assert it.get('controller', 'kp') == [90.5, 90.5]
        assert [line.split(']: ')[1] for line in it.lines if 'WARN' in line] == [
            'effort_limit is infinite for joint1, joint2: set them to the limits of the drives']
        for value, found in ((13.5, 13.5), (14, 14.0), (10.0, 10.0)):
            assert it.set('controller', 'ka', value).successful
            assert it.get('controller', 'ka') == [found, found]
        assert 'ka: [-1.0, -1.0] is not allowed' in it.set('controller', 'ka', -1.0).reason
        assert it.set('controller', 'law', 'integral').successful
        for word in ('inf', '1e1'):
            assert f"effort_limit: '{word}' is not allowed" in it.set(
                'controller', 'effort_limit', word).reason
        assert it.set('controller', 'effort_limit', math.inf).successful  # As it is already.
        assert it.set('controller', 'effort_limit', 50).successful
        it.until(lambda: any('effort_limit' in line and '->' in line for line in it.lines), 'log')
        assert [line.split(']: ')[1] for line in it.lines if ' -> ' in line] == [
            'ka: [12.0, 12.0] -> [13.5, 13.5]', 'ka: [13.5, 13.5] -> [14.0, 14.0]',
            'ka: [14.0, 14.0] -> [10.0, 10.0]', 'law: chattering -> integral',
            'effort_limit: [inf, inf] -> [50.0, 50.0]']


def test_every_parameter_is_described_and_a_signal_ends_the_node(tmp_path: Path) -> None:
    with probe() as it:
        children = {name: it.start(name, *(
            ('-p', f'bag:={tmp_path}/bag') if name == 'recorder' else ())) for name in NODES}
        for name, child in children.items():
            listed = it.call(
                ListParameters, f'/{name}/list_parameters', ListParameters.Request())
            names = [x for x in listed.result.names if x in CONFIGS[name].parameters()]
            assert set(names) == set(CONFIGS[name].parameters())
            descriptors = it.call(DescribeParameters, f'/{name}/describe_parameters',
                                  DescribeParameters.Request(names=names)).descriptors
            for found in descriptors:
                spec = CONFIGS[name].parameters()[found.name]
                assert found.description.startswith(spec.description)
                assert found.read_only == spec.read_only
                assert found.additional_constraints == spec.allowed
            assert interrupt(child, signal.SIGTERM if name == 'plant' else signal.SIGINT) < 1.0
            assert child.status == 0
        assert not any('Traceback' in line for line in it.lines)


def test_a_wrong_start_is_refused_in_one_line(tmp_path: Path) -> None:
    unknown = tmp_path / 'unknown.yaml'
    unknown.write_text('controller: {ros__parameters: {gravitty: 9.81}}')
    with probe() as it:
        wrong = [it.start('plant', *x) for x in (('-r', 'joint_states'), ('--log-level', 'loud'))]
        for child in wrong:  # ROS has the words, and may say more.
            it.until(lambda child=child: child.status is not None, 'the end')  # type: ignore
            child.exit_report()
            assert child.status == 1
            assert child.tail[-1].startswith('plant: failed to initialize rcl: ')
        children = [(it.start(name, *arguments), status, message)
                    for name, arguments, status, message in (
            ('controller', ('-p', 'law:=nonsense'), 2, "law: 'nonsense' is not allowed; allowed:"),
            ('plant', ('-p', 'coulomb_friction:=[-1.0, .nan]'), 2, 'coulomb_friction: [-1.0, '),
            ('reference', ('-p', 'joint_names:=[a, a]'), 2, "joint_names: ['a', 'a'] is not"),
            ('recorder', ('-p', 'bag:=/'), 1, '/: exists already'),
            ('plant', ('-p', 'command_timeout:=0'), 2, 'command_timeout: 0.0 is not allowed'),
            ('plant', ('--params-file', 'none.yaml'), 2, '--params-file none.yaml: there is no '),
            ('controller', ('--params-file', str(unknown)), 1, 'no parameter gravitty'))]
        for child, status, message in children:
            it.until(lambda child=child: child.status is not None, 'the end')  # type: ignore
            child.exit_report()
            assert (child.status, len(child.tail)) == (status, 1), child.tail
            assert child.tail[0].startswith(f'{child.name}: ')
            assert message in child.tail[0]


def test_the_plant_in_lockstep_takes_torques_by_label_and_holds_time() -> None:
    oracle = Plant(PlantConfig())
    with probe() as it:
        states, clocks = it.listen(JointState, 'joint_states'), it.listen(Clock, 'clock')
        commands = it.node.create_publisher(Float64MultiArray, COMMANDS, 1000)
        it.start('plant', '-p', 'pacing:=lockstep', '-p', 'hold_at:=0.005')
        it.until(lambda: states and commands.get_subscription_count(), 'the first state')
        assert list(states[0].position) == [0.0, 0.0]
        for k in range(5):
            for bad in (torques([1.0]), torques([1.0, math.inf]), torques([1.0, 2.0], 'a', 'b'),
                        torques([1.0, 2.0], 'joint1', 'joint1')):
                commands.publish(bad)
            tau = (60.0 + k, -30.0)
            commands.publish(torques([tau[1], math.nan, tau[0]], 'joint2', 'other', 'joint1')
                             if k % 2 else torques([*tau]))
            oracle.step(tau)
            if k == 4:
                break
            it.until(lambda: len(states) == k + 2, 'the next state')
            assert states[-1].header.stamp == stamp((k + 1) * MS)
            assert list(states[-1].position) == list(oracle.q)
            assert list(states[-1].velocity) == list(oracle.dq)
            assert list(states[-1].effort) == [*tau]
        it.until(lambda: clocks[-1].clock == stamp(5 * MS), 'the hold')
        commands.publish(torques([0.0, 0.0]))
        assert it.set('plant', 'coulomb_friction', [0.0, 0.0]).successful
        assert it.set('plant', 'hold_at', 0.0).successful
        it.until(lambda: states[-1].header.stamp == stamp(5 * MS), 'the state after the hold')
        assert list(states[-1].position) == list(oracle.q)
        assert any('refused' in line for line in it.lines)


def test_the_reference_follows_the_clock_ahead_of_time() -> None:
    motion = Sinusoid(ReferenceConfig(phase=(0.3, 0.4), control_period=2e-3))
    with probe() as it:
        node = ReferenceUnderTest(it, '-p', 'phase:=[0.3, 0.4]', '-p', 'control_period:=0.002',
                                  '-p', 'horizon:=0.2')
        for now in (0, 50 * MS, 90 * MS, 1_500 * MS):
            node.tell(now, 190 * MS)
        points = node.points
        assert all(t % (2 * MS) == 0 for t in points)
        assert all(t in points for t in range(0, 290 * MS, 2 * MS))
        for t, point in points.items():
            q_d, dq_d, ddq_d = motion.at(t)
            assert list(point.positions) == list(q_d)
            assert list(point.velocities) == list(dq_d)
            assert list(point.accelerations) == list(ddq_d)


def test_a_sinusoid_that_is_changed_while_it_runs_goes_on_without_a_jump() -> None:
    """Set at once, each by a call of its own: position and velocity go on, to the new motion."""
    period = 10 * MS
    changed = ReferenceConfig(
        amplitude=(0.2, 0.9), center=(1.0, -1.0), frequency=(0.4, 1.7), control_period=1e-2)
    with probe() as it:
        node = ReferenceUnderTest(it, '-p', 'control_period:=0.01')
        node.run_to(1000 * MS)
        for name in ('amplitude', 'center', 'frequency'):
            assert it.set('reference', name, list(getattr(changed, name))).successful
        assert not it.set('reference', 'frequency', [-1.0, 1.0]).successful
        node.run_to(6000 * MS)
        points = node.points
        times = sorted(points)
        assert times == list(range(0, times[-1] + 1, period))
        for before, after in itertools.pairwise(times):
            a, b = points[before], points[after]
            for j in range(2):
                mean = 0.5 * (a.velocities[j] + b.velocities[j])
                assert b.positions[j] - a.positions[j] == pytest.approx(1e-2 * mean, abs=2e-4)
                mean = 0.5 * (a.accelerations[j] + b.accelerations[j])
                assert b.velocities[j] - a.velocities[j] == pytest.approx(1e-2 * mean, abs=2e-2)
        last = Sinusoid(changed).at(times[-1])
        assert list(points[times[-1]].positions) == list(last[0])
        assert points[0].positions[0] == math.pi
