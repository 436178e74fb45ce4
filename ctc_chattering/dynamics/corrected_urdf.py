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
A URDF with identified bodies, rotors and gravity.

`ctc identify` writes the robot that it has identified. All other text stays, including comments.
Only spaces within tags may change.

Links that are fixed to each other are one body. The heaviest of them takes the whole difference.
Where it cannot, every link takes a share of the identified body in proportion to its mass. A tilt
becomes a fixed joint between a new level root and the old root. A rotor inertia, reflected to the
joint, is `rotor_inertia` in <dynamics>. RaiSim and `urdf_model` read it, other programs ignore it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import atan2, degrees, hypot
import xml.etree.ElementTree as ET

from ctc_chattering.dynamics.description_xml import parse_description
from ctc_chattering.dynamics.kinematics import ForwardKinematics, origin_pose
from ctc_chattering.dynamics.pseudo_inertia import (
    is_possible,
    parameters_of,
    pseudo_inertia,
)
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.dynamics.urdf_parser import (
    add_joint,
    add_origin,
    fill_inertial,
    Inertial,
    Origin,
    Tree,
)
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Name of the new root link.
_LEVEL_LINK = 'world'
#: Smaller relative changes are rounding, and are not written.
_NO_CHANGE = 1e-12
#: Largest error with which the new text may be read, relative to a body.
_TEXT_TOLERANCE = 1e-9
#: Attributes of an inertia in the order of inertial parameters.
_MOMENTS = ('ixx', 'ixy', 'iyy', 'ixz', 'iyz', 'izz')


def corrected_urdf(
    description: str,
    joints: Sequence[str],
    parameters: Array,
    rotor: Sequence[float] = (),
    gravity: Sequence[float] = (0.0, 0.0, -1.0),
    locked: Mapping[str, float] | None = None,
) -> str:
    """
    Return a URDF with other parameters of its bodies.

    Parameters
    ----------
    description : str
        The URDF.
    joints : sequence of str, length n
        Joints of the model.
    parameters : ndarray, shape (n, 10)
        Mass [kg], first moments [kg·m] and inertia [kg·m²] of the body that each joint moves,
        about the joint's frame, in Pinocchio's order. A rigid body must have them.
    rotor : sequence of float, length n
        Rotor inertias, reflected to the joints [kg·m²]. Empty for those of the URDF.
    gravity : sequence of float, length 3
        Direction of gravity in the frame of the root. The default is -z.
    locked : mapping of str to float, optional
        Positions of other joints [rad or m].

    Raises
    ------
    CtcError
        If no body has such parameters, or the URDF is not that of a model.

    """
    for row in parameters:
        if not is_possible(pseudo_inertia(row)):
            raise CtcError(f'no body can have the inertial parameters {row.tolist()}')
    if len(gravity) != 3 or not np.linalg.norm(gravity) > 0.0:
        raise CtcError(
            f'gravity must be three numbers that are not all 0: {list(gravity)}'
        )
    tree = Tree(description)
    robot = parse_description(description, comments=True)
    bodies = [pseudo_inertia(row) for row in parameters]
    _write_bodies(robot, tree, ForwardKinematics(tree, joints, locked), bodies)
    rotors = {
        name: value
        for name, value in zip(joints, rotor)
        if abs(value - tree.joints[name].rotor_inertia) > _NO_CHANGE
    }
    _write_rotors(robot, rotors)
    _tilt(robot, tree, gravity)
    header = description[: description.index('<robot')]
    result = header + ET.tostring(robot, encoding='unicode') + '\n'
    _verify(UrdfModel(result, joints, locked=locked), parameters, rotor)
    return result


def _write_bodies(
    robot: ET.Element,
    tree: Tree,
    kinematics: ForwardKinematics,
    bodies: Sequence[Array],
) -> None:
    """Give links the inertias that add up to bodies."""
    elements = {link.get('name', ''): link for link in robot.findall('link')}
    for body, poses in zip(bodies, kinematics.rigid_bodies()):
        for link, inertia in _changed_inertias(tree, poses, body).items():
            _write_inertial(elements[link], inertia)


