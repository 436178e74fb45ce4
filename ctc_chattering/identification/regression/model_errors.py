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
Models with another mass in one place: how an error there would show in the torque.

The equation of motion is linear in the mass of a link whose centre and shape stay, so the model
with twice that mass less the model itself is the column of the regression, and the coefficient the
part by which the link is heavier than the model says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import cos, sin
from typing import NamedTuple
import xml.etree.ElementTree as ElementTree

from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.payload import with_payload
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_parser import Tree


class ModelError(NamedTuple):
    """
    A possible error of a model.

    Attributes
    ----------
    name : str
        Link, or `payload`.
    unit : str
        Of the coefficient: '' for a part of the link's mass, kg for a payload.
    model : Model
        With a coefficient of 1.

    """

    name: str
    unit: str
    model: Model


class _TwoLinkHeavier(Model):
    """
    The paper's arm with a heavier link, or a ball at its end.

    The paper's numbers do not say how the mass is shared. Link 2 is taken as a uniform rod: from
    its first moment 0.63 kg m and its moment of inertia 0.62 kg m² follow a length of 1.476 m and
    0.854 kg; it hangs at 0.51 / 0.63 = 0.81 m of link 1.

    Parameters
    ----------
    model : TwoLink
        The arm.
    first, second, load : float
        By how much link 1 and link 2 are heavier, as a part; mass at the end [kg].

    """

    n = 2
    LENGTH_1 = 0.51 / 0.63
    LENGTH_2 = 1.5 * 0.62 / 0.63
    MASS_2 = 0.63 / (0.75 * 0.62 / 0.63)

    def __init__(self, model: TwoLink, first: float = 0.0, second: float = 0.0,
                 load: float = 0.0) -> None:
        self._arm, self.gravity = model, model.gravity
        a, b = self.LENGTH_1, self.LENGTH_2
        carried = self.MASS_2 * a * a
        #: M is [[a + 2 k cos q2, ...], ...]: constants, then what goes with cos q2.
        self._m11 = first * (8.77 - carried - 0.62) + second * (carried + 0.62) + load * (
            a * a + b * b)
        self._m12 = second * 0.76 + load * b * b
        self._m22 = second * 0.62 + load * b * b
        self._k = second * 0.51 + load * a * b
        self._g1 = model.gravity * (
            first * (7.6 - self.MASS_2 * a) + second * self.MASS_2 * a + load * a)
        self._g2 = model.gravity * (second * 0.63 + load * b)

    def mass_matrix(self, q: Sequence[float]) -> Sequence[Sequence[float]]:
        """Return M(q), shape (2, 2)."""
        (m11, m12), (_, m22) = self._arm.mass_matrix(q)
        c = self._k * cos(q[1])
        m12 += self._m12 + c
        return ((m11 + self._m11 + 2.0 * c, m12), (m12, m22 + self._m22))

    def coriolis_matrix(self, q: Sequence[float], dq: Sequence[float]
                        ) -> Sequence[Sequence[float]]:
        """Return C(q, dq), shape (2, 2)."""
        (c11, c12), (c21, _) = self._arm.coriolis_matrix(q, dq)
        k = self._k * sin(q[1])
        return ((c11 - k * dq[1], c12 - k * (dq[0] + dq[1])), (c21 + k * dq[0], 0.0))

    def gravity_torque(self, q: Sequence[float]) -> Sequence[float]:
        """Return G(q), shape (2,)."""
        g1, g2 = self._arm.gravity_torque(q)
        both = self._g2 * sin(q[0] + q[1])
        return (g1 + self._g1 * sin(q[0]) + both, g2 + both)

    def potential_energy(self, q: Sequence[float]) -> float:
        """Return the potential energy, 0 where both links hang down [J]."""
        return (self._arm.potential_energy(q) + self._g1 * (1.0 - cos(q[0]))
                + self._g2 * (1.0 - cos(q[0] + q[1])))


def candidates(model: Model, description: str = '',
               locked: Mapping[str, float] | None = None) -> list[ModelError]:
    """
    Return the errors of a model that are looked for: each link's mass, and a payload at the tip.

    Parameters
    ----------
    model : Model
        The two-link arm, or one of a URDF; of others no link is known.
    description : str
        Text of the URDF.
    locked : mapping of str to float, optional
        As the model has it.

    """
    if isinstance(model, TwoLink):
        return [ModelError('link 1', '', _TwoLinkHeavier(model, first=1.0)),
                ModelError('link 2', '', _TwoLinkHeavier(model, second=1.0)),
                ModelError('payload', 'kg', _TwoLinkHeavier(model, load=1.0))]
    joints: Sequence[str] = getattr(model, 'joint_names', ())
    if not (joints and description):
        return []
    from ctc_chattering.dynamics.urdf_model import UrdfModel

    def made(text: str) -> Model:
        return UrdfModel(text, joints, getattr(model, 'gravity', 9.81),
                         locked)
    found = [ModelError(name, '', made(text))
             for name, text in heavier_links(description, joints)]
    outwards = [name for name in Tree(description).ends if name in joints]
    return [*found, ModelError('payload', 'kg', made(with_payload(description, outwards, 1.0)))]


def heavier_links(description: str, joints: Sequence[str], factor: float = 2.0
                  ) -> list[tuple[str, str]]:
    """
    Return name and URDF with `factor` times the mass, for the body that each joint moves.

    Links that are fixed to each other are one body, named after its heaviest link.
    """
    tree = Tree(description)
    found = []
    for joint in joints:
        body = _body(tree, tree.ends[joint][1], joints)
        masses = {name: _mass(tree.links[name]) for name in body}
        if sum(masses.values()) > 0.0:
            found.append((max(masses, key=lambda name: masses[name]),
                          _scaled(description, body, factor)))
    return found


def _body(tree: Tree, link: str, joints: Sequence[str]) -> list[str]:
    """Return the links that move with `link`."""
    found = [link]
    for name, (parent, child) in tree.ends.items():
        if parent in found and name not in joints:
            found.append(child)
    return found


def _mass(link: ElementTree.Element) -> float:
    mass = link.find('inertial/mass')
    return 0.0 if mass is None else float(mass.get('value', '0'))


def _scaled(description: str, links: Sequence[str], factor: float) -> str:
    """Return a URDF with `factor` times the mass and inertia of some links."""
    root = ElementTree.fromstring(description.encode())
    for link in root.iter('link'):
        if link.get('name') in links:
            for element, keys in ((link.find('inertial/mass'), ('value',)),
                                  (link.find('inertial/inertia'),
                                   ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz'))):
                if element is not None:
                    for key in keys:
                        element.set(key, repr(factor * float(element.get(key, '0'))))
    return ElementTree.tostring(root, encoding='unicode')
