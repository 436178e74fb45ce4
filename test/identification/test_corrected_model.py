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

"""Corrected models of faulty robots, on motions that were not recorded."""

from __future__ import annotations

from functools import cache

from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.identification.findings import ALL_JOINTS, Reason
from ctc_chattering.identification.identified_robot import (
    corrected_description,
    correction_findings,
)
from ctc_chattering.identification.identify import Identification, identify_recordings
from ctc_chattering.identification.sentences import verdict_text
from ctc_chattering.identification.verdict import verdicts
from ctc_chattering.numerics.linear_algebra import Array
from faults_of_arms import case, recorded
from faulty_robots import Faulty, sampled
import numpy as np
import pytest
from rigid_bodies import dynamics
from robots import arm, motion


def errors(robot: Faulty, texts: list[str], seed: int) -> list[Array]:
    """Return the RMS error of each URDF's inverse dynamics along another motion [N·m]."""
    one = arm(robot.name)
    states = sampled(motion(one, 10.0, seed + 700), 0.02)
    mass, bias, true = np.empty((robot.n, robot.n)), np.empty(robot.n), []
    for q, dq, ddq in states:
        dynamics(robot.physics.bodies, q, dq, mass, bias)
        true.append(mass @ ddq + bias + robot.physics.rotor * ddq)
    models = [UrdfModel(text, one.joints) for text in texts]
    return [np.sqrt(np.square(np.array([model.inverse_dynamics(
        *(x.tolist() for x in state)) for state in states]) - true).mean(axis=0))
        for model in models]


@cache
def identified(name: str, fault: str, seed: int, duration: float = 15.0
               ) -> tuple[Faulty, str, Identification]:
    """Return a faulty robot, its URDF, and what is identified."""
    one = case(name, fault, seed, duration)
    recording = recorded(one, seed, duration)[1].checked()
    urdf, joints = arm(name).urdf, one.robot.joints
    return one.robot, urdf, identify_recordings([recording], UrdfModel(urdf, joints))


@pytest.mark.parametrize('fault', [
    'forearm', pytest.param('tilt', marks=pytest.mark.slow), 'plain'])
def test_the_corrected_model_of_two_links_is_right(fault: str) -> None:
    """The right model stays; 1 kg more, or a turned base, is in the corrected one."""
    robot, urdf, found = identified('two_link_urdf', fault, 1, 10.0)
    text = corrected_description(found, urdf)
    if fault == 'plain':
        assert text == ''
    else:
        before, after = errors(robot, [urdf, text], 1)
        assert (after < 0.05 * before).all()


@pytest.mark.slow
@pytest.mark.parametrize('name', ['ur5', 'panda'])
@pytest.mark.parametrize('fault', ['rotor', 'tilt', 'centres', 'forearm', 'payload'])
@pytest.mark.parametrize('seed', range(2))
def test_corrected_models_of_faulty_robots_are_closer(name: str, fault: str, seed: int) -> None:
    """Closer on every joint whose model was wrong, never worse than by a trifle."""
    robot, urdf, found = identified(name, fault, seed)
    text = corrected_description(found, urdf)
    assert text, list(map(verdict_text, verdicts(found)))
    before, after = errors(robot, [urdf, text], seed)
    assert (after < 0.2 * before + 1e-3 * before.max()).all()


def test_the_changes_of_the_corrected_urdf_are_noted() -> None:
    """A turned base needs care, since it is mounted otherwise than the URDF says."""
    for fault, reasons in (('forearm', [Reason.CORRECTED]),
                           ('tilt', [Reason.CORRECTED, Reason.MOUNT])):
        _, _, found = identified('two_link_urdf', fault, 1, 10.0)
        notes = [x for x in correction_findings(found, 'x.urdf') if x.joint == ALL_JOINTS]
        assert [x.reason for x in notes] == reasons
        assert all(x.values['file'] == 'x.urdf' for x in notes)
    assert found.bodies is not None
    assert notes[-1].values['degrees'] == pytest.approx(np.degrees(found.bodies.turn))
    assert corrected_description(found, '') == ''
