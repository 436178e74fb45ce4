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
The plant of MuJoCo, from an MJCF or a URDF description.

It has the clock, the drives and the sensors of the builtin plant
(`simulation/simulated_robot.py`). MuJoCo is imported when a plant is constructed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
import xml.etree.ElementTree as ElementTree

from ctc_chattering.dynamics.urdf_parser import parse_description, Tree
from ctc_chattering.errors import CtcError, ParameterError, refused_as
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.simulation.motion import Acting, total
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.simulated_robot import Robot
import numpy as np

#: The largest impedance of a constraint that MuJoCo accepts.
_IMPEDANCE = 0.9999
#: Sweeps of the no-slip solver, and the improvement, relative to the inertia, below which it ends:
#: with 0 it would make all sweeps every time.
_SWEEPS = 300
_ENOUGH = 1e-30
#: Improvement below which MuJoCo's Newton method ends.
_TOLERANCE = 1e-14


class MujocoPlant(Robot):
    """
    The simulated robot of MuJoCo.

    The description gives the bodies, their inertia, and for the joints in `joint_names` the axes,
    armature, springs and limits of position (MuJoCo's soft ones). The configuration gives
    everything else: gravity (along -z), friction and damping of these joints, step, disturbance.
    Limits of torque are `torque_saturation`, not the file's. Contacts, actuators, tendons and
    geometry are ignored, except the geometry of an MJCF body without `inertial`. Closed loops
    (connect, weld) are refused. Joints that are not in `joint_names` are removed from the model,
    with their body at the fixed position: a constraint would be soft, and would cost time.

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
        MJCF or URDF, as XML; the root element says which.
    locked : mapping, optional
        Position [rad or m] at which a joint that is not in `joint_names` is held; by default 0.

    Raises
    ------
    CtcError
        If MuJoCo is not installed, cannot make a model of the description, or the description
        does not have the joints.

    Attributes
    ----------
    mjmodel, mjdata : mujoco.MjModel, mujoco.MjData
        MuJoCo's own.

    """

    def __init__(self, config: PlantConfig, description: str,
                 locked: Mapping[str, float] | None = None) -> None:
        try:
            import mujoco
        except ImportError:
            raise CtcError('plant_backend mujoco needs MuJoCo: pip install mujoco') from None
        super().__init__(config)
        if mujoco.get_mju_user_warning() is None:
            # It would write MUJOCO_LOG.TXT where we are; what it counts is seen in _move.
            mujoco.set_mju_user_warning(lambda _: None)
        with refused_as('MuJoCo refuses the description'):
            model = _compiled(mujoco, config.joint_names, description, locked or {})
            _set_options(mujoco, model, config.gravity, self._h)
            data = mujoco.MjData(model)
        self.mjmodel, self.mjdata = model, data
        # Hinges and slides only: one position and one velocity each, in the same order.
        self._order = [model.joint(name).id for name in config.joint_names]
        _check_limits(model, self._order, config)
        data.qpos[self._order], data.qvel[self._order] = self.q, self.dq
        self._mujoco = mujoco
        self.configure(config)

    def configure(self, config: PlantConfig) -> None:
        """Use another friction or disturbance from the next step on."""
        super().configure(config)
        self.mjmodel.dof_damping[self._order] = self.mechanics.friction.viscous

    @property
    def computed_by(self) -> str:
        """Return what computes the next step."""
        return 'MuJoCo'

    def _move(self, now: Acting) -> None:
        """Go on by one control period in as many steps as `integration_step` asks for."""
        order, h, data, p = self._order, self._h, self.mjdata, self.mechanics
        self.mjmodel.dof_frictionloss[order] = now.breakaway
        if p.disturbed or now.pushed or not p.ideal:
            for i in range(self._substeps):
                data.qfrc_applied[order] = self._mean_torque(now, now.start + (i + 0.5) * h)
                self._mujoco.mj_step(self.mjmodel, data)
        else:
            data.qfrc_applied[order] = now.commanded
            self._mujoco.mj_step(self.mjmodel, data, self._substeps)
        counts = data.warning.number.tolist()
        if any(counts):
            kind = next(i for i, count in enumerate(counts) if count)
            text = self._mujoco.mju_warningText(kind, data.warning[kind].lastinfo)
            raise CtcError(f'the motion of the plant diverged at t = {now.start:g} s; MuJoCo: '
                           + ' '.join(text.split()))
        self.q, self.dq = data.qpos[order].tolist(), data.qvel[order].tolist()

    def _mean_torque(self, now: Acting, t: float) -> Vector:
        """Return the torque for the step whose middle is at `t` [s], shape (n,) [N·m]."""
        p, command, half = self.mechanics, now.commanded, 0.5 * self._h
        middle = total(p, now, command, t, half)
        if p.ideal:
            return middle
        return [(a + 4.0 * b + c) / 6.0 for a, b, c in zip(
            total(p, now, command, t - half, 0.0), middle, total(p, now, command, t + half, 0.0))]


