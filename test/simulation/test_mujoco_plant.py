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

"""The robot that MuJoCo moves: against closed forms, scipy, the builtin plant, and MuJoCo."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import cos, pi, sin
from pathlib import Path
import sys
from typing import Any

from ctc_chattering.analysis.metrics import metrics
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.linear_algebra import Rows, Vector
from ctc_chattering.simulation.closed_loop import Event, simulate
from ctc_chattering.simulation.mujoco_plant import MujocoPlant
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import BACKENDS, PlantConfig
from ctc_chattering.simulation.registry import make_plant
from ctc_chattering.simulation.simulated_robot import Robot
from ctc_chattering.trajectory.reference import ReferenceConfig
import numpy as np
from oracles import Array
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]
from scipy.special import ellipk  # type: ignore[import-untyped]

mujoco = pytest.importorskip('mujoco')

#: Two-link arm that hangs at q = 0: mass, length, centre of mass and inertia of each link.
M1, L1, C1, I1 = 6.0, 1.0, 0.4, 0.7
M2, L2, C2, I2 = 2.5, 0.8, 0.35, 0.2

ARM_MJCF = f"""
<mujoco>
  <option gravity="3 0 1" timestep="0.5" integrator="RK4" iterations="1"/>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="upper" pos="0 0 2">
      <joint name="joint1" axis="0 1 0"/>
      <inertial pos="0 0 -{C1}" mass="{M1}" diaginertia="{I1} {I1} {I1}"/>
      <geom type="capsule" size="0.3" fromto="0 0 0 0 0 -{L1}"/>
      <body name="lower" pos="0 0 -{L1}">
        <joint name="joint2" axis="0 1 0"/>
        <inertial pos="0 0 -{C2}" mass="{M2}" diaginertia="{I2} {I2} {I2}"/>
        <geom type="capsule" size="0.3" fromto="0 0 0 0 0 -{L2}"/>
      </body>
    </body>
  </worldbody>
</mujoco>"""


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

#: Two wheels that know nothing of each other, of 2 and 0.5 kg·m².
WHEELS = """
<mujoco><worldbody>
  <body><joint name="joint1" axis="1 0 0"/>
    <inertial pos="0 0 0" mass="1" diaginertia="2 2 2"/></body>
  <body pos="0 3 0"><joint name="joint2" axis="0 0 1"/>
    <inertial pos="0 0 0" mass="1" diaginertia="0.5 0.5 0.5"/></body>
