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
Motion that excites the robot of a parameter file, and the parameter file that plays it.

`ctc excite` and the Python API call `excite`, which takes the first random motion within the
limits of the robot, and `write_excitation`. The recording of the motion is for `ctc identify`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import dataclasses
from itertools import product
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

from ctc_chattering.analysis.tables import fitted, paragraph
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.collision import Approach, SelfCollision
from ctc_chattering.configuration.loop_setup import Setup, Values
from ctc_chattering.configuration.trajectory_file import write_trajectory
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import locked_positions, model_of
from ctc_chattering.errors import CtcError, MachineError, suggest
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

#: Name of the file of waypoints.
MOTION = 'motion.yaml'
#: Name of the parameter file that plays them.
RUN = 'run.yaml'
#: The command that writes these.
EXCITE = 'ctc excite'


@dataclasses.dataclass(frozen=True)
class SearchLimits:
    """Limits of the search, and of the gains of the motion."""

    #: Factors of random motions, one after the other until a motion keeps all limits.
    sizes: tuple[float, ...] = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15)
    #: Steps in which distances are checked. Most refused motions are refused in large ones.
    distance_steps_s: tuple[float, ...] = (0.025, 0.005)
    torque_step_s: float = 0.05
    #: Part of an effort limit that is used, since torques are computed in steps.
    torque_part: float = 0.97
    #: Step in which a motion is evaluated for the report.
    report_step_s: float = 0.01
    #: Distance at which friction may hold a joint, over the amplitude of the slow reversals.
    max_hold: float = 0.2
    #: Largest product of the velocity gain with control period and delay.
    max_gain_delay: float = 0.1
    #: Part of the room for joints that the motion is not for.
    others_part: float = 0.25


SEARCH = SearchLimits()


@dataclasses.dataclass(frozen=True)
class AssumedFriction:
    """Assumed Coulomb [N·m] and viscous [N·m·s/rad] friction, each of shape (n,)."""

    coulomb: Array
    viscous: Array

    def torques(self, model: Model, motion: Array) -> Array:
        """
        Return the torques with friction, shape (N, n) [N·m].

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
    Return the distance at which friction holds each joint, (n,) [rad].

    That is under computed torque.

    All joints stick while the law's torque M Kp e is within ±Kf: |e| ≤ |Kp⁻¹ M⁻¹| Kf.

    Parameters
    ----------
    model : Model
        Gives M.
    positions : ndarray, shape (m, n)
        Positions to evaluate it at. The largest distance counts.
    kp : ndarray, shape (n,)
        Position gains [1/s²].
    friction : AssumedFriction
        Its Coulomb friction counts.

    """
    inverse = np.array([np.linalg.inv(np.array(model.mass_matrix(q.tolist()))) for q in positions])
    return np.asarray((np.abs(inverse) @ friction.coulomb).max(axis=0) / kp)


class LoopGains(NamedTuple):
    """Gains of law `compensation`, each of shape (n,) [1/s², 1/s]."""

    kp: Array
    kv: Array

    def raised(self, hold: Array, slow: Array, delay: float) -> LoopGains:
        """
        Return gains that friction takes little of the reversals from.

        They are never lower.

        Parameters
        ----------
        hold : ndarray, shape (n,)
            Distance by `sticking` for these gains [rad].
        slow : ndarray, shape (n,)
            Amplitude of the reversals [rad].
        delay : float
            Control period and input delay [s].

        """
        largest = (0.5 * SEARCH.max_gain_delay / delay) ** 2
        wanted = np.ceil(np.minimum(self.kp * hold / (SEARCH.max_hold * slow), largest))
        kp = np.where(hold > SEARCH.max_hold * slow, np.maximum(self.kp, wanted), self.kp)
        kv = np.maximum(self.kv, np.ceil(2.0 * np.sqrt(kp)))
        return LoopGains(kp, np.where(kp > self.kp, kv, self.kv))


