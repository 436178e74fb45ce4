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

"""Motions that an arm can hold."""

from __future__ import annotations

from math import sin
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.new_robot import KA, new_robot
from ctc_chattering.configuration.package_share import find_file
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.learning.motion import motion_of
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.trajectory.reference import make_motion
import numpy as np
import pytest
from urdfs import FIRST_LIMITS, grip, L1, M1, M2, R1, R2, robot, two_links, write_urdf

ROBOTS = 'package://example-robot-data/robots'
URDF = f'{ROBOTS}/asr_twodof_description/urdf/TwoDofs.urdf'


def weight_of_two_links(q1: float, q2: float) -> float:
    """Return the torque that holds the first joint of `two_links` [N·m]."""
    return 9.81 * ((M1 * R1 + M2 * L1) * sin(q1) + M2 * R2 * sin(q1 + q2))


def coarse(values: dict[str, Any], duration: float) -> dict[str, Any]:
    """Return the parameters of a run at 500 Hz."""
    return {**values, '/**': {**values['/**'], 'control_period': 2e-3},
            'plant': {**values['plant'], 'duration': duration, 'integration_step': 2e-3}}


def test_the_motion_is_within_half_the_limits_and_the_torques() -> None:
    """Compare with the limits as the URDF has them, at the samples of a simulated run."""
    values = new_robot(URDF).values
    setup = parameter_file.load(None, coarse(values, 4.0))
    result = simulate(setup)
    joints = [Tree(find_file(URDF).read_text()).joints[x] for x in result.joint_names]
    assert len(joints) == 2
    moving = result.t >= 2.0  # After the smooth start.
    for i, joint in enumerate(joints):
        low, high = joint.position
        quarter = 0.25 * (high - low)
        if np.isfinite(quarter):
            assert np.abs(result.q_d[:, i] - 0.5 * (low + high)).max() <= 1.001 * quarter + 0.01
        assert np.abs(result.dq_d[moving, i]).max() <= 0.51 * joint.velocity
        assert np.abs(result.tau[moving, i]).max() <= joint.effort
        assert setup.controller.ka[i] >= (KA * joint.effort if np.isfinite(joint.effort) else 0.0)
    error = np.sqrt(np.square(result.e[result.t >= 3.0]).mean(axis=0))
    assert (error < 0.01 * np.ptp(result.q_d, axis=0)).all()


def test_an_arm_of_another_kind_with_as_many_joints_runs_before_it() -> None:
    """Both are compiled where the tests run: one loop must not take the numbers of the other."""
    simulate(parameter_file.load_parameters('friction', {
        'plant': {'duration': 0.1}, 'controller': {'law': 'observer_feedback'}}))
    values = new_robot(URDF).values
    short = {**values, 'plant': {**values['plant'], 'duration': 0.1}}
    assert len(simulate(parameter_file.load(None, short)).t) > 50


def test_another_centre_where_a_joint_cannot_hold_the_middle(tmp_path: Path) -> None:
    """From 0.4 to 2.8 rad the first joint must lift the arm: 23 N*m at the middle."""
    limits = 'lower="0.4" upper="2.8" effort="21" velocity="0"'
    location = write_urdf(tmp_path / 'weak.urdf', two_links().replace(FIRST_LIMITS, limits))
    found = new_robot(location)
    assert found.motion.about_middle is not None
    assert found.motion.about_middle.joint.name == 'a'
    assert weight_of_two_links(1.6, 0.0) > 21.0
    assert weight_of_two_links(*found.motion.center) < 0.6 * 21.0
    assert found.motion.center[0] - found.motion.amplitude[0] > 0.4
    assert found.motion.center[0] + found.motion.amplitude[0] < 2.8
    result = simulate(parameter_file.load(None, coarse(found.values, 3.0)))
    assert np.abs(result.tau[:, 0]).max() < 21.0
    assert np.abs(result.e[result.t >= 2.5]).max() < 0.02
    again = new_robot(location)
    assert again.values == found.values
    strong = new_robot(write_urdf(tmp_path / 'strong.urdf', two_links().replace(
        FIRST_LIMITS, limits.replace('21', '80'))))
    assert strong.motion.center == [1.6, 0.0]
    assert strong.motion.about_middle is None
    assert strong.motion.size == 1.0