</worldbody></mujoco>"""
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


def _plant(description: str = ARM_MJCF, locked: dict[str, float] | None = None,
           **values: Any) -> MujocoPlant:
    names = {'amplitude': 'disturbance.amplitude', 'frequency': 'disturbance.frequency'}
    return MujocoPlant(PlantConfig.from_mapping(
        {'plant_backend': 'mujoco', **{names.get(k, k): v for k, v in values.items()}}),
        description, locked)


def _pendulum(**values: Any) -> MujocoPlant:
    return _plant(PENDULUM, joint_names=['hinge'], **{'coulomb_friction': [0.0], **values})


def _state(plant: Robot) -> list[float]:
    return [*plant.q, *plant.dq]


def _turn(plant: Robot, duration: float, tau: list[float]) -> None:
    for _ in range(round(duration * 1e9 / plant.period_ns)):
        plant.step(tau)


def _torques(count: int) -> list[list[float]]:
    rows: list[list[float]] = (
        np.random.default_rng(3).normal(size=(count, 2)) * [30.0, 10.0]).tolist()
    return rows


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


@pytest.mark.parametrize('description', [ARM_MJCF, ARM_URDF])
@pytest.mark.parametrize(('amplitude', 'order', 'bound'), [
    ([0.0, 0.0], 4, 1e-7), ([4.0, -2.0], 2, 1e-3)])
def test_the_arm_converges_to_scipy(description: str, amplitude: list[float], order: int,
                                    bound: float) -> None:
    """Check 1 s under torque, gravity and d(t): how large the error is, and how it falls."""
    frequency, tau, start = [3.0, 40.0], [12.0, -3.0], [0.5, -1.0, 1.0, -2.0]

    def push(t: float) -> Array:
        return np.array(amplitude) * np.sin(np.array(frequency) * t)

    exact = _exact(tau, push, start, 1.0)
    errors = []
    for step in (1e-2, 5e-3, 2.5e-3):
        plant = _plant(description, **FREE, initial_position=start[:2],
                       initial_velocity=start[2:], amplitude=amplitude, frequency=frequency,
                       control_period=1e-2, integration_step=step)
        _turn(plant, 1.0, tau)
        errors.append(np.abs(np.subtract(_state(plant), exact)).max())
    assert errors[2] < bound
    assert np.log2(np.divide(errors[:2], errors[1:])) == pytest.approx(order, abs=0.3)
    calm = _exact(tau, lambda _: np.zeros(2), start, 1.0)
    assert (np.abs(exact - calm).max() > 0.1) == any(amplitude)


def test_urdf_and_mjcf_agree() -> None:
    """Check both descriptions of the arm against each other under everything at once."""
    plants = [_plant(text, coulomb_friction=[3.0, 1.0], viscous_friction=[0.5, 0.2],
                     amplitude=[2.0, 1.0], frequency=[5.0, 9.0], initial_position=[0.4, 0.3])
              for text in (ARM_MJCF, ARM_URDF)]
    for tau in _torques(500):
        for plant in plants:
            plant.step(tau)
    assert plants[0].q != (0.4, 0.3)
    np.testing.assert_allclose(_state(plants[0]), _state(plants[1]), atol=1e-9)


@pytest.mark.parametrize('gravity', [0.0, 1.62, 9.81])
def test_gravity_is_the_configurations(gravity: float) -> None:
    """Check the first step of a pendulum at 90°: -g m l / I, whatever the file says of g."""
    text = PENDULUM.replace('<mujoco>', '<mujoco><option gravity="0 0 5"/>')
    plant = _plant(text, joint_names=['hinge'], coulomb_friction=[0.0], gravity=gravity,
                   initial_position=[pi / 2])
    plant.step([0.0])
    assert plant.dq[0] == pytest.approx(-gravity * 3.0 * 0.5 / 1.0 * 1e-3, rel=1e-9)


def test_a_control_period_is_cut_in_equal_steps() -> None:
    """Check that 5 ms in steps of at most 2 ms are three steps of 5/3 ms."""
    plant = _pendulum(control_period=5e-3, integration_step=2e-3, initial_position=[1.0])
    assert plant.mjmodel.opt.timestep == pytest.approx(5e-3 / 3)
    plant.step([0.0])
    assert (plant.k, plant.t) == (1, 5e-3)
    assert plant.mjdata.time == pytest.approx(5e-3)


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


def test_friction_of_the_file_does_not_count() -> None:
    """Check that a wheel with friction and damping in the file turns as freely as one without."""
    damping = '6 7 8' if hasattr(mujoco.MjModel, 'dof_dampingpoly') else '6'
    text = WHEELS.replace(
        'axis="1 0 0"', f'axis="1 0 0" frictionloss="5" damping="{damping}"')
    plant = _plant(text, **FREE, initial_velocity=[1.0, 1.0])
    _turn(plant, 1.0, [0.0, 0.0])
    np.testing.assert_allclose(plant.dq, [1.0, 1.0], atol=1e-12)


def test_configure_acts_from_the_next_step() -> None:
    """Check friction, damping and disturbance switched in the run; state and time live on."""
    plant = _plant(WHEELS, coulomb_friction=[3.0, 3.0])
    plant.step([2.0, 0.0])
    assert plant.dq == pytest.approx([0.0, 0.0], abs=1e-15)
    for values, push in (
            ({'coulomb_friction': [1.0, 3.0]}, 1.0), ({'coulomb_friction': [0.0, 0.0]}, 2.0),
            ({'disturbance.amplitude': [4.0, 0.0], 'disturbance.frequency': [pi / 9e-3, 0.0]},
             2.0 + 4.0 * sin(pi * 3.5 / 9.0))):
        before = plant.dq[0]
        plant.configure(plant.config.changed(values))
        plant.step([2.0, 0.0])
        assert plant.dq[0] - before == pytest.approx(push / 2.0 * 1e-3)
    assert (plant.k, plant.t) == (4, 0.004)
    plant.configure(plant.config.changed({
        'disturbance.amplitude': [0.0, 0.0], 'viscous_friction': [500.0, 0.0]}))
    _turn(plant, 0.1, [0.0, 0.0])
    assert plant.dq[0] == pytest.approx(0.0, abs=1e-9)


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


def test_stribeck_friction_is_refused() -> None:
    """Check that what MuJoCo does not have is not left out in silence, nor during the run."""
    plant = _plant(WHEELS)
    with pytest.raises(ParameterError, match=r'stribeck_friction: .*plant_backend mujoco'):
        _plant(WHEELS, stribeck_friction=[0.0, 0.1])
    with pytest.raises(ParameterError, match='stribeck_friction'):
        plant.config.changed({'stribeck_friction': [0.0, 0.1]})


# Drives, sensors, and what else both plants have.


def _either(backend: str, **values: Any) -> Robot:
    return make_plant(PlantConfig.from_mapping({'plant_backend': backend, **values}), ARM_MJCF)


@pytest.mark.parametrize('backend', BACKENDS)
@pytest.mark.parametrize('delay', [0, 1, 3])
def test_delay_and_saturation(backend: str, delay: int) -> None:
    """Check the state bit for bit against a plant that is fed what should arrive."""
    limit = [40.0, 8.0]
    plant = _either(backend, input_delay=delay, torque_saturation=limit)
    plain = _either(backend)
    torques = _torques(80)
    for sent, due in zip(torques, [[0.0, 0.0]] * delay + torques):
        cut = np.clip(due, np.negative(limit), limit).tolist()
        plant.step(sent)
        plain.step(cut)
        assert list(plant.applied) == cut
        assert _state(plant) == _state(plain)
    assert any(abs(x) > limit[1] for _, x in torques)


@pytest.mark.parametrize('backend', BACKENDS)
def test_sensors(backend: str) -> None:
    """Check resolution, noise and its seed, and that the true state does not know of them."""
    plain = _either(backend)
    coarse = _either(backend, encoder_resolution=[1e-3, 0.0])
    noisy = [_either(backend, position_noise=[0.01, 0.02], velocity_noise=[0.03, 0.0],
                     noise_seed=seed) for seed in (1, 1, 2)]
    seen = []
    for tau in _torques(400):
        for plant in (plain, coarse, *noisy):
            plant.step(tau)
            assert _state(plant) == _state(plain)
        assert plain.measured == (plain.q, plain.dq)
        assert coarse.measured[0][0] / 1e-3 == pytest.approx(round(plain.q[0] / 1e-3))
        assert noisy[0].measured == noisy[1].measured != noisy[2].measured
        seen.append(np.subtract(noisy[0].measured, (plain.q, plain.dq)).ravel())
    assert np.std(seen, axis=0) == pytest.approx([0.01, 0.02, 0.03, 0.0], rel=0.15)


@pytest.mark.parametrize('backend', BACKENDS)
@pytest.mark.parametrize('tau', [[1e300, 0.0], [np.nan, 0.0], [0.0, np.inf]])
def test_divergence_is_an_error(backend: str, tau: list[float], tmp_path: Path,
                                monkeypatch: pytest.MonkeyPatch,
                                capfd: pytest.CaptureFixture[str]) -> None:
    """Check one line of error, nothing printed and no log left behind."""
    monkeypatch.chdir(tmp_path)
    plant = _either(backend)
    with pytest.raises(CtcError, match='at t = ') as caught:
        for _ in range(20):
            plant.step(tau)
    assert '\n' not in str(caught.value)
    assert capfd.readouterr() == ('', '')
    assert not list(tmp_path.iterdir())


def test_joints_in_another_order() -> None:
    """Check that names decide: everything per joint swapped, the motion is the same."""
    values: dict[str, Any] = {
        'initial_position': [0.4, -0.3], 'initial_velocity': [0.1, -0.2],
        'coulomb_friction': [3.0, 1.0], 'viscous_friction': [0.5, 0.2],
        'disturbance.amplitude': [2.0, 1.0], 'disturbance.frequency': [5.0, 9.0],
        'torque_saturation': [25.0, 9.0]}
    straight = _plant(**values)
    swapped = _plant(joint_names=['joint2', 'joint1'],
                     **{name: value[::-1] for name, value in values.items()})
    for tau in _torques(300):
        straight.step(tau)
        swapped.step(tau[::-1])
        assert list(swapped.q) == list(straight.q)[::-1]
        assert list(swapped.dq) == list(straight.dq)[::-1]
        assert list(swapped.applied) == list(straight.applied)[::-1]


# Joints that are not ours.


@pytest.mark.parametrize('description', [ARM_MJCF, ARM_URDF])
@pytest.mark.parametrize('at', [None, 0.0, 1.2, -2.5])
def test_a_locked_joint_makes_one_body(description: str, at: float | None) -> None:
    """Check the first step of the arm with joint 2 locked: (tau - G1(q)) / M11(q2)."""
    arm, q = Arm(), [0.7, at or 0.0]
    plant = _plant(description, {} if at is None else {'joint2': at}, joint_names=['joint1'],
                   coulomb_friction=[0.0], initial_position=[0.7], control_period=1e-5)
    plant.step([5.0])
    assert plant.dq[0] == pytest.approx(
        1e-5 * (5.0 - arm.gravity_torque(q)[0]) / arm.mass_matrix(q)[0][0], rel=1e-8)
    assert plant.mjmodel.dof_invweight0[0] == pytest.approx(1.0 / arm.mass_matrix(q)[0][0])


SPATIAL = """
<mujoco>
  <compiler angle="degree"/>
  <worldbody><frame euler="20 0 10">
    <body name="cart" pos="0.1 0.2 0.3" euler="10 20 30">
      <freejoint name="loose"/>
      <inertial pos="0.1 0 0" mass="2" diaginertia="0.3 0.2 0.25"/>
      <body pos="0.5 0 0.1" euler="0 40 0">
        <joint name="a" axis="1 2 3" pos="0.1 0.05 0" ref="15" stiffness="2" armature="0.1"/>
        <inertial pos="0 0.2 0" mass="1.5" diaginertia="0.1 0.2 0.15"/>
        <body pos="0 0.4 0.1" euler="5 0 0">
          <joint name="rail" type="slide" axis="0 1 1" ref="0.05"/>
          <geom type="box" size="0.1 0.2 0.3" mass="1"/>
          <body pos="0.2 0 0.3"><joint name="b" axis="0 1 0" pos="0 0 -0.1"/>
            <inertial pos="0 0.1 0.2" mass="0.7" diaginertia="0.05 0.06 0.07"/>
            <body pos="0 0 0.5" euler="0 0 70"><joint name="c" axis="1 0 0"/>
              <joint name="d" axis="0 0 1"/><geom type="sphere" size="0.2" density="500"/>
            </body>
          </body>
        </body>
      </body>
    </body></frame>
  </worldbody>
