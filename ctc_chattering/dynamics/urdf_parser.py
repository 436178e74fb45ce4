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

from collections.abc import Collection, Iterable, Mapping, Sequence
from math import hypot
from typing import NamedTuple
import xml.etree.ElementTree as ET

from ctc_chattering.dynamics.description_xml import parse_description, XACRO
from ctc_chattering.errors import CtcError, ParameterError, suggest

#: Types of joint with one degree of freedom.
_MOVABLE = ('revolute', 'continuous', 'prismatic')
_INF = float('inf')
#: Largest number that counts as one.
_LARGEST = 1e300
#: Attributes of the elements of an inertial.
_INERTIAL = {'mass': ('value',), 'inertia': ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')}


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
    x, y, z = _raw_axis(where, joint)
    size = hypot(x, y, z) or 1.0
    return x / size, y / size, z / size


def _raw_axis(where: str, joint: ET.Element) -> list[float]:
    """Return the axis of a joint as the text has it."""
    element = joint.find('axis')
    text = '1 0 0' if element is None else element.get('xyz', '1 0 0')
    return numbers(where, 'axis', text, 3)


def numbers(where: str, what: str, text: str, count: int, most: float = _LARGEST) -> list[float]:
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
    #: Coulomb [N·m or N] and viscous [N·m·s/rad or N·s/m] friction; 0 where the URDF has none.
    friction: float
    damping: float
    mimic: Mimic | None
    #: Contradiction in its limits or friction; empty for none.
    fault: str

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
    name : str
        Of the robot; empty if it has none.
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
    unexpanded : tuple of str
        Macros of xacro that are left in the text, each once. They are ignored, as urdfdom does.

    Raises
    ------
    CtcError
        If the text is no URDF of a tree of such joints.

    """

    def __init__(self, urdf: str | ET.Element) -> None:
        robot = parse_description(urdf) if isinstance(urdf, str) else urdf
        if robot.tag != 'robot':
            raise CtcError(f'URDF: the outermost element is <{robot.tag}>, not <robot>')
        self.unexpanded = tuple(dict.fromkeys(
            element.tag for element in robot.iter() if str(element.tag).startswith(XACRO)))
        self.name = robot.get('name', '')
        self.links, self._elements = _named(robot, 'link'), _named(robot, 'joint')
        if not self.links:
            advice = '; run xacro on it first' if self.unexpanded else ''
            raise CtcError(f'URDF: it has no link{advice}')
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
    def leaders(self) -> dict[str, tuple[str, ...]]:
        """Joints that others mimic, with these."""
        followers: dict[str, tuple[str, ...]] = {}
        for name, joint in self.joints.items():
            if joint.mimic:
                leader = joint.mimic.leader
                followers[leader] = (*followers.get(leader, ()), name)
        return followers

    @property
    def movable(self) -> tuple[str, ...]:
        """Names of the joints a model can have: they mimic none, and none mimics them."""
        leaders = self.leaders
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
                                     f'{", ".join(self.movable)}{suggest(name, self.movable)}')
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
        followers = [name for name, joint in self.joints.items() if joint.mimic is not None]
        return stand | {name: self._following(name, stand) for name in followers}

    def _following(self, follower: str, stand: Mapping[str, float]) -> float:
        """Return the position of a joint that mimics, where leaders `stand` [rad or m]."""
        scale, shift, name = 1.0, 0.0, follower
        for _ in self.joints:
            mimic = self.joints[name].mimic
            if mimic is None:
                return scale * stand[name] + shift
            shift += scale * mimic.offset
            scale *= mimic.multiplier
            leader = self.joints.get(mimic.leader)
            if leader is None or (leader.mimic is None and mimic.leader not in stand):
                what = 'not movable' if leader is None else 'a joint of the model'
                raise CtcError(f'URDF: joint {name} mimics {mimic.leader}, which is {what}')
            name = mimic.leader
        raise CtcError(f'URDF: joint {follower} mimics itself')

    def check_limits(self, names: Iterable[str]) -> None:
        """Raise `CtcError` if limits or friction of one of these joints contradict themselves."""
        for name in names:
            if name in self.joints and self.joints[name].fault:
                raise CtcError(f'URDF: joint {name}: {self.joints[name].fault}')

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
            ET.SubElement(robot, 'link', name=names[name]).extend(
                map(_bare_inertial, link.findall('inertial')))
        for i, (name, joint) in enumerate(self._elements.items()):
            made = ET.SubElement(robot, 'joint', name=name if name in self.joints else (
                f'fixed joint {i}'), type=joint.get('type', '').replace('continuous', 'revolute'))
            for tag, end in zip(('parent', 'child'), self.ends[name]):
                ET.SubElement(made, tag, link=names[end])
            _add_origin(made, self.origins[name])
            ET.SubElement(made, 'axis', xyz=_words(_raw_axis(f'joint {name}', joint)))
            ET.SubElement(made, 'limit', lower='-1', upper='1', effort='0', velocity='0')
        return ET.tostring(robot, encoding='unicode')


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
        for tag, keys in _INERTIAL.items():
            element = inertial.find(tag)
            if element is None:
                raise CtcError(f'URDF: {where} has no {tag}')
            for key in keys:
                (value,) = numbers(where, f'{tag} {key}', element.get(key, ''), 1)
                if tag == 'mass' and value < 0.0:
                    raise CtcError(f'URDF: {where}: mass is {value:g} kg; it must not be negative')
        origin(where, inertial)


def _bare_inertial(inertial: ET.Element) -> ET.Element:
    """Return checked inertias with nothing around their numbers: urdfdom drops those it has."""
    bare = ET.Element('inertial')
    _add_origin(bare, origin('', inertial))
    for tag, keys in _INERTIAL.items():
        element = inertial.find(tag)
        assert element is not None  # _check_inertia has seen it.
        ET.SubElement(bare, tag, {key: repr(float(element.get(key, ''))) for key in keys})
    return bare


def _add_origin(parent: ET.Element, place: Origin) -> None:
    ET.SubElement(parent, 'origin', xyz=_words(place.xyz), rpy=_words(place.rpy))


def _words(values: Iterable[float]) -> str:
    return ' '.join(map(repr, values))


def _joint(element: ET.Element) -> Joint:
    name, kind = element.get('name', ''), element.get('type', '')
    where = f'joint {name}'

    def number(tag: str, key: str, default: str = '0', most: float = _INF) -> float:
        part = element.find(tag)
        text = default if part is None else part.get(key, default)
        return numbers(where, key, text, 1, most)[0]

    sizes = {key: number('limit', key) for key in ('effort', 'velocity')}
    sizes |= {key: number('limit', key, 'inf') for key in ('acceleration', 'deceleration')}
    sizes |= {key: number('dynamics', key, most=_LARGEST) for key in ('friction', 'damping')}
    rotor_inertia = number('dynamics', 'rotor_inertia', most=_LARGEST)  # Not in the standard.
    if rotor_inertia < 0.0:
        raise CtcError(f'URDF: {where}: rotor_inertia is {rotor_inertia:g}; it must not be '
                       'negative')
    low, high = number('limit', 'lower'), number('limit', 'upper')
    if kind == 'continuous' or low == high == 0.0:
        low, high = -_INF, _INF
    acceleration = min(sizes[key] or _INF for key in ('acceleration', 'deceleration'))
    return Joint(name, kind, (low, high), sizes['velocity'] or _INF, sizes['effort'] or _INF,
                 acceleration, rotor_inertia, sizes['friction'], sizes['damping'],
                 _mimic(where, element), _fault(sizes) or _fault_of_range(low, high))


def _mimic(where: str, element: ET.Element) -> Mimic | None:
    mimic = element.find('mimic')
    if mimic is None:
        return None
    (multiplier,) = numbers(where, 'multiplier', mimic.get('multiplier', '1'), 1)
    (offset,) = numbers(where, 'offset', mimic.get('offset', '0'), 1)
    return Mimic(mimic.get('joint', ''), multiplier, offset)


def _fault(sizes: Mapping[str, float]) -> str:
    """Return which of some sizes is negative; empty for none."""
    for name, value in sizes.items():
        if value < 0.0 and name in ('effort', 'velocity'):
            return (f'{name} is {value:g}, which Gazebo takes for no limit and ros2_control for '
                    f'{-value:g}; write 0 for no limit, or the limit')
        if value < 0.0:
            return f'{name} is {value:g}; it must not be negative'
    return ''


def _fault_of_range(low: float, high: float) -> str:
    """Return the fault of limits that leave no room; simulators take some for no limits."""
    return '' if low < high else (
        f'lower is {low:g} and upper {high:g}, where one that is missing is 0; lower must be '
        'below upper, or both 0 for no limits')
