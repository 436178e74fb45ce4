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

import dataclasses
from functools import cache

from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.identification.attribution import Cause, CauseKind, Explanation
from ctc_chattering.identification.findings import ALL_JOINTS, Finding, Kind, Severity
from ctc_chattering.identification.identified_robot import corrected_description, with_correction
from ctc_chattering.identification.identify import Identification, identify
from ctc_chattering.identification.model_errors import candidates
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
    model = UrdfModel(urdf, joints)
    return one.robot, urdf, identify([recording], model, candidates(model, urdf, {}))


@pytest.mark.parametrize('fault', [
    'forearm', pytest.param('tilt', marks=pytest.mark.slow), 'plain'])
def test_two_links(fault: str) -> None:
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
def test_faulty_robots(name: str, fault: str, seed: int) -> None:
    """Closer on every joint whose model was wrong, never worse than by a trifle."""
    robot, urdf, found = identified(name, fault, seed)
    text = corrected_description(found, urdf)
    assert text, [x for x in found.findings if x.severity == Severity.REFUSED]
    before, after = errors(robot, [urdf, text], seed)
    assert (after < 0.1 * before + 1e-3 * before.max()).all()


def test_what_is_refused_is_no_correction() -> None:
    _, urdf, found = identified('two_link_urdf', 'forearm', 1, 10.0)
    said = with_correction(found, found, 'x.urdf')
    assert said is not None and 'x.urdf' in said.findings[-1].reason
    assert 'turns the base' not in said.findings[-1].reason
    _, _, leaning = identified('two_link_urdf', 'tilt', 1, 10.0)
    said = with_correction(leaning, leaning, 'x.urdf')
    assert said is not None and 'and turns the base by' in said.findings[-1].reason
    refused = dataclasses.replace(found, findings=(Finding(Kind.NO_NUMBER, ALL_JOINTS, 'so'),))
    assert with_correction(found, refused, 'x.urdf') is None
    assert corrected_description(refused, urdf) == ''
    assert corrected_description(found, '') == ''


def test_what_is_worse_on_other_data_or_may_be_a_torque_scale_is_not_written() -> None:
    _, urdf, found = identified('two_link_urdf', 'forearm', 1, 10.0)
    assert (found.held_out < 0.1).all() and corrected_description(found, urdf)
    for ratios in ([0.1, 1.1], [np.inf, 0.1], []):
        other = dataclasses.replace(found, held_out=np.array(ratios))
        assert corrected_description(other, urdf) == ''
    scale = Cause(CauseKind.SCALE, 1, 'scale', np.full(1, 0.1), np.zeros((2, 3, 1)))
    for size, written in ((0.0, True), (-0.05, False)):
        alike = Explanation((scale,), (np.array([size]),), 0.0, np.zeros(2))
        other = dataclasses.replace(found, selected=dataclasses.replace(
            found.selected, alike=(alike,)))
        assert bool(corrected_description(other, urdf)) == written
