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
Links and joints of a URDF as one tree.

Models, kinematics, joint limits and `ctc new-robot` read descriptions here. Input is the text of
the URDF, or the element that `parse_description` returns. `Tree.bare` writes what Pinocchio needs.
"""

from __future__ import annotations

from collections.abc import Collection, Container, Iterable, Mapping, Sequence
from math import hypot, inf
from typing import NamedTuple
import xml.etree.ElementTree as ET

from ctc_chattering.dynamics.description_xml import parse_description, XACRO
from ctc_chattering.errors import CtcError, ParameterError, suggest

#: Larger numbers are refused: sums of their squares overflow.
_LARGEST_NUMBER = 1e300
#: Attributes of an inertia.
MOMENTS = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')


#: Types of joint with one degree of freedom.
_MOVABLE = ('revolute', 'continuous', 'prismatic')


class Origin(NamedTuple):
    """A frame in that of its parent."""

    #: x, y and z [m].
    xyz: tuple[float, ...] = (0.0, 0.0, 0.0)
    #: Roll, pitch and yaw [rad].
    rpy: tuple[float, ...] = (0.0, 0.0, 0.0)


def parse_numbers(
    where: str, attribute: str, text: str, count: int, largest: float = _LARGEST_NUMBER
) -> list[float]:
    """Return the numbers of an attribute, none above `largest`."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(abs(x) <= largest for x in values):
        expected = 'a number' if count == 1 else f'{count} numbers'
        raise CtcError(f'URDF: {where}: {attribute} is {text!r}, not {expected}')
    return values


def number_text(values: Iterable[float]) -> str:
    """Return numbers as an attribute has them, without rounding."""
    return ' '.join(map(repr, values))


def parse_origin(where: str, element: ET.Element) -> Origin:
    """Return the origin of an element, zeros without one."""

    def triple(key: str) -> tuple[float, ...]:
        text = _attribute(element, 'origin', key, '0 0 0')
        return tuple(parse_numbers(where, f'origin {key}', text, 3))

    return Origin(triple('xyz'), triple('rpy'))


def _attribute(parent: ET.Element, tag: str, key: str, default: str = '') -> str:
    """Return an attribute of the first child with a tag."""
    child = parent.find(tag)
    return default if child is None else child.get(key, default)


class Inertial(NamedTuple):
    """Mass and inertia of a link."""

    #: The centre of mass, and the axes of the moments, in the frame of the link.
    origin: Origin
    #: [kg]
    mass: float
    #: Elements of the inertia about the centre by attribute, ``ixx`` and so on [kg·m²].
    moments: Mapping[str, float]


class Mimic(NamedTuple):
    """A position that follows: multiplier * leader + offset."""

    leader: str
    multiplier: float
    offset: float


class Joint(NamedTuple):
    """A joint with one degree of freedom."""

    name: str
    #: ``revolute``, ``continuous`` or ``prismatic``.
    joint_type: str
    #: Direction of the axis, of length 1, or zeros where the text says so.
    axis: tuple[float, ...]
    #: Least and greatest position [rad or m], ∓inf without limits.
    position: tuple[float, float]
    #: Greatest speed [rad/s or m/s], inf where the URDF has none, or 0.
    velocity: float
    #: Greatest effort [N·m or N], inf where the URDF has none, or 0.
    effort: float
    #: Greatest acceleration and deceleration of URDF 1.2 [rad/s² or m/s²], inf for none.
    acceleration: float
    #: Inertia of the rotor, reflected to the joint [kg·m² or kg]. No body includes it.
    rotor_inertia: float
    #: Coulomb friction [N·m or N].
    friction: float
    #: Viscous friction [N·m·s/rad or N·s/m].
    damping: float
    mimic: Mimic | None
    #: Contradiction in its limits or friction, as a user reads it. Empty for none.
    fault: str

    @property
    def continuous(self) -> bool:
        """Return whether the joint turns endlessly."""
        return self.joint_type == 'continuous'

    @property
    def prismatic(self) -> bool:
        """Return whether the joint slides."""
        return self.joint_type == 'prismatic'

    @property
    def position_unit(self) -> str:
        """Return the unit of the position."""
        return 'm' if self.prismatic else 'rad'


