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

"""The whole graph in lockstep, as real processes: nothing lost, nothing changed."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
import os
from pathlib import Path
import signal
import sys

from ctc_chattering.analysis.result import simulate
from ctc_chattering.analysis.terms import Replay, ReplayVerdict
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.laws.registry import LAWS
from ctc_chattering.launch.child_process import Child
from faults import Diagnostics, ERROR, running
from mujoco_plant import simulated_by_mujoco
import numpy as np
from processes import bringup, CONFIG, PATIENCE, Probe, probe
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from recorded_runs import assert_equal, counts, record, reports_of
from ros_messages import COMMANDS, MS, ns
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from urdfs import link, PANDA, panda, two_links, ur5

pytestmark = pytest.mark.ros


@pytest.mark.slow
def test_every_law_one_after_another(tmp_path: Path) -> None:
    """
    The law changes every 25 ms; the graph equals the simulation to the last bit.

    Both are plain: what other tests compile meanwhile, a node would take law by law.
    """
    file = tmp_path / 'params.yaml'
    events = [f'{0.025 * k:.3f} controller law {law}' for k, law in enumerate(LAWS[1:], 1)]
    file.write_text(f"""
plant:
  ros__parameters: {{pacing: lockstep, duration: 0.26, compiled: false,
    actuator_lag: [0.002, 0.002], encoder_resolution: [1.0e-5, 1.0e-5],
    initial_position: [3.14159, 1.5708]}}
controller:
  ros__parameters: {{law: {LAWS[0]}, compiled: false, switching: implicit_observer,
    state_decimation: 1, ka: [60.0, 30.0], actuator_lag: [0.002, 0.002],
    friction_level: [9.0, 9.0]}}
bringup:
  ros__parameters:
    events: {events}
""")
    result = record(tmp_path / 'bag', '--params-file', str(file))
    assert [config.law for _, config in result.configs] == list(LAWS)
    assert_equal(result.run, simulate(parameter_file.load(file)).run)


@pytest.mark.slow
def test_other_period_names_namespace_waypoints_and_every_imperfection(tmp_path: Path) -> None:
    """
    Waypoints are quintic, cubic and linear, for the joints in another order, with a rest.

    Arguments for ROS stand above those of bringup, and reach the nodes.
    """
    file, waypoints = tmp_path / 'params.yaml', tmp_path / 'waypoints.yaml'
    waypoints.write_text("""
joint_names: [elbow, shoulder]
points:
  - {positions: [-0.1, 0.5], velocities: [0.3, 0.0], accelerations: [0, 0],
     time_from_start: 0.1}
  - {positions: [0.1, 0.7], velocities: [0.0, 0.4], accelerations: [0, 1],
     time_from_start: 0.2}
  - {positions: [0.2, 0.6], velocities: [0.0, 0.0], time_from_start: 0.3}
  - {positions: [0.0, 0.4], time_from_start: 0.4}
""")
    file.write_text(f"""
