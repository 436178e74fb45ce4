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

"""The oracle itself: MuJoCo's robot against closed forms, scipy and the package's plant."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import cos, pi, sin
from typing import Any

from ctc_chattering.analysis.metrics import metrics
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Rows, Vector
from ctc_chattering.simulation.closed_loop import simulate
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
from mujoco_plant import MujocoPlant, WHEELS
import numpy as np
from oracles import Array
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]
from scipy.special import ellipk  # type: ignore[import-untyped]

#: Two-link arm that hangs at q = 0: mass, length, centre of mass and inertia of each link.
M1, L1, C1, I1 = 6.0, 1.0, 0.4, 0.7
M2, L2, C2, I2 = 2.5, 0.8, 0.35, 0.2


def _link(name: str, mass: float, centre: float, inertia: float) -> str:
    mesh = '<origin xyz="0 0 0"/><geometry><mesh filename="package://none/such.stl"/></geometry>'
    return f"""
  <link name="{name}">
    <inertial>
      <origin xyz="0 0 -{centre}"/><mass value="{mass}"/>
      <inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual>{mesh}</visual><collision>{mesh}</collision>
  </link>"""


ARM_URDF = f"""<?xml version="1.0" encoding="utf-8"?>
<robot name="arm">
  <link name="base"/>{_link('upper', M1, C1, I1)}{_link('lower', M2, C2, I2)}
  <link name="tool"/>
  <joint name="joint1" type="continuous">
    <parent link="base"/><child link="upper"/><origin xyz="0 0 2"/><axis xyz="0 1 0"/>
    <dynamics damping="7" friction="8"/>
  </joint>
  <joint name="joint2" type="revolute">
    <parent link="upper"/><child link="lower"/><origin xyz="0 0 -{L1}"/><axis xyz="0 1 0"/>
    <limit lower="-9" upper="9" effort="1" velocity="1"/>
  </joint>
  <joint name="flange" type="fixed"><parent link="lower"/><child link="tool"/></joint>