</mujoco>"""


@pytest.mark.parametrize('locked', [
    {}, {'a': 0.4}, {'rail': -0.3, 'a': -1.1}, {'rail': 0.2, 'b': 2.0}])
def test_locked_joints_against_the_whole_model(locked: dict[str, float]) -> None:
    """Check M ddq + C dq + G of what moves against MuJoCo's for the description as it is."""
    names = [name for name in 'dcba' if name not in locked]
    plant = _plant(SPATIAL, locked, joint_names=names,
                   coulomb_friction=[0.0] * len(names))
    model = mujoco.MjModel.from_xml_string(SPATIAL.replace('<freejoint name="loose"/>', ''))
    model.opt.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data = mujoco.MjData(model)
    data.qpos[model.joint('rail').id] = 0.0
    for name, at in locked.items():
        data.qpos[model.joint(name).id] = at
    mine, part = plant.mjdata, [model.joint(name).id for name in names]
    own = [plant.mjmodel.joint(name).id for name in names]
    rng = np.random.default_rng(7)
    for _ in range(20):
        for field in ('qpos', 'qvel', 'qacc'):
            row = rng.normal(size=len(names))
            getattr(data, field)[part] = row
            getattr(mine, field)[own] = row
        mujoco.mj_inverse(model, data)
        mujoco.mj_inverse(plant.mjmodel, mine)
        np.testing.assert_allclose(
            mine.qfrc_inverse[own], data.qfrc_inverse[part], rtol=1e-9, atol=1e-9)