/**:
  ros__parameters: {{joint_names: [shoulder, elbow], control_period: 0.002}}
plant:
  ros__parameters: {{pacing: lockstep, duration: 0.5, initial_position: [0.3, -0.2],
    coulomb_friction: [3.0, 1.0], velocity_noise: [0.005, 0.004],
    position_noise: [1.0e-5, 0.0], encoder_resolution: [0.0, 1.0e-4], noise_seed: 7,
    input_delay: 2, torque_saturation: [900.0, 150.0], viscous_friction: [0.5, 0.2],
    stribeck_friction: [1.0, 0.5], load_friction: [0.02, 0.01],
    friction_asymmetry: [0.1, -0.2], actuator_lag: [0.002, 0.001],
    torque_rate_limit: [.inf, 100000.0], torque_resolution: [0.0, 0.01],
    joint_stiffness: [.inf, 5000.0], motor_inertia: [0.0, 0.1], joint_damping: [0.0, 5.0],
    velocity_sensor: filtered, velocity_cutoff: 900.0, sample_loss: 0.1, late_samples: 0.1}}
controller:
  ros__parameters: {{kp: [120.0, 5.0, 5.0, 90.0], ka: [4.0, 2.0], lambda: 5.0, b: 0.5,
    state_decimation: 1, effort_limit: [300.0, .inf], switching: implicit_observer, input_delay: 2,
    inertia_scale: 0.95, gravity_scale: 1.05}}
reference:
  ros__parameters: {{joint_names: [elbow, shoulder], trajectory_file: {waypoints}}}
bringup:
  ros__parameters:
    events: ['0.1 controller ka [13.0, 13.0]', '0.12 plant sample_loss 0.4',
             '0.15 plant friction_asymmetry [0.0, 0.1]']
""")
    result = record(
        tmp_path / 'bag', '--params-file', str(file), '--law', 'compensation', '--ros-args', '-r',
        '__ns:=/robot1', '-p', 'law:=chattering', '-p', 'experiment:=mine', '-p',
        'controller:b:=0.8')
    expected = simulate(parameter_file.load(
        file, {'plant': {'experiment': 'mine'}, 'controller': {'b': 0.8}}))
    assert_equal(result.run, expected.run)
    numbers = result.metrics()
    assert numbers == {**expected.metrics(), 'bag': 'bag', 'origins': numbers['origins']}
    assert numbers['origins']['robust'] == 'computed exactly'
    assert result.experiment == 'mine'
    assert result.joint_names == ('shoulder', 'elbow')
    assert np.abs(result.run.tau[:, 0]).max() == 300.0
    assert 150 < len(result.run.t) < 225
    assert counts(tmp_path / 'bag')['/robot1/joint_states'] >= len(result.run.t)
    rest = result.run.t >= 0.4
    assert rest.sum() > 20 and (result.run.q_d[rest] == [0.4, 0.0]).all()


#: Parameters of the reference, and of the plant.
LEARNING = [
    pytest.param('pd_gravity', 'speed_scaling: 1.0', 'sample_loss: 0.05', 3.6, (),
                 id='quick'),
    pytest.param('observer_feedback', 'speed_scaling: 0.5', 'sample_loss: 0.05', 8.0, (),
                 marks=pytest.mark.slow),
    pytest.param('pd_gravity', 'speed_scaling: 0.5',
                 'sample_loss: 0.05, sample_jitter: 4.0e-4, late_samples: 0.1', 8.0,
                 ('q_d', 'dq_d', 'ddq_d', 'v'), marks=pytest.mark.slow)]


@pytest.mark.parametrize(('law', 'reference', 'plant', 'duration', 'but'), LEARNING)
def test_learning_is_that_of_the_simulation_to_the_last_bit(
        tmp_path: Path, law: str, reference: str, plant: str, duration: float, but: Sequence[str]
        ) -> None:
    """The reference of a bag is interpolated between samples, with jitter by another formula."""
    file = tmp_path / 'params.yaml'
    file.write_text(f"""
/**:
  ros__parameters: {{control_period: 0.002}}
plant:
  ros__parameters: {{pacing: lockstep, duration: {duration}, initial_position: [3.1, 1.5],
    coulomb_friction: [3.0, 1.0], actuator_lag: [0.002, 0.002], compiled: false,
    encoder_resolution: [1.0e-5, 1.0e-5], {plant}}}
controller:
  ros__parameters: {{law: {law}, kp: [400.0, 400.0], kv: [40.0, 40.0], compiled: false,
    estimator_bandwidth: 50.0, actuator_lag: [0.002, 0.002], state_decimation: 3}}
reference:
  ros__parameters: {{learning: true, frequency: [4.0, 8.0], amplitude: [0.05, 0.02],
    joint_names: [joint2, joint1], center: [1.5, 3.1], start_duration: 0.2, {reference}}}
""")
    expected = simulate(parameter_file.load(file))
    result = record(tmp_path / 'bag', '--params-file', str(file), '--gains', 'file')
    assert expected.learner is not None
    errors = [max(x.rms) for x in expected.learner.passes]
    assert len(errors) >= 3 and errors[-1] < 0.6 * errors[0]
    report = reports_of(tmp_path / 'bag', 'reference')[-1]
    assert (report['pass'], report['learning']) == (str(len(errors)), 'learning')
    assert float(report['pass error']) == pytest.approx(errors[-1], rel=1e-3)
    assert_equal(result.run, expected.run, but)


@pytest.mark.slow
def test_a_recorder_that_is_stopped_again_and_again_keeps_each_torque_with_its_state(
        tmp_path: Path) -> None:
    """The run does not wait for it. It receives much of one topic before the next one."""
    file, bag = tmp_path / 'params.yaml', tmp_path / 'bag'
    file.write_text("""
plant:
  ros__parameters: {pacing: lockstep, duration: 30.0, compiled: false}
controller:
  ros__parameters: {compiled: false}
/**:
  ros__parameters: {control_period: 0.005, sample_loss: 0.05}
""")
    with bringup('--record', str(bag), '--params-file', str(file)) as process:
        recorder = running(process, bag)['recorder']
        with closing(Probe()) as it:
            states = it.listen(JointState, 'joint_states')
            for _ in range(5):
                os.kill(recorder, signal.SIGSTOP)
                # Less than the histories of the writers hold.
                it.until(lambda: len(states) > 300)
                states.clear()
                os.kill(recorder, signal.SIGCONT)
                it.until(lambda: len(states) > 100)
                states.clear()
        output, _ = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, output
    result = read_bag(bag)
    assert result.replay == Replay(ReplayVerdict.EXACT)
    assert_equal(result.run, simulate(parameter_file.load(file)).run)


def test_a_robot_of_a_urdf_and_the_bag_says_all(tmp_path: Path) -> None:
    """The bag is read when the files are gone."""
    robot, file, bag = tmp_path / 'robot.urdf', tmp_path / 'params.yaml', tmp_path / 'bag'
    robot.write_text(panda(), encoding='utf-8')
    text = (CONFIG / 'panda.yaml').read_text(encoding='utf-8')
    where = next(x for x in text.split() if x.startswith('package://'))
    file.write_text(text.replace(where, str(robot)))
    expected = simulate(parameter_file.load(file, {'plant': {'duration': 0.2}}))
    record(bag, '--params-file', str(file), '--duration', '0.2', '--ros-args', '-p',
           'state_decimation:=1')  # Each torque is published with its stamp.
    robot.unlink()
    file.unlink()
    result = read_bag(bag)
    assert_equal(result.run, expected.run)
    assert len(result.run.t) == 201
    assert result.joint_names == tuple(PANDA)
    assert (result.experiment, result.config.switching) == ('panda', 'implicit_observer')
    assert np.abs(result.terms.robust).max() > 0.0
    with closing(open_bag(bag)) as reader:
        assert reader.description() == panda()


LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DESCRIPTION = 'robot_description'
EXAMPLE = CONFIG.parent / 'examples' / 'mujoco_plant.py'
ARM = ['-p', 'model:=urdf', '-p', 'joint_names:=[a,b]']


def test_the_example_node_of_mujoco_is_a_robot() -> None:
    """
    Every fourth sample is there once, and the motion is the one that the oracle of the tests has.

    The controller comes later than the first state, which is repeated. What it publishes fits into
    the histories of writer and reader, however late this process takes it.
    """
    file, urdf = CONFIG / 'friction.yaml', CONFIG / 'two_link.urdf'
    arguments = ('--params-file', str(file), '-p', 'model:=urdf', '-p', f'description:={urdf}')
    law = {'switching': 'implicit_observer', 'state_decimation': 4}
    start = {'duration': 0.5, 'initial_position': [3.1, 1.5]}

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
        it.until(lambda: robot.status is not None and len(tracking) == 126, 'the end')
        assert robot.status == 0, it.lines
    assert [ns(m.header.stamp) for m in tracking] == [k * MS for k in range(0, 501, 4)]
    described = {'model': 'urdf', 'description': str(urdf)}
    run = simulated_by_mujoco(parameter_file.load(
        file, {'/**': described, 'plant': start, 'controller': law})).run
    error = run.q_d - run.q
    np.testing.assert_allclose([m.position[2:] for m in tracking], error[::4], atol=1e-9)


@pytest.mark.slow
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
        it.start('reference', '-p', 'joint_names:=[a,b]', '-p', 'center:=[0.5, 0.0]',
                 '-p', 'amplitude:=[1.4, 0.5]', '-p', 'frequency:=[6.0, 6.0]')
        nodes = ('controller', 'plant')
        for node in nodes:
            report = reports.until(node, lambda r: r.level == ERROR, 'the error')
            assert report.message == f'waiting for {DESCRIPTION}'
        topic = it.node.create_publisher(String, DESCRIPTION, LATCHED)
        for text, words in (
                ('', ['model urdf needs']), ('<robot', ['the description is not XML']),
                (ur5(), ["joint_names: ['a', 'b'] is not allowed", 'shoulder_pan_joint']),
                (massless, ['M is singular', 'moved by b ']),
                (two_links().replace('effort="40"', 'effort="-1"'), ['joint a: effort is -1']),
                (two_links().replace('value="3.0"', 'value="-3"'), ['upper: mass is -3 kg'])):
            topic.publish(String(data=text))
            for node in nodes:
                it.until(lambda: any(
                    x.startswith(f'[{node}] [ERROR]') and f']: {DESCRIPTION}: ' in x
                    and all(word in x for word in words) for x in it.lines), words[0])
        assert commands == told == []
        topic.publish(String(data=two_links()))
        it.until(lambda: len(commands) > 100, 'torques')
        for node in nodes:
            reports.until(node, lambda r: r.message.startswith('running'), 'health')
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
        assert not any('Traceback' in line for line in it.lines)
