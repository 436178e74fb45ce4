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

from collections.abc import Iterable, Mapping, Sequence
import dataclasses
from math import inf
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.output import prepare
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup, Values
from ctc_chattering.configuration.yaml_file import write_trajectory
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import locked_positions, model_of
from ctc_chattering.errors import CtcError, MachineError, near, ParameterError
from ctc_chattering.identification.collision import Approach, SelfCollision
from ctc_chattering.identification.random_motions import (
    Bounds,
    bounds_of,
    Excitation,
    ExcitationConfig,
    RandomMotions,
)
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.parameters import matrix, vector, whole
from ctc_chattering.trajectory.joint_limits import DescribedLimits, JointLimits
import numpy as np

#: Files that `write` makes.
MOTION, RUN = 'motion.yaml', 'run.yaml'
#: What may help where no motion keeps a limit.
ADVICE = 'choose smaller limits, a smaller position_range or another centre'
#: By what random motions are scaled one after the other until they keep all limits.
_SMALLER = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15)
#: Steps in which distances are checked one after the other [s].
_STEP, CHECK = 0.025, 0.005
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

    def added(self, torque: Array, dq: Array) -> Array:
        """Return torque with friction; where a joint rests, friction acts with the torque."""
        smooth = torque + self.viscous * dq
        return smooth + self.coulomb * np.sign(np.where(dq == 0.0, smooth, dq))


@dataclasses.dataclass(frozen=True)
class Played:
    """
    A motion as it is played, with its torques.

    Attributes
    ----------
    t : ndarray, shape (N,)
        Time [s].
    q, dq, ddq : ndarray, shape (N, n)
        Position [rad], velocity [rad/s] and acceleration [rad/s²].
    tau : ndarray, shape (N, n)
        Torque with friction [N·m].

    """

    t: Array
    q: Array
    dq: Array
    ddq: Array
    tau: Array


def torques(model: Model, motion: Iterable[Array], friction: AssumedFriction) -> Array:
    """Return the torque of position, velocity and acceleration, each (N, n), (N, n) [N·m]."""
    q, dq, ddq = motion
    smooth = [model.inverse_dynamics(*x) for x in zip(q.tolist(), dq.tolist(), ddq.tolist())]
    return friction.added(np.array(smooth), dq)


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
    inverse = np.array([np.linalg.inv(np.array(model.mass_matrix(q.tolist())))
                        for q in positions])
    distance: Array = (np.abs(inverse) @ friction.coulomb).max(axis=0) / kp
    return distance


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


