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

from collections.abc import Collection, Mapping
import dataclasses
from math import inf
from pathlib import Path

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup, Values
from ctc_chattering.configuration.trajectory_file import write_trajectory
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import locked_positions, model_of
from ctc_chattering.errors import CtcError, MachineError, ParameterError
from ctc_chattering.identification.excitation.best_motion import Excitation, Shapes
from ctc_chattering.identification.excitation.collision import Approach, SelfCollision
from ctc_chattering.identification.excitation.forecast import gains, Played, played, sticking
from ctc_chattering.identification.excitation.information import Regression
from ctc_chattering.identification.excitation.limits import Bounds, bounds_of, ExcitationConfig
from ctc_chattering.identification.excitation.margins import (
    ADVICE,
    AssumedFriction,
    DistanceLimit,
    Limit,
    TorqueLimit,
)
from ctc_chattering.identification.excitation.search import BestMotion, Search
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.parameters import matrix
from ctc_chattering.trajectory.joint_limits import DescribedLimits, JointLimits
import numpy as np

#: Files that `write` makes.
MOTION, RUN = 'motion.yaml', 'run.yaml'


#: Step in which distances are checked at the end [s], by how much a motion shrinks that is too
#: near then, and how often it may.
CHECK, _SHRINK, _TIMES = 0.002, 0.98, 50


@dataclasses.dataclass(frozen=True)
class Checked:
    """
    What is known of collisions of the robot with itself.

    Attributes
    ----------
    links : SelfCollision or None
        What was checked.
    reason : str
        Why nothing was.

    """

    links: SelfCollision | None
    reason: str = ''


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
    regression : Regression
        What identification solves.
    best : BestMotion
        What it tells of friction and parameters.
    widened : ndarray
        By how much the interval of Coulomb friction is wider than with all else known.
    checked : Checked
        Distances of links.
    near : Approach or None
        Where links have the least to spare, of samples of 2 ms.
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
    regression: Regression
    best: BestMotion
    widened: Array
    checked: Checked
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


def plan(setup: Setup, config: ExcitationConfig, coulomb: Array | None = None,
         evaluations: int = 1000, seed: int = 0, allowed: Collection[frozenset[str]] = (),
         floor: float | None = None) -> Plan:
    """
    Return the motion that tells most of the robot of a parameter file.

    Parameters
    ----------
    setup : Setup
        Model, limits, gains and friction of the robot.
    config : ExcitationConfig
        What is asked for.
    coulomb : ndarray, shape (n,), optional
        Coulomb friction to expect [N·m], in place of the plant's.
    evaluations, seed : int
        Number of motions to evaluate, and seed of the random ones.
    allowed : collection of frozenset of str
        Pairs of links that may touch.
    floor : float, optional
        Height of a floor in the frame of the root link [m].

    Raises
    ------
    CtcError
        If there is no model, or the limits cannot be kept.

    """
    plant, controller = setup.plant, setup.controller
    description = setup.descriptions.get('controller', '')
    model = model_of(controller, description)
    limits = _limits(description, config.joint_names)
    bounds = bounds_of(config, limits)
    friction = AssumedFriction(np.array(plant.coulomb_friction) if coulomb is None else coulomb,
                               np.array(plant.viscous_friction))
    effort = np.minimum(
        controller.largest_torque(model.effort_limits), plant.torque_saturation)
    checked = _checked(setup, config, allowed, floor)
    kept: list[Limit] = [TorqueLimit(config.joint_names, model, friction, effort)]
    if checked.links is not None:
        kept.append(DistanceLimit(checked.links))
    shapes = Shapes(config, bounds)
    regression = Regression(model, bounds, _noise(shapes, model, friction, seed))
    best = Search(shapes, bounds, regression, kept).best(evaluations, seed)
    found, near = _kept(shapes, best.z, checked.links)
    motion = played(found.path, model, friction)
    slow = [round((a + b) / 2.0 / (motion.t[1] - motion.t[0])) for a, b in found.slow]
    kp, kv = (matrix(x, model.n).diagonal() for x in (controller.kp, controller.kv))
    hold = sticking(model, motion.q[slow], kp, friction)
    delay = controller.control_period * (1 + controller.input_delay)
    higher, kv = gains(kp, kv, hold, bounds.slow, delay)
    widened = best.information.inflation()[:2 * model.n].reshape(2, -1).max(axis=0)
    return Plan(limits, bounds, found, motion, effort, regression, best, widened, checked, near,
                higher, kv, hold * kp / higher)


def _noise(shapes: Shapes, model: Model, friction: AssumedFriction, seed: int) -> Array:
    """Return what torques are weighted by: those of a random motion, shape (n,) [N·m]."""
    motion = shapes.motion(shapes.random(np.random.default_rng(seed)))
    found = np.sqrt(np.square(played(motion.path, model, friction, 0.2).tau).mean(axis=0))
    return np.asarray(np.maximum(found, 1e-6 * found.max()))


def _checked(setup: Setup, config: ExcitationConfig, allowed: Collection[frozenset[str]],
             floor: float | None) -> Checked:
    """Return the distances that can be checked, or why none can."""
    description = setup.descriptions.get('controller', '')
    if not description:
        return Checked(None, 'there is no description of its links')
    try:
        links = SelfCollision(
            description, config.joint_names, locked_positions(setup.controller.locked),
            np.array([config.center, config.start]), config.clearance, allowed, floor)
    except MachineError:
        raise
    except CtcError as error:
        return Checked(None, str(error))
    if not links.pairs:
        why = f' ({", ".join(links.unseen)})' if links.unseen else ''
        return Checked(None, f'no two links have collision shapes{why}')
    return Checked(links)


def _kept(shapes: Shapes, z: Array, links: SelfCollision | None
          ) -> tuple[Excitation, Approach | None]:
    """Return a motion, smaller if in small steps links come too near, and its least distance."""
    if links is None:
        return shapes.motion(z), None
    for _ in range(_TIMES):
        found = shapes.motion(z)
        t = np.arange(0.0, found.path.times[-1] / NANOSECONDS + CHECK, CHECK)
        near = links.nearest(found.path.at(t)[0])
        if near.spare >= 0.0:
            return found, near
        z = z.copy()
        z[shapes.free] *= _SHRINK
    raise CtcError('the motion is refused; nearest approach of two links: '
                   f'{links.text(near, float(t[near.sample]))} is needed: {ADVICE}')


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
