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
How near the links of a robot come to each other, by Pinocchio and the shapes of its description.

Meshes count as their convex hull, in which they lie; where hulls come too near, the mesh itself
counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import copy
import importlib
from itertools import combinations
from math import inf
from typing import Any, NamedTuple
import xml.etree.ElementTree as ET

from ctc_chattering.configuration.package_share import find_mesh
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, refused_as
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Name of the floor in messages, and half the sides of the box that stands for it [m].
FLOOR, _WIDE = 'the floor', 50.0
#: Distance of hulls below which meshes count at the latest [m].
_NEAR = 0.05
#: Distance below which links touch [m].
_TOUCH = 1e-3


class Approach(NamedTuple):
    """
    Two links at one sample of a motion.

    Attributes
    ----------
    distance, kept : float
        Between them, and what they must keep; inf where no pair is nearer than asked for [m].
    spare : float
        Distance over what they must keep, less 1.
    sample, pair : int
        Index of the sample, and of the pair among `SelfCollision.pairs`.

    """

    distance: float
    kept: float
    spare: float
    sample: int
    pair: int


class SelfCollision:
    """
    Distances between links that no joint joins.

    Parameters
    ----------
    description : str
        Text of the URDF.
    joints : sequence of str, length n
        That move.
    locked : mapping of str to float
        Positions of others [rad or m].
    rests : ndarray, shape (m, n)
        Positions at which links may be near each other: the centre first, and the start.
    clearance : float
        What links must keep; half of their distance at `rests` if that is less [m].
    floor : float, optional
        Height of a floor in the frame of the root link [m].

    Attributes
    ----------
    pairs : list of (str, str)
        Links that are checked; a pair of links comes as often as they have shapes.
    touching : list of str
        Pairs of links that touch at the first of `rests`; they are not checked.
    unseen : list of str
        Links with a picture but no shape, or a shape of a file that is missing.

    Raises
    ------
    CtcError
        If Pinocchio refuses a shape.

    """

    def __init__(self, description: str, joints: Sequence[str], locked: Mapping[str, float],
                 rests: Array, clearance: float, floor: float | None = None) -> None:
        tree = Tree(description)
        text, self.unseen = shaped(tree)
        self._pin: Any = importlib.import_module('pinocchio')
        if not hasattr(self._pin, 'computeDistance'):
            raise CtcError('this Pinocchio has no coal')
        with refused_as('collision shapes: Pinocchio refuses them'):
            self._model, meshes = geometry(self._pin, text, tree.locked(joints, locked), floor)
            self._kinds = (convex_hulls(meshes), meshes)
        self._data = self._model.createData()
        back = [self._model.joints[self._model.getJointId(name)].idx_q for name in joints]
        self._order: Any = np.argsort(back)
        joined = {frozenset(tree.ends[name]) for name in joints}
        shapes = self._kinds[0].geometryObjects.tolist()
        names = [link_of(list(tree.links), shape.name) for shape in shapes]
        pairs = [(a, b) for (a, x), (b, y) in combinations(enumerate(shapes), 2)
                 if x.parentJoint != y.parentJoint
                 and frozenset((names[a], names[b])) not in joined]
        pairs, self.touching = self._apart(pairs, names, rests, clearance)
        self.pairs = [(names[a], names[b]) for a, b in pairs]

    def _apart(self, pairs: list[tuple[int, int]], names: Sequence[str], rests: Array,
               clearance: float) -> tuple[list[tuple[int, int]], list[str]]:
        """Return the pairs that do not touch at the centre, and the names of those that do."""
        self._states = self._with(pairs)
        self._least = np.full(len(pairs), inf)
        distances = np.empty((len(rests), len(pairs)))
        for row, q in zip(distances, rests):
            row[:] = self._distances(q)
        touch = distances[0] <= _TOUCH
        found = [pair for pair, no in zip(pairs, touch) if not no]
        self._states = self._with(found)
        free = np.where(distances > _TOUCH, distances, inf)[:, ~touch].min(axis=0)
        self._least = np.minimum(clearance, 0.5 * free)
        return found, sorted({' and '.join(names[i] for i in pair)
                              for pair, yes in zip(pairs, touch) if yes})

    def _with(self, pairs: Sequence[tuple[int, int]]) -> list[tuple[Any, Any]]:
        """Return hulls and meshes of these pairs, with memory for places and distances."""
        for model in self._kinds:
            model.removeAllCollisionPairs()
            for pair in pairs:
                model.addCollisionPair(self._pin.CollisionPair(*pair))
        return [(model, model.createData()) for model in self._kinds]

    def nearest(self, q: Array) -> Approach:
        """Return where positions q, shape (N, n), leave the least to spare."""
        best = Approach(inf, inf, inf, 0, 0)
        for sample, row in enumerate(q if len(self.pairs) else ()):
            distances = self._distances(row)
            spare = distances / self._least - 1.0
            pair = int(spare.argmin())
            if spare[pair] < best.spare:
                best = Approach(float(distances[pair]), float(self._least[pair]),
                                float(spare[pair]), sample, pair)
        return best

    def text(self, near: Approach, time: float) -> str:
        """Return which links come how near to each other at a time [s]."""
        first, second = self.pairs[near.pair]
        how = f'{near.distance:.2g} m' if near.distance > 0.0 else 'they touch'
        return f'{how}, {first} and {second} at {time:.1f} s; at least {near.kept:.2g} m'

    def _distances(self, q: Array) -> Array:
        """Return the distance of each pair at positions q, shape (n,) [m]."""
        (hulls, data), (meshes, theirs) = self._states
        pin = self._pin
        pin.computeDistances(self._model, self._data, hulls, data, q[self._order])
        found = np.array([x.min_distance for x in data.distanceResults])
        near = np.flatnonzero(found <= np.minimum(self._least, _NEAR)).tolist()
        if near:
            pin.updateGeometryPlacements(self._model, self._data, meshes, theirs)
        for pair in near:
            mesh = pin.computeDistance(meshes, theirs, pair).min_distance
            found[pair] = max(found[pair], mesh)
        return found


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
    """Return whether the file of a mesh is read, and put its path in the place of its name."""
    path = find_mesh(mesh.get('filename', ''))
    if path is not None:
        mesh.set('filename', str(path.absolute()))
    return path is not None


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
