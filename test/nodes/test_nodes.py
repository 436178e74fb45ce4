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

import math
from pathlib import Path
import signal

from controller_process import ControllerUnderTest
from ctc_chattering.configuration.node_parameters import NODES as CONFIGS
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig, Sinusoid
from faults import Diagnostics
from processes import interrupt, probe
import pytest
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import DescribeParameters, ListParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_messages import COMMANDS, MS, reference, stamp, state, torques
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from urdfs import two_links

pytestmark = pytest.mark.ros
NODES = ('plant', 'controller', 'reference', 'recorder')
S = 1000 * MS
#: Security without a keystore.
ENFORCED = {'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce'}


def test_the_controller_finds_its_joints_by_name_and_takes_what_is_set() -> None:
    """
    Extra joints, any order, no efforts, a reference in another order: the law's torque.

    The first state waits for its reference, bad ones are passed over, and every second sample is
    told. A law or a gain that is set takes effect at the next sample, as in `Controller`.
    """
    motion = [Sinusoid(ReferenceConfig()).at(k * MS) for k in range(40)]
    law = Controller(ControllerConfig(ka=(13.0, 13.0)))
    changes = {20: ('law', 'compensation'), 25: ('kp', [90.0, 80.0]), 30: ('lambda', 7),
               35: ('law', 'chattering')}
    with probe() as it:
        heard = {name: it.listen(JointState, f'controller/{name}')
                 for name in ('tracking', 'filter', 'torques')}
        controller = ControllerUnderTest(it, '-p', 'state_decimation:=2', '-p', 'ka:=13')
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
        for k in range(40):
            if k in changes:
                name, value = changes[k]
                assert it.set('controller', name, value).successful
                assert not it.set('controller', 'law', 'nonsense').successful
                law.configure(law.config.changed({name: value}))
            joints = {'joint1': (0.1 * k, 0.2), 'joint2': (-0.3, 0.01 * k),
                      'wheel': (7.0, math.nan), 'x': (math.inf, 6.0)}
            if k:
                controller.answer(state(k * MS, **{
                    name: joints[name] for name in orders[k % 3]}))
            last = law.step((0.1 * k, -0.3), (0.2, 0.01 * k), *motion[k])
            assert list(controller.commands[-1].data) == list(last.tau)
            if k == 10:
                tenth = last
        assert len(controller.commands) == 40
        assert [x.label for x in controller.commands[-1].layout.dim] == ['joint1', 'joint2']
        it.until(lambda: all(len(x) == 20 for x in heard.values()), 'every second sample')
        for messages in heard.values():
            assert [m.header.stamp for m in messages] == [stamp(k * MS) for k in range(0, 40, 2)]
        tracking, filtered, parts = (heard[x][5] for x in ('tracking', 'filter', 'torques'))
        assert tracking.name == ['joint1/desired', 'joint2/desired', 'joint1/error',
                                 'joint2/error']
        assert list(tracking.position) == [*motion[10][0], *tenth.e]
        assert list(tracking.velocity) == [*motion[10][1], *tenth.de]
        assert list(filtered.velocity) == list(tenth.v)
        named = dict(zip(parts.name, parts.effort))
        assert named.pop('V') == law.lyapunov((1.0, -0.3), tenth.v)
        for joint, tau in zip(('joint1/', 'joint2/'), tenth.tau):
            assert named.pop(f'{joint}commanded') == tau
            assert sum(value for name, value in named.items() if name.startswith(joint)
                       ) == pytest.approx(tau, rel=1e-12)
        latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        told = it.listen(ParameterEvent, 'controller/parameters', latched)
        it.until(lambda: len(told) == 5, 'the parameters in force')
        assert len(told[0].new_parameters) == len(CONFIGS['controller'].parameters())
        assert [(m.stamp, [p.name for p in m.changed_parameters]) for m in told[1:]] == [
            (stamp(k * MS), [name]) for k, (name, _) in changes.items()]

        # One number is for all joints, and every change is logged.
        for value in (14, 10.0):
            assert it.set('controller', 'ka', value).successful
            assert it.get('controller', 'ka') == [value, value]
        assert 'ka: [-1.0, -1.0] is not allowed' in it.set('controller', 'ka', -1.0).reason
        it.until(lambda: 'ka: [14.0, 14.0] -> [10.0, 10.0]' in it.lines[-1], 'the last change')
        said = [line.split(']: ')[1] for line in it.lines]
        assert [line.split(': ')[0] for line in said if ' -> ' in line] == [
            *(name for name, _ in changes.values()), 'ka', 'ka']
        assert 'law: chattering -> compensation' in said
        assert 'ka: [13.0, 13.0] -> [14.0, 14.0]' in said
        assert ('effort_limit is infinite for joint1, joint2; set it to the limits of the '
                'drives') in said