def test_a_smaller_and_slower_motion_where_no_posture_is_enough(tmp_path: Path) -> None:
    """Nothing weighs anything along a horizontal rail: what counts is the acceleration."""
    rail = grip().replace('type="revolute"', 'type="prismatic"').replace(
        '<limit effort="0" velocity="0"/>', '<limit effort="6" velocity="0"/>', 1)
    found = new_robot(write_urdf(tmp_path / 'rail.urdf', rail))
    assert found.joints == ('turn',)
    assert found.motion.size < 1.0
    moved = 2.7 * found.motion.amplitude[0] * (2.0 * np.pi * found.motion.frequency[0]) ** 2
    assert moved + found.friction.coulomb[0] < 0.95 * 6.0


@pytest.mark.parametrize('slow', [0.85, 0.6, 0.35, 0.2])
def test_the_motion_has_a_common_period_that_can_be_learned(slow: float, tmp_path: Path) -> None:
    """Velocity limits of [rad/s] would give one joint a frequency such as 0.133 Hz."""
    text = two_links().replace(
        FIRST_LIMITS, f'lower="-3" upper="3" effort="80" velocity="{slow}"')
    found = new_robot(write_urdf(tmp_path / 'slow.urdf', text))
    motion = found.motion
    speeds = 2.0 * np.pi * np.array(motion.frequency) * motion.amplitude
    assert 0.25 * slow < speeds[0] <= 0.51 * slow
    assert motion.frequency[0] != motion.frequency[1]
    setup = parameter_file.load(None, found.values)
    state = dict.fromkeys(found.joints, (0.0, 0.0))
    repeated = motion_of(setup.reference, None, make_motion(setup.reference, None, state))
    assert repeated.duration <= 40 * NANOSECONDS


def test_a_given_centre_is_taken_or_refused(tmp_path: Path) -> None:
    location = write_urdf(tmp_path / 'arm.urdf', two_links())
    found = new_robot(location, center=[-1.0, 0.5])
    assert found.values['reference']['center'] == [-1.0, 0.5]
    assert found.values['plant']['initial_position'] == [-1.0, 0.5]
    for center, words in (([-2.0, 0.0], 'above -2 and below 3 rad, the limits of a'),
                          ([float('nan'), 0.0], 'above -2 and below 3'), ([0.0], '2 positions')):
        with pytest.raises(ParameterError, match=words):
            new_robot(location, center=center)
    weak = write_urdf(tmp_path / 'weak.urdf', two_links().replace('effort="40"', 'effort="20"'))
    assert new_robot(weak, center=[0.0, 0.0]).motion.size == 1.0
    with pytest.raises(CtcError, match=r'a: the lightest motion about --center needs .* of 20 N'):
        new_robot(weak, center=[1.57, 0.0])


@pytest.mark.parametrize(('limits', 'center'), [
    ('lower="2" upper="inf" effort="80" velocity="1"', 3.0),
    ('lower="-inf" upper="-1" effort="80" velocity="1"', -2.0),
    ('lower="-inf" upper="inf" effort="inf" velocity="inf"', 0.0),
    ('upper="1" effort="80" velocity="1"', 0.5), ('effort="80" velocity="1"', 0.0),
    ('lower="0.1" upper="0.100001" effort="80" velocity="1"', 0.1),
    ('lower="-1e9" upper="1e9" effort="1e300" velocity="1e-9"', 0.0)])
def test_odd_limits_are_kept(limits: str, center: float, tmp_path: Path) -> None:
    """One bound, none, hardly any room: a file, and no division by zero."""
    found = new_robot(write_urdf(tmp_path / 'odd.urdf', two_links().replace(FIRST_LIMITS, limits)))
    assert found.motion.center[0] == pytest.approx(center, abs=2e-6)


def test_a_real_arm_that_cannot_hold_the_middle_of_its_limits() -> None:
    location = f'{ROBOTS}/talos_data/robots/talos_left_arm.urdf'
    found = new_robot(location)
    load = found.motion.about_middle
    assert load is not None
    assert (load.joint.name, load.limit) == ('arm_left_2_joint', 22.32)
    assert load.torque > 22.32
    assert found.motion.load.share <= 0.9
    limits = [Tree(robot('talos_left_arm')).joints[name].position for name in found.joints]
    for (low, high), center, amplitude in zip(limits, found.motion.center, found.motion.amplitude):
        assert low < center - amplitude < center + amplitude < high