class Tree:
    """
    The links and joints of a URDF.

    Parameters
    ----------
    urdf : str or Element
        Its text, or the element of `parse_description`.

    Attributes
    ----------
    name : str
        Name of the robot, empty without one.
    root : str
        Link that no joint carries.
    links : dict of str to Element
        All links, in the order of the text.
    inertials : dict of str to Inertial or None
        Mass and inertia of each link.
    ends : dict of str to (str, str)
        Parent and child link of every joint, fixed ones included, from the root outwards.
    carriers : dict of str to str
        Joint that carries each link but the root.
    joints : dict of str to Joint
        Joints with one degree of freedom, from the root outwards.
    origins : dict of str to Origin
        Frame of every joint on its parent link.
    unexpanded : tuple of str
        Macros of xacro that are still in the text. They are ignored, as urdfdom does.

    Raises
    ------
    CtcError
        If the text is no URDF of a tree of such joints.

    """

    def __init__(self, urdf: str | ET.Element) -> None:
        robot = parse_description(urdf) if isinstance(urdf, str) else urdf
        if robot.tag != 'robot':
            raise CtcError(f'URDF: the outermost element is <{robot.tag}>, not <robot>')
        self.unexpanded = tuple(
            dict.fromkeys(
                element.tag
                for element in robot.iter()
                if str(element.tag).startswith(XACRO)
            )
        )
        self.name = robot.get('name', '')
        self.links = _elements_by_name(robot, 'link')
        self._elements = _elements_by_name(robot, 'joint')
        if not self.links:
            advice = '; run xacro on it first' if self.unexpanded else ''
            raise CtcError(f'URDF: it has no link{advice}')
        self.inertials = {name: _inertial(link) for name, link in self.links.items()}
        self.ends = {
            name: (
                _link_name(joint, 'parent', self.links),
                _link_name(joint, 'child', self.links),
            )
            for name, joint in self._elements.items()
        }
        self.carriers = _carriers(self.ends)
        self.root = _root(self.links, self.carriers)
        self.ends = {name: self.ends[name] for name in self._joints_outwards()}
        self.origins = {
            name: parse_origin(f'joint {name}', joint)
            for name, joint in self._elements.items()
        }
        self.joints: dict[str, Joint] = {}
        for name in self.ends:
            joint_type = self._elements[name].get('type', '')
            if joint_type in _MOVABLE:
                self.joints[name] = _joint(self._elements[name])
            elif joint_type != 'fixed':
                raise CtcError(
                    f'URDF: joint {name} is {joint_type!r}; an arm has fixed joints, '
                    f'and joints with one degree of freedom: {", ".join(_MOVABLE)}'
                )

    def joints_on(self, link: str) -> list[str]:
        """Return the joints whose parent is a link."""
        return [name for name, (parent, _) in self.ends.items() if parent == link]

    def _joints_outwards(self) -> list[str]:
        """Return all joints of the tree, from the root outwards."""
        outwards: list[str] = []
        waiting = self.joints_on(self.root)
        while waiting:
            name = waiting.pop(0)
            outwards.append(name)
            waiting = self.joints_on(self.ends[name][1]) + waiting
        if len(outwards) < len(self.ends):
            circle = ', '.join(name for name in self.ends if name not in outwards)
            raise CtcError(f'URDF: joints {circle} form a closed chain')
        return outwards

    @property
    def leaders(self) -> dict[str, tuple[str, ...]]:
        """Joints that others mimic, each with its followers."""
        followers: dict[str, tuple[str, ...]] = {}
        for name, joint in self.joints.items():
            if joint.mimic:
                leader = joint.mimic.leader
                followers[leader] = (*followers.get(leader, ()), name)
        return followers

    @property
    def movable(self) -> tuple[str, ...]:
        """Joints of a model: they neither mimic nor lead."""
        leaders = self.leaders
        return tuple(
            name
            for name, joint in self.joints.items()
            if joint.mimic is None and name not in leaders
        )

    def locked(
        self, selected: Sequence[str], positions: Mapping[str, float]
    ) -> dict[str, float]:
        """
        Return the position of every joint not in `selected`.

        Parameters
        ----------
        selected : sequence of str
            Joints of the model.
        positions : mapping of str to float
            Positions of other joints. The default is 0. A joint that mimics follows its leader.

        Raises
        ------
        CtcError
            If a name is wrong, or a joint of the model mimics another or is mimicked.

        """
        self._check_selected(selected)
        free = [
            name
            for name, joint in self.joints.items()
            if joint.mimic is None and name not in selected
        ]
        for name, value in positions.items():
            if name not in free or not abs(value) < inf:
                raise ParameterError(
                    'locked',
                    f'{name}: {value}',
                    f'finite positions of joints not in joint_names: {", ".join(free) or "none"}',
                )
        leading = {name: positions.get(name, 0.0) for name in free}
        return {
            name: self._position(name, leading)
            for name in self.joints
            if name not in selected
        }

    def _check_selected(self, selected: Sequence[str]) -> None:
        """Raise `CtcError` unless a model can have the joints."""
        for name in selected:
            joint = self.joints.get(name)
            if joint is None:
                movable = self.movable
                raise ParameterError(
                    'joint_names',
                    tuple(selected),
                    f'movable joints of the URDF: {", ".join(movable)}{suggest(name, movable)}',
                )
            if joint.mimic is not None:
                raise CtcError(
                    f'URDF: joint {name} mimics {joint.mimic.leader} and cannot be a '
                    'joint of the model'
                )

    def _position(
        self, name: str, leading: Mapping[str, float], followers: tuple[str, ...] = ()
    ) -> float:
        """Return the position of a free or following joint."""
        mimic = self.joints[name].mimic
        if mimic is None:
            return leading[name]
        if name in followers:
            raise CtcError(f'URDF: joint {name} mimics itself')
        leader = self.joints.get(mimic.leader)
        if leader is None or (leader.mimic is None and mimic.leader not in leading):
            fault = 'not movable' if leader is None else 'a joint of the model'
            raise CtcError(
                f'URDF: joint {name} mimics {mimic.leader}, which is {fault}'
            )
        position = self._position(mimic.leader, leading, (*followers, name))
        return mimic.multiplier * position + mimic.offset

    def check_limits(self, names: Iterable[str]) -> None:
        """Raise `CtcError` if limits or friction contradict themselves."""
        for name in names:
            joint = self.joints.get(name)
            if joint and joint.fault:
                raise CtcError(f'URDF: joint {name}: {joint.fault}')

    def bare(self) -> str:
        """
        Return a URDF with inertias, origins and axes alone.

        Without meshes, no file is looked for. A continuous joint becomes a revolute one, which
        has the same dynamics. Links and fixed joints get other names: in Pinocchio, unlike in a
        URDF, a joint must not have the name of a link. Link i is called ``link i``.
        """
        robot = ET.Element('robot', name='robot')
        bare_names = {name: f'link {i}' for i, name in enumerate(self.links)}
        for name, inertial in self.inertials.items():
            link = ET.SubElement(robot, 'link', name=bare_names[name])
            if inertial is not None:
                # Numbers without spaces around them: urdfdom does not read those.
                fill_inertial(ET.SubElement(link, 'inertial'), inertial)
        for i, (name, joint) in enumerate(self._elements.items()):
            bare_type = joint.get('type', '').replace('continuous', 'revolute')
            bare_name = name if name in self.joints else f'fixed joint {i}'
            parent, child = self.ends[name]
            bare = add_joint(
                robot, bare_name, bare_type, bare_names[parent], bare_names[child]
            )
            add_origin(bare, self.origins[name])
            ET.SubElement(bare, 'axis', xyz=number_text(_axis_numbers(joint)))
            ET.SubElement(
                bare, 'limit', lower='-1', upper='1', effort='0', velocity='0'
            )
        return ET.tostring(robot, encoding='unicode')


