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

"""
MuJoCo as the physics of a simulated robot: the oracle of plant, laws and dynamics.

Clock, drives, disturbance and sensors are the package's (`simulation/plant.py`).
"""

from __future__ import annotations

from math import ceil
from typing import Any
import xml.etree.ElementTree as ElementTree

from ctc_chattering.analysis.result import Result, simulate
from ctc_chattering.compiled.compilable import some
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.payload import with_payload
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array, Rows, Vector
from ctc_chattering.simulation.coordinates import RigidJoints
from ctc_chattering.simulation.motion import (
    Mechanics,
    Motion,
    PeriodLoad,
    total,
    total_at_middle,
)
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
import mujoco

#: The largest impedance of a constraint that MuJoCo accepts.
_IMPEDANCE = 0.9999
#: Sweeps of the no-slip solver, and the improvement, relative to the inertia, below which it ends:
#: with 0 it would make all sweeps every time.
_SWEEPS = 300
_ENOUGH = 1e-30
#: Improvement below which MuJoCo's Newton method ends.
_TOLERANCE = 1e-14


class Joints(Model):
    """The number of joints, in the place of a model."""

    def __init__(self, n: int) -> None:
        self.n = n

    def mass_matrix(self, q: Vector) -> Rows:
        """Return nothing."""
        raise NotImplementedError

    coriolis_matrix = gravity_torque = potential_energy = mass_matrix  # type: ignore[assignment]


class MujocoPlant(Plant):
    """
    The simulated robot of MuJoCo.

    The description gives the bodies, their inertia, and the axes and armature of the joints in
    `joint_names`; the other joints are removed, at position 0. The configuration gives everything
    else: gravity (along -z), friction and damping, payload, step, disturbance.

    Coulomb friction is MuJoCo's `frictionloss`, a constraint on the velocity, as hard as possible:
    with the highest impedance, a damping that removes the velocity within a step, and the no-slip
    solver, which removes the remaining softness. Without this solver a stuck joint whose friction
    prevents an acceleration a creeps at 1e-4 a h: at 95 % of Kf and a step h of 1 ms a two-link
    arm at 2e-6 rad/s, a Panda at 5e-5 rad/s. With it at most 1e-15 rad/s were measured, on a
    two-link arm, a UR5 and a Panda, and no change of position.

    The integrator is Runge-Kutta of fourth order, which is second order in the disturbance (that
    of the middle of each step, held over it) and first order in the instants at which a joint
    stops or breaks away. MuJoCo's faster ones advance the position half a step ahead of the
    velocity: at 1 ms the error of a loop that should be 1e-5 rad was 1e-3 rad. Viscous friction c
    on an inertia I needs a step below 2.7 I / c.

    Parameters
    ----------
    config : PlantConfig
        Start, friction, disturbance, drives and sensors; `model` is ignored.
    description : str
        URDF, or MJCF without contacts, actuators and the like, as XML.

    Raises
    ------
    CtcError
        If the motion diverges.

    Attributes
    ----------
    mjmodel, mjdata : mujoco.MjModel, mujoco.MjData
        MuJoCo's own.

    """

    def __init__(self, config: PlantConfig, description: str) -> None:
        if config.payload:
            description = with_payload(description, config.joint_names, config.payload)
        if mujoco.get_mju_user_warning() is None:
            # It would write MUJOCO_LOG.TXT where we are; what it counts is seen in _move.
            mujoco.set_mju_user_warning(lambda _: None)
        self.mjmodel = model = _model(config, description)
        h, steps = config.control_period, ceil(
            config.control_period / config.integration_step - 1e-9)
        _set_options(model, config.gravity, h / max(1, steps))
        self.mjdata = data = mujoco.MjData(model)
        # Hinges and slides only: one position and one velocity each, in the same order.
        self._order = [model.joint(name).id for name in config.joint_names]
        data.qpos[self._order] = config.initial_position
        data.qvel[self._order] = config.initial_velocity
        super().__init__(config, Joints(len(config.joint_names)))

    def _mechanism_of(self, mechanics: Mechanics) -> Any:
        """Return what moves: this plant itself, as `Mechanism`."""
        self.mechanics, self.joints = mechanics, RigidJoints()
        self.mjmodel.dof_damping[self._order] = mechanics.friction.viscous_friction
        return self

    @property
    def computed_by(self) -> str:
        """Return what computes the next step."""
        return 'MuJoCo'

    def integrate(self, load: PeriodLoad, motion: Motion) -> Motion:
        """Return the motion a sample period later, in as many steps as the plant's."""
        order, data, p = self._order, self.mjdata, self.mechanics
        self.mjmodel.dof_frictionloss[order] = load.breakaway
        if some(p.amplitude) or load.pushed or not p.drives.ideal:
            for i in range(p.steps):
                data.qfrc_applied[order] = self._mean_torque(
                    load, load.start + (i + 0.5) * p.period / p.steps)
                mujoco.mj_step(self.mjmodel, data)
        else:
            data.qfrc_applied[order] = load.commanded
            mujoco.mj_step(self.mjmodel, data, p.steps)
        if any(data.warning.number.tolist()):
            raise CtcError(f'MuJoCo: the motion diverged at t = {load.start:g} s')
        return motion._replace(q=data.qpos[order].copy(), dq=data.qvel[order].copy())

    def _mean_torque(self, load: PeriodLoad, t: float) -> Array:
        """Return the torque for the step whose middle is at `t` [s], shape (n,) [N·m]."""
        mechanism: Any = self
        half = 0.5 * self.mechanics.period / self.mechanics.steps
        start, end = (total(mechanism, load, load.commanded, t + s) for s in (-half, half))
        middle = total_at_middle(mechanism, load, load.commanded, t, half)
        return middle if self.mechanics.drives.ideal else (start + 4.0 * middle + end) / 6.0