def test_every_parameter_is_described_and_a_signal_ends_the_node(tmp_path: Path) -> None:
    more = {'recorder': ('-p', f'bag:={tmp_path}/bag'), 'reference': (
        '-p', 'use_sim_time:=true')}
    with probe() as it:
        reports = Diagnostics(it)
        children = {name: it.start(name, *more.get(name, ())) for name in NODES}
        reports.until('reference', lambda r: 'but /clock has no publisher' in r.message,
                      'that time stands still')
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


def test_a_wrong_start_is_refused_in_one_line(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is wrong with arguments is proved in `ros`; here what the node finds."""
    robot, stubs = tmp_path / 'arm.urdf', tmp_path / 'stubs' / 'pinocchio'
    robot.write_text(two_links())
    stubs.mkdir(parents=True)
    (stubs / '__init__.py').write_text("raise ImportError('not here')\n")
    arm = ('-p', 'model:=urdf', '-p', 'joint_names:=[a,b]', '-p')
    with probe() as it:
        child = it.start('plant', '-r', 'joint_states')
        it.until(lambda: child.status is not None, 'the end')
        child.exit_report()
        assert child.status == 1  # ROS has the words, and may say more.
        assert child.tail[-1].startswith('plant: failed to initialize rcl: ')
        children = [(it.start(name, *arguments), status, message)
                    for name, arguments, status, message in (
            ('plant', ('-p', 'coulomb_friction:=[-1.0, .nan]'), 2, 'coulomb_friction: [-1.0, '),
            ('controller', (*arm, 'description:=no.urdf'), 1,
             'description: no.urdf: No such file or directory'))]
        monkeypatch.setenv('PYTHONPATH', str(stubs.parent), prepend=':')
        children.append((it.start('controller', *arm, f'description:={robot}'), 1,
                         'the model urdf needs Pinocchio (not here): pip install pin, or '))
        for name, value in ENFORCED.items():
            monkeypatch.setenv(name, value)
        children.append((it.start('recorder', '-p', f'bag:={tmp_path / "bag"}'), 1,
                         'ROS_SECURITY_KEYSTORE is not set'))
        for child, status, message in children:
            it.until(lambda child=child: child.status is not None, 'the end')  # type: ignore
            child.exit_report()
            assert (child.status, len(child.tail)) == (status, 1), child.tail
            assert child.tail[0].startswith(f'{child.name}: ')
            assert message in child.tail[0]
    assert not (tmp_path / 'bag').exists()


def test_the_plant_in_lockstep_takes_torques_by_label_and_holds_time() -> None:
    """A torque from which no motion follows ends it in one line."""
    oracle = Plant(PlantConfig())
    with probe() as it:
        states, clocks = it.listen(JointState, 'joint_states'), it.listen(Clock, 'clock')
        commands = it.node.create_publisher(Float64MultiArray, COMMANDS, 1000)
        plant = it.start('plant', '-p', 'pacing:=lockstep', '-p', 'hold_at:=0.005')
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
            it.until(lambda k=k: states[-1].header.stamp  # type: ignore[misc]
                     == stamp((k + 1) * MS), 'the next state')
            assert list(states[-1].position) == list(oracle.q)
            assert list(states[-1].velocity) == list(oracle.dq)
            assert list(states[-1].effort) == [*tau]
        it.until(lambda: clocks[-1].clock == stamp(5 * MS), 'the hold')
        commands.publish(torques([0.0, 0.0]))
        assert it.set('plant', 'coulomb_friction', [0.0, 0.0]).successful
        assert it.set('plant', 'hold_at', 0.0).successful
        it.until(lambda: states[-1].header.stamp == stamp(5 * MS), 'the state after the hold')
        assert list(states[-1].position) == list(oracle.q)
        it.until(lambda: any('refused' in line for line in it.lines), 'the refusal')
        commands.publish(torques([1e200, 1e200]))
        it.until(lambda: plant.status is not None, 'the end')
        plant.exit_report()
        assert plant.status == 1
        assert [x for x in it.lines if 'the motion of the plant diverged at t = ' in x] == (
            it.lines[-1:])