def _compiled(mujoco: Any, names: Sequence[str], description: str, locked: Mapping[str, float]
              ) -> Any:
    """Return MuJoCo's model with the joints `names` and no other."""
    spec = _specification(mujoco, names, description)
    spec.compiler.fusestatic = False  # So that bodies keep their numbers below.
    full = spec.compile()
    one = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    there = [joint.name for joint in spec.joints if joint.type in one and joint.name]
    if not set(names) <= set(there):
        raise ParameterError('joint_names', tuple(names), 'joints of the description that turn '
                             'or slide: ' + ', '.join(there))
    other = [name for name in there if name not in names]
    for name in locked:
        if name not in other:
            raise ParameterError('locked', name, 'joints of the description that turn or slide '
                                 'and are not in joint_names: ' + ', '.join(other))
    bodies: dict[int, Any] = {}
    for joint, i in [(joint, joint.id) for joint in spec.joints if joint.name not in names]:
        if joint.type in one:
            by = locked.get(joint.name, 0.0) - full.qpos0[full.jnt_qposadr[i]]
            body = int(full.jnt_bodyid[i])
            if by and full.body_jntnum[body] > 1:
                raise CtcError(f'joint {joint.name} cannot be locked at another position than '
                               'that of the description: its body has further joints')
            if by:
                bodies[body] = _displaced(mujoco, full, i, by)
        spec.delete(joint)
    model = spec.compile()
    for body, (pos, quat) in bodies.items():
        model.body_pos[body], model.body_quat[body] = pos, quat
    if bodies:
        mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _specification(mujoco: Any, names: Sequence[str], description: str) -> Any:
    """Return the description, editable, without what is not used of it."""
    root = parse_description(description)
    if root.tag == 'robot':
        mimics = {joint.get('name') for joint in root.iter('joint')
                  if joint.find('mimic') is not None}
        for parent in root.iter():
            for tag in ('visual', 'collision', 'mimic'):
                for child in parent.findall(tag):
                    parent.remove(child)
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding='unicode'))
        rotors = {name: joint.rotor_inertia for name, joint in Tree(description).joints.items()}
        for joint in spec.joints:
            joint.armature = rotors.get(joint.name, 0.0)
    elif root.tag == 'mujoco':
        spec = mujoco.MjSpec.from_string(description)
        mimics = {equality.name1 for equality in spec.equalities
                  if equality.type == mujoco.mjtEq.mjEQ_JOINT and equality.active}
        if any(equality.active and equality.type in (
                mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)
                for equality in spec.equalities):
            raise CtcError('the description closes a kinematic loop (connect or weld), which is '
                           'not supported')
    else:
        raise CtcError('the description is neither MJCF nor URDF: its root element is '
                       f'{root.tag}, not mujoco or robot')
    for name in names:
        if name in mimics:
            raise ParameterError('joint_names', tuple(names),
                                 f'joints that do not mimic another, as {name} does')
    _strip(mujoco, spec)
    return spec


def _strip(mujoco: Any, spec: Any) -> None:
    """Delete what can push, or refers to a joint, and the geoms that give no body its inertia."""
    for kind in ('actuators', 'sensors', 'keys', 'tendons', 'equalities', 'pairs', 'excludes',
                 'tuples', 'flexes', 'skins'):
        for element in list(getattr(spec, kind)):
            spec.delete(element)
    rule, rules = spec.compiler.inertiafromgeom, mujoco.mjtInertiaFromGeom
    for body in spec.bodies:
        given = body.id == 0 or rule == rules.mjINERTIAFROMGEOM_FALSE or (
            rule == rules.mjINERTIAFROMGEOM_AUTO and body.explicitinertial)
        for geom in list(body.geoms):
            if given:
                spec.delete(geom)
            else:
                geom.material = ''
    used = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name not in used:
            spec.delete(mesh)
    for element in [*spec.materials, *spec.textures]:
        spec.delete(element)


def _displaced(mujoco: Any, model: Any, joint: int, by: float) -> tuple[Any, Any]:
    """Return position and orientation that a joint's body has when the joint has moved."""
    body = int(model.jnt_bodyid[joint])
    pos, quat = model.body_pos[body].copy(), model.body_quat[body].copy()
    shift = model.jnt_axis[joint] * by
    turned = quat
    if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
        turn, turned, anchor = np.zeros(4), np.zeros(4), np.zeros(3)
        mujoco.mju_axisAngle2Quat(turn, model.jnt_axis[joint], by)
        mujoco.mju_rotVecQuat(anchor, model.jnt_pos[joint], turn)
        mujoco.mju_mulQuat(turned, quat, turn)
        shift = model.jnt_pos[joint] - anchor
    moved = np.zeros(3)
    mujoco.mju_rotVecQuat(moved, shift, quat)
    return pos + moved, turned


def _set_options(mujoco: Any, model: Any, gravity: float, h: float) -> None:
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
    option.enableflags = 0
    model.dof_solref[:] = (0.0, -_IMPEDANCE / h)  # Damping 1 / h: at rest after one step.
    model.dof_solimp[:] = (_IMPEDANCE, _IMPEDANCE, 1e-3, 0.5, 2.0)
    if hasattr(model, 'dof_dampingpoly'):  # MuJoCo 4: damping that grows with the velocity.
        model.dof_dampingpoly[:] = 0.0


def _check_limits(model: Any, order: Sequence[int], config: PlantConfig) -> None:
    """Raise `ParameterError` if a joint starts beyond its limit."""
    for i, name, q in zip(order, config.joint_names, config.initial_position):
        low, high = model.jnt_range[i].tolist()
        if model.jnt_limited[i] and not low <= q <= high:
            raise ParameterError('initial_position', config.initial_position,
                                 f'{low:g} to {high:g} for {name}, by the description')
