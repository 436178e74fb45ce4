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
What is known of an arm besides its bodies, and where each number comes from.

A URDF has bodies and limits. What a law needs besides, the rotors, the rate of the torque, the
lowest resonance and the payload, is given by the user, known of the arm by its name, or assumed;
`ArmKnowledge` is the one record of it. The parameter file has the numbers, this says their origin.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from enum import Enum
from math import inf
from typing import NamedTuple

from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import ParameterError
from ctc_chattering.parameters import LEAST, Parameter

#: Inertia of a rotor at the joint per effort limit that is assumed where a URDF has none [kg·m²
#: per N·m]. Data sheets of geared arms have `LEAST_ROTOR` to `MOST_ROTOR`.
ASSUMED_ROTOR = 0.002
LEAST_ROTOR, MOST_ROTOR = 0.001, 0.006
#: Effort limit from which on it is none, but a way to write that there is none [N·m].
NO_LIMIT = 1e5
#: Payload of an arm that carries what its effort limits allow, at most, as a part of its mass.
MOST_PAYLOAD = 0.3
#: What the user may say of an arm.
TORQUE_RATE = Parameter(
    'torque_rate', 'float[]', None, 'largest rate of the torque that the interface of the robot '
    'accepts; default: that of a robot that is known, or none', 'N*m/s', minimum=LEAST, shape='n')
ROTOR = Parameter(
    'rotor_inertia', 'float[]', None, 'inertia of each rotor at its joint, gear ratio squared '
    'included; default: that of the URDF, or assumed', 'kg*m^2', shape='n')
RESONANCE = Parameter(
    'resonance', 'float', inf, 'lowest resonance of the arm while its drives hold it, measured by '
    'a tap; .inf for stiff joints', 'Hz', minimum=LEAST, infinite=True)
PAYLOAD = Parameter(
    'payload', 'float', None, 'largest unknown mass at the tip; default: what the effort limits '
    'allow', 'kg', minimum=0.0)


class Source(Enum):
    """Origin of a number."""

    URDF = 'URDF'
    USER = 'given'
    ARM = 'known of this arm'
    ASSUMED = 'assumed'
    NOT_KNOWN = 'not known'


class Known(NamedTuple):
    """A number and its origin."""

    value: float
    source: Source

    def text(self, unit: str) -> str:
        """Return number, unit and origin."""
        if self.source == Source.NOT_KNOWN:
            return str(self.source.value)
        number = f'{float(f"{self.value:.3g}"):g}'
        return ' '.join(filter(None, (number, unit, f'({self.source.value})')))


class KnownArm(NamedTuple):
    """
    Limits of an arm's interface.

    Attributes
    ----------
    names : tuple of str
        Beginnings of the name of the robot in its URDF.
    torque_rate : float
        Largest rate of a commanded torque [N·m/s].
    reference : str
        Document that has it.

    """

    names: tuple[str, ...]
    torque_rate: float
    reference: str


#: Arms whose interface stops above a rate of the torque.
KNOWN_ARMS = (
    KnownArm(('panda', 'fr3', 'fer', 'franka'), 1000.0,
             'Franka Control Interface, limits for control in joint space'),)


@dataclasses.dataclass(frozen=True)
class ArmKnowledge:
    """
    What is known of an arm of n joints.

    Attributes
    ----------
    joints : tuple of str, length n
        Names.
    rotors : tuple of Known, length n
        Inertia of each rotor at its joint [kg·m²].
    torque_rates : tuple of Known, length n
        Largest rate of the torque of each joint [N·m/s].
    resonance : Known
        Lowest one with the drives holding [Hz].
    payload : Known
        Largest unknown mass at the tip [kg].
    continuous : tuple of str
        Joints that turn without end.

    """

    joints: tuple[str, ...]
    rotors: tuple[Known, ...]
    torque_rates: tuple[Known, ...]
    resonance: Known
    payload: Known
    continuous: tuple[str, ...]

    def rows(self) -> Iterator[tuple[str, ...]]:
        """Yield heads and a row of each joint, for a table."""
        yield 'joint', 'rotor [kg*m^2]', 'torque rate [N*m/s]', 'turns'
        for joint, rotor, rate in zip(self.joints, self.rotors, self.torque_rates):
            yield (joint, rotor.text(''), rate.text(''),
                   'endless' if joint in self.continuous else 'between limits')

    def lines(self) -> Iterator[str]:
        """Yield what is known of the whole arm, and what to find out next."""
        yield f'lowest resonance: {self.resonance.text("Hz")}'
        most = '' if self.payload.source == Source.NOT_KNOWN else 'at most '
        yield f'unknown payload: {most}{self.payload.text("kg")}'
        assumed = [joint for joint, rotor in zip(self.joints, self.rotors)
                   if rotor.source == Source.ASSUMED]
        if assumed:
            lacking = '' if len(assumed) == len(self.joints) else f' for {", ".join(assumed)}'
            yield (f'the URDF has no rotors{lacking}: {ASSUMED_ROTOR:g} kg*m^2 per N*m of '
                   'effort are assumed. Take them from a data sheet (--rotor-inertia), or from '
                   '`ctc identify`; a wrong one costs more than all else')


def rotors_of(tree: Tree, joints: Sequence[str], given: Sequence[float] = ()) -> tuple[Known, ...]:
    """
    Return the rotors: as given, as in the URDF, or assumed.

    Parameters
    ----------
    tree : Tree
        The URDF.
    joints : sequence of str, length n
        Names.
    given : sequence of float, length n
        Inertias at the joints [kg·m²]; empty, or 0 for a joint, where the user says nothing.

    """
    if given and len(given) != len(joints):
        raise ParameterError('rotor_inertia', tuple(given), f'{len(joints)} numbers')
    rotors = []
    for k, name in enumerate(joints):
        joint = tree.joints[name]
        if given and given[k] > 0.0:
            rotors.append(Known(given[k], Source.USER))
        elif joint.rotor_inertia > 0.0:
            rotors.append(Known(joint.rotor_inertia, Source.URDF))
        elif not joint.prismatic and joint.effort < NO_LIMIT:
            rotors.append(Known(ASSUMED_ROTOR * joint.effort, Source.ASSUMED))
        else:
            rotors.append(Known(0.0, Source.NOT_KNOWN))
    return tuple(rotors)


def torque_rates_of(robot_name: str, joints: Sequence[str], given: Sequence[float] = ()
                    ) -> tuple[Known, ...]:
    """Return the largest rates of the torque: as given, one for all or each, of an arm, or inf."""
    if len(given) not in (0, 1, len(joints)):
        raise ParameterError('torque_rate', tuple(given), f'1 or {len(joints)} numbers')
    if len(given):
        rates = tuple(Known(float(rate), Source.USER) for rate in given)
        return rates * (len(joints) if len(rates) == 1 else 1)
    for arm in KNOWN_ARMS:
        if robot_name.lower().startswith(arm.names):
            return (Known(arm.torque_rate, Source.ARM),) * len(joints)
    return (Known(inf, Source.NOT_KNOWN),) * len(joints)
