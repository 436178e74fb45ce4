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

"""Shapes of the links of a URDF, for distances by Pinocchio; pairs that may touch by an SRDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import copy
import importlib
from typing import Any
import xml.etree.ElementTree as ET

from ctc_chattering.configuration.robot_description import find_file
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError
import numpy as np

#: Name of the floor in messages, and half the sides of the box that stands for it [m].
FLOOR, _WIDE = 'the floor', 50.0


def shaped(tree: Tree) -> tuple[str, list[str]]:
    """Return a URDF with collision shapes, and the links that should have one more."""
    robot = ET.fromstring(tree.bare())
    unseen = []
    for link, element in zip(tree.links.values(), robot.findall('link')):
        shapes = [copy.deepcopy(shape) for shape in link.findall('collision')]
        files = [mesh for shape in shapes for mesh in shape.iter('mesh')]
        there = [_found(mesh) for mesh in files]
        if all(there):
            element.extend(shapes)
        if not all(there) or (not shapes and link.find('visual') is not None):
            unseen.append(link.get('name', ''))
    return ET.tostring(robot, encoding='unicode'), unseen


def _found(mesh: ET.Element) -> bool:
    """Return whether the file of a mesh is there, and put its path in the place of its name."""
    try:
        path = find_file(mesh.get('filename', '').removeprefix('file://'))
    except CtcError:
        return False
    mesh.set('filename', str(path.absolute()))
    return path.is_file()


def link_of(links: Sequence[str], shape: str) -> str:
    """Return the link of a shape, whose name `Tree.bare` and Pinocchio made."""
    return FLOOR if shape == FLOOR else links[int(shape.split()[1].split('_')[0])]


def geometry(pin: Any, text: str, stand: Mapping[str, float], floor: float | None) -> Any:
    """Return Pinocchio's model of the joints that move, and its shapes."""
    model = pin.buildModelFromXML(text)
    shapes = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION)
    if floor is not None:
        coal: Any = importlib.import_module('coal')
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, floor - _WIDE]))
        shapes.addGeometryObject(pin.GeometryObject(
            FLOOR, 0, 0, place, coal.Box(*[2.0 * _WIDE] * 3)))
    q = pin.neutral(model)
    ids = [model.getJointId(name) for name in stand]
    for joint, value in zip(ids, stand.values()):
        q[model.joints[joint].idx_q] = value
    return pin.buildReducedModel(model, shapes, ids, q)


def convex_hulls(meshes: Any) -> Any:
    """Return the shapes with the convex hull in the place of each mesh that has one."""
    hulls = meshes.copy()
    for shape in hulls.geometryObjects:
        if hasattr(shape.geometry, 'buildConvexHull'):
            try:
                shape.geometry.buildConvexHull(True, 'Qt')
            except (RuntimeError, ValueError):  # All points in a plane.
                continue
            shape.geometry = shape.geometry.convex
    return hulls


def allowed_pairs(srdf: str) -> set[frozenset[str]]:
    """
    Return the pairs of links that the text of an SRDF allows to touch.

    Raises
    ------
    CtcError
        If it is no SRDF.

    """
    try:
        robot = ET.fromstring(srdf.strip())
    except ET.ParseError as error:
        raise CtcError(f'SRDF: not XML: {error}') from None
    if robot.tag != 'robot':
        raise CtcError(f'SRDF: the outermost element is <{robot.tag}>, not <robot>')
    return {frozenset((x.get('link1', ''), x.get('link2', '')))
            for x in robot.iter('disable_collisions')}