def _elements_by_name(robot: ET.Element, tag: str) -> dict[str, ET.Element]:
    """Return links or joints by their unique names."""
    elements: dict[str, ET.Element] = {}
    for element in robot.findall(tag):
        name = element.get('name', '')
        if not name:
            raise CtcError(f'URDF: a {tag} is not named')
        if name in elements:
            raise CtcError(f'URDF: two {tag}s are named {name}')
        elements[name] = element
    return elements


def _link_name(joint: ET.Element, tag: str, links: Collection[str]) -> str:
    """Return the parent or child link of a joint."""
    name = _attribute(joint, tag, 'link')
    if name not in links:
        fault = f'{name}, which is no link' if name else 'missing'
        raise CtcError(f'URDF: the {tag} of joint {joint.get("name")} is {fault}')
    return name


def _carriers(ends: Mapping[str, tuple[str, str]]) -> dict[str, str]:
    """Return the one joint that carries each link."""
    carriers: dict[str, str] = {}
    for name, (_, child) in ends.items():
        if child in carriers:
            raise CtcError(
                f'URDF: joints {carriers[child]} and {name} both carry link {child}: '
                'a closed chain'
            )
        carriers[child] = name
    return carriers


def _root(links: Iterable[str], carriers: Container[str]) -> str:
    """Return the only link that no joint carries."""
    roots = [link for link in links if link not in carriers]
    if len(roots) > 1:
        raise CtcError(
            f'URDF: no joint carries the links {", ".join(roots)}, but one link '
            'alone can be the base'
        )
    return ''.join(roots)


def _inertial(link: ET.Element) -> Inertial | None:
    """Return the first inertial of a link."""
    where = f'inertial of link {link.get("name")}'
    inertials = [
        _parse_inertial(where, element) for element in link.findall('inertial')
    ]
    return inertials[0] if inertials else None


