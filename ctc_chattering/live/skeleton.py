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
Shapes of an arm to draw, fixed to its links.

`ForwardKinematics` has the poses of the links.

The live page draws their meshes (`body_meshes`), the exported page their capsules (`as_json`).
Input is a configuration and the text of a URDF.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
import dataclasses
from math import hypot
from typing import Any, NamedTuple
import xml.etree.ElementTree as ET

from ctc_chattering.configuration.package_share import config_directory, find_mesh
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
LONGEST_M = 1e6
#: Larger meshes are not drawn.
_MAX_TRIANGLES = 200_000


class Capsule(NamedTuple):
    """A line from a body's origin to `end` [m], with a radius [m]."""

    end: tuple[float, ...]
    radius: float


@dataclasses.dataclass(frozen=True)
class Body:
    """
    A link with its shapes.

    Attributes
    ----------
    frame : LinkFrame
        The link's frame.
    link : Element
        The link in the URDF, with its visual and collision shapes.
    capsules : tuple of Capsule
        Lines to the bodies it carries, or to its end.

    """

    frame: LinkFrame
    link: ET.Element
    capsules: tuple[Capsule, ...]

    def has(self, tag: str) -> bool:
        """Return whether it has shapes with a tag, ``visual`` or ``collision``."""
        return self.link.find(f'{tag}/geometry/*') is not None


@dataclasses.dataclass(frozen=True)
class Skeleton:
    """
    The bodies of an arm, parents first.

    Attributes
    ----------
    kinematics : ForwardKinematics
        Frames of the bodies.
    bodies : tuple of Body
    reach : float
        Sum of the distances between the joints along the longest chain, and that of the last two
        again [m].

    """

    kinematics: ForwardKinematics
    bodies: tuple[Body, ...]
    reach: float

    def poses(self, q: Sequence[float] | Array) -> Array:
        """Return the poses of the bodies, shape (bodies, 4, 4)."""
        return self.kinematics.poses(q)


def skeleton_of(config: RobotConfig, description: str = '') -> Skeleton | None:
    """
    Return the arm of a configuration, or None if its shape is not known.

    Parameters
    ----------
    config : RobotConfig
        Model, joints and locked positions.
    description : str
        Text of the URDF. It may be empty for the paper's arm.

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
    if not reach < LONGEST_M:
        raise CtcError(f'an arm of {reach:g} m; drawn are those of less than {LONGEST_M:g} m')
    ends: list[list[Array]] = [[] for _ in kinematics.frames]
    for frame in kinematics.frames[1:]:
        ends[frame.parent].append(frame.origin[:3, 3])
    bodies = []
    for frame, link_ends in zip(kinematics.frames, ends):
        link = tree.links[frame.link]
        capsules = _capsules(link_ends, tree.inertials[frame.link], _RADIUS_RATIO * reach)
        bodies.append(Body(frame, link, capsules))
    return Skeleton(kinematics, tuple(bodies), reach)


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
) -> tuple[Capsule, ...]:
    """Return lines from a link's origin to its joints or its end."""
    if not ends and inertial is not None:
        ends = [2.0 * np.array(inertial.origin.xyz)]
    return tuple(
        Capsule(tuple(map(float, end)), radius)
        for end in ends
        if radius and _SHORTEST_M < hypot(*end) < LONGEST_M
    )


def body_meshes(skeleton: Skeleton) -> list[list[Any]]:
    """
    Return the meshes of each body in its frame.

    A body has its visual shapes. If one of them cannot be read, it has its collision shapes, and
    then its capsules. An arm without any shapes has capsules.
    """
    is_bare = not any(body.has('visual') or body.has('collision') for body in skeleton.bodies)
    return [_readable_meshes(body, is_bare) for body in skeleton.bodies]


