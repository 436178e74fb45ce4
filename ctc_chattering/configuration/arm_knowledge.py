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
Facts about an arm that its URDF lacks.

Beside bodies and limits, a law needs the rotors, the rate of the torque, the lowest resonance and
the payload. They are stated by the user, known of an arm by its name, or assumed. `ctc new-robot`
writes the numbers into a parameter file, and `ArmKnowledge` has their origin.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from enum import Enum
from math import inf
from typing import NamedTuple

from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import ParameterError
from ctc_chattering.number_format import round_number
from ctc_chattering.parameters import LEAST, Parameter

#: Rotor inertia at the joint per effort limit, assumed without a URDF's [kg·m² per N·m].
ASSUMED_ROTOR = 0.002
#: Smallest value in data sheets of geared arms [kg·m² per N·m].
LEAST_ROTOR = 0.001
#: Largest value in data sheets of geared arms [kg·m² per N·m].
MOST_ROTOR = 0.006
#: Effort limit from which on it is none, but a way to write that there is none [N·m].
NO_LIMIT = 1e5
#: Assumed payload over the arm's mass, at most, where the effort limits allow more.
MOST_PAYLOAD = 0.3
#: Arms whose interface stops above a rate of the torque, by the beginnings of their names. The
#: Franka Control Interface has the number in its limits for control in joint space [N·m/s].
_TORQUE_RATES = {('panda', 'fr3', 'fer', 'franka'): 1000.0}
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
        number = f'{round_number(self.value):g}'
        return ' '.join(filter(None, (number, unit, f'({self.source.value})')))


_UNKNOWN = Known(inf, Source.NOT_KNOWN)


@dataclasses.dataclass(frozen=True)
class ArmFacts:
    """
    Facts about an arm that its user states.

    Attributes
    ----------
    rotor_inertia : sequence of float, length n
        Inertia of each rotor at its joint [kg·m²]. Empty, or 0 for a joint, states nothing.
    torque_rate : sequence of float, length 1 or n
        Rate of the torque that the interface accepts [N·m/s].
    resonance : float
        Lowest resonance while the drives hold the arm [Hz].
    payload : float, optional
        Largest unknown mass at the tip [kg].

    """

    rotor_inertia: Sequence[float] = ()
    torque_rate: Sequence[float] = ()
    resonance: float = inf
    payload: float | None = None


NO_FACTS = ArmFacts()


@dataclasses.dataclass(frozen=True)
class ArmKnowledge:
    """
    Facts about an arm with their origin, n joints.

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
    continuous : tuple of str
        Joints that turn without end.
    payload : Known
        Largest unknown mass at the tip [kg].

    """

    joints: tuple[str, ...]
    rotors: tuple[Known, ...]
    torque_rates: tuple[Known, ...]
    resonance: Known
    continuous: tuple[str, ...]
    payload: Known = _UNKNOWN

    @classmethod
    def from_urdf(cls, tree: Tree, joints: Sequence[str], facts: ArmFacts = NO_FACTS
                  ) -> ArmKnowledge:
        """
        Return the knowledge about joints of a URDF.

        Raises
        ------
        ParameterError
            If there are facts about another number of joints.

        """
        resonance = facts.resonance
        return cls(
            tuple(joints),
            find_rotors(tree, joints, facts.rotor_inertia),
            find_torque_rates(tree.name, joints, facts.torque_rate),
            Known(resonance, Source.USER) if resonance < inf else _UNKNOWN,
            tuple(name for name in joints if tree.joints[name].continuous))

    def joints_with(self, source: Source) -> tuple[str, ...]:
        """Return the joints whose rotor has this origin."""
        return tuple(joint for joint, rotor in zip(self.joints, self.rotors)
                     if rotor.source == source)

    def rows(self) -> Iterator[tuple[str, ...]]:
        """Yield the rows of a table, a joint each."""
        yield 'joint', 'rotor [kg*m^2]', 'torque rate [N*m/s]', 'turns'
        for joint, rotor, rate in zip(self.joints, self.rotors, self.torque_rates):
            turns = 'endless' if joint in self.continuous else 'between limits'
            yield joint, rotor.text(''), rate.text(''), turns

    def lines(self) -> Iterator[str]:
        """Yield lines about the whole arm."""
        yield f'lowest resonance: {self.resonance.text("Hz")}'
        bound = '' if self.payload.source == Source.NOT_KNOWN else 'at most '
        yield f'unknown payload: {bound}{self.payload.text("kg")}'
        assumed = self.joints_with(Source.ASSUMED)
        if assumed:
            joints = '' if assumed == self.joints else f' for {", ".join(assumed)}'
            yield (f'the URDF has no rotors{joints}: {ASSUMED_ROTOR:g} kg*m^2 per N*m of '
                   'effort are assumed. Take them from a data sheet (--rotor-inertia), or from '
                   '`ctc identify`; a wrong one costs more than all else')


def find_rotors(tree: Tree, joints: Sequence[str], stated: Sequence[float] = ()
                ) -> tuple[Known, ...]:
    """
    Return the rotors that are stated, described or assumed.

    Parameters
    ----------
    tree : Tree
        The URDF.
    joints : sequence of str, length n
        Names.
    stated : sequence of float, length n
        Inertias at the joints [kg·m²]. Empty, or 0 for a joint, if nothing is stated.

    """
    stated = stated or (0.0,) * len(joints)
    if len(stated) != len(joints):
        raise ParameterError('rotor_inertia', tuple(stated), f'{len(joints)} numbers')
    rotors = []
    for name, inertia in zip(joints, stated):
        joint = tree.joints[name]
        if inertia > 0.0:
            rotor = Known(inertia, Source.USER)
        elif joint.rotor_inertia > 0.0:
            rotor = Known(joint.rotor_inertia, Source.URDF)
        elif not joint.prismatic and joint.effort < NO_LIMIT:
            rotor = Known(ASSUMED_ROTOR * joint.effort, Source.ASSUMED)
        else:
            rotor = Known(0.0, Source.NOT_KNOWN)
        rotors.append(rotor)
    return tuple(rotors)


def find_torque_rates(robot_name: str, joints: Sequence[str], stated: Sequence[float] = ()
                      ) -> tuple[Known, ...]:
    """Return the torque rates that are stated or known."""
    n = len(joints)
    if len(stated) not in (0, 1, n):
        raise ParameterError('torque_rate', tuple(stated), f'1 or {n} numbers')
    rates = [Known(float(rate), Source.USER) for rate in stated]
    for names, rate in _TORQUE_RATES.items():
        if not rates and robot_name.lower().startswith(names):
            rates = [Known(rate, Source.ARM)]
    rates = rates or [_UNKNOWN]
    return tuple(rates * n if len(rates) == 1 else rates)