@dataclasses.dataclass(frozen=True)
class Plan:
    """
    An excitation motion and its prediction, in arrays of shape (n,).

    Attributes
    ----------
    limits : sequence of JointLimits
        Limits of the description.
    bounds : Bounds
        Bounds that the motion keeps.
    excitation : Excitation
        The motion.
    motion : ndarray, shape (3, N, n)
        Position, velocity and acceleration every 10 ms [rad, rad/s, rad/s²].
    tau : ndarray, shape (N, n)
        Torque there, with friction [N·m].
    effort : ndarray
        Largest torques, or inf for unlimited [N·m].
    links : SelfCollision or None
        Check for collisions of the robot with itself.
    approach : Approach or None
        The nearest approach of two links, of samples of 5 ms.
    unchecked : str
        Why nothing was checked without `links`.
    kp, kv : ndarray
        Gains to play it with [1/s², 1/s]. Of a matrix in the file, the diagonal counts.
    hold : ndarray
        Distance from the motion at which friction holds a joint under these gains [rad].

    """

    limits: Sequence[JointLimits]
    bounds: Bounds
    excitation: Excitation
    motion: Array
    tau: Array
    effort: Array
    links: SelfCollision | None
    approach: Approach | None
    unchecked: str
    kp: Array
    kv: Array
    hold: Array

    def text(self) -> str:
        """Return limits and predictions for a terminal."""
        q, dq, ddq = self.motion
        peaks = [np.abs(x).max(axis=0) for x in (dq, ddq, self.tau)]
        largest = (self.bounds.velocity, self.bounds.acceleration, self.effort)
        rows: list[tuple[str, ...]] = [
            ('joint', 'position', 'velocity', 'accel.', 'torque', 'kp', 'kv', 'sticks')
        ]
        for i, joint in enumerate(self.limits):
            rows.append(
                (
                    joint.name,
                    f'{q[:, i].min():.2f} to {q[:, i].max():.2f}',
                    *(f'{peak[i]:.3g}/{limit[i]:.4g}' for peak, limit in zip(peaks, largest)),
                    f'{self.kp[i]:g}',
                    f'{self.kv[i]:g}',
                    f'{self.hold[i]:.3f}',
                )
            )
        return '\n'.join(
            [*fitted(rows, 0), *(line for note in self._notes() for line in paragraph(note, 0))]
        )

    def _notes(self) -> Iterator[str]:
        """Yield sentences on collisions and on assumed limits."""
        if self.links is None or self.approach is None:
            yield (
                'warning: the motion is not checked for collisions of the robot with itself: '
                f'{self.unchecked}'
            )
        else:
            yield f'The nearest approach of two links is {self.approach.text}.'
            for reason, names in (
                ('They touch at the centre', self.links.touching),
                ('They have no collision shapes', self.links.unseen),
            ):
                if names:
                    yield f'warning: these links are not checked: {", ".join(names)}. {reason}.'
        for quantity in ('velocity', 'acceleration'):
            names = [joint.name for joint in self.limits if getattr(joint, quantity)[1] == inf]
            if names:
                joints = 'any joint' if len(names) == len(self.limits) else ', '.join(names)
                yield (
                    f'The description has no {quantity} limit of {joints}: those above are '
                    'assumed.'
                )


def excite(
    setup: Setup, request: Mapping[str, Any] | None = None, joints: Sequence[str] = ()
) -> Plan:
    """
    Return a motion within limits that shows every joint's friction.

    Parameters
    ----------
    setup : Setup
        Model, limits, gains and friction of the robot.
    request : mapping, optional
        Request for the motion, by the names of `ExcitationConfig`: ``duration`` [s],
        ``poses``, ``center`` [rad], ``friction`` [N·m], ``position_range`` [rad],
        ``velocity_scale``, ``clearance`` [m], ``floor`` [m], ``evaluations``, ``seed``.
    joints : sequence of str
        Joints that the motion is for: the others move little. Empty means all.

    Returns
    -------
    Plan
        The motion with its peaks and distances, for `write_excitation`.

    Raises
    ------
    CtcError
        If an argument is not allowed, there is no model, or the limits cannot be kept.

    """
    plant, controller, reference = setup.plant, setup.controller, setup.reference
    names, center = controller.joint_names, dict(zip(reference.joint_names, reference.center))
    config = ExcitationConfig.from_mapping(
        {
            'joint_names': names,
            'start': plant.initial_position,
            'friction': plant.coulomb_friction,
            'center': [center[name] for name in names],
            **(request or {}),
        }
    )
    for name in joints:
        if name not in names:
            raise CtcError(
                f'joints: no joint is called {name}; allowed: {", ".join(names)}'
                f'{suggest(name, names)}'
            )
    description = setup.descriptions.get('controller', '')
    model = model_of(controller, description)
    limits = (
        read_limits(description, names) if description else [JointLimits(name) for name in names]
    )
    bounds = bounds_of(config, limits)
    for quantity, values in (('velocity', bounds.velocity), ('acceleration', bounds.acceleration)):
        if values.min() < LEAST:
            raise CtcError(
                f'joint {names[int(values.argmin())]}: its {quantity} limit leaves no '
                f'motion: {values.min():g}; at least {LEAST:g} is needed'
            )
    friction = AssumedFriction(np.array(config.friction), np.array(plant.viscous_friction))
    effort = np.minimum(controller.largest_torque(model.effort_limits), plant.torque_saturation)
    links, unchecked = None, ''
    try:
        links = SelfCollision(
            description,
            names,
            locked_positions(controller.locked),
            np.array([config.center, config.start]),
            config.clearance,
            config.floor,
        )
    except MachineError:
        raise
    except CtcError as error:
        unchecked = str(error)
    share = np.where(np.isin(names, joints or names), 1.0, SEARCH.others_part)
    excitation, approach = first_motion(config, bounds, share, model, friction, effort, links)
    steps = round(config.duration / SEARCH.report_step_s)
    motion = excitation.at(np.linspace(0.0, config.duration, steps + 1))
    poses = excitation.at(np.array([span.reverse for span in excitation.slow]))[0]
    gains = LoopGains(*(matrix(x, model.n).diagonal() for x in (controller.kp, controller.kv)))
    hold = sticking(model, poses, gains.kp, friction)
    delay = controller.control_period * (1 + controller.input_delay)
    raised = gains.raised(hold, bounds.slow, delay)
    return Plan(
        limits=limits,
        bounds=bounds,
        excitation=excitation,
        motion=motion,
        tau=friction.torques(model, motion),
        effort=effort,
        links=links,
        approach=approach,
        unchecked=unchecked,
        kp=raised.kp,
        kv=raised.kv,
        hold=hold * gains.kp / raised.kp,
    )