def first_motion(motions: RandomMotions, count: int, seed: int, model: Model,
                 friction: AssumedFriction, effort: Array, links: SelfCollision | None
                 ) -> tuple[Excitation, Approach | None]:
    """
    Return the first random motion that keeps all limits, as large as any does, and its approach.

    Parameters
    ----------
    motions : RandomMotions
        That are drawn.
    count, seed : int
        Motions to draw, and their seed.
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
    rng = np.random.default_rng(seed)
    drawn = [motions.draw(rng) for _ in range(count)]
    for size in _SMALLER:
        for one in drawn:
            found = motions.motion(one, size)
            t = np.arange(0.0, found.path.times[-1] / NANOSECONDS, _TORQUE_STEP)
            torque = np.abs(torques(model, found.path.at(t), friction))
            refusal, nearest = _torque_beyond(torque, effort, found.names), None
            if not refusal and links is not None:
                refusal, nearest = _too_near(found, links)
            if not refusal:
                return found, nearest
    raise CtcError(refusal)


def _torque_beyond(torque: Array, effort: Array, names: Sequence[str]) -> str:
    """Return which magnitudes of torque, shape (N, n) [N·m], are too large; empty for none."""
    k, i = divmod(int((torque / effort).argmax()), len(names))
    if torque[k, i] <= _TORQUE * effort[i]:
        return ''
    return (f'peak torque of {names[i]}: {torque[k, i]:.4g} is not allowed; at most '
            f'{effort[i]:g} N*m, its effort limit: {ADVICE}')


def _too_near(found: Excitation, links: SelfCollision) -> tuple[str, Approach]:
    """Return which links come too near, empty for none, and the nearest approach."""
    for step in (_STEP, CHECK):  # Most that come too near do so in large steps already.
        t = np.arange(0.0, found.path.times[-1] / NANOSECONDS + step, step)
        nearest = links.nearest(found.path.at(t)[0])
        if nearest.spare < 0.0:
            return ('the motion is refused; nearest approach of two links: '
                    f'{links.text(nearest, float(t[nearest.sample]))} is needed: '
                    f'{ADVICE}'), nearest
    return '', nearest


@dataclasses.dataclass(frozen=True)
class Plan:
    """
    A motion with what is foretold of it; arrays of shape (n,).

    Attributes
    ----------
    limits : tuple of JointLimits
        Of the description.
    bounds : Bounds
        What the motion keeps.
    excitation : Excitation
        The motion.
    motion : Played
        As it is played.
    effort : ndarray
        Largest torques [N·m]; inf for unlimited.
    links : SelfCollision or None
        What was checked for collisions of the robot with itself.
    unchecked : str
        Why nothing was.
    near : Approach or None
        Where links have the least to spare, of samples of 5 ms.
    kp, kv : ndarray
        Gains to play it with [1/s², 1/s]; of a matrix in the file, the diagonal counts.
    hold : ndarray
        How far friction holds a joint from the motion under these gains [rad].

    """

    limits: tuple[JointLimits, ...]
    bounds: Bounds
    excitation: Excitation
    motion: Played
    effort: Array
    links: SelfCollision | None
    unchecked: str
    near: Approach | None
    kp: Array
    kv: Array
    hold: Array


def request_of(setup: Setup, values: Values) -> ExcitationConfig:
    """
    Return what is asked for: the robot's start and centre of a parameter file, and `values`.

    Raises
    ------
    ParameterError
        If a value is not allowed, or the joints of the file's nodes differ.

    """
    names, plant, reference = setup.controller.joint_names, setup.plant, setup.reference
    if sorted(reference.joint_names) != sorted(names):
        raise ParameterError('reference: joint_names', reference.joint_names,
                             f'those of the controller: {", ".join(names)}')
    center = dict(zip(reference.joint_names, reference.center))
    return ExcitationConfig.from_mapping({
        'joint_names': names, 'start': plant.initial_position,
        'center': [center[name] for name in names], **values})


def excite(setup: Setup, request: Mapping[str, Any] | None = None,
           friction: Sequence[float] | None = None, evaluations: int = 20, seed: int = 0,
           floor: float | None = None, joints: Sequence[str] = ()) -> Plan:
    """
    Return a motion that shows the friction of every joint within the robot's limits.

    Parameters
    ----------
    setup : Setup
        Model, limits, gains and friction of the robot.
    request : mapping, optional
        What is asked of the motion: ``duration`` [s], ``poses``, ``center`` [rad],
        ``position_range`` [rad],
        ``velocity_scale``, ``clearance`` [m].
    friction : sequence of float, length n, optional
        Coulomb friction to expect, in place of the plant's [N·m].
    evaluations, seed : int
        Random motions, of which the first that keeps all limits is taken, and their seed.
    floor : float, optional
        Height of a floor in the frame of the root link [m].
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
    evaluations, seed = whole('evaluations', evaluations, 1), whole('seed', seed, 0)
    config = request_of(setup, dict(request or {}))
    names, plant, controller = config.joint_names, setup.plant, setup.controller
    for name in joints:
        if name not in names:
            raise CtcError(f'joints: no joint is called {name}; allowed: {", ".join(names)}'
                           f'{near(name, names)}')
    coulomb = vector('friction', plant.coulomb_friction if friction is None else friction,
                     len(names))
    if not (np.isfinite(coulomb) & (coulomb >= 0.0)).all():
        raise ParameterError('friction', friction, 'finite numbers >= 0')
    description = setup.descriptions.get('controller', '')
    model, limits = model_of(controller, description), _limits(description, names)
    bounds = bounds_of(config, limits)
    assumed = AssumedFriction(coulomb, np.array(plant.viscous_friction))
    effort = np.minimum(
        controller.largest_torque(model.effort_limits), plant.torque_saturation)
    links, reason = _checked(setup, config, floor)
    only = [names.index(name) for name in joints]
    share = np.where(np.isin(np.arange(len(names)), only), 1.0, _OTHERS) if only else None
    motions = RandomMotions(config, bounds, share)
    found, approach = first_motion(motions, evaluations, seed, model, assumed, effort, links)
    t = np.arange(round(found.path.times[-1] / NANOSECONDS / _FINE) + 1) * _FINE
    q, dq, ddq = found.path.at(t)
    motion = Played(t, q, dq, ddq, torques(model, (q, dq, ddq), assumed))
    slow = [round((a + b) / 2.0 / (motion.t[1] - motion.t[0])) for a, b in found.slow]
    kp, kv = (matrix(x, model.n).diagonal() for x in (controller.kp, controller.kv))
    hold = sticking(model, motion.q[slow], kp, assumed)
    delay = controller.control_period * (1 + controller.input_delay)
    higher, kv = gains(kp, kv, hold, bounds.slow, delay)
    return Plan(limits, bounds, found, motion, effort, links, reason, approach, higher, kv,
                hold * kp / higher)


