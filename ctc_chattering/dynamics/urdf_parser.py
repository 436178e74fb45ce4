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

"""Joints and links of a URDF: read, checked to form a tree of joints, reduced to inertias."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from math import hypot
from typing import NamedTuple
import xml.etree.ElementTree as ET

from ctc_chattering.errors import CtcError, near, ParameterError

#: Types of joint with one degree of freedom.
_MOVABLE = ('revolute', 'continuous', 'prismatic')
_INF = float('inf')
#: Largest description: urdfdom overflows the stack with a chain of 30,000 links.
_CHARACTERS, _BODIES = 4_000_000, 500


class Origin(NamedTuple):
    """Where something is on what carries it: x, y, z [m] and roll, pitch, yaw [rad]."""

    xyz: tuple[float, ...]
    rpy: tuple[float, ...]


def origin(where: str, element: ET.Element) -> Origin:
    """Return what an element's origin says, zeros without one; raise `CtcError` for no numbers."""
    found = element.find('origin')
    given = {} if found is None else found.attrib
    return Origin(*(tuple(numbers(where, f'origin {key}', given.get(key, '0 0 0'), 3))
                    for key in ('xyz', 'rpy')))


def axis(where: str, joint: ET.Element) -> tuple[float, float, float]:
    """Return the axis of a joint with length 1, or 0 as the text has it; raise for no numbers."""
    found = joint.find('axis')
    x, y, z = numbers(
        where, 'axis', '1 0 0' if found is None else found.get('xyz', '1 0 0'), 3)
    size = hypot(x, y, z) or 1.0
    return x / size, y / size, z / size


