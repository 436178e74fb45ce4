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
A URDF with other inertial parameters, rotor inertias and direction of gravity.

All else stays, comments too; only spaces within tags may change. Links that are fixed
to each other are one body: the heaviest takes the difference. Where no link can have what is left
for it, each takes the part of the whole body that it has of the mass. A tilt is in a fixed joint
between a new root, which is level, and the old one. A rotor inertia, reflected to the joint, is
`rotor_inertia` in <dynamics>: RaiSim and `urdf_model` read it, others pass over it. `with_payload`
adds a body at the end of an arm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import atan2, degrees, hypot
import xml.etree.ElementTree as ET

from ctc_chattering.dynamics.description_xml import parse_description
from ctc_chattering.dynamics.pseudo_inertia import parameters_of, pseudo_inertia
from ctc_chattering.dynamics.urdf_model import pinocchio, UrdfModel
from ctc_chattering.dynamics.urdf_parser import origin, Tree
from ctc_chattering.errors import CtcError, ParameterError, suggest
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Name of the link that is level.
_LEVEL = 'world'
#: Relative change that is none.
_SAME = 1e-12
#: Error of the text, relative to a body.
_EXACT = 1e-9
_INERTIA = ('ixx', 'ixy', 'iyy', 'ixz', 'iyz', 'izz')


def corrected_urdf(description: str, joints: Sequence[str], parameters: Array,
                   rotor: Sequence[float] = (), gravity: Sequence[float] = (0.0, 0.0, -1.0),
                   locked: Mapping[str, float] | None = None) -> str:
    """
    Return a URDF with given parameters of its moved bodies.

    Parameters
    ----------
    description : str
        The URDF.
    joints : sequence of str, length n
        Joints of the model.
    parameters : ndarray, shape (n, 10)
        Mass [kg], first moments [kg·m] and inertia [kg·m²] of the body that each joint moves,
        about the joint's frame, in Pinocchio's order; every one must be that of a body.
    rotor : sequence of float, length n
        Rotor inertias, reflected to the joints [kg·m²]; empty for those of the URDF.
    gravity : sequence of float, length 3
        In the frame of the root; its direction counts. By default along -z.
    locked : mapping of str to float, optional
        As the model has it.

    Raises
    ------
    CtcError
        If no body has such parameters, or the URDF is not that of a model.

    """
    for row in parameters:
        if not _possible(pseudo_inertia(row)):
            raise CtcError(f'no body can have the inertial parameters {row.tolist()}')
    if len(gravity) != 3 or not np.linalg.norm(gravity) > 0.0:
        raise CtcError(f'gravity must be three numbers that are not all 0: {list(gravity)}')
    model, tree = UrdfModel(description, joints, locked=locked), Tree(description)
    robot = parse_description(description, comments=True)
    links, elements = ({x.get('name', ''): x for x in robot.findall(tag)}
                       for tag in ('link', 'joint'))
    for i in range(model.n):
        for name, inertia in _changed(model, tree, i, pseudo_inertia(parameters[i])).items():
            _set_inertial(links[name], inertia)
    for name, value in zip(joints, rotor):
        if abs(value - tree.joints[name].rotor_inertia) > _SAME:
            _set_rotor(elements[name], value)
    _tilt(robot, tree, gravity)
    header = description[:description.index('<robot')]
    result = header + ET.tostring(robot, encoding='unicode') + '\n'
    _verify(UrdfModel(result, joints, locked=locked), parameters, rotor)
    return result


def _possible(matrix: Array) -> bool:
    """Return whether a body can have a pseudo-inertia; it needs a mass."""
    mass = matrix[3, 3]
    if not mass > 0.0:
        return False
    length = np.sqrt(max(np.trace(matrix[:3, :3]) / mass, 1e-12))
    scale = np.array([length] * 3 + [1.0]) * np.sqrt(mass)
    return bool(np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0] > -_SAME)


def _changed(model: UrdfModel, tree: Tree, i: int, body: Array) -> dict[str, Array]:
    """Return the pseudo-inertias, in their own frames, of links whose body is to have another."""
    at = {name: place for name, (joint, place) in model.places().items() if joint == i}
    links = {name: place @ _link_inertia(tree.links[name]) @ place.T
             for name, place in at.items()}
    before = sum(links.values())
    if np.abs(body - before).max() <= _SAME * np.abs(body).max():
        return {}
    heaviest = max(links, key=lambda name: float(links[name][3, 3]))
    left = body - (before - links[heaviest])
    if _possible(left):
        changed = {heaviest: left}
    else:
        mass = before[3, 3]
        changed = {name: x[3, 3] / mass * body for name, x in links.items() if x[3, 3] > 0.0}
    back = {name: np.linalg.inv(at[name]) for name in changed}
    return {name: back[name] @ x @ back[name].T for name, x in changed.items()}


def _link_inertia(link: ET.Element) -> Array:
    """Return the pseudo-inertia of a link in its frame."""
    inertial = link.find('inertial')
    if inertial is None:
        return np.zeros((4, 4))
    mass, inertia = inertial.find('mass'), inertial.find('inertia')
    assert mass is not None and inertia is not None  # Tree has checked them.
    m = float(mass.get('value', '0'))
    about = [float(inertia.get(key, '0')) for key in _INERTIA]
    place = origin('', inertial)
    turn = np.eye(4)
    turn[:3, :3], turn[:3, 3] = pinocchio().rpy.rpyToMatrix(*place.rpy), place.xyz
    found: Array = turn @ pseudo_inertia(np.array([m, 0.0, 0.0, 0.0, *about])) @ turn.T
    return found


