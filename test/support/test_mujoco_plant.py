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

"""Two plants, MuJoCo's and the package's, alone and in the loop."""

from __future__ import annotations

from math import cos, sin
from typing import Any

from ctc_chattering.analysis.metrics import metrics
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Rows, Vector
from ctc_chattering.simulation.closed_loop import simulate
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
from mujoco_plant import MujocoPlant
import numpy as np
from oracles import Array

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


def test_agrees_with_the_builtin_plant() -> None:
    """Check 2 s of stick and slide, gravity and couplings, at 0.1 ms per step."""
    values: dict[str, Any] = {
        'coulomb_friction': [15.0, 4.0], 'viscous_friction': [0.3, 0.1],
        'initial_position': [1.0, -0.5], 'disturbance.amplitude': [3.0, 1.0],
        'disturbance.frequency': [4.0, 7.0]}
    ours = Plant(PlantConfig.from_mapping(values), Arm())
    theirs = MujocoPlant(PlantConfig.from_mapping({
        'model': 'urdf', 'integration_step': 1e-4, **values}), ARM_URDF)
    stuck = 0
    for k in range(2000):
        tau = [10.0 * sin(0.003 * k), 3.0 * sin(0.005 * k)]
        for plant in (ours, theirs):
            plant.step(tau)
        np.testing.assert_allclose(theirs.q, ours.q, atol=2e-4)
        np.testing.assert_allclose(theirs.dq, ours.dq, atol=2e-3)
        stuck += 0 in ours.modes
    assert 100 < stuck < 1900


def _error(robot: str) -> Array:
    config = PlantConfig(coulomb_friction=(9.0, 4.0), duration=8.0)
    plant = MujocoPlant(config, ARM_URDF) if robot == 'mujoco' else Plant(config, Arm())
    run = simulate(
        config, ControllerConfig(switching='implicit_observer', ka=(12.0, 6.0)),
        ReferenceConfig(), robot=plant, model=Arm())
    assert len(run.t) == 8001
    return np.array(metrics(run)['rms_error_rad'])


def test_both_plants_give_the_same_error() -> None:
    """Check the RMS error of the loop with MuJoCo against the one with our own plant."""
    np.testing.assert_allclose(_error('mujoco'), _error('builtin'), rtol=0.05)
