"""A motion that excites the robot of a parameter file, and the parameter file that plays it."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from math import inf
from pathlib import Path

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.parameter_file import Setup, Values
from ctc_chattering.configuration.trajectory_file import write_trajectory
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import ParameterError
from ctc_chattering.identification.excitation.forecast import (
    AssumedFriction,
    best_excitation,
    condition_numbers,
    gains,
    Played,
    played,
    sticking,
)
from ctc_chattering.identification.excitation.limits import Bounds, bounds_of, ExcitationConfig
from ctc_chattering.identification.excitation.random_motion import Excitation
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import matrix
from ctc_chattering.trajectory.joint_limits import DescribedLimits, JointLimits
import numpy as np

#: Files that `write` makes.
MOTION, RUN = 'motion.yaml', 'run.yaml'


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
    conditions : ndarray, shape (n, 2)
        Condition numbers, as the regression is and with scaled columns.
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
    conditions: Array
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


def plan(setup: Setup, config: ExcitationConfig, coulomb: Array | None, draws: int, seed: int
         ) -> Plan:
    """
    Return the best conditioned of random motions for the robot of a parameter file.

    Parameters
    ----------
    setup : Setup
        Model, limits, gains and friction of the robot.
    config : ExcitationConfig
        What is asked for.
    coulomb : ndarray, shape (n,), optional
        Coulomb friction to expect [N·m], in place of the plant's.
    draws, seed : int
        Number of motions, and seed of their random numbers.

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
    found = best_excitation(config, bounds, model, friction, effort, draws, seed)
    motion = played(found.route, config.start, model, friction)
    slow = [round((a + b) / 2.0 / (motion.t[1] - motion.t[0])) for a, b in found.slow]
    kp, kv = (matrix(x, model.n).diagonal() for x in (controller.kp, controller.kv))
    hold = sticking(model, motion.q[slow], kp, friction)
    delay = controller.control_period * (1 + controller.input_delay)
    higher, kv = gains(kp, kv, hold, bounds.slow, delay)
    return Plan(limits, bounds, found, motion, effort, condition_numbers(motion), higher, kv,
                hold * kp / higher)


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