def test_what_cannot_be_locked() -> None:
    """Check the refusals, each of which says what is possible."""
    for locked, text in (({'z': 0.0}, 'locked: .*: rail, b, c, d'), ({'a': 1.0}, 'locked'),
                         ({'loose': 1.0}, 'locked'), ({'c': 1.0}, 'joint c cannot be locked')):
        with pytest.raises(CtcError, match=text):
            _plant(SPATIAL, locked, joint_names=['a'], coulomb_friction=[0.0])


def test_a_limit_of_the_description_holds() -> None:
    """Check that the joint is stopped close to its limit, and may not start beyond it."""
    text = PENDULUM.replace('axis=', 'range="-30 45" axis=')
    plant = _plant(text, joint_names=['hinge'], coulomb_friction=[0.5])
    _turn(plant, 2.0, [20.0])
    assert plant.q[0] == pytest.approx(pi / 4, abs=0.02)
    assert plant.dq[0] == pytest.approx(0.0, abs=1e-6)
    with pytest.raises(ParameterError, match=r'initial_position: .*-0.523599 to 0.785398 for hin'):
        _plant(text, joint_names=['hinge'], initial_position=[0.9])


def test_what_a_description_may_hold_besides() -> None:
    """Check that actuators, sensors, tendons, meshes and the like neither push nor disturb."""
    whole = ARM_MJCF.replace('<worldbody>', """
      <asset><mesh name="none" file="none.stl"/>
        <texture name="none" type="2d" file="none.png"/>
        <material name="none" texture="none"/></asset>
      <worldbody>""").replace('<geom type="capsule"', """
      <geom type="mesh" mesh="none" material="none"/><geom type="capsule\"""").replace(
          '</mujoco>', """
      <tendon><fixed name="t" stiffness="100"><joint joint="joint1" coef="1"/></fixed></tendon>
      <actuator><position joint="joint1" kp="1000"/><motor joint="joint2"/></actuator>
      <sensor><jointpos joint="joint2"/></sensor>
      <contact><exclude body1="upper" body2="lower"/></contact>
      <keyframe><key qpos="1 2" ctrl="3 4"/></keyframe></mujoco>""")
    plants = [_plant(text, initial_position=[1.0, 0.0], coulomb_friction=[1.0, 1.0])
              for text in (ARM_MJCF, whole)]
    for tau in _torques(200):
        for plant in plants:
            plant.step(tau)
        assert _state(plants[0]) == _state(plants[1])
    alone = _plant(whole, joint_names=['joint2'], coulomb_friction=[0.0])
    _turn(alone, 0.1, [1.0])
    assert alone.dq[0] > 0.0


