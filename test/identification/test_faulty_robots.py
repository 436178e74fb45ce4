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

"""The judge of identifications, and the independent plant that it judges them on."""

from __future__ import annotations

import dataclasses
from functools import cache
from math import sin

from ctc_chattering.identification.findings import Estimate, Severity
from ctc_chattering.identification.recording import Recording
from faults_of_arms import case, FAULTS, OTHER_FAULTS, recorded
from faulty_robots import Case, plain, plant_of, Played
from identification_judge import judged, Number, Outcome, outcome
import numpy as np
import pinocchio as pin
import pytest
from rigid_bodies import bodies_of, dynamics
import urdfs


@pytest.mark.parametrize(('urdf', 'joints'), [
    (urdfs.panda(), urdfs.PANDA), (urdfs.ur5(), urdfs.UR5),
    (urdfs.two_links('prismatic'), urdfs.TWO_LINKS)], ids=['panda', 'ur5', 'prismatic'])
def test_dynamics_are_those_of_pinocchio(urdf: str, joints: tuple[str, ...]) -> None:
    n = len(joints)
    whole = pin.buildModelFromXML(urdf)
    others = [k for k in range(1, whole.njoints) if whole.names[k] not in joints]
    model = pin.buildReducedModel(whole, others, pin.neutral(whole))
    q, dq = np.random.default_rng(1).normal(size=(2, n))
    mass, bias = np.empty((n, n)), np.empty(n)
    dynamics(bodies_of(urdf, joints), q, dq, mass, bias)
    data = model.createData()
    upper = np.triu(pin.crba(model, data, q))
    assert mass == pytest.approx(upper + np.triu(upper, 1).T, abs=1e-12)
    assert bias == pytest.approx(pin.nonLinearEffects(model, data, q, dq), abs=1e-12)


def test_friction_holds_a_joint_exactly_and_lets_it_go_at_its_limit() -> None:
    robot = plain('two_link_urdf', 0).with_physics(coulomb=(3.0, 1.0))
    angle = 0.4
    held = 9.81 * sin(angle) * np.array((
        urdfs.M1 * urdfs.R1 + urdfs.M2 * urdfs.L1 + urdfs.M2 * urdfs.R2, urdfs.M2 * urdfs.R2))
    for more, moves in ((0.999, False), (-0.999, False), (1.001, True)):
        plant = plant_of(robot, (angle, 0.0))
        for _ in range(100):
            plant.step(held + more * np.array((3.0, 1.0)))
        assert (plant.state.v[0] != 0.0) == moves
        assert (plant.state.x[0] != angle) == moves


@pytest.mark.slow
@pytest.mark.parametrize('fault', [x for x in FAULTS if x not in OTHER_FAULTS])
def test_every_fault_shows_in_the_recording(fault: str) -> None:
    one = case('two_link_urdf', fault, 3, 2.0)
    seen, recording = recorded(one, 3, 2.0)
    assert np.isfinite(seen.q).all()
    assert np.abs(seen.position - seen.wanted).max() < 0.5
    robot = plain('two_link_urdf', 3)
    healthy, same = recorded(dataclasses.replace(one, robot=robot, alter=None), 3, 2.0)
    assert same.command is not None
    command = same.command if recording.command is None else recording.command
    differs = (len(seen.q) != len(healthy.q) or (recording.t != same.t).any()
               or recording.command is None or np.abs(command - same.command).max() > 1e-3
               or (one.effort == 'motor' and not np.array_equal(
                   np.array(recording.effort), np.array(same.effort))))
    assert differs == (fault != 'plain')


_SECONDS = 10.0


@cache
def made() -> tuple[Case, Played, Recording, Outcome]:
    one = case('two_link_urdf', 'plain', 2, _SECONDS)
    seen, recording = recorded(one, 2, _SECONDS)
    return one, seen, recording, outcome(one, recording, 2)


def with_coulomb(made: Outcome, value: float, half: float) -> Outcome:
    assert made.results is not None
    found = made.results.found
    friction = [dataclasses.replace(x, coulomb=Estimate(value, half, 'N*m'))
                for x in found.friction]
    return made._replace(results=dataclasses.replace(
        made.results, found=dataclasses.replace(found, friction=friction)))


def test_a_plain_robot_is_identified_without_a_wrong_number() -> None:
    one, seen, _, right = made()
    row = judged(one, seen, right, _SECONDS)
    assert row['wrong'] == []
    assert row['refused'] == 0
    assert all(x == Severity.NOTE for x in right.severity)
    assert np.mean(row['held']) > 0.7


def test_a_wrong_number_is_counted_unless_something_warns_of_its_joint() -> None:
    one, seen, _, right = made()
    true = one.robot.physics.coulomb
    bad = with_coulomb(right, 1.05 * true[0], 0.001)
    row = judged(one, seen, bad, _SECONDS)
    assert any(x.startswith('coulomb[0]') for x in row['wrong'])
    wide = with_coulomb(right, 1.05 * true[0], 0.1 * true[0])
    assert not any(x.startswith('coulomb[0]') for x in judged(
        one, seen, wide, _SECONDS)['wrong'])
    warned = bad._replace(severity=(Severity.CARE, Severity.CARE))
    row = judged(one, seen, warned, _SECONDS)
    assert row['wrong'] == []
    assert any(x.startswith('coulomb[0]') for x in row['warned'])


@pytest.mark.parametrize(('low', 'high', 'holds', 'wrong'), [
    (0.99, 1.02, True, False), (1.005, 1.01, False, False), (1.04, 1.06, False, True),
    (1.04, 1.30, False, False), (0.90, 0.94, False, True)])
def test_a_wrong_number_is_off_by_two_half_intervals_and_two_per_cent(
        low: float, high: float, holds: bool, wrong: bool) -> None:
    number = Number('coulomb', 0, low, high, (1.0, 1.0), 1.0)
    assert (number.holds, number.wrong) == (holds, wrong)


def test_a_drift_is_right_anywhere_on_its_way() -> None:
    number = Number('coulomb', 0, 1.09, 1.11, (1.0, 1.2), 1.2)
    assert number.holds
    assert not number.wrong
    assert number._replace(low=1.29, high=1.31).wrong