def _changed_inertias(
    tree: Tree, poses: Mapping[str, Array], body: Array
) -> dict[str, Array]:
    """
    Return the changed pseudo-inertias of a body's links, in their own frames.

    Parameters
    ----------
    tree : Tree
        The URDF.
    poses : mapping of str to ndarray, shape (4, 4)
        Poses of the body's links in the frame of its joint.
    body : ndarray, shape (4, 4)
        Identified pseudo-inertia of the body in the frame of its joint.

    """
    links = {
        name: _transformed(pose, _link_inertia(tree.inertials[name]))
        for name, pose in poses.items()
    }
    described: Array = np.sum(list(links.values()), axis=0)
    if np.abs(body - described).max() <= _NO_CHANGE * np.abs(body).max():
        return {}
    heaviest = max(links, key=lambda name: float(links[name][3, 3]))
    remainder = body - (described - links[heaviest])
    if is_possible(remainder):
        changed = {heaviest: remainder}
    else:
        mass = described[3, 3]
        changed = {
            name: inertia[3, 3] / mass * body
            for name, inertia in links.items()
            if inertia[3, 3] > 0.0
        }
    return {
        name: _transformed(np.asarray(np.linalg.inv(poses[name]), float), inertia)
        for name, inertia in changed.items()
    }


def _transformed(pose: Array, inertia: Array) -> Array:
    """Return a pseudo-inertia in the frame of its pose."""
    transformed: Array = pose @ inertia @ pose.T
    return transformed


def _link_inertia(inertial: Inertial | None) -> Array:
    """Return the pseudo-inertia of a link in its frame."""
    if inertial is None:
        return np.zeros((4, 4))
    moments = [inertial.moments[key] for key in _MOMENTS]
    about_center = pseudo_inertia(np.array([inertial.mass, 0.0, 0.0, 0.0, *moments]))
    return _transformed(origin_pose(inertial.origin), about_center)


def _write_inertial(link: ET.Element, inertia: Array) -> None:
    """Give a link a pseudo-inertia."""
    mass, *first_moments = parameters_of(inertia)[:4].tolist()
    center = np.array(first_moments) / mass
    lever = np.array([*center, 1.0])
    moments = parameters_of(inertia - mass * np.outer(lever, lever))[4:].tolist()
    element = _child(link, 'inertial')
    for child in list(element):
        element.remove(child)
    element.text = None
    element.append(ET.Comment(' identified '))
    origin = Origin(tuple(center.tolist()))
    fill_inertial(element, Inertial(origin, mass, dict(zip(_MOMENTS, moments))))


def _child(parent: ET.Element, tag: str, **attributes: str) -> ET.Element:
    """Return the first child with a tag, or add it."""
    child = parent.find(tag)
    return ET.SubElement(parent, tag, attributes) if child is None else child


def with_rotors(description: str, inertias: Mapping[str, float]) -> str:
    """Return a URDF with reflected rotor inertias [kg·m²]."""
    robot = parse_description(description)
    _write_rotors(robot, inertias)
    return ET.tostring(robot, encoding='unicode')


def _write_rotors(robot: ET.Element, inertias: Mapping[str, float]) -> None:
    """Give joints the inertias of their rotors."""
    for joint in robot.findall('joint'):
        name = joint.get('name', '')
        if name in inertias:
            # Without damping or friction, urdfdom refuses the element.
            dynamics = _child(joint, 'dynamics', damping='0')
            dynamics.set('rotor_inertia', repr(float(inertias[name])))


def _tilt(robot: ET.Element, tree: Tree, gravity: Sequence[float]) -> None:
    """Add a root along whose -z gravity points."""
    x, y, z = gravity
    horizontal = hypot(x, y)
    if horizontal <= _NO_CHANGE * abs(z) and z < 0.0:
        return
    name = _LEVEL_LINK
    while name in tree.links or name in tree.ends:
        name += '_'
    robot.append(
        ET.Comment(
            f' identified: tilted by {degrees(atan2(horizontal, -z)):.3g} degrees '
        )
    )
    ET.SubElement(robot, 'link', name=name)
    # Pinocchio keeps links and fixed joints in one table of names.
    joint = add_joint(robot, f'{name}_to_{tree.root}', 'fixed', name, tree.root)
    # Ry(pitch) Rx(roll) brings gravity in the root's frame to -z.
    roll = atan2(-y, -z)
    pitch = atan2(x, hypot(y, z))
    add_origin(joint, Origin(rpy=(roll, pitch, 0.0)))


def _verify(model: UrdfModel, parameters: Array, rotor: Sequence[float]) -> None:
    """Raise `CtcError` unless the new text has the parameters."""
    sizes = np.abs(parameters).max(axis=1, keepdims=True)
    written = model.inertial_parameters().reshape(-1, 10)
    errors = np.abs(written - parameters) / sizes
    error = float(errors.max())
    if not error <= _TEXT_TOLERANCE or (
        len(rotor) and list(rotor) != list(model.rotor_inertias)
    ):
        raise CtcError(
            'the URDF cannot be corrected: with the parameters written into it, it is '
            f'read with an error of {error:.2g}'
        )
