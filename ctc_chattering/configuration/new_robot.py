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
Parameters for a robot from its URDF, for `ctc new-robot`.

What the URDF lacks is stated by the user or assumed, see `arm_knowledge`.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from math import inf
from typing import Any, NamedTuple

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.arm_knowledge import (
    ArmFacts,
    ArmKnowledge,
    Known,
    MOST_PAYLOAD,
    NO_FACTS,
    Source,
)
from ctc_chattering.configuration.holding_motion import (
    choose_motion,
    DURATION_S,
    HeldArm,
    HoldingMotion,
    largest_speeds,
    middle_position,
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
from ctc_chattering.number_format import round_number
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import LARGEST
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.joint_limits import JointLimits, read_limits
import numpy as np

#: Assumed Coulomb friction over the torque that the model takes.
FRICTION = 0.1
#: Friction of a URDF over the effort limit, above which it is a placeholder.
LARGEST_FRICTION = 1.0 / 3.0
#: Damping of a URDF that stops a joint faster belongs to a rotor that the URDF lacks [s].
LEAST_STOPPING_TIME = 0.01
#: Share of ka for the friction of the real robot, over the effort limit.
KA = 0.06
#: Factor by which ka exceeds the friction of a URDF.
_KA_MARGIN = 1.25
#: Postures in which the torque of a payload is taken.
_PAYLOAD_POSTURES = 100


class DescribedFriction(NamedTuple):
    """Friction of the simulated robot, with its origin."""

    #: Coulomb friction, shape (n,) [N·m or N].
    coulomb: Array
    #: Viscous friction, shape (n,) [N·m·s/rad or N·s/m].
    viscous: Array
    #: Joints whose Coulomb friction is that of the URDF.
    coulomb_described: tuple[str, ...]
    #: Joints whose viscous friction is that of the URDF.
    viscous_described: tuple[str, ...]
    #: Joints whose friction in the URDF is too large to be taken.
    implausible: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class NewRobot:
    """
    Parameters of a run, with their origin.

    Attributes
    ----------
    values : dict
        Parameters by section of a file.
    tree : Tree
        The URDF.
    unlimited : tuple of str
        Joints without an effort limit.
    knowledge : ArmKnowledge
        Rotors, rate of the torque, resonance and payload, with their origin.
    friction : DescribedFriction
        Friction of the plant.
    motion : HoldingMotion
        The desired motion.

    """

    values: dict[str, Values]
    tree: Tree
    unlimited: tuple[str, ...]
    knowledge: ArmKnowledge
    friction: DescribedFriction
    motion: HoldingMotion

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints of the model."""
        return self.knowledge.joints

    @property
    def held(self) -> tuple[str, ...]:
        """Movable joints that are not controlled, at 0."""
        return tuple(name for name in self.tree.movable if name not in self.joints)


def new_robot(location: str, joints: Sequence[str] = (), gravity: float = 9.81, tip: str = '',
              center: Sequence[float] = (), facts: ArmFacts = NO_FACTS) -> NewRobot:
    """
    Return parameters of a run that the robot can do.

    The motion is a sinusoid at no more than half the limits of position, velocity and
    acceleration, under law `observer_feedback` with the recommended gains. Its centre is the
    middle of the limits, or the nearest posture found in which every joint carries its weight.
    Collisions are not checked.

    Friction is that of the URDF where it is plausible, else 10 % of the torque that the model
    takes. `ka` has room for it, for 6 % of the effort limit, and for a payload.

    Parameters
    ----------
    location : str
        Path of the URDF, or ``package://NAME/PATH``.
    joints : sequence of str
        Joints that are controlled. By default those up to `tip`, or the longest chain.
    gravity : float
        Acceleration of gravity [m/s²].
    tip : str
        Link at the end of the arm.
    center : sequence of float
        Centre of the motion [rad or m]. Empty to choose it.
    facts : ArmFacts
        Facts beside the URDF.

    Raises
    ------
    CtcError
        If there is no model of the URDF, or the robot cannot hold itself.

    """
    text = read_description(location)
    tree = Tree(text)
    names = _choose_joints(tree, joints, tip)
    knowledge = ArmKnowledge.from_urdf(tree, names, facts)
    shared: Values = {
        'joint_names': names, 'control_period': 1e-3, 'gravity': gravity, 'model': 'urdf',
        'description': location}
    if knowledge.joints_with(Source.USER) or knowledge.joints_with(Source.ASSUMED):
        shared['rotor_inertia'] = [round_number(rotor.value) for rotor in knowledge.rotors]
    config = ControllerConfig.from_mapping(shared)
    model = model_of(config, text)
    torque = model_torque(config, model)
    assert torque is not None  # Only a model of the user's has none.
    effort = np.array(model.effort_limits)
    largest_torque = np.where(effort < inf, effort, torque)
    limits = read_limits(text, names)
    friction = _find_friction(tree, limits, model, largest_torque, torque)
    motion = choose_motion(HeldArm(limits, model, friction.coulomb, friction.viscous), center)
    payload, payload_torque = _find_payload(text, names, model, gravity, facts.payload)
    knowledge = dataclasses.replace(knowledge, payload=payload)
    described = np.isin(names, friction.coulomb_described + friction.viscous_described)
    needed = _KA_MARGIN * (friction.coulomb + friction.viscous * largest_speeds(limits))
    ka = np.maximum(KA * largest_torque, np.where(described, needed, 0.0))
    # Some URDFs have 1e300 for no limit, and ka gets a share for the error of the model as well.
    ka = np.minimum(ka, 0.5 * LARGEST) + payload_torque
    values: dict[str, Values] = {
        parameter_file.EVERY_NODE: shared,
        'plant': {'pacing': 'lockstep', 'duration': DURATION_S,
                  'initial_position': motion.center,
                  'coulomb_friction': friction.coulomb.tolist(),
                  'viscous_friction': friction.viscous.tolist()},
        'controller': _controller_values(config, knowledge, ka, torque),
        'reference': {'center': motion.center, 'amplitude': motion.amplitude,
                      'frequency': motion.frequency, 'start_duration': START_S}}
    parameter_file.load(None, values)
    unlimited = tuple(name for name, limit in zip(names, effort) if limit == inf)
    return NewRobot(values, tree, unlimited, knowledge, friction, motion)


def _choose_joints(tree: Tree, joints: Sequence[str], tip: str) -> tuple[str, ...]:
    """Return the joints of the model."""
    names = tuple(joints) or (chain_to(tree, tip) if tip else longest_chain(tree))
    if not names:
        raise CtcError('URDF: no joint moves a link with a mass' if tree.movable else
                       'URDF: it has no joint that moves')
    tree.locked(names, {})  # Refuses joints that are not there.
    tree.check_limits(names)
    return names


def _controller_values(config: ControllerConfig, knowledge: ArmKnowledge, ka: Array, torque: Array
                       ) -> Values:
    """Return law and gains, with their facts."""
    facts: dict[str, Any] = {}
    if knowledge.resonance.source == Source.USER:
        facts['resonance'] = knowledge.resonance.value
    if knowledge.joints_with(Source.ASSUMED):
        facts['estimator_slope'] = False
    rates = knowledge.torque_rates
    if rates[0].source != Source.NOT_KNOWN:
        facts['torque_rate_limit'] = [rate.value for rate in rates]
    resolution = max(PlantConfig().encoder_resolution)
    gains = recommended_gains(RECOMMENDED_LAW, KnownLoop(
        config.changed({'ka': ka, **facts}), lambda: torque, resolution))
    if 'torque_rate_limit' in facts:
        facts['effort_rate_limit'] = facts['torque_rate_limit']
    return {'law': RECOMMENDED_LAW, **gains, **facts}


def _find_payload(text: str, names: tuple[str, ...], model: Model, gravity: float,
                  stated: float | None) -> tuple[Known, Array]:
    """
    Return the payload [kg] and its torque, shape (n,) [N·m].

    It is the largest unknown mass at the tip. Unless it is stated, it is what the effort limits
    allow beside the weight of the arm, and at most a fraction of its mass.
    """
    loaded = UrdfModel(with_payload(text, names, 1.0), names, gravity)
    generator = np.random.default_rng(0)
    postures = generator.uniform(-np.pi, np.pi, (_PAYLOAD_POSTURES, model.n)).tolist()
    weight, loaded_weight = (
        np.array([arm.gravity_torque(q) for q in postures]) for arm in (model, loaded))
    torque_per_kg = np.abs(loaded_weight - weight).max(axis=0)
    if stated is not None:
        return Known(stated, Source.USER), stated * torque_per_kg
    mass = float(sum(model.inertial_parameters()[::10]))  # type: ignore[attr-defined]
    effort = np.array(model.effort_limits)
    room = np.maximum(effort - np.abs(weight).max(axis=0), 0.0)
    carried = np.min(room / np.maximum(torque_per_kg, 1e-9), initial=inf)
    payload = round_number(min(float(carried), MOST_PAYLOAD * mass))
    return Known(payload, Source.ASSUMED), payload * torque_per_kg


def _find_friction(tree: Tree, limits: Sequence[JointLimits], model: Model, largest_torque: Array,
                   torque: Array) -> DescribedFriction:
    """Return the friction, which a URDF gives where it is plausible."""
    joints = [tree.joints[limit.name] for limit in limits]
    coulomb = np.array([joint.friction for joint in joints])
    viscous = np.array([joint.damping for joint in joints])
    mass_matrix = np.array(model.mass_matrix([middle_position(limit) for limit in limits]))
    inertia = 1.0 / np.diagonal(np.linalg.inv(mass_matrix))
    plausible = np.minimum(LARGEST_FRICTION * largest_torque, torque)
    implausible = (coulomb + viscous * largest_speeds(limits) > plausible) | (
        viscous * LEAST_STOPPING_TIME > inertia)
    coulomb[implausible] = viscous[implausible] = 0.0
    assumed = [round_number(FRICTION * x) for x in torque]
    names = np.array([joint.name for joint in joints])
    described = coulomb > 0.0  # Every joint has friction: 0 says that nobody knows it.
    return DescribedFriction(
        np.where(described, coulomb, assumed),
        viscous,
        coulomb_described=tuple(names[described].tolist()),
        viscous_described=tuple(names[viscous > 0.0].tolist()),
        implausible=tuple(names[implausible].tolist()))
