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

"""The independent plant: its bodies, its energy, and friction that holds a joint exactly."""

from __future__ import annotations

import dataclasses
from math import cos, exp, sin

from faults_of_arms import case, FAULTS, recorded
from faulty_robots import plain, Plant, sampled
from identified_robots import arm, motion
import numpy as np
from other_faults import OTHER_FAULTS
import pinocchio as pin
import pytest
from rigid_bodies import bodies_of, dynamics
import urdfs

PENDULUM = urdfs.urdf([
    urdfs.link('base'), urdfs.link('bob', 2.0, (0, 0, -0.5), (0.1, 0.1, 0.1)),
    urdfs.joint('swing', 'revolute', 'base', 'bob', '0 -1 0')])


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


def energy(plant: Plant) -> float:
    """Return kinetic and potential energy of a two-link arm of `urdfs` [J]."""
    one = urdfs
    (q1, q2), (v1, v2) = plant.state.x, plant.state.v
    mass, bias = np.empty((2, 2)), np.empty(2)
    dynamics(plant.robot.physics.bodies, plant.state.x, plant.state.v, mass, bias)
    weight = -9.81 * ((one.M1 * one.R1 + one.M2 * one.L1) * cos(q1)
                      + one.M2 * one.R2 * cos(q1 + q2))
    return 0.5 * float(np.array((v1, v2)) @ mass @ (v1, v2)) + weight


def test_energy_is_kept_without_friction() -> None:
    robot = plain('two_link_urdf', 0).with_physics(coulomb=0.0, viscous=0.0)
    plant = Plant(robot, (1.0, 0.5))
    before = energy(plant)
    for _ in range(2000):
        plant.step((0.0, 0.0))
    # Of 30 J that go to and fro; the step is of second order.
    assert abs(plant.state.v).max() > 0.5
    assert energy(plant) == pytest.approx(before, abs=1e-4)


def test_a_joint_with_viscous_friction_agrees_with_its_closed_form() -> None:
    robot = plain('two_link_urdf', 0)
    robot = dataclasses.replace(robot.with_physics(coulomb=0.0, viscous=0.7, rotor=0.2), name='')
    bodies = bodies_of(PENDULUM, ('swing',), gravity=0.0)
    one = {key: x[:1] for key, x in robot.physics._asdict().items() if key not in (
        'bodies', 'helper')}
    robot = dataclasses.replace(robot, nominal=bodies, encoder=0.0, physics=robot.physics._replace(
        **one, bodies=bodies, helper=bodies))
    plant = Plant(robot, (0.3,))
    for _ in range(1000):
        plant.step((1.4,))
    inertia = 0.1 + 2.0 * 0.25 + 0.2
    decay = exp(-0.7 / inertia)
    assert plant.state.v[0] == pytest.approx(2.0 * (1.0 - decay), abs=1e-7)
    assert plant.state.x[0] == pytest.approx(
        0.3 + 2.0 * (1.0 - inertia / 0.7 * (1.0 - decay)), abs=1e-7)


def test_friction_holds_a_joint_exactly_and_lets_it_go_at_its_limit() -> None:
    robot = plain('two_link_urdf', 0).with_physics(coulomb=(3.0, 1.0))
    angle = 0.4
    held = 9.81 * sin(angle) * np.array((
        urdfs.M1 * urdfs.R1 + urdfs.M2 * urdfs.L1 + urdfs.M2 * urdfs.R2, urdfs.M2 * urdfs.R2))
    for more, moves in ((0.999, False), (-0.999, False), (1.001, True)):
        plant = Plant(robot, (angle, 0.0))
        for _ in range(100):
            plant.step(held + more * np.array((3.0, 1.0)))
        assert (plant.state.v[0] != 0.0) == moves
        assert (plant.state.x[0] != angle) == moves


def test_a_joint_stops_after_the_way_that_its_friction_allows() -> None:
    robot = plain('two_link_urdf', 0).with_physics(coulomb=(2.0, 50.0), viscous=0.0)
    robot = robot.with_bodies(gravity=np.zeros(3))
    plant = Plant(robot, (0.0, 0.0))
    plant.state.v[0] = 1.5
    mass, bias = np.empty((2, 2)), np.empty(2)
    dynamics(robot.physics.bodies, plant.state.x, plant.state.v, mass, bias)
    while plant.state.v[0]:
        plant.step((0.0, 0.0))
    assert plant.state.x[0] == pytest.approx(0.5 * mass[0, 0] * 1.5 ** 2 / 2.0, rel=1e-3)
    assert plant.state.x[1] == 0.0


def test_waypoints_are_met_with_velocity_and_acceleration() -> None:
    route = motion(arm('ur5'), 4.0, 1)
    found = sampled(route, 1e-3)
    assert found[::50] == pytest.approx(np.array(route.points), abs=1e-9)
    slope = np.gradient(found, 1e-3, axis=0)
    assert slope[1:-1, 0] == pytest.approx(found[1:-1, 1], abs=1e-3)
    assert slope[1:-1, 1] == pytest.approx(found[1:-1, 2], abs=0.1)


def test_quadratic_friction_and_an_end_stop_agree_with_their_closed_forms() -> None:
    robot = plain('two_link_urdf', 0).with_bodies(gravity=np.zeros(3))
    robot = robot.with_physics(coulomb=(0.0, 50.0), viscous=0.0, quadratic=(0.8, 0.0))
    plant = Plant(robot, (0.0, 0.0))
    plant.state.v[0] = 1.5
    mass, bias = np.empty((2, 2)), np.empty(2)
    dynamics(robot.physics.bodies, plant.state.x, plant.state.v, mass, bias)
    for _ in range(1000):
        plant.step((0.0, 0.0))
    assert plant.state.v[0] == pytest.approx(1.5 / (1.0 + 0.8 * 1.5 / mass[0, 0]), rel=1e-3)
    robot = robot.with_physics(coulomb=(0.1, 50.0), viscous=5.0, stop=(0.01, np.inf))
    plant = Plant(robot, (0, 0))
    for _ in range(3000):
        plant.step((10.0, 0.0))
    assert plant.state.x[0] == pytest.approx(0.01 + 10.0 / 2000.0, abs=1e-4)


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