def _parse_inertial(where: str, inertial: ET.Element) -> Inertial:
    def number(tag: str, key: str) -> float:
        element = inertial.find(tag)
        if element is None:
            raise CtcError(f'URDF: {where} has no {tag}')
        return parse_numbers(where, f'{tag} {key}', element.get(key, ''), 1)[0]

    mass = number('mass', 'value')
    if mass < 0.0:
        raise CtcError(f'URDF: {where}: mass is {mass:g} kg; it must not be negative')
    moments = {key: number('inertia', key) for key in MOMENTS}
    return Inertial(parse_origin(where, inertial), mass, moments)


def fill_inertial(element: ET.Element, inertial: Inertial) -> None:
    """Add mass and inertia to an element."""
    add_origin(element, inertial.origin)
    ET.SubElement(element, 'mass', value=repr(inertial.mass))
    ET.SubElement(
        element,
        'inertia',
        {key: repr(moment) for key, moment in inertial.moments.items()},
    )


def add_joint(
    robot: ET.Element, name: str, joint_type: str, parent: str, child: str
) -> ET.Element:
    """Add a joint between two links, and return it."""
    joint = ET.SubElement(robot, 'joint', name=name, type=joint_type)
    ET.SubElement(joint, 'parent', link=parent)
    ET.SubElement(joint, 'child', link=child)
    return joint


def add_origin(parent: ET.Element, origin: Origin) -> None:
    """Add an origin to an element."""
    ET.SubElement(
        parent, 'origin', xyz=number_text(origin.xyz), rpy=number_text(origin.rpy)
    )


def _axis_numbers(joint: ET.Element) -> list[float]:
    """Return the axis as the text has it."""
    text = _attribute(joint, 'axis', 'xyz', '1 0 0')
    return parse_numbers(f'joint {joint.get("name")}', 'axis', text, 3)


def _joint(element: ET.Element) -> Joint:
    """Return a joint with one degree of freedom."""
    name = element.get('name', '')
    joint_type = element.get('type', '')
    where = f'joint {name}'

    def number(tag: str, key: str, default: str = '0') -> float:
        text = _attribute(element, tag, key, default)
        largest = inf if tag == 'limit' else _LARGEST_NUMBER
        return parse_numbers(where, key, text, 1, largest)[0]

    sizes = {
        'effort': number('limit', 'effort'),
        'velocity': number('limit', 'velocity'),
        'acceleration': number('limit', 'acceleration', 'inf'),
        'deceleration': number('limit', 'deceleration', 'inf'),
        'friction': number('dynamics', 'friction'),
        'damping': number('dynamics', 'damping'),
    }
    # Not in the standard.
    rotor_inertia = number('dynamics', 'rotor_inertia')
    if rotor_inertia < 0.0:
        raise CtcError(
            f'URDF: {where}: rotor_inertia is {rotor_inertia:g}; it must not be negative'
        )
    low = number('limit', 'lower')
    high = number('limit', 'upper')
    if joint_type == 'continuous' or low == high == 0.0:
        low = -inf
        high = inf
    axis = _axis_numbers(element)
    length = hypot(*axis) or 1.0
    mimic = None
    if element.find('mimic') is not None:
        mimic = Mimic(
            _attribute(element, 'mimic', 'joint'),
            number('mimic', 'multiplier', '1'),
            number('mimic', 'offset'),
        )
    return Joint(
        name,
        joint_type,
        tuple(x / length for x in axis),
        (low, high),
        velocity=sizes['velocity'] or inf,
        effort=sizes['effort'] or inf,
        acceleration=min(sizes['acceleration'] or inf, sizes['deceleration'] or inf),
        rotor_inertia=rotor_inertia,
        friction=sizes['friction'],
        damping=sizes['damping'],
        mimic=mimic,
        fault=_negative_size(sizes) or _empty_range(low, high),
    )


def _negative_size(sizes: Mapping[str, float]) -> str:
    """Return the fault of a negative size, or nothing."""
    for name, value in sizes.items():
        if value < 0.0:
            advice = '; it must not be negative'
            if name in ('effort', 'velocity'):
                advice = (
                    ', which Gazebo takes for no limit and ros2_control for '
                    f'{-value:g}; write 0 for no limit, or the limit'
                )
            return f'{name} is {value:g}{advice}'
    return ''


def _empty_range(low: float, high: float) -> str:
    """Return the fault of limits without positions, or nothing."""
    if low < high:
        return ''
    return (
        f'lower is {low:g} and upper {high:g}, where one that is missing is 0; lower must be '
        'below upper, or both 0 for no limits'
    )