def simulated_by_mujoco(setup: Setup, truth: bool = False) -> Result:
    """Return the run of a setup on MuJoCo's plant; the controller keeps its own model."""
    return simulate(
        setup, robot=MujocoPlant(setup.plant, setup.descriptions['plant']), truth=truth)


def _model(config: PlantConfig, description: str) -> Any:
    """Return MuJoCo's model with the joints of `joint_names` and no other, without geometry."""
    root = ElementTree.fromstring(description)
    for parent in root.iter():
        for tag in ('visual', 'collision', 'mimic'):
            for child in parent.findall(tag):
                parent.remove(child)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding='unicode'))
    rotors = {name: joint.rotor_inertia for name, joint in Tree(description).joints.items()
              } if root.tag == 'robot' else {}
    for joint in spec.joints:
        if joint.name in config.joint_names:
            joint.armature = rotors.get(joint.name, 0.0)
        else:
            spec.delete(joint)
    return spec.compile()


def _set_options(model: Any, gravity: float, h: float) -> None:
    """Set gravity, the step `h` [s], and the solver; see `MujocoPlant`."""
    option, flag = model.opt, mujoco.mjtDisableBit
    option.timestep = h
    option.gravity = (0.0, 0.0, -gravity)
    option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.iterations, option.tolerance = 100, _TOLERANCE
    option.ls_iterations, option.ls_tolerance = 50, 1e-4
    option.noslip_iterations, option.noslip_tolerance = _SWEEPS, _ENOUGH
    option.disableflags = int(flag.mjDSBL_CONTACT | flag.mjDSBL_AUTORESET)
    model.dof_solref[:] = (0.0, -_IMPEDANCE / h)  # Damping 1 / h: at rest after one step.
    model.dof_solimp[:] = (_IMPEDANCE, _IMPEDANCE, 1e-3, 0.5, 2.0)
    if hasattr(model, 'dof_dampingpoly'):  # MuJoCo 4: damping that grows with the velocity.
        model.dof_dampingpoly[:] = 0.0