def numbers(where: str, what: str, text: str, count: int, most: float = 1e300) -> list[float]:
    """Return the numbers of an attribute, none of them larger than `most`."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(abs(x) <= most for x in values):
        raise CtcError(f'URDF: {where}: {what} is {text!r}, not '
                       f'{"a number" if count == 1 else f"{count} numbers"}')
    return values


class Mimic(NamedTuple):
    """A joint that follows another: position = multiplier * that of the leader + offset."""

    leader: str
    multiplier: float
    offset: float


class Joint(NamedTuple):
    """One joint with one degree of freedom."""

    name: str
    #: ``revolute``, ``continuous`` or ``prismatic``.
    kind: str
    #: Least and greatest position [rad or m]; ∓inf where there is no limit.
    position: tuple[float, float]
    #: Greatest speed [rad/s or m/s] and effort [N·m or N]; inf where the URDF has none, or 0.
    velocity: float
    effort: float
    #: Greatest acceleration and deceleration [rad/s² or m/s²], as URDF 1.2 has them; inf for none.
    acceleration: float
    #: Inertia of the rotor, reflected to the joint [kg·m² or kg]; no body of the URDF has it.
    rotor_inertia: float
    mimic: Mimic | None

    @property
    def continuous(self) -> bool:
        """Whether it turns endlessly."""
        return self.kind == 'continuous'


class Tree:
    """
    The joints of a URDF.

    Parameters
    ----------
    urdf : str or Element
        Its text, or what `parse_description` made of it.

    Attributes
    ----------
    links : dict of str to Element
        In the order of the text.
    ends : dict of str to (str, str)
        Parent and child link of every joint, fixed ones too, from the root outwards.
    joints : dict of str to Joint
        Those with one degree of freedom, from the root outwards, in the order of the text.
    origins : dict of str to Origin
        Where every joint is on its parent link.
    axes : dict of str to tuple of float, length 3
        Of the joints with one degree of freedom, of length 1, or 0 as the text has it.

    Raises
    ------
    CtcError
        If the text is no URDF of a tree of such joints.

    """

    def __init__(self, urdf: str | ET.Element) -> None:
        robot = parse_description(urdf) if isinstance(urdf, str) else urdf
        if robot.tag != 'robot':
            raise CtcError(f'URDF: the outermost element is <{robot.tag}>, not <robot>')
        if any('xacro' in element.tag for element in robot.iter()):
            raise CtcError('URDF: this is xacro; run xacro on it first')
        self.links, self._elements = _named(robot, 'link'), _named(robot, 'joint')
        if not self.links:
            raise CtcError('URDF: it has no link')
        for link in self.links.values():
            _check_inertia(link)
        self.ends = _outwards(self.links, {
            name: (_link(joint, 'parent', self.links), _link(joint, 'child', self.links))
            for name, joint in self._elements.items()})
        self.origins = {name: origin(f'joint {name}', joint)
                        for name, joint in self._elements.items()}
        self.axes: dict[str, tuple[float, float, float]] = {}
        self.joints: dict[str, Joint] = {}
        for name in self.ends:
            kind = self._elements[name].get('type', '')
            if kind in _MOVABLE:
                self.joints[name] = _joint(self._elements[name])
                self.axes[name] = axis(f'joint {name}', self._elements[name])
            elif kind != 'fixed':
                raise CtcError(f'URDF: joint {name} is {kind!r}; an arm has fixed joints, and '
                               f'joints with one degree of freedom: {", ".join(_MOVABLE)}')

    @property
    def movable(self) -> tuple[str, ...]:
        """Names of the joints a model can have: they mimic none, and none mimics them."""
        leaders = {joint.mimic.leader for joint in self.joints.values() if joint.mimic}
        return tuple(name for name, joint in self.joints.items()
                     if joint.mimic is None and name not in leaders)

    def locked(self, chosen: Sequence[str], positions: Mapping[str, float]) -> dict[str, float]:
        """
        Return where every joint stands that is not one of `chosen` [rad or m].

        Parameters
        ----------
        chosen : sequence of str
            Joints of the model.
        positions : mapping of str to float
            Positions of others; 0 for those left out. A joint that mimics goes with its leader.

        Raises
        ------
        CtcError
            If a name is wrong, or a joint of the model mimics another or is mimicked.

        """
        for name in chosen:
            joint = self.joints.get(name)
            if joint is None:
                raise ParameterError('joint_names', tuple(chosen), 'movable joints of the URDF: '
                                     f'{", ".join(self.movable)}{near(name, self.movable)}')
            if joint.mimic is not None:
                raise CtcError(f'URDF: joint {name} mimics {joint.mimic.leader} and cannot be a '
                               'joint of the model')
        free = [name for name, joint in self.joints.items()
                if joint.mimic is None and name not in chosen]
        for name, value in positions.items():
            if name not in free or not abs(value) < _INF:
                raise ParameterError(
                    'locked', f'{name}: {value}',
                    f'finite positions of joints not in joint_names: {", ".join(free) or "none"}')
        stand = {name: positions.get(name, 0.0) for name in free}
        for name, (*_, mimic) in self.joints.items():
            if mimic is not None:
                if mimic.leader not in free:
                    raise CtcError(f'URDF: joint {name} mimics {mimic.leader}, which is a joint '
                                   'of the model, mimics another joint, or is not movable')
                stand[name] = mimic.multiplier * stand[mimic.leader] + mimic.offset
        return stand

    def bare(self) -> str:
        """
        Return a URDF of links with their inertias and joints with their places and axes.

        No meshes, so that no file is looked for; no limits. A continuous joint is a revolute one
        here: to the dynamics there is no difference. Links and fixed joints get other names: in
        Pinocchio, but not in a URDF, those of joints and links must differ.
        """
        robot = ET.Element('robot', name='robot')
        names = {name: f'link {i}' for i, name in enumerate(self.links)}
        for name, link in self.links.items():
            ET.SubElement(robot, 'link', name=names[name]).extend(link.findall('inertial'))
        for i, (name, joint) in enumerate(self._elements.items()):
            made = ET.SubElement(robot, 'joint', name=name if name in self.joints else (
                f'fixed joint {i}'), type=joint.get('type', '').replace('continuous', 'revolute'))
            for tag, end in zip(('parent', 'child'), self.ends[name]):
                ET.SubElement(made, tag, link=names[end])
            for tag in ('origin', 'axis'):
                made.extend(joint.findall(tag))
            ET.SubElement(made, 'limit', lower='-1', upper='1', effort='0', velocity='0')
        return ET.tostring(robot, encoding='unicode')


def parse_description(text: str) -> ET.Element:
    """
    Return the outermost element of a robot's description, URDF or MJCF.

    Raises
    ------
    CtcError
        If the text is not XML, or of a size at which the parsers in C++ take minutes or overflow
        the stack.

    """
    if len(text) > _CHARACTERS:
        raise CtcError(f'the description is too large: {len(text)} characters, of '
                       f'{_CHARACTERS} at most')
    if '<!ENTITY' in text:
        raise CtcError('the description declares XML entities')
    try:
        root = ET.fromstring(text.strip())
    except (ET.ParseError, ValueError) as error:
        raise CtcError(f'the description is not XML: {error}') from None
    bodies = sum(element.tag in ('link', 'body') for element in root.iter())
    if bodies > _BODIES:
        raise CtcError(f'the description is too large: {bodies} bodies, of {_BODIES} at most')
    return root


def _named(robot: ET.Element, tag: str) -> dict[str, ET.Element]:
    """Return the links, or joints, by name; raise unless each has a name of its own."""
    found: dict[str, ET.Element] = {}
    for element in robot.findall(tag):
        name = element.get('name', '')
        if not name or name in found:
            raise CtcError(f'URDF: {f"two {tag}s are" if name else f"a {tag} is not"} '
                           f'named {name}'.rstrip())
        found[name] = element
    return found


def _outwards(links: Collection[str], ends: Mapping[str, tuple[str, str]]
              ) -> dict[str, tuple[str, str]]:
    """Return joints and their links from the root outwards; raise if they do not form one tree."""
    above: dict[str, str] = {}
    children: dict[str, list[str]] = {link: [] for link in links}
    for name, (parent, child) in ends.items():
        if child in above:
            raise CtcError(f'URDF: joints {above[child]} and {name} both carry link {child}: '
                           'a closed chain')
        above[child] = name
        children[parent].append(child)
    waiting = [link for link in links if link not in above]
    if len(waiting) > 1:
        raise CtcError(f'URDF: no joint carries the links {", ".join(waiting)}, but one link '
                       'alone can be the base')
    found: dict[str, tuple[str, str]] = {}
    while waiting:
        link = waiting.pop()
        if link in above:
            found[above[link]] = ends[above[link]]
        waiting += reversed(children[link])
    if len(found) < len(ends):
        circle = ', '.join(name for name in ends if name not in found)
        raise CtcError(f'URDF: joints {circle} form a closed chain')
    return found


def _link(joint: ET.Element, tag: str, links: Collection[str]) -> str:
    """Return the name of the link on one side of a joint."""
    element = joint.find(tag)
    name = '' if element is None else element.get('link', '')
    if name not in links:
        raise CtcError(f'URDF: the {tag} of joint {joint.get("name")} is '
                       f'{f"{name}, which is no link" if name else "missing"}')
    return name


def _check_inertia(link: ET.Element) -> None:
    """Raise unless inertias can be read; the parser would leave them out."""
    for inertial in link.findall('inertial'):
        where = f'inertial of link {link.get("name")}'
        for tag, keys in (('mass', ('value',)),
                          ('inertia', ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz'))):
            element = inertial.find(tag)
            if element is None:
                raise CtcError(f'URDF: {where} has no {tag}')
            for key in keys:
                numbers(where, f'{tag} {key}', element.get(key, ''), 1)
        origin(where, inertial)


def _joint(element: ET.Element) -> Joint:
    name, kind = element.get('name', ''), element.get('type', '')
    where, found = f'joint {name}', element.find('limit')
    limit = {} if found is None else found.attrib
    low, high, velocity, effort = (numbers(where, key, limit.get(key, '0'), 1, _INF)[0]
                                   for key in ('lower', 'upper', 'velocity', 'effort'))
    acceleration = min(numbers(where, key, limit.get(key, 'inf'), 1, _INF)[0] or _INF
                       for key in ('acceleration', 'deceleration'))
    dynamics = element.find('dynamics')
    (rotor_inertia,) = (0.0,) if dynamics is None else numbers(  # It is not in the standard.
        where, 'rotor_inertia', dynamics.get('rotor_inertia', '0'), 1)
    if rotor_inertia < 0.0:
        raise CtcError(f'URDF: {where}: rotor_inertia is {rotor_inertia:g}; it must not be '
                       'negative')
    if kind == 'continuous' or low == high == 0.0:
        low, high = -_INF, _INF
    mimic, follows = None, element.find('mimic')
    if follows is not None:
        (multiplier,) = numbers(where, 'multiplier', follows.get('multiplier', '1'), 1)
        (offset,) = numbers(where, 'offset', follows.get('offset', '0'), 1)
        mimic = Mimic(follows.get('joint', ''), multiplier, offset)
    return Joint(name, kind, (low, high), velocity or _INF, effort or _INF, acceleration,
                 rotor_inertia, mimic)
