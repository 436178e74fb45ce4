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

"""A motion that excites the robot of a parameter file, and the parameter file that plays it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from itertools import product
from pathlib import Path
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup, Values
from ctc_chattering.configuration.trajectory_file import write_trajectory
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import locked_positions, model_of
from ctc_chattering.errors import CtcError, MachineError, suggest
from ctc_chattering.identification.collision import SelfCollision
from ctc_chattering.identification.random_motions import (
    Bounds,
    bounds_of,
    Excitation,
    ExcitationConfig,
    random_motion,
)
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.output_folder import new_folder
from ctc_chattering.parameters import LEAST, matrix
from ctc_chattering.trajectory.joint_limits import JointLimits, read_limits
import numpy as np

#: Files that `write_excitation` makes.
MOTION, RUN = 'motion.yaml', 'run.yaml'
#: The command that writes them.
EXCITE = 'ctc excite'
#: What may help where no motion keeps a limit.
ADVICE = 'choose smaller limits, a smaller position_range or another centre'
#: By what random motions are scaled one after the other until they keep all limits.
_SMALLER = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15)
#: Steps in which distances are checked one after the other [s]: most motions in which links come
#: too near are refused in large ones.
_STEPS = (0.025, 0.005)
#: Part of a largest torque that is used, since it is computed in steps [s].
_TORQUE, _TORQUE_STEP = 0.97, 0.05
#: Step in which a motion is evaluated for what is reported [s].
_FINE = 0.01
#: Part of the amplitude of the slow reversals within which friction may hold a joint.
_STICKING = 0.2
#: Largest product of the velocity gain with control period and delay.
_GAIN = 0.1
#: Part of the room that joints take which a motion is not for.
_OTHERS = 0.25


@dataclasses.dataclass(frozen=True)
class AssumedFriction:
    """Assumed Coulomb [N·m] and viscous [N·m·s/rad] friction, each of shape (n,)."""

    coulomb: Array
    viscous: Array

    def torques(self, model: Model, motion: Array) -> Array:
        """
        Return the torques of a model with friction, shape (N, n) [N·m].

        Parameters
        ----------
        model : Model
            Gives those without.
        motion : ndarray, shape (3, N, n)
            Position, velocity and acceleration. Where a joint rests, friction acts with the
            torque.

        """
        dq = motion[1]
        smooth = np.array([model.inverse_dynamics(*x) for x in zip(*motion.tolist())])
        smooth = smooth + self.viscous * dq
        return np.asarray(smooth + self.coulomb * np.sign(np.where(dq == 0.0, smooth, dq)))


def sticking(model: Model, positions: Array, kp: Array, friction: AssumedFriction) -> Array:
    """
    Return how far friction can hold each joint from the motion under computed torque, (n,) [rad].

    All joints stick while the law's torque M Kp e is within ±Kf: |e| ≤ |Kp⁻¹ M⁻¹| Kf.

    Parameters
    ----------
    model : Model
        Gives M.
    positions : ndarray, shape (m, n)
        Where to evaluate it; the largest distance is returned.
    kp : ndarray, shape (n,)
        Position gains [1/s²].
    friction : AssumedFriction
        Its Coulomb friction counts.

    """
    inverse = np.array([np.linalg.inv(np.array(model.mass_matrix(q.tolist()))) for q in positions])
    return np.asarray((np.abs(inverse) @ friction.coulomb).max(axis=0) / kp)


def gains(kp: Array, kv: Array, hold: Array, slow: Array, delay: float) -> tuple[Array, Array]:
    """
    Return gains with which friction takes little of the slow reversals, as far as they may rise.

    Parameters
    ----------
    kp, kv : ndarray, shape (n,)
        Gains [1/s², 1/s]; they are never lowered.
    hold : ndarray, shape (n,)
        What `sticking` returns for them [rad].
    slow : ndarray, shape (n,)
        Amplitude of the reversals [rad].
    delay : float
        Control period and input delay [s].

    """
    most = (0.5 * _GAIN / delay) ** 2
    wanted = np.ceil(np.minimum(kp * hold / (_STICKING * slow), most))
    higher = np.where(hold > _STICKING * slow, np.maximum(kp, wanted), kp)
    return higher, np.where(higher > kp, np.maximum(kv, np.ceil(2.0 * np.sqrt(higher))), kv)


@dataclasses.dataclass(frozen=True)
class Plan:
    """
    A motion with what is foretold of it; arrays of shape (n,).

    Attributes
    ----------
    limits : sequence of JointLimits
        Of the description.
    bounds : Bounds
        What the motion keeps.
    excitation : Excitation
        The motion.
    motion : ndarray, shape (3, N, n)
        Position, velocity and acceleration every 10 ms [rad, rad/s, rad/s²].
    tau : ndarray, shape (N, n)
        Torque there, with friction [N·m].
    effort : ndarray
        Largest torques [N·m]; inf for unlimited.
    links : SelfCollision or None
        What was checked for collisions of the robot with itself.
    nearest : str
        The nearest approach of two links, of samples of 5 ms; why nothing was checked without
        `links`.
    kp, kv : ndarray
        Gains to play it with [1/s², 1/s]; of a matrix in the file, the diagonal counts.
    hold : ndarray
        How far friction holds a joint from the motion under these gains [rad].

    """

    limits: Sequence[JointLimits]
    bounds: Bounds
    excitation: Excitation
    motion: Array
    tau: Array
    effort: Array
    links: SelfCollision | None
    nearest: str
    kp: Array
    kv: Array
    hold: Array


def excite(setup: Setup, request: Mapping[str, Any] | None = None, joints: Sequence[str] = ()
           ) -> Plan:
    """
    Return a motion that shows the friction of every joint within the robot's limits.

    Parameters
    ----------
    setup : Setup
        Model, limits, gains and friction of the robot.
    request : mapping, optional
        What is asked of the motion, by the names of `ExcitationConfig`: ``duration`` [s],
        ``poses``, ``center`` [rad], ``friction`` [N·m], ``position_range`` [rad],
        ``velocity_scale``, ``clearance`` [m], ``floor`` [m], ``evaluations``, ``seed``.
    joints : sequence of str
        Joints that the motion is for: the others move little; empty for all.

    Returns
    -------
    Plan
        The motion with its peaks and distances; for `write_excitation`.

    Raises
    ------
    CtcError
        If an argument is not allowed, there is no model, or the limits cannot be kept.

    """
    plant, controller, reference = setup.plant, setup.controller, setup.reference
    names, center = controller.joint_names, dict(zip(reference.joint_names, reference.center))
    config = ExcitationConfig.from_mapping({
        'joint_names': names, 'start': plant.initial_position, 'friction': plant.coulomb_friction,
        'center': [center[name] for name in names], **(request or {})})
    for name in joints:
        if name not in names:
            raise CtcError(f'joints: no joint is called {name}; allowed: {", ".join(names)}'
                           f'{suggest(name, names)}')
    description = setup.descriptions.get('controller', '')
    model = model_of(controller, description)
    limits = (read_limits(description, names) if description else
              [JointLimits(name) for name in names])
    bounds = bounds_of(config, limits)
    for quantity, values in (('velocity', bounds.velocity), ('acceleration', bounds.acceleration)):
        if values.min() < LEAST:
            raise CtcError(f'joint {names[int(values.argmin())]}: its {quantity} limit leaves no '
                           f'motion: {values.min():g}; at least {LEAST:g} is needed')
    friction = AssumedFriction(np.array(config.friction), np.array(plant.viscous_friction))
    effort = np.minimum(controller.largest_torque(model.effort_limits), plant.torque_saturation)
    links, reason = None, ''
    try:
        links = SelfCollision(
            description, names, locked_positions(controller.locked),
            np.array([config.center, config.start]), config.clearance, config.floor)
    except MachineError:
        raise
    except CtcError as error:
        reason = str(error)
    share = np.where(np.isin(names, joints or names), 1.0, _OTHERS)
    found, approach = first_motion(config, bounds, share, model, friction, effort, links)
    motion = found.at(np.linspace(0.0, config.duration, round(config.duration / _FINE) + 1))
    poses = found.at(np.array([begin for begin, *_ in found.slow]))[0]
    kp, kv = (matrix(x, model.n).diagonal() for x in (controller.kp, controller.kv))
    hold = sticking(model, poses, kp, friction)
    delay = controller.control_period * (1 + controller.input_delay)
    higher, kv = gains(kp, kv, hold, bounds.slow, delay)
    return Plan(limits, bounds, found, motion, friction.torques(model, motion), effort, links,
                approach or reason, higher, kv, hold * kp / higher)


def first_motion(config: ExcitationConfig, bounds: Bounds, share: Array, model: Model,
                 friction: AssumedFriction, effort: Array, links: SelfCollision | None
                 ) -> tuple[Excitation, str]:
    """
    Return the first random motion that keeps all limits, as large as any does, and its approach.

    Parameters
    ----------
    config, bounds, share
        As `random_motion` takes them.
    model, friction
        Give torques.
    effort : ndarray, shape (n,)
        Largest torques [N·m]; inf for unlimited.
    links : SelfCollision or None
        Gives distances.

    Raises
    ------
    CtcError
        If no motion keeps the limits.

    """
    for size, seed in product(_SMALLER, range(config.evaluations)):
        found, nearest = random_motion(config, bounds, share, size, seed), ''
        refusal = _torque_beyond(found, friction, model, effort)
        for step in _STEPS:
            if links is not None and not refusal:
                t = np.arange(0.0, config.duration + step, step)
                spare, nearest = links.nearest(t, found.at(t)[0])
                if spare < 0.0:
                    refusal = f'nearest approach of two links: {nearest} is needed: {ADVICE}'
        if not refusal:
            return found, nearest
    raise CtcError(f'the motion is refused; {refusal}')


def _torque_beyond(found: Excitation, friction: AssumedFriction, model: Model, effort: Array
                   ) -> str:
    """Return which torque of a motion is too large; empty for none."""
    t = np.arange(0.0, found.times[-1], _TORQUE_STEP)
    torque = np.abs(friction.torques(model, found.at(t)))
    k, i = divmod(int((torque / effort).argmax()), len(effort))
    if torque[k, i] <= _TORQUE * effort[i]:
        return ''
    return (f'peak torque of {found.names[i]}: {torque[k, i]:.4g} is not allowed; at most '
            f'{effort[i]:g} N*m, its effort limit: {ADVICE}')


def write_excitation(found: Plan, setup: Setup, out: str | Path, overwrite: bool = False) -> None:
    """
    Write a motion, and a parameter file that plays it; check that both are accepted.

    Parameters
    ----------
    found : Plan
        What `excite` has found.
    setup : Setup
        The robot for which it has.
    out : str or Path
        Directory for ``motion.yaml``, the waypoints, and ``run.yaml``, the robot's parameters
        with this motion under law compensation.
    overwrite : bool
        Replace what an earlier call has written there.

    Raises
    ------
    CtcError
        If there are files already, or one cannot be written.

    """
    changed: dict[str, Values] = {
        'plant': {'duration': float(found.excitation.times[-1])},
        'controller': {'law': 'compensation', 'kp': found.kp.tolist(), 'kv': found.kv.tolist()},
        'reference': {'trajectory_file': str(Path(out).resolve() / MOTION),
                      'start_duration': 0.0},
        'bringup': {'events': ['']}}
    with new_folder(Path(out), EXCITE, overwrite) as folder:
        write_trajectory(found.excitation.route, folder / MOTION)
        parameter_file.dump({node: {
            **setup.values.get(node, {}), **changed.get(node, {})
        } for node in (*setup.values, *changed)}, folder / RUN)
        parameter_file.load(
            folder / RUN, {'reference': {'trajectory_file': str(folder / MOTION)}})
