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
Shapes of an arm to draw, fixed to the links whose poses `ForwardKinematics` has.

The live page and the exported page draw them. Input is a configuration and the text of a URDF.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
import dataclasses
from math import hypot
from typing import Any
import xml.etree.ElementTree as ET

from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.dynamics.description_xml import parse_description
from ctc_chattering.dynamics.kinematics import ForwardKinematics, LinkFrame, origin_pose
from ctc_chattering.dynamics.registry import locked_positions, RobotConfig
from ctc_chattering.dynamics.urdf_parser import Inertial, parse_numbers, parse_origin, Tree
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

#: Radius of capsules over the reach of the arm.
_RADIUS_RATIO = 0.03
#: Capsules that are shorter are not drawn [m].
_SHORTEST_M = 1e-3
#: Distance of arms side by side, over their reach.
_DISTANCE_RATIO = 1.2
#: Longer capsules and arms are not drawn [m].
LONGEST = 1e6
#: Numbers of a shape: attributes with their counts.
_SIZES = {
    'mesh': (('scale', 3),),
    'box': (('size', 3),),
    'sphere': (('radius', 1),),
    'cylinder': (('radius', 1), ('length', 1)),
}
_DEFAULT_SIZES = {'scale': '1 1 1'}


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
    A link with its shapes.

    Attributes
    ----------
    frame : LinkFrame
        The link's frame.
    visual, collision : tuple of Shape
        The description's shapes.
    capsules : tuple of Shape
        Lines to the bodies it carries, or to its end.

    """

    frame: LinkFrame
    visual: tuple[Shape, ...]
    collision: tuple[Shape, ...]
    capsules: tuple[Shape, ...]


@dataclasses.dataclass(frozen=True)
class Skeleton:
    """
    The bodies of an arm, parents first.

    Attributes
    ----------
    kinematics : ForwardKinematics
        Frames of the bodies.
    bodies : tuple of Body
    n : int
        Number of joints of the model.
    reach : float
        Sum of the distances between the joints along the longest chain, and that of the last two
        again [m].

    """

    kinematics: ForwardKinematics
    bodies: tuple[Body, ...]
    n: int
    reach: float

    def poses(self, q: Sequence[float] | Array) -> Array:
        """Return the pose of every body in the frame of the root, shape (bodies, 4, 4)."""
        return self.kinematics.poses(q)

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
    robot = parse_description((config_directory() / 'two_link.urdf').read_text(encoding='utf-8'))
    for joint, name in zip(robot.findall('joint'), joint_names):
        joint.set('name', name)
    return ET.tostring(robot, encoding='unicode')


def urdf_skeleton(
    urdf: str | ET.Element, joint_names: Sequence[str], locked: Mapping[str, float] | None = None
) -> Skeleton:
    """
    Return the bodies of a URDF.

    Parameters
    ----------
    urdf : str or Element
        Its text, or the element of `parse_description`.
    joint_names : sequence of str
        Joints of the model.
    locked : mapping of str to float, optional
        Positions of other joints [rad or m].

    Raises
    ------
    CtcError
        If the text is no URDF with these joints, or its arm is too long to be drawn.

    """
    tree = Tree(urdf)
    kinematics = ForwardKinematics(tree, joint_names, locked)
    reach = _reach(kinematics.frames)
    if not reach < LONGEST:
        raise CtcError(f'an arm of {reach:g} m; drawn are those of less than {LONGEST:g} m')
    ends: list[list[Array]] = [[] for _ in kinematics.frames]
    for frame in kinematics.frames[1:]:
        ends[frame.parent].append(frame.origin[:3, 3])
    bodies = []
    for frame, link_ends in zip(kinematics.frames, ends):
        link = tree.links[frame.link]
        capsules = _capsules(link_ends, tree.inertials[frame.link], _RADIUS_RATIO * reach)
        bodies.append(Body(frame, _shapes(link, 'visual'), _shapes(link, 'collision'), capsules))
    return Skeleton(kinematics, tuple(bodies), len(joint_names), reach)


def _reach(frames: Sequence[LinkFrame]) -> float:
    """Return the reach of a `Skeleton` [m]; 1 for one of points."""
    distances = [0.0]
    last_length = 0.0
    for frame in frames[1:]:
        length = hypot(*frame.origin[:3, 3])
        last_length = length or last_length
        distances.append(distances[frame.parent] + length)
    return max(distances) + last_length or 1.0


def _capsules(
    ends: Sequence[Array], inertial: Inertial | None, radius: float
) -> tuple[Shape, ...]:
    """Return lines from the origin of a link to the joints on it, or to its end."""
    if not ends and inertial is not None:
        ends = [2.0 * np.array(inertial.origin.xyz)]
    return tuple(
        Shape('capsule', (0.0, 0.0, 0.0, *map(float, end), radius), np.eye(4))
        for end in ends
        if radius and _SHORTEST_M < hypot(*end) < LONGEST
    )


def _shapes(link: ET.Element, tag: str) -> tuple[Shape, ...]:
    """Return the shapes of a link, ``unreadable`` in the place of those without numbers."""
    shapes: list[Shape] = []
    for element in link.findall(tag):
        try:
            shapes += list(_readable_shapes(element))
        except CtcError:
            shapes.append(Shape('unreadable', (), np.eye(4)))
    return tuple(shapes)


def _readable_shapes(element: ET.Element) -> Iterator[Shape]:
    """Yield the shapes of a visual or collision element. Raise `CtcError` for no numbers."""
    pose = origin_pose(parse_origin(element.tag, element))
    for shape in element.findall('geometry/*'):
        sizes: list[float] = []
        for key, count in _SIZES.get(shape.tag, ()):
            text = shape.get(key, _DEFAULT_SIZES.get(key, ''))
            sizes += parse_numbers(shape.tag, key, text, count)
        if sizes:
            yield Shape(shape.tag, tuple(sizes), pose, shape.get('filename', ''))


def quaternion(matrix: Array) -> Array:
    """Return the quaternion w, x, y, z of a rotation matrix of shape (3, 3)."""
    return np.roll(Rotation.from_matrix(matrix).as_quat(), 1)


def places(count: int, reach: float) -> list[tuple[float, float, float]]:
    """Return the roots of `count` arms side by side [m]."""
    return [(_DISTANCE_RATIO * reach * (i - 0.5 * (count - 1)), 0.0, 0.0) for i in range(count)]


def stage(skeletons: Iterable[Skeleton | None]) -> tuple[float, float]:
    """Return the reach of the largest arm and the height of the floor: hanging arms need room."""
    drawn = [x for x in skeletons if x is not None]
    reach = max((x.reach for x in drawn), default=1.0)
    lowest = min((x.tips([0.0] * x.n)[:, 2].min() for x in drawn), default=0.0)
    return reach, -reach if lowest < -0.1 * reach else 0.0


def as_json(skeleton: Skeleton) -> list[dict[str, Any]]:
    """Return the bodies with their capsules, as the exported page reads them."""
    return [_body_json(body) for body in skeleton.bodies]


def _body_json(body: Body) -> dict[str, Any]:
    frame = body.frame
    fields: dict[str, Any] = {
        'parent': frame.parent,
        'origin': np.round(frame.origin, 9).ravel().tolist(),
        'joint': frame.joint_index,
        'capsules': [np.round(x.sizes, 6).tolist() for x in body.capsules],
    }
    if frame.joint is not None:
        fields['kind'] = 'prismatic' if frame.joint.prismatic else 'revolute'
        fields['axis'] = frame.joint.axis
    return fields