@pytest.mark.parametrize(('text', 'message'), [
    ('', 'not XML'), ('hello', 'not XML'), ('<mujoco>', 'not XML'),
    ('<sdf/>', 'neither MJCF nor URDF.* sdf'),
    ('<mujoco><worldbody><bodi/></worldbody></mujoco>', 'MuJoCo refuses.*bodi'),
    (ARM_URDF.replace('<child link="lower"/>', ''), 'MuJoCo refuses'),
    (ARM_MJCF.replace(f'mass="{M2}"', 'mass="0"'), 'MuJoCo refuses.*mass'),
    (WHEELS.replace('joint2', 'other'), 'joint_names: .*: joint1, other$'),
    (WHEELS.replace('axis="0 0 1"', 'type="ball"'), 'joint_names: .*: joint1$'),
    (ARM_MJCF.replace('</mujoco>', '<equality><connect body1="lower" anchor="0 0 0"/></equality>'
                      '</mujoco>'), 'loop'),
    (ARM_MJCF.replace('</mujoco>', '<equality><joint joint1="joint2" joint2="joint1"/></equality>'
                      '</mujoco>'), 'joint_names: .*mimic another, as joint2 does'),
    (ARM_URDF.replace('<limit', '<mimic joint="joint1"/><limit'),
     'joint_names: .*mimic another, as joint2 does')])
