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

Meshes count as their convex hull, in which they lie.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import copy
import importlib
from itertools import combinations
from math import inf
from typing import Any
import xml.etree.ElementTree as ET

from ctc_chattering.configuration.package_share import find_mesh
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import as_ctc_error, CtcError
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Name of the floor in messages, and half the sides of the box that stands for it [m].
FLOOR, _WIDE = 'the floor', 50.0
#: Distance below which links touch [m].
_TOUCH = 1e-3


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
    floor : float
        Height of a floor in the frame of the root link; inf for none [m].

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
        If Pinocchio refuses a shape, or there are no two links to check.

    """

    def __init__(self, description: str, joints: Sequence[str], locked: Mapping[str, float],
                 rests: Array, clearance: float, floor: float = inf) -> None:
        if not description:
            raise CtcError('there is no description of its links')
        tree = Tree(description)
        text, self.unseen = shaped(tree)
        self._pin: Any = importlib.import_module('pinocchio')
        if not hasattr(self._pin, 'computeDistance'):
            raise CtcError('this Pinocchio has no coal')
        with as_ctc_error('collision shapes: Pinocchio refuses them'):
            self._model, self._shapes = geometry(
                self._pin, text, tree.locked(joints, locked), floor)
        back = [self._model.joints[self._model.getJointId(name)].idx_q for name in joints]
        self._order: Any = np.argsort(back)
        joined = {frozenset(tree.ends[name]) for name in joints}
        shapes = self._shapes.geometryObjects.tolist()
        # `Tree.bare` and Pinocchio made the names.
        links = list(tree.links)
        names = [FLOOR if x.name == FLOOR else links[int(x.name.split()[1].split('_')[0])]
                 for x in shapes]
        pairs = [(a, b) for (a, x), (b, y) in combinations(enumerate(shapes), 2)
                 if x.parentJoint != y.parentJoint
                 and frozenset((names[a], names[b])) not in joined]
        distances = self._distances(pairs, rests)
        touch = distances[0] <= _TOUCH
        self._kept = [pair for pair, no in zip(pairs, touch) if not no]
        free = np.where(distances > _TOUCH, distances, inf)[:, ~touch].min(axis=0)
        self._least = np.minimum(clearance, 0.5 * free)
        self.pairs, touching = ([(names[a], names[b]) for (a, b), yes in zip(pairs, touch)
                                 if yes == kind] for kind in (False, True))
        self.touching = sorted({' and '.join(pair) for pair in touching})
        if not self.pairs:
            why = f' ({", ".join(self.unseen)})' if self.unseen else ''
            raise CtcError(f'no two links have collision shapes{why}' if not pairs else
                           f'links touch at the centre: {", ".join(self.touching)}')

    def nearest(self, t: Array, q: Array) -> tuple[float, str]:
        """
        Return where links have the least to spare.

        Parameters
        ----------
        t : ndarray, shape (N,)
            Times [s].
        q : ndarray, shape (N, n)
            Positions at these [rad].

        Returns
        -------
        spare : float
            Distance over what links must keep, less 1.
        text : str
            Which links, when, how near, and what they must keep.

        """
        distances = self._distances(self._kept, q)
        spare = distances / self._least - 1.0
        k, pair = divmod(int(spare.argmin()), len(self.pairs))
        found, (first, second) = float(distances[k, pair]), self.pairs[pair]
        how = f'{found:.2g} m' if found > 0.0 else 'they touch'
        return float(spare[k, pair]), (f'{how}, {first} and {second} at {t[k]:.1f} s; at least '
                                       f'{self._least[pair]:.2g} m')

    def _distances(self, pairs: Sequence[tuple[int, int]], q: Array) -> Array:
        """Return the distances of pairs of shapes at positions q, (N, n), shape (N, pairs) [m]."""
        pin, shapes, state = self._pin, self._shapes, self._model.createData()
        shapes.removeAllCollisionPairs()
        for pair in pairs:
            shapes.addCollisionPair(pin.CollisionPair(*pair))
        data, found = shapes.createData(), np.empty((len(q), len(pairs)))
        for row, place in zip(found, q):
            pin.computeDistances(self._model, state, shapes, data, place[self._order])
            row[:] = [x.min_distance for x in data.distanceResults]
        return found


def shaped(tree: Tree) -> tuple[str, list[str]]:
    """Return a URDF with collision shapes, and the links that should have one more."""
    robot = ET.fromstring(tree.bare())
    unseen = []
    for link, element in zip(tree.links.values(), robot.findall('link')):
        shapes = [copy.deepcopy(shape) for shape in link.findall('collision')]
        meshes = [mesh for shape in shapes for mesh in shape.iter('mesh')]
        paths = [find_mesh(mesh.get('filename', '')) for mesh in meshes]
        for mesh, path in zip(meshes, paths):
            mesh.set('filename', str(path and path.absolute()))
        if all(paths):
            element.extend(shapes)
        if not all(paths) or (not shapes and link.find('visual') is not None):
            unseen.append(link.get('name', ''))
    return ET.tostring(robot, encoding='unicode'), unseen


def geometry(pin: Any, text: str, stand: Mapping[str, float], floor: float) -> Any:
    """Return Pinocchio's model of the joints that move, and its shapes, meshes as their hulls."""
    model = pin.buildModelFromXML(text)
    shapes = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION)
    if floor < inf:
        coal: Any = importlib.import_module('coal')
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, floor - _WIDE]))
        shapes.addGeometryObject(pin.GeometryObject(
            FLOOR, 0, 0, place, coal.Box(*[2.0 * _WIDE] * 3)))
    for shape in shapes.geometryObjects:
        if hasattr(shape.geometry, 'buildConvexHull'):
            try:
                shape.geometry.buildConvexHull(True, 'Qt')
            except (RuntimeError, ValueError):  # All points in a plane.
                continue
            shape.geometry = shape.geometry.convex
    q = pin.neutral(model)
    ids = [model.getJointId(name) for name in stand]
    for joint, value in zip(ids, stand.values()):
        q[model.joints[joint].idx_q] = value
    return pin.buildReducedModel(model, shapes, ids, q)
