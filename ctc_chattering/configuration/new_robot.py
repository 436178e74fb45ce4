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

"""A parameter file for a robot of which no more is known than its URDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from math import inf
from typing import NamedTuple

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.arm_knowledge import (
    ArmKnowledge,
    Known,
    MOST_PAYLOAD,
    rotors_of,
    Source,
    torque_rates_of,
)
from ctc_chattering.configuration.holding_motion import (
    choose_motion,
    DURATION_S,
    fastest,
    HeldArm,
    HoldingMotion,
    middle,
    START_S,
)
from ctc_chattering.configuration.loop_setup import Values
from ctc_chattering.configuration.package_share import read_description
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.recommended_gains import (
    KnownLoop,
    model_torque,
    recommended_gains,
    RECOMMENDED_LAW,
)
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.payload import with_payload
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.dynamics.serial_chain import chain_to, longest_chain
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import LARGEST
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.joint_limits import DescribedLimits, JointLimits
import numpy as np

#: Coulomb friction that is assumed, as a part of the torque that the model takes.
FRICTION = 0.1
#: Friction of a URDF that exceeds this part of the effort limit is a placeholder.
LARGEST_FRICTION = 1.0 / 3.0
#: Damping of a URDF that stops a joint faster belongs to a rotor that the URDF lacks [s].
LEAST_STOPPING_TIME = 0.01
#: Part of the effort limit that ka has for the friction of the real robot.
KA = 0.06
#: By what ka exceeds the friction of a URDF.
_KA_MARGIN = 1.25
#: Significant digits of friction.
_DIGITS = 3
#: Postures in which the torque of a payload is taken.
PAYLOAD_POSTURES = 100


class DescribedFriction(NamedTuple):
    """Friction of the simulated robot, and the joints for which the URDF gives it."""

    #: Coulomb friction, shape (n,) [N·m or N].
    coulomb: Array
    #: Viscous friction, shape (n,) [N·m·s/rad or N·s/m].
    viscous: Array
    #: Joints whose Coulomb, or viscous, friction is that of the URDF.
    coulomb_described: tuple[str, ...]
    viscous_described: tuple[str, ...]
    #: Joints whose friction in the URDF is too large to be taken.
    implausible: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class NewRobot:
    """
    The parameters of a run that a robot can do, and what was taken of its URDF.

    Attributes
    ----------
    values : dict
        Parameters by section of a file.
    joints : tuple of str
        Those of the model.
    held : tuple of str
        Joints that could be joints of the model, and stand at 0.
    leaders : mapping of str to tuple of str
        Joints that cannot, because others mimic them: these.
    unexpanded : tuple of str
        Macros of xacro that are left in the URDF.
    unlimited : tuple of str
        Joints without an effort limit.
    knowledge : ArmKnowledge
        Rotors, rate of the torque, resonance and payload, with their origin.
    friction : DescribedFriction
        Of the plant.
    motion : HoldingMotion
        About `center`, or about the posture that was chosen.

    """

    values: dict[str, Values]
    joints: tuple[str, ...]
    held: tuple[str, ...]
    leaders: Mapping[str, tuple[str, ...]]
    unexpanded: tuple[str, ...]
    unlimited: tuple[str, ...]
    knowledge: ArmKnowledge
    friction: DescribedFriction
    motion: HoldingMotion


@dataclasses.dataclass(frozen=True)
class Told:
    """
    What the user says of an arm; nothing by default.

    Attributes
    ----------
    rotor_inertia : sequence of float, length n
        Of each rotor at its joint [kg·m²].
    torque_rate : sequence of float, length n
        That the interface accepts [N·m/s].
    resonance : float
        Lowest one while the drives hold the arm [Hz].
    payload : float, optional
        Largest unknown mass at the tip [kg]; by default what the effort limits allow.

    """

    rotor_inertia: Sequence[float] = ()
    torque_rate: Sequence[float] = ()
    resonance: float = inf
    payload: float | None = None


def new_robot(location: str, joints: Sequence[str] = (), gravity: float = 9.81, tip: str = '',
              center: Sequence[float] = (), told: Told = Told()) -> NewRobot:
    """
    Return the parameters of a run that the robot can do.

    A sinusoid at no more than half the limits of position, velocity and acceleration, under law
    `observer_feedback` with the recommended gains. Its centre is the middle of the limits, or the
    nearest posture found in which every joint carries its weight. Collisions are not checked.

    Friction is that of the URDF where it is plausible, else 10 % of the torque that the model
    takes; `ka` has room for it, and for 6 % of the effort limit.

    Parameters
    ----------
    location : str
        Of the URDF: a path or ``package://NAME/PATH``.
    joints : sequence of str
        Those that are controlled; by default those up to `tip`, or the longest chain.
    gravity : float
        [m/s²].
    tip : str
        Link at the end of the arm.
    center : sequence of float
        Centre of the motion [rad or m]; empty to choose it.
    told : Told
        What is known besides the URDF.

    Raises
    ------
    CtcError
        If there is no model of the URDF, or the robot cannot hold itself.

    """
    text = read_description(location)
    tree = Tree(text)
    names = tuple(joints) or (chain_to(tree, tip) if tip else longest_chain(tree))
    if not names:
        raise CtcError('URDF: no joint moves a link with a mass' if tree.movable else
                       'URDF: it has no joint that moves')
    tree.locked(names, {})  # Refuses joints that are not there.
    tree.check_limits(names)
    rotors = rotors_of(tree, names, told.rotor_inertia)
    shared: Values = {
        'joint_names': names, 'control_period': 1e-3, 'gravity': gravity, 'model': 'urdf',
        'description': location}
    if any(rotor.source in (Source.USER, Source.ASSUMED) for rotor in rotors):
        shared['rotor_inertia'] = [_rounded(rotor.value) for rotor in rotors]
    config = ControllerConfig.from_mapping(shared)
    model = model_of(config, text)
    expected = model_torque(config, model)
    assert expected is not None  # Only a model of the user's has none.
    effort = np.array(model.effort_limits)
    largest = np.where(effort < inf, effort, expected)
    limits = DescribedLimits(text, names).joints
    friction = _friction(tree, limits, model, largest, expected)
    motion = choose_motion(HeldArm(limits, model, friction.coulomb, friction.viscous), center)
    described = np.isin(names, friction.coulomb_described + friction.viscous_described)
    needed = _KA_MARGIN * (friction.coulomb + friction.viscous * fastest(limits))
    # Some URDFs have 1e300 for no limit; ka gets a part for the error of the model as well.
    ka = np.minimum(np.maximum(KA * largest, np.where(described, needed, 0.0)), 0.5 * LARGEST)
    payload, load = _payload(text, names, model, gravity, told.payload, effort)
    rates = torque_rates_of(tree.name, names, told.torque_rate)
    assumed = any(rotor.source == Source.ASSUMED for rotor in rotors)
    known = {'ka': ka + load, 'estimator_slope': not assumed, 'resonance': told.resonance, **(
        {'torque_rate_limit': [rate.value for rate in rates]}
        if rates[0].source != Source.NOT_KNOWN else {})}
    resolution = max(PlantConfig().encoder_resolution)
    gains = recommended_gains(RECOMMENDED_LAW, KnownLoop(
        config.changed(known), lambda: expected, resolution))
    if told.resonance < inf:
        gains['resonance'] = told.resonance
    if assumed:
        gains['estimator_slope'] = False
    for name in ('torque_rate_limit', 'effort_rate_limit') if 'torque_rate_limit' in known else ():
        gains[name] = known['torque_rate_limit']
    values: dict[str, Values] = {
        parameter_file.EVERY_NODE: shared,
        'plant': {'pacing': 'lockstep', 'duration': DURATION_S,
                  'initial_position': motion.center,
                  'coulomb_friction': friction.coulomb.tolist(),
                  'viscous_friction': friction.viscous.tolist()},
        'controller': {'law': RECOMMENDED_LAW, **gains},
        'reference': {'center': motion.center, 'amplitude': motion.amplitude,
                      'frequency': motion.frequency, 'start_duration': START_S}}
    parameter_file.load(None, values)
    return NewRobot(
        values, names, tuple(name for name in tree.movable if name not in names),
        tree.leaders, tree.unexpanded,
        tuple(name for name, limit in zip(names, effort) if limit == inf),
        ArmKnowledge(
            names, rotors, rates,
            Known(told.resonance, Source.USER if told.resonance < inf else Source.NOT_KNOWN),
            payload, tuple(name for name in names if tree.joints[name].continuous)),
        friction, motion)


def _payload(text: str, names: tuple[str, ...], model: Model, gravity: float,
             told: float | None, effort: Array) -> tuple[Known, Array]:
    """
    Return the largest unknown mass at the tip [kg], and the torque that ka has for it, (n,) [N·m].

    By default it is what the effort limits, (n,) [N·m], allow beside the weight of the arm, and at
    most a part of its mass.
    """
    loaded = UrdfModel(with_payload(text, names, 1.0), names, gravity)
    postures = np.random.default_rng(0).uniform(-np.pi, np.pi, (PAYLOAD_POSTURES, model.n))
    weight = np.array([model.gravity_torque(q) for q in postures.tolist()])
    more = np.array([loaded.gravity_torque(q) for q in postures.tolist()]) - weight
    per_kg = np.abs(more).max(axis=0)
    if told is not None:
        return Known(told, Source.USER), told * per_kg
    mass = float(sum(model.inertial_parameters()[::10]))  # type: ignore[attr-defined]
    room = np.maximum(effort - np.abs(weight).max(axis=0), 0.0)
    carried = np.min(room / np.maximum(per_kg, 1e-9), initial=inf)
    payload = _rounded(min(float(carried), MOST_PAYLOAD * mass))
    return Known(payload, Source.ASSUMED), payload * per_kg


def _rounded(value: float) -> float:
    """Return a number to three digits."""
    return float(f'{value:.{_DIGITS}g}')


def _friction(tree: Tree, limits: Sequence[JointLimits], model: Model, largest: Array,
              expected: Array) -> DescribedFriction:
    """Return the friction of the simulated robot: what the URDF says, where its bodies fit it."""
    joints = [tree.joints[limit.name] for limit in limits]
    coulomb = np.array([joint.friction for joint in joints])
    viscous = np.array([joint.damping for joint in joints])
    mass_matrix = np.array(model.mass_matrix([middle(limit) for limit in limits]))
    inertia = 1.0 / np.diagonal(np.linalg.inv(mass_matrix))
    most = np.minimum(LARGEST_FRICTION * largest, expected)
    implausible = (coulomb + viscous * fastest(limits) > most) | (
        viscous * LEAST_STOPPING_TIME > inertia)
    coulomb[implausible] = viscous[implausible] = 0.0
    assumed = np.array([float(f'{FRICTION * torque:.{_DIGITS}g}') for torque in expected])
    names = np.array([joint.name for joint in joints])
    # Every joint has friction: 0 says that nobody knows it.
    return DescribedFriction(np.where(coulomb > 0.0, coulomb, assumed), viscous, *(
        tuple(map(str, names[which])) for which in (coulomb > 0.0, viscous > 0.0, implausible)))
