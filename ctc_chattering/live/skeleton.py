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

"""The bodies of an arm and where they are: kinematics of a URDF for drawing, in numpy alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import dataclasses
from math import hypot
from typing import Any
import xml.etree.ElementTree as ET

from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.dynamics.description_xml import parse_description
from ctc_chattering.dynamics.registry import locked_positions, RobotConfig
from ctc_chattering.dynamics.urdf_parser import numbers, Origin, origin, Tree
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

#: Radius of a capsule as a part of the arm's reach, and the least length of one that is drawn.
_RADIUS, _SHORTEST = 0.03, 1e-3
#: Between the roots of two arms, as a part of the reach.
_APART = 1.2
#: What is longer is not drawn [m].
LONGEST = 1e6
#: Attributes of a shape with how many numbers each has; what stands for one that is missing.
_SIZES = {'mesh': (('scale', 3),), 'box': (('size', 3),), 'sphere': (('radius', 1),),
          'cylinder': (('radius', 1), ('length', 1))}
_UNSCALED = {'scale': '1 1 1'}


@dataclasses.dataclass(frozen=True)
class Shape:
    """
    Something to draw, fixed to a body.

    Attributes
    ----------
    kind : str
        ``capsule``, ``mesh``, ``box``, ``cylinder`` or ``sphere``; or ``unreadable``.
    sizes : tuple of float
        Capsule: its ends, six numbers, and its radius [m]. Mesh: scale along x, y and z. Box: its
        edges [m]; cylinder: radius and length [m]; sphere: radius [m].
    pose : ndarray, shape (4, 4)
        In the frame of the body.
    file : str
        Where a mesh is, as the description says.

    """

    kind: str
    sizes: tuple[float, ...]
    pose: Array
    file: str = ''


@dataclasses.dataclass(frozen=True)
class Body:
    """
    A link, and the joint that carries it.

    Attributes
    ----------
    name : str
        Of the link.
    parent : int
        Index of the body that carries it; -1 for the root.
    origin : ndarray, shape (4, 4)
        Pose of the joint in the frame of the parent, at position 0.
    kind : str
        ``fixed``, ``revolute`` or ``prismatic``.
    axis : tuple of float, length 3
        Of length 1.
    joint : int
        Index of the joint among those of the model; -1 if it stands still.
    visual, collision : tuple of Shape
        The description's shapes.
    capsules : tuple of Shape
        Lines to the bodies it carries, or to its end.

    """

    name: str
    parent: int
    origin: Array
    kind: str
    axis: tuple[float, float, float]
    joint: int
    visual: tuple[Shape, ...]
    collision: tuple[Shape, ...]
    capsules: tuple[Shape, ...]


@dataclasses.dataclass(frozen=True)
class Skeleton:
    """
    The bodies of an arm, parents first.

    Attributes
    ----------
    bodies : tuple of Body
    n : int
        Number of joints of the model.
    reach : float
        Sum of the distances between the joints along the longest chain, and that of the last two
        again [m].

    """

    bodies: tuple[Body, ...]
    n: int
    reach: float

    def poses(self, q: Sequence[float] | Array) -> Array:
        """Return the pose of every body in the frame of the root, shape (bodies, 4, 4)."""
        poses = np.empty((len(self.bodies), 4, 4))
        for i, body in enumerate(self.bodies):
            pose = body.origin
            if body.joint >= 0:
                pose = pose @ _motion(body.kind, body.axis, float(q[body.joint]))
            poses[i] = poses[body.parent] @ pose if body.parent >= 0 else pose
        return poses

    def tips(self, q: Sequence[float] | Array) -> Array:
        """Return the origins of the bodies in the frame of the root, shape (bodies, 3) [m]."""
        return self.poses(q)[:, :3, 3]


def skeleton_of(config: RobotConfig, description: str = '') -> Skeleton | None:
    """
    Return the bodies of the arm that a configuration names; None if its shape is not known.

    Parameters
    ----------
    config : RobotConfig
        Model, joints and locked positions.
    description : str
        Text of the URDF; may be empty for the paper's arm.

    """
    if config.model == 'two_link':
        return urdf_skeleton(two_link_urdf(config.joint_names), config.joint_names)
    root = parse_description(description) if description.strip() else None
    if root is None or root.tag != 'robot':
        return None
    return urdf_skeleton(root, config.joint_names, locked_positions(config.locked))


def two_link_urdf(joint_names: Sequence[str] = ('joint1', 'joint2')) -> str:
    """Return the URDF of the paper's arm, with its joints named."""
    robot = parse_description(
        (config_directory() / 'two_link.urdf').read_text(encoding='utf-8'))
    for joint, name in zip(robot.findall('joint'), joint_names):
        joint.set('name', name)
    return ET.tostring(robot, encoding='unicode')