class FirstMotion(NamedTuple):
    """Motion within all limits, with its nearest approach of links."""

    excitation: Excitation
    approach: Approach | None


def first_motion(
    config: ExcitationConfig,
    bounds: Bounds,
    share: Array,
    model: Model,
    friction: AssumedFriction,
    effort: Array,
    links: SelfCollision | None,
) -> FirstMotion:
    """
    Return the first of the largest random motions within all limits.

    Parameters
    ----------
    config, bounds, share
        As `random_motion` takes them.
    model, friction
        Give torques.
    effort : ndarray, shape (n,)
        Largest torques, or inf for unlimited [N·m].
    links : SelfCollision or None
        Gives distances.

    Raises
    ------
    CtcError
        If no motion keeps the limits.

    """
    refusal = ''
    for size, seed in product(SEARCH.sizes, range(config.evaluations)):
        excitation = random_motion(config, bounds, share, size, seed)
        refusal = _find_torque_beyond(excitation, friction, model, effort)
        approach = None
        for step in SEARCH.distance_steps_s:
            if links is not None and not refusal:
                t = np.arange(0.0, config.duration + step, step)
                approach = links.nearest(t, excitation.at(t)[0])
                if approach.spare < 0.0:
                    refusal = f'nearest approach of two links: {approach.text}'
        if not refusal:
            return FirstMotion(excitation, approach)
    raise CtcError(
        f'the motion is refused; {refusal}: choose smaller limits, a smaller '
        'position_range or another centre'
    )


def _find_torque_beyond(
    excitation: Excitation, friction: AssumedFriction, model: Model, effort: Array
) -> str:
    """Return a too large torque of a motion in words, empty for none."""
    t = np.arange(0.0, excitation.times[-1], SEARCH.torque_step_s)
    torque = np.abs(friction.torques(model, excitation.at(t)))
    k, i = divmod(int((torque / effort).argmax()), len(effort))
    if torque[k, i] <= SEARCH.torque_part * effort[i]:
        return ''
    return (
        f'peak torque of {excitation.names[i]}: {torque[k, i]:.4g} is not allowed; at most '
        f'{effort[i]:g} N*m, its effort limit'
    )


def write_excitation(plan: Plan, setup: Setup, out: str | Path, overwrite: bool = False) -> None:
    """
    Write a motion and a parameter file that plays it.

    Both are checked.

    Parameters
    ----------
    plan : Plan
        Result of `excite`.
    setup : Setup
        The robot that `excite` had.
    out : str or Path
        Directory for ``motion.yaml``, the waypoints, and ``run.yaml``, the robot's parameters
        with this motion under law compensation.
    overwrite : bool
        Replace the output of an earlier call.

    Raises
    ------
    CtcError
        If there are files already, or one cannot be written.

    """
    changed: dict[str, Values] = {
        'plant': {'duration': float(plan.excitation.times[-1])},
        'controller': {'law': 'compensation', 'kp': plan.kp.tolist(), 'kv': plan.kv.tolist()},
        'reference': {'trajectory_file': str(Path(out).resolve() / MOTION), 'start_duration': 0.0},
        'bringup': {'events': ['']},
    }
    with new_folder(Path(out), EXCITE, overwrite) as folder:
        write_trajectory(plan.excitation.route, folder / MOTION)
        parameter_file.dump(
            {
                node: {**setup.values.get(node, {}), **changed.get(node, {})}
                for node in (*setup.values, *changed)
            },
            folder / RUN,
        )
        parameter_file.load(folder / RUN, {'reference': {'trajectory_file': str(folder / MOTION)}})