def _readable_meshes(body: Body, is_bare: bool) -> list[Any]:
    """Return the first meshes that can be read."""
    tags = [tag for tag in ('visual', 'collision') if body.has(tag)]
    for tag in tags:
        meshes = [
            read_mesh(shape, element)
            for element in body.link.findall(tag)
            for shape in element.findall('geometry/*')]
        if all(mesh is not None for mesh in meshes):
            return meshes
    return [_capsule_mesh(capsule) for capsule in body.capsules] if tags or is_bare else []


def read_mesh(shape: ET.Element, element: ET.Element) -> Any:
    """
    Return the mesh of a shape in its body's frame.

    A shape that cannot be read gives None.

    Parameters
    ----------
    shape : Element
        A mesh, box, cylinder or sphere.
    element : Element
        The visual or collision element around it, with its origin.

    """
    with suppress(Exception):  # Of arbitrary files, readers raise arbitrary exceptions.
        mesh = _make_mesh(shape)
        if 0 < len(mesh.faces) <= _MAX_TRIANGLES:
            mesh.apply_transform(origin_pose(parse_origin(element.tag, element)))
            if np.abs(mesh.vertices).max() < LONGEST_M:
                return mesh
    return None


def _make_mesh(shape: ET.Element) -> Any:
    """Return the mesh of a shape in its own frame."""
    import trimesh

    def numbers(key: str, count: int = 1) -> list[float]:
        return parse_numbers(shape.tag, key, shape.get(key, ''), count)

    if shape.tag == 'box':
        return trimesh.creation.box(numbers('size', 3))
    if shape.tag == 'cylinder':
        return trimesh.creation.cylinder(*numbers('radius'), *numbers('length'), sections=24)
    if shape.tag == 'sphere':
        return trimesh.creation.icosphere(2, *numbers('radius'))
    path = find_mesh(shape.get('filename', ''))
    if path is None:
        raise CtcError(f'{shape.get("filename")}: not found')
    mesh: Any = trimesh.load(path, force='mesh')
    if 'scale' in shape.attrib:
        mesh.apply_scale(numbers('scale', 3))
    return mesh


def _capsule_mesh(capsule: Capsule) -> Any:
    import trimesh

    ball = trimesh.creation.icosphere(2, capsule.radius).vertices
    return trimesh.convex.convex_hull(np.concatenate((ball, ball + capsule.end)))


def quaternion(matrix: Array) -> Array:
    """Return the quaternion w, x, y, z of a rotation matrix."""
    return np.roll(Rotation.from_matrix(matrix).as_quat(), 1)


def root_positions(count: int, reach: float) -> list[tuple[float, float, float]]:
    """Return the roots of `count` arms side by side [m]."""
    return [(_DISTANCE_RATIO * reach * (i - 0.5 * (count - 1)), 0.0, 0.0) for i in range(count)]


def stage(skeletons: Iterable[Skeleton | None]) -> tuple[float, float]:
    """Return the reach of the largest arm and the floor's height [m]."""
    drawn = [x for x in skeletons if x is not None]
    reach = max((x.reach for x in drawn), default=1.0)
    heights = [x.poses(np.zeros(x.kinematics.n))[:, 2, 3].min() for x in drawn]
    # Hanging arms need room.
    is_hanging = min(heights, default=0.0) < -0.1 * reach
    return reach, -reach if is_hanging else 0.0


def as_json(skeleton: Skeleton) -> list[dict[str, Any]]:
    """Return the bodies with their capsules, as the exported page reads them."""
    return [_body_json(body) for body in skeleton.bodies]


def _body_json(body: Body) -> dict[str, Any]:
    frame = body.frame
    joint = frame.joint
    return {
        'parent': frame.parent,
        # DOMMatrix has its numbers column by column.
        'origin': np.round(frame.origin.T, 9).ravel().tolist(),
        'joint': frame.joint_index,
        'kind': 'prismatic' if joint and joint.prismatic else 'revolute',
        'axis': joint.axis if joint else (0.0, 0.0, 1.0),
        'capsules': [np.round((*x.end, x.radius), 6).tolist() for x in body.capsules]}