def urdf_skeleton(urdf: str | ET.Element, joint_names: Sequence[str],
                  locked: Mapping[str, float] | None = None) -> Skeleton:
    """
    Return the bodies of a URDF.

    Parameters
    ----------
    urdf : str or Element
        Its text, or what `parse_description` made of it.
    joint_names : sequence of str
        Joints of the model.
    locked : mapping of str to float, optional
        Positions of others [rad or m].

    Raises
    ------
    CtcError
        If the text is no URDF with these joints, or its arm is too long to be drawn.

    """
    tree = Tree(urdf)
    stand = tree.locked(joint_names, locked or {})
    children = [child for _, child in tree.ends.values()]
    root = next(link for link in tree.links if link not in children)
    index, lengths, last = {root: 0}, [0.0], 0.0
    made = [(root, -1, np.eye(4), 'fixed', (0.0, 0.0, 1.0), -1)]
    for name, (parent, child) in tree.ends.items():
        place, axis = _pose(tree.origins[name]), tree.axes.get(name, (0.0, 0.0, 1.0))
        joint = tree.joints.get(name)
        kind = 'fixed' if joint is None else joint.kind.replace('continuous', 'revolute')
        if name in stand:
            place, kind = place @ _motion(kind, axis, stand[name]), 'fixed'
        number = list(joint_names).index(name) if kind != 'fixed' else -1
        length = hypot(*place[:3, 3])
        last = length or last
        lengths.append(lengths[index[parent]] + length)
        index[child] = len(made)
        made.append((child, index[parent], place, kind, axis, number))
    reach = max(lengths) + last or 1.0
    if not reach < LONGEST:
        raise CtcError(f'an arm of {reach:g} m; drawn are those of less than {LONGEST:g} m')
    bodies = []
    for i, fields in enumerate(made):
        link, ends = tree.links[fields[0]], [x[2][:3, 3] for x in made if x[1] == i]
        bodies.append(Body(*fields, _shapes(link, 'visual'), _shapes(link, 'collision'),
                           _capsules(ends, link, _RADIUS * reach)))
    return Skeleton(tuple(bodies), len(joint_names), reach)


def _capsules(ends: Sequence[Array], link: ET.Element, radius: float) -> tuple[Shape, ...]:
    """Return lines from the origin of a link to the joints on it, or to its end."""
    if not ends:
        mass = link.find('inertial')
        ends = [2.0 * np.array(origin('inertial', mass).xyz)] if mass is not None else []
    return tuple(Shape('capsule', (0.0, 0.0, 0.0, *map(float, end), radius), np.eye(4))
                 for end in ends if radius and _SHORTEST < hypot(*end) < LONGEST)


def _shapes(link: ET.Element, tag: str) -> tuple[Shape, ...]:
    """Return the shapes of a link; one of kind ``unreadable`` if there is one with no numbers."""
    found = []
    for element in link.findall(tag):
        try:
            pose = _pose(origin(tag, element))
            found += [Shape(x.tag, tuple(
                value for key, count in _SIZES[x.tag]
                for value in numbers(x.tag, key, x.get(key, _UNSCALED.get(key, '')), count)),
                pose, x.get('filename', ''))
                for x in element.findall('geometry/*') if x.tag in _SIZES]
        except CtcError:
            found.append(Shape('unreadable', (), np.eye(4)))
    return tuple(found)


def _motion(kind: str, axis: Sequence[float], q: float) -> Array:
    """Return the pose of what a joint carries, relative to its pose at 0, shape (4, 4)."""
    pose = np.eye(4)
    if kind == 'prismatic':
        pose[:3, 3] = q * np.array(axis)
    elif kind == 'revolute':
        pose[:3, :3] = Rotation.from_rotvec(q * np.array(axis)).as_matrix()
    return pose


def quaternion(matrix: Array) -> Array:
    """Return the quaternion w, x, y, z of a rotation matrix of shape (3, 3)."""
    return np.roll(Rotation.from_matrix(matrix).as_quat(), 1)


def _pose(origin: Origin) -> Array:
    """Return an origin as a matrix, shape (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler('xyz', origin.rpy).as_matrix()
    pose[:3, 3] = origin.xyz
    return pose


def places(count: int, reach: float) -> list[tuple[float, float, float]]:
    """Return where the roots of `count` arms are, side by side [m]."""
    return [(_APART * reach * (i - 0.5 * (count - 1)), 0.0, 0.0) for i in range(count)]


def stage(skeletons: Iterable[Skeleton | None]) -> tuple[float, float]:
    """Return the reach of the largest arm and the height of the floor: hanging arms need room."""
    known = [x for x in skeletons if x is not None]
    reach = max((x.reach for x in known), default=1.0)
    lowest = min((x.tips([0.0] * x.n)[:, 2].min() for x in known), default=0.0)
    return reach, -reach if lowest < -0.1 * reach else 0.0


def as_json(skeleton: Skeleton) -> list[dict[str, Any]]:
    """Return the bodies with their capsules, as the exported page reads them."""
    return [{
        'parent': body.parent, 'origin': np.round(body.origin, 9).ravel().tolist(),
        'kind': body.kind, 'axis': body.axis, 'joint': body.joint,
        'capsules': [np.round(x.sizes, 6).tolist() for x in body.capsules]}
        for body in skeleton.bodies]