def test_refused_descriptions(text: str, message: str) -> None:
    """Check that each is refused in one line that says why."""
    with pytest.raises(CtcError, match=message) as caught:
        _plant(text)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('text', [
    ARM_MJCF.replace('</mujoco>', '<equality><joint joint1="joint2" joint2="joint1"/></equality>'
                     '</mujoco>'),
    ARM_URDF.replace('<limit', '<mimic joint="joint1"/><limit')])
def test_a_joint_that_mimics_is_locked_like_any_other(text: str) -> None:
    """Check that the arm is the one with joint 2 locked at 0."""
    plant, plain = (_plant(x, joint_names=['joint1'], coulomb_friction=[0.0])
                    for x in (text, ARM_MJCF))
    for robot in (plant, plain):
        _turn(robot, 0.2, [5.0])
    np.testing.assert_allclose(_state(plant), _state(plain), atol=1e-12)


# Making one.


def test_without_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check that the error says what to install; the module is imported without it."""
    monkeypatch.setitem(sys.modules, 'mujoco', None)
    with pytest.raises(CtcError, match='pip install mujoco'):
        _plant()


def test_make_plant() -> None:
    """Check the backends, where the description comes from, and what is wrong with it."""
    assert isinstance(make_plant(PlantConfig()), Plant)
    config = PlantConfig(plant_backend='mujoco')
    assert isinstance(make_plant(config, ARM_URDF), MujocoPlant)
    with pytest.raises(CtcError, match='needs the parameter description, or the topic'):
        make_plant(config)
    assert isinstance(make_plant(config, ARM_MJCF), MujocoPlant)
    with pytest.raises(ParameterError, match=r'plant_backend: .*builtin \| mujoco'):
        PlantConfig(plant_backend='bullet')
    assert PlantConfig(plant_backend='mujoco', joint_names=('a', 'b', 'c')).model == 'two_link'


# The closed loop.


@cache
def _errors(robot: str, law: str = 'chattering', switching: str = 'sign') -> Array:
    config = PlantConfig.from_mapping(
        {'plant_backend': robot, 'coulomb_friction': [9.0, 4.0], 'duration': 8.0})
    plant = MujocoPlant(config, ARM_MJCF) if robot == 'mujoco' else Plant(config, Arm())
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
    ours, theirs = (_errors(robot, law, switching) for robot in BACKENDS)
    np.testing.assert_allclose(theirs, ours, rtol=0.05)


def test_events_reach_it() -> None:
    """Check a change in mid-run."""
    config = PlantConfig(plant_backend='mujoco', duration=0.4)
    change = Event(0.2, 'plant', {'coulomb_friction': (0.0, 0.0)})
    runs = [simulate(config, ControllerConfig(law='compensation'), ReferenceConfig(), events,
                     robot=make_plant(config, ARM_MJCF), model=Arm())
            for events in ((), (change,))]
    np.testing.assert_array_equal(runs[0].q[:201], runs[1].q[:201])
    assert np.abs(runs[0].q[-1] - runs[1].q[-1]).max() > 1e-3
