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

"""Margins of rotors and masses, against the controller itself on arms with other inertias."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.arm_knowledge import (
    ArmFacts,
    ASSUMED_ROTOR,
    LEAST_ROTOR,
    MOST_ROTOR,
)
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.new_robot import new_robot, NewRobot
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.control.controller import Controller
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.margins.linear_law import Frozen
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.runs.arm_margins import arm_margins, with_stable_gains
from ctc_chattering.runs.recommended import desired_points
from ctc_chattering.runs.stability import loops_of
from ctc_commands import ctc
import numpy as np
import pytest
from scipy.linalg import expm  # type: ignore[import-untyped]
from urdfs import two_links

H = 1e-3
#: Samples within which an error that begins with 1e-9 rad grows or fades.
COUNT = 900


def arm(folder: Path, **told: Any) -> NewRobot:
    """Return an arm whose assumed rotors, 8 and 4 kg·m², exceed its bodies."""
    text = two_links().replace('effort="0" velocity="1.5"', 'effort="2000" velocity="1.5"'
                               ).replace('effort="40"', 'effort="4000"')
    (folder / 'arm.urdf').write_text(text)
    return new_robot(str(folder / 'arm.urdf'), facts=ArmFacts(**told))


def setup_of(robot: NewRobot, **controller: Any) -> Setup:
    return parameter_file.load(None, {**robot.values, 'controller': {
        **robot.values['controller'], 'ka': [1e6] * 2, 'friction_level': [0.0] * 2,
        'actuator_lag': [0.0] * 2, 'compiled': False, **controller}})


def growth(setup: Setup, assumed: Array, actual: Array) -> float:
    """Return how much an error grows in a motion of 1 rad/s, with a constant M̂ and M."""
    controller = Controller(setup.controller, Frozen(assumed))
    n = len(assumed)
    flow = np.zeros((3 * n, 3 * n))
    flow[:n, n:2 * n], flow[n:2 * n, 2 * n:] = np.eye(n), np.linalg.inv(actual)
    step = expm(H * flow)
    x, errors = np.concatenate([[1e-9] * n, [1.0] * n]), []
    for k in range(COUNT):
        point = ([H * k] * n, [1.0] * n, [0.0] * n)
        tau = controller.step(x[:n].tolist(), x[n:].tolist(), *point).tau
        x = (step @ np.concatenate([x, tau]))[:2 * n]
        errors.append(np.abs(x[:n] - H * (k + 1)).max())
    # What has faded is rounding, of some 1e-15 rad, which neither grows nor fades.
    return float(np.max(errors[-100:]) / max(np.max(errors[500:600]), 1e-13))


def inertias(setup: Setup) -> tuple[list[Array], Array]:
    """Return M of the bodies at instants of the motion, and that of the rotors."""
    model = model_of(setup.controller, setup.descriptions['controller'])
    rotors = np.diag(setup.controller.rotor_inertia)
    return [np.array(model.mass_matrix(q)) - rotors
            for q, _, _ in desired_points(setup, setup.plant.duration, 5)], rotors


@pytest.mark.parametrize('slope', [True, False])
def test_the_ends_are_those_of_the_eigenvalues(slope: bool, tmp_path: Path) -> None:
    setup = setup_of(arm(tmp_path), estimator_slope=slope)
    margins, span = arm_margins(setup), loops_of(setup).ratios()
    assert margins is not None
    assert margins.rotors is not None
    assert margins.masses is not None
    assert span is not None
    bodies, rotors = inertias(setup)
    for actual, most in (
            ([B + margins.rotors.low * rotors for B in bodies], True),
            ([B + margins.rotors.high * rotors for B in bodies], False),
            ([margins.masses.high * B + rotors for B in bodies], False)):
        ratios = [np.linalg.eigvals((B + rotors) @ np.linalg.inv(M)).real
                  for B, M in zip(bodies, actual)]
        assert (np.max(ratios) if most else np.min(ratios)) == pytest.approx(
            span.high if most else span.low, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize('slope', [True, False])
def test_errors_grow_beyond_the_margins_and_fade_within(slope: bool, tmp_path: Path) -> None:
    setup = setup_of(arm(tmp_path), estimator_slope=slope)
    margins = arm_margins(setup)
    assert margins is not None
    assert margins.rotors is not None
    assert margins.masses is not None
    bodies, rotors = inertias(setup)
    assert 0.1 < margins.rotors.low < 0.6
    assert 1.8 < margins.rotors.high < 9.0
    for end, within in ((margins.rotors.low, 1.15), (margins.rotors.high, 0.85)):
        for factor, grows in ((within * end, False), (end / within, True)):
            found = max(growth(setup, B + rotors, B + factor * rotors) for B in bodies)
            assert (found > 1.0) == grows, (end, factor, found)
    for factor, grows in ((0.85 * margins.masses.high, False), (1.15 * margins.masses.high, True)):
        found = max(growth(setup, B + rotors, factor * B + rotors) for B in bodies)
        assert (found > 1.0) == grows, (factor, found)


def test_a_model_without_rotors_says_how_many_it_may_lack(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    values = {**robot.values, '/**': {**robot.values['/**'], 'rotor_inertia': 0.0}}
    margins = arm_margins(parameter_file.load(None, values))
    assert margins is not None
    assert margins.rotors is None
    assert margins.lacking is not None
    assert 1e-5 < margins.lacking < 1e-3
    assert arm_margins(parameter_file.load(find_config('friction'))) is None


def test_the_assumed_range_is_within_the_margins(tmp_path: Path) -> None:
    """Of the sampled loop; with a slow drive the pole is lowered until it is."""
    robot = arm(tmp_path)
    margins = arm_margins(parameter_file.load(None, with_stable_gains(robot).values))
    assert margins is not None
    assert margins.rotors is not None
    assert margins.rotors.low < LEAST_ROTOR / ASSUMED_ROTOR
    assert margins.rotors.high > MOST_ROTOR / ASSUMED_ROTOR


def test_the_pole_is_lowered_until_the_assumed_range_is_within_the_margins(
        tmp_path: Path) -> None:
    """From a pole that is too fast for the period; kp, kv and bandwidth go together."""
    robot = arm(tmp_path)
    robot.values['controller'].update(
        kp=[160000.0] * 2, kv=[800.0] * 2, estimator_bandwidth=1600.0)
    before = arm_margins(parameter_file.load(None, robot.values))
    gains = with_stable_gains(robot).values['controller']
    assert before is None or before.rotors is None or (
        before.rotors.low > LEAST_ROTOR / ASSUMED_ROTOR)
    assert gains['kv'][0] < 800.0
    assert gains['kp'][0] == pytest.approx(0.25 * gains['kv'][0] ** 2)
    assert gains['estimator_bandwidth'] == pytest.approx(2.0 * gains['kv'][0])


def test_known_rotors_change_no_gain(tmp_path: Path) -> None:
    robot = arm(tmp_path, rotor_inertia=[0.1, 0.1])
    assert with_stable_gains(robot) is robot


def test_the_command_prints_the_margins(tmp_path: Path) -> None:
    arm(tmp_path)
    assert ctc('new-robot', '--urdf', 'arm.urdf', '--resonance', '15', cwd=tmp_path
               ).returncode == 0
    done = ctc('stability', 'robot.yaml', cwd=tmp_path)
    assert 'rotors / rotors of the model ' in done.stdout
    assert 'masses / masses of the model ' in done.stdout
    assert 'resonance' not in done.stdout
    file = tmp_path / 'robot.yaml'
    file.write_text(file.read_text().replace('resonance: 15.0', 'resonance: 5.0'))
    done = ctc('stability', 'robot.yaml', cwd=tmp_path)
    assert 'warning: the pole is 0.6 times the resonance of 5 Hz; ' in done.stdout
