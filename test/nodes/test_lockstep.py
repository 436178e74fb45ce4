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

from contextlib import closing
from pathlib import Path

from ctc_chattering.analysis.result import simulate
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.controller import LAWS
import numpy as np
from processes import CONFIG
import pytest
from recorded_runs import assert_equal, counts, record
from urdfs import PANDA, panda

pytestmark = pytest.mark.ros


def test_every_law_one_after_another(tmp_path: Path) -> None:
    """
    The law changes every 50 ms; the graph equals the simulation to the last bit.

    Both are plain: what other tests compile meanwhile, a node would take law by law.
    """
    file = tmp_path / 'params.yaml'
    events = [f'{0.05 * k:.2f} controller law {law}' for k, law in enumerate(LAWS[1:], 1)]
    file.write_text(f"""
plant:
  ros__parameters: {{pacing: lockstep, duration: 0.52, compiled: false,
    actuator_lag: [0.002, 0.002], encoder_resolution: [1.0e-5, 1.0e-5],
    initial_position: [3.14159, 1.5708]}}
controller:
  ros__parameters: {{law: {LAWS[0]}, compiled: false, switching: implicit_observer,
    ka: [60.0, 30.0], actuator_lag: [0.002, 0.002], friction_level: [9.0, 9.0]}}
bringup:
  ros__parameters:
    events: {events}
""")
    result = record(tmp_path / 'bag', '--params-file', str(file))
    assert [config.law for _, config in result.configs] == list(LAWS)
    assert_equal(result.run, simulate(parameter_file.load(file)).run)


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
     time_from_start: 0.2}
  - {positions: [0.1, 0.7], velocities: [0.0, 0.4], accelerations: [0, 1],
     time_from_start: 0.4}
  - {positions: [0.2, 0.6], velocities: [0.0, 0.0], time_from_start: 0.6}
  - {positions: [0.0, 0.4], time_from_start: 0.8}
""")
    file.write_text(f"""
/**:
  ros__parameters: {{joint_names: [shoulder, elbow], control_period: 0.002}}
plant:
  ros__parameters: {{pacing: lockstep, duration: 1.0, initial_position: [0.3, -0.2],
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
    effort_limit: [300.0, .inf], switching: implicit_observer, input_delay: 2,
    inertia_scale: 0.95, gravity_scale: 1.05}}
reference:
  ros__parameters: {{joint_names: [elbow, shoulder], trajectory_file: {waypoints}}}
bringup:
  ros__parameters:
    events: ['0.2 controller ka [13.0, 13.0]', '0.25 plant sample_loss 0.4',
             '0.3 plant friction_asymmetry [0.0, 0.1]']
""")
    result = record(
        tmp_path / 'bag', '--params-file', str(file), '--law', 'compensation', '--ros-args', '-r',
        '__ns:=/robot1', '-p', 'law:=chattering', '-p', 'experiment:=mine', '-p',
        'controller:b:=0.8')
    expected = simulate(parameter_file.load(
        file, {'plant': {'experiment': 'mine'}, 'controller': {'b': 0.8}}))
    assert_equal(result.run, expected.run)
    assert result.metrics() == {**expected.metrics(), 'bag': 'bag'}
    assert result.experiment == 'mine'
    assert result.joint_names == ('shoulder', 'elbow')
    assert np.abs(result.run.tau[:, 0]).max() == 300.0
    assert 300 < len(result.run.t) < 450
    assert counts(tmp_path / 'bag')['/robot1/joint_states'] >= len(result.run.t)
    rest = result.run.t >= 0.8
    assert rest.sum() > 40 and (result.run.q_d[rest] == [0.4, 0.0]).all()


def test_a_robot_of_a_urdf_and_the_bag_says_all(tmp_path: Path) -> None:
    """The bag is read when the files are gone."""
    robot, file, bag = tmp_path / 'robot.urdf', tmp_path / 'params.yaml', tmp_path / 'bag'
    robot.write_text(panda(), encoding='utf-8')
    text = (CONFIG / 'panda.yaml').read_text(encoding='utf-8')
    where = next(x for x in text.split() if x.startswith('package://'))
    file.write_text(text.replace(where, str(robot)))
    expected = simulate(parameter_file.load(file, {'plant': {'duration': 0.2}}))
    record(bag, '--params-file', str(file), '--duration', '0.2')
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