def _child(parent: ET.Element, tag: str, **attributes: str) -> ET.Element:
    """Return the first child of a kind; a new one with some attributes, if there is none."""
    found = parent.find(tag)
    return ET.SubElement(parent, tag, attributes) if found is None else found


def _words(values: Sequence[float]) -> str:
    return ' '.join(map(repr, values))


def _set_inertial(link: ET.Element, matrix: Array) -> None:
    """Give a link its inertia."""
    mass, *moments = parameters_of(matrix)[:4].tolist()
    center = np.array(moments) / mass
    about = parameters_of(matrix - mass * np.outer([*center, 1.0], [*center, 1.0]))[4:].tolist()
    inertial = _child(link, 'inertial')
    for part in list(inertial):
        inertial.remove(part)
    inertial.text = None
    inertial.append(ET.Comment(' identified '))
    ET.SubElement(inertial, 'origin', xyz=_words(center.tolist()), rpy='0 0 0')
    ET.SubElement(inertial, 'mass', value=repr(mass))
    ET.SubElement(inertial, 'inertia', {key: repr(x) for key, x in zip(_INERTIA, about)})


def _set_rotor(joint: ET.Element, inertia: float) -> None:
    """Give a joint the inertia of its rotor, reflected to it [kg·m²]."""
    # Without damping or friction, urdfdom refuses the element.
    dynamics = _child(joint, 'dynamics', damping='0')
    dynamics.set('rotor_inertia', repr(float(inertia)))


def with_rotors(description: str, inertias: Mapping[str, float]) -> str:
    """Return a URDF with the inertias of some rotors, reflected to their joints [kg·m²]."""
    robot = parse_description(description)
    for joint in robot.findall('joint'):
        if joint.get('name') in inertias:
            _set_rotor(joint, inertias[joint.get('name', '')])
    return ET.tostring(robot, encoding='unicode')


def _tilt(robot: ET.Element, tree: Tree, gravity: Sequence[float]) -> None:
    """Turn the arm so that gravity is along -z of the root, a new one."""
    x, y, z = gravity
    if hypot(x, y) <= _SAME * abs(z) and z < 0.0:
        return
    (root, _), name = next(iter(tree.ends.values())), _LEVEL
    while name in tree.links or name in tree.ends:
        name += '_'
    robot.append(ET.Comment(
        f' identified: tilted by {degrees(atan2(hypot(x, y), -z)):.3g} degrees '))
    ET.SubElement(robot, 'link', name=name)
    # Pinocchio keeps links and fixed joints in one table of names.
    joint = ET.SubElement(robot, 'joint', name=f'{name}_to_{root}', type='fixed')
    # Ry(pitch) Rx(roll) brings gravity in the root's frame to -z.
    ET.SubElement(joint, 'origin', xyz='0 0 0',
                  rpy=_words((atan2(-y, -z), atan2(x, hypot(y, z)), 0.0)))
    ET.SubElement(joint, 'parent', link=name)
    ET.SubElement(joint, 'child', link=root)


def _verify(model: UrdfModel, parameters: Array, rotor: Sequence[float]) -> None:
    """Raise `CtcError` unless the new text is read as it should be."""
    size = np.abs(parameters).max(axis=1, keepdims=True)
    made = model.inertial_parameters().reshape(-1, 10)
    error = float((np.abs(made - parameters) / size).max())
    if not error <= _EXACT or (len(rotor) and list(rotor) != list(model.rotor_inertias)):
        raise CtcError('the URDF cannot be corrected: with the parameters written into it, it is '
                       f'read with an error of {error:.2g}')


#: Name of the link and of the joint that are added; radius of the sphere [m].
NAME, _RADIUS = 'ctc_chattering_payload', 0.05


def tip_of(tree: Tree, joint_names: Sequence[str]) -> str:
    """
    Return the last link that follows the last joint of an arm over fixed joints only.

    Raises
    ------
    CtcError
        If there is no such joint.

    """
    if joint_names[-1] not in tree.joints:
        raise ParameterError('joint_names', tuple(joint_names), 'joints of the description')
    end = tree.ends[joint_names[-1]][1]
    for name, (parent, child) in tree.ends.items():  # From the root outwards.
        if parent == end and name not in tree.joints:
            end = child
    return end


def with_payload(description: str, joint_names: Sequence[str], mass: float, link: str = ''
                 ) -> str:
    """
    Return a URDF with a sphere of 5 cm fixed to the end of the arm, or at the origin of a link.

    The end is the origin of the link that `tip_of` returns.

    Parameters
    ----------
    description : str
        The URDF.
    joint_names : sequence of str
        Joints of the arm.
    mass : float
        Of the sphere, above 0 [kg].
    link : str
        That it is fixed to; empty for the end.

    Raises
    ------
    CtcError
        If the description is no URDF, or lacks the last joint or the link.

    """
    robot = parse_description(description)
    tree = Tree(robot)
    if link and link not in tree.links:
        raise CtcError(f'payload: no link is called {link}; allowed: {", ".join(tree.links)}'
                       f'{suggest(link, tree.links)}')
    end = link or tip_of(tree, joint_names)
    inertia = f'{0.4 * mass * _RADIUS ** 2!r}'
    inertial = ET.SubElement(ET.SubElement(robot, 'link', name=NAME), 'inertial')
    ET.SubElement(inertial, 'mass', value=repr(mass))
    ET.SubElement(inertial, 'inertia', ixx=inertia, iyy=inertia, izz=inertia, ixy='0', ixz='0',
                  iyz='0')
    joint = ET.SubElement(robot, 'joint', name=NAME, type='fixed')
    ET.SubElement(joint, 'parent', link=end)
    ET.SubElement(joint, 'child', link=NAME)
    return ET.tostring(robot, encoding='unicode')