</robot>"""

INERTIA = np.array([2.0, 0.5])

PENDULUM = """
<mujoco><worldbody><body><joint name="hinge" axis="0 1 0"/>
  <inertial pos="0 0 -0.5" mass="3" diaginertia="0.25 0.25 0.25"/></body></worldbody></mujoco>"""
FREE: dict[str, Any] = {'coulomb_friction': [0.0, 0.0]}


class Arm(Model):
    """The same arm, derived by hand."""

    n = 2

    def mass_matrix(self, q: Vector) -> Rows:
        """Return M(q)."""
        m22 = I2 + M2 * C2 ** 2
        m12 = m22 + M2 * L1 * C2 * cos(q[1])
        m11 = I1 + M1 * C1 ** 2 + M2 * L1 ** 2 + 2.0 * m12 - m22
        return ((m11, m12), (m12, m22))

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:
        """Return C(q, dq)."""
        k = M2 * L1 * C2 * sin(q[1])
        return ((-k * dq[1], -k * (dq[0] + dq[1])), (k * dq[0], 0.0))

    def gravity_torque(self, q: Vector) -> Vector:
        """Return G(q)."""
        second = M2 * C2 * sin(q[0] + q[1])
        return (9.81 * ((M1 * C1 + M2 * L1) * sin(q[0]) + second), 9.81 * second)

    def potential_energy(self, q: Vector) -> float:
        """Return the height of the masses times their weight."""
        return -9.81 * ((M1 * C1 + M2 * L1) * cos(q[0]) + M2 * C2 * cos(q[0] + q[1]))


def _plant(description: str = ARM_URDF, **values: Any) -> MujocoPlant:
    names = {'amplitude': 'disturbance.amplitude', 'frequency': 'disturbance.frequency'}
    return MujocoPlant(PlantConfig.from_mapping({
        'model': 'urdf', **{names.get(k, k): v for k, v in values.items()}}), description)


def _pendulum(**values: Any) -> MujocoPlant:
    return _plant(PENDULUM, joint_names=['hinge'], **{'coulomb_friction': [0.0], **values})


def _state(plant: Plant) -> list[float]:
    return [*plant.q, *plant.dq]


def _turn(plant: Plant, duration: float, tau: list[float]) -> None:
    for _ in range(round(duration * 1e9 / plant.period_ns)):
        plant.step(tau)


# Smooth motion.


def test_period_and_energy_of_a_pendulum() -> None:
    """Check T = 4 K(sin²(q0/2)) / w at 2 rad, and that the energy stays after 20 periods."""
    w = np.sqrt(9.81 * 3.0 * 0.5 / (0.25 + 3.0 * 0.25))
    period = 4.0 / w * ellipk(np.sin(1.0) ** 2)
    plant = _pendulum(initial_position=[2.0])
    crossings, last = [], 0.0
    while plant.t < 20.2 * period:
        q, dq = plant.q[0], plant.dq[0]
        plant.step([0.0])
        if dq < 0.0 <= plant.dq[0]:  # the far end, between two samples
            last = plant.t - 1e-3 * plant.dq[0] / (plant.dq[0] - dq)
            crossings.append(last)
            assert q == pytest.approx(-2.0, abs=1e-3)
    assert np.diff(crossings) == pytest.approx(period, abs=1e-5)
    energy = 0.5 * plant.dq[0] ** 2 - 3.0 * 9.81 * 0.5 * cos(plant.q[0])
    assert energy == pytest.approx(-3.0 * 9.81 * 0.5 * cos(2.0), abs=1e-8)


def _exact(tau: list[float], d: Callable[[float], Array], start: list[float], end: float
           ) -> Array:
    arm = Arm()

    def field(t: float, x: Array) -> Array:
        q, dq = x[:2].tolist(), x[2:].tolist()
        bias = np.array(arm.coriolis_matrix(q, dq)) @ dq + arm.gravity_torque(q)
        return np.concatenate([dq, np.linalg.solve(
            np.array(arm.mass_matrix(q)), np.add(tau, d(t)) - bias)])

    found: Array = solve_ivp(field, (0, end), start, method='DOP853', rtol=1e-12,
                             atol=1e-12).y[:, -1]
    return found


@pytest.mark.parametrize(('amplitude', 'order', 'bound'), [
    ([0.0, 0.0], 4, 1e-7), ([4.0, -2.0], 2, 1e-3)])
def test_the_arm_converges_to_scipy(amplitude: list[float], order: int, bound: float) -> None:
    """Check 1 s under torque, gravity and d(t): how large the error is, and how it falls."""
    frequency, tau, start = [3.0, 40.0], [12.0, -3.0], [0.5, -1.0, 1.0, -2.0]

    def push(t: float) -> Array:
        return np.array(amplitude) * np.sin(np.array(frequency) * t)

    exact = _exact(tau, push, start, 1.0)
    errors = []
    for step in (1e-2, 5e-3, 2.5e-3):
        plant = _plant(**FREE, initial_position=start[:2], initial_velocity=start[2:],
                       amplitude=amplitude, frequency=frequency, control_period=1e-2,
                       integration_step=step)
        _turn(plant, 1.0, tau)
        errors.append(np.abs(np.subtract(_state(plant), exact)).max())
    assert errors[2] < bound
    assert np.log2(np.divide(errors[:2], errors[1:])) == pytest.approx(order, abs=0.3)
    calm = _exact(tau, lambda _: np.zeros(2), start, 1.0)
    assert (np.abs(exact - calm).max() > 0.1) == any(amplitude)


@pytest.mark.parametrize('gravity', [0.0, 1.62, 9.81])
def test_gravity_is_the_configurations(gravity: float) -> None:
    """Check the first step of a pendulum at 90°: -g m l / I, whatever the file says of g."""
    text = PENDULUM.replace('<mujoco>', '<mujoco><option gravity="0 0 5"/>')
    plant = _plant(text, joint_names=['hinge'], coulomb_friction=[0.0], gravity=gravity,
                   initial_position=[pi / 2])
    plant.step([0.0])
    assert plant.dq[0] == pytest.approx(-gravity * 3.0 * 0.5 / 1.0 * 1e-3, rel=1e-9)


# Friction.


@pytest.mark.parametrize('step', [1e-3, 1e-4])
def test_a_sliding_wheel_stops_at_the_closed_form(step: float) -> None:
    """Check w(t) = w0 - Kf t / I down to 0 at I w0 / Kf, the angle it takes, and rest after."""
    kf, start = np.array([3.0, 0.8]), np.array([1.51, -1.37])
    plant = _plant(WHEELS, coulomb_friction=kf.tolist(), initial_velocity=start.tolist(),
                   integration_step=step)
    stops = INERTIA * np.abs(start) / kf
    last = kf / INERTIA * step  # what friction takes from the speed in one step
    for _ in range(1500):
        plant.step([0.0, 0.0])
        left = stops - plant.t
        speed = np.sign(start) * kf / INERTIA * np.maximum(left, 0.0)
        assert (np.abs(plant.dq - speed) < np.where(left < step, last, 1e-10)).all()
        assert (np.abs(plant.dq) < np.where(left < -0.03, 1e-11, 2.0)).all()
    np.testing.assert_allclose(plant.q, start * stops / 2, atol=2.0 * step ** 2)
    rest = plant.q
    _turn(plant, 1.0, [2.9, -0.79])
    np.testing.assert_allclose(plant.q, rest, atol=1e-13)


def test_stuck_until_the_load_exceeds_kf() -> None:
    """Check 15 s at 99 % of Kf on a coupled arm for creep, and that 101 % moves it."""
    q = [0.3, -0.2]
    gravity = Arm().gravity_torque(q)
    plant = _plant(initial_position=q, coulomb_friction=[9.9, 4.0])
    for load in ([9.8, -3.96], [-9.8, 3.96], [0.0, 3.96]):
        for _ in range(5000):
            plant.step([gravity[0] + load[0], gravity[1] + load[1]])
        assert np.abs(plant.dq).max() < 1e-14
        np.testing.assert_allclose(plant.q, q, atol=1e-14)
    _turn(plant, 0.1, [gravity[0] + 10.0, gravity[1]])
    assert plant.dq[0] > 1e-3


def test_above_kf_the_rest_accelerates() -> None:
    """Check (tau - Kf) / I from rest, in both directions, and through a reversal."""
    kf = np.array([3.0, 0.8])
    plant = _plant(WHEELS, coulomb_friction=kf.tolist())
    tau = np.array([3.5, -1.0])
    _turn(plant, 0.2, tau.tolist())
    np.testing.assert_allclose(plant.dq, np.sign(tau) * (np.abs(tau) - kf) / INERTIA * 0.2,
                               atol=1e-11)
    turn = 0.05 / (3.5 + 3.0) * 2.0
    assert plant.dq[0] == pytest.approx(0.05)
    _turn(plant, 0.1, [-3.5, 0.0])
    assert plant.dq[0] == pytest.approx(-0.5 / 2.0 * (0.1 - turn), abs=4e-3)


def test_viscous_friction_decays_exponentially() -> None:
    """Check dq(t) = tau/c + (dq(0) - tau/c) exp(-c t / I) on each joint."""
    c, start, tau = np.array([3.0, 0.5]), np.array([1.5, -2.0]), np.array([2.0, -1.0])
    plant = _plant(WHEELS, **FREE, viscous_friction=c.tolist(), initial_velocity=start.tolist())
    for _ in range(1000):
        plant.step(tau.tolist())
        decay = np.exp(-c / INERTIA * plant.t)
        np.testing.assert_allclose(plant.dq, tau / c + (start - tau / c) * decay, atol=1e-11)
    np.testing.assert_allclose(
        plant.q, tau / c * plant.t + (start - tau / c) * INERTIA / c * (1.0 - decay), atol=1e-11)


def test_agrees_with_the_builtin_plant() -> None:
    """Check 2 s of stick and slide, gravity and couplings, at 0.1 ms per step."""
    values: dict[str, Any] = {
        'coulomb_friction': [15.0, 4.0], 'viscous_friction': [0.3, 0.1],
        'initial_position': [1.0, -0.5], 'disturbance.amplitude': [3.0, 1.0],
        'disturbance.frequency': [4.0, 7.0]}
    ours = Plant(PlantConfig.from_mapping(values), Arm())
    theirs = _plant(integration_step=1e-4, **values)
    stuck = 0
    for k in range(2000):
        tau = [10.0 * sin(0.003 * k), 3.0 * sin(0.005 * k)]
        for plant in (ours, theirs):
            plant.step(tau)
        np.testing.assert_allclose(theirs.q, ours.q, atol=2e-4)
        np.testing.assert_allclose(theirs.dq, ours.dq, atol=2e-3)
        stuck += 0 in ours.modes
    assert 100 < stuck < 1900


def test_a_locked_joint_makes_one_body() -> None:
    """Check the first step of the arm with joint 2 locked: (tau - G1(q)) / M11(0)."""
    arm, q = Arm(), [0.7, 0.0]
    plant = _plant(joint_names=['joint1'], coulomb_friction=[0.0], initial_position=[0.7],
                   control_period=1e-5)
    plant.step([5.0])
    assert plant.dq[0] == pytest.approx(
        1e-5 * (5.0 - arm.gravity_torque(q)[0]) / arm.mass_matrix(q)[0][0], rel=1e-8)
    assert plant.mjmodel.dof_invweight0[0] == pytest.approx(1.0 / arm.mass_matrix(q)[0][0])


# The closed loop.


@cache
def _errors(robot: str, law: str = 'chattering', switching: str = 'sign') -> Array:
    config = PlantConfig(coulomb_friction=(9.0, 4.0), duration=8.0)
    plant = MujocoPlant(config, ARM_URDF) if robot == 'mujoco' else Plant(config, Arm())
    run = simulate(
        config, ControllerConfig(law=law, switching=switching, ka=(12.0, 6.0)), ReferenceConfig(),
        robot=plant, model=Arm())
    assert len(run.t) == 8001
    return np.array(metrics(run)['rms_error_rad'])


def test_chattering_beats_compensation() -> None:
    """Check the RMS error of each joint under a law that knows neither friction nor MuJoCo."""
    without = _errors('mujoco', 'compensation')
    assert (without > 1e-3).all()
    for switching, factor in (('sign', 30.0), ('implicit', 30.0), ('implicit_observer', 100.0)):
        assert (without > factor * _errors('mujoco', switching=switching)).all()


@pytest.mark.parametrize(('law', 'switching'), [
    *(pytest.param(*x, marks=pytest.mark.slow) for x in (
        ('compensation', 'sign'), ('chattering', 'sign'), ('chattering', 'implicit'))),
    ('chattering', 'implicit_observer')])
def test_both_plants_give_the_same_error(law: str, switching: str) -> None:
    """Check the RMS error of the loop with MuJoCo against the one with our own plant."""
    ours, theirs = (_errors(robot, law, switching) for robot in ('builtin', 'mujoco'))
    np.testing.assert_allclose(theirs, ours, rtol=0.05)