def _checked(setup: Setup, config: ExcitationConfig, floor: float | None
             ) -> tuple[SelfCollision | None, str]:
    """Return the distances that can be checked, or None and why none can."""
    description = setup.descriptions.get('controller', '')
    if not description:
        return None, 'there is no description of its links'
    try:
        links = SelfCollision(
            description, config.joint_names, locked_positions(setup.controller.locked),
            np.array([config.center, config.start]), config.clearance, floor)
    except MachineError:
        raise
    except CtcError as error:
        return None, str(error)
    if not links.pairs:
        why = f' ({", ".join(links.unseen)})' if links.unseen else ''
        return None, f'no two links have collision shapes{why}'
    return links, ''


def _limits(description: str, names: tuple[str, ...]) -> tuple[JointLimits, ...]:
    """Return the limits of a description, or of none."""
    if description:
        return tuple(DescribedLimits(description, names).joints)
    free = (-inf, inf)
    return tuple(JointLimits(name, 'rad', free, free, free) for name in names)


def write(found: Plan, sections: Mapping[str, Values], out: Path) -> None:
    """
    Write the motion, and a parameter file that plays it; check that both are accepted.

    Parameters
    ----------
    found : Plan
        The motion.
    sections : mapping
        What `parameter_file.read` returns for the robot's file; law, gains, motion and duration
        are replaced.
    out : Path
        Directory for `MOTION` and `RUN`.

    Raises
    ------
    CtcError
        If a file cannot be written.

    """
    motion = out.resolve() / MOTION
    write_trajectory(found.excitation.route, motion)
    changed: dict[str, Values] = {
        'plant': {'duration': float(found.motion.t[-1])},
        'controller': {'law': 'compensation', 'kp': found.kp.tolist(), 'kv': found.kv.tolist()},
        'reference': {'trajectory_file': str(motion), 'start_duration': 0.0},
        'bringup': {'events': ['']}}
    parameter_file.dump({node: {**sections.get(node, {}), **changed.get(node, {})}
                         for node in (*sections, *changed)}, out / RUN)
    parameter_file.load(out / RUN)


def write_excitation(found: Plan, setup: Setup, out: str | Path) -> None:
    """
    Write a motion, and a parameter file that plays it.

    Parameters
    ----------
    found : Plan
        What `excite` has found.
    setup : Setup
        The robot for which it has.
    out : str or Path
        Directory for ``motion.yaml``, the waypoints, and ``run.yaml``, the robot's parameters
        with this motion under law compensation.

    Raises
    ------
    CtcError
        If a file exists already, or cannot be written.

    """
    sections: dict[str, Values] = {node: {
        **setup.values.get(node, {}), **config.as_mapping()} for node, config in (
            ('plant', setup.plant), ('controller', setup.controller),
            ('reference', setup.reference))}
    write(found, sections, prepare(Path(out), (MOTION, RUN)))
