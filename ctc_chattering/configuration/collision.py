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
Distances between the links of a robot along a motion.

`ctc excite` refuses motions that bring links too near each other. Shapes come from the URDF,
poses from `ForwardKinematics`, distances from Pinocchio and coal. A mesh counts as its convex
hull, which contains it.
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
from ctc_chattering.dynamics.kinematics import ForwardKinematics
from ctc_chattering.dynamics.urdf_model import pinocchio
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import as_ctc_error, CtcError
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Name of the floor among the links.
FLOOR = 'the floor'
#: Half of the floor's edges [m].
_FLOOR_HALF_WIDTH_M = 50.0
#: Links that are nearer than this touch [m].
_TOUCH_M = 1e-3


class LinkShapes(NamedTuple):
    """The collision shapes of a robot."""

    #: Pinocchio's GeometryModel.
    model: Any
    #: Link of each shape, or `FLOOR`.
    links: list[str]
    #: Pose of each shape in the frame of its link, shape (shapes, 4, 4).
    poses: Array


class Approach(NamedTuple):
    """
    Nearest approach of two links.

    It is the least distance in proportion to the required one, with its time [s, m].
    """

    links: tuple[str, str]
    t: float
    distance: float
    required: float

    @property
    def spare(self) -> float:
        """Distance over the required one, less 1."""
        return self.distance / self.required - 1.0

    @property
    def text(self) -> str:
        """Approach in words."""
        distance = f'{self.distance:.2g} m' if self.distance > 0.0 else 'none: they touch'
        return (
            f'{distance}, {" and ".join(self.links)} at {self.t:.1f} s; at least '
            f'{self.required:.2g} m is needed'
        )


class SelfCollision:
    """
    Distances between links that no joint joins.

    Parameters
    ----------
    description : str
        Text of the URDF.
    joints : sequence of str, length n
        Joints that move.
    locked : mapping of str to float
        Positions of other joints [rad or m].
    rests : ndarray, shape (m, n)
        Positions at which links may be near each other: the centre first, and the start.
    clearance : float
        Distance that links must keep [m]. Half of their distance at `rests`, if less, suffices.
    floor : float
        Height of a floor in the frame of the root link, or inf for none [m].

    Attributes
    ----------
    pairs : list of (str, str)
        Links that are checked. A pair of links comes as often as they have shapes.
    touching : list of str
        Pairs of links that touch at the first of `rests`. They are not checked.
    unseen : list of str
        Links with a picture but no shape, or a shape of a file that is missing.

    Raises
    ------
    CtcError
        If Pinocchio refuses a shape, or there are no two links to check.

    """

    def __init__(
        self,
        description: str,
        joints: Sequence[str],
        locked: Mapping[str, float],
        rests: Array,
        clearance: float,
        floor: float = inf,
    ) -> None:
        if not description:
            raise CtcError('there is no description of its links')
        tree = Tree(description)
        text, self.unseen = shaped(tree)
        self._pin = pinocchio()
        if not hasattr(self._pin, 'computeDistance'):
            raise CtcError('this Pinocchio has no coal')
        self._kinematics = ForwardKinematics(tree, joints, locked)
        with as_ctc_error('collision shapes: Pinocchio refuses them'):
            self._shapes = geometry(self._pin, text, list(tree.links), floor)
        names = self._shapes.links
        frame_indices = {frame.link: i for i, frame in enumerate(self._kinematics.frames)}
        # The floor is fixed to the root.
        self._frame_indices = [frame_indices.get(name, 0) for name in names]
        bodies = self._kinematics.rigid_bodies()
        body_of = {link: i for i, body in enumerate(bodies) for link in body}
        joined = {frozenset(tree.ends[name]) for name in joints}
        pairs = [
            (a, b)
            for a, b in combinations(range(len(names)), 2)
            if body_of.get(names[a]) != body_of.get(names[b])
            and frozenset((names[a], names[b])) not in joined
        ]
        distances = self._distances(pairs, rests)
        touch = distances[0] <= _TOUCH_M
        self._checked = [pair for pair, touches in zip(pairs, touch) if not touches]
        self.pairs = [(names[a], names[b]) for a, b in self._checked]
        self.touching = sorted(
            {f'{names[a]} and {names[b]}' for (a, b), touches in zip(pairs, touch) if touches}
        )
        separate = np.where(distances > _TOUCH_M, distances, inf)[:, ~touch].min(axis=0)
        self._required = np.minimum(clearance, 0.5 * separate)
        if not pairs:
            unseen = f' ({", ".join(self.unseen)})' if self.unseen else ''
            raise CtcError(f'no two links have collision shapes{unseen}')
        if not self.pairs:
            raise CtcError(f'links touch at the centre: {", ".join(self.touching)}')

    def nearest(self, t: Array, q: Array) -> Approach:
        """
        Return the nearest approach of two links.

        Parameters
        ----------
        t : ndarray, shape (N,)
            Times [s].
        q : ndarray, shape (N, n)
            Positions at these [rad].

        """
        distances = self._distances(self._checked, q)
        k, pair = divmod(int((distances / self._required).argmin()), len(self.pairs))
        return Approach(self.pairs[pair], float(t[k]), float(distances[k, pair]),
                        float(self._required[pair]))

    def _distances(self, pairs: Sequence[tuple[int, int]], q: Array) -> Array:
        """
        Return the distances of pairs of shapes, shape (N, pairs) [m].

        Positions q have the shape (N, n).
        """
        model = self._shapes.model
        model.removeAllCollisionPairs()
        for pair in pairs:
            model.addCollisionPair(self._pin.CollisionPair(*pair))
        data = model.createData()
        shape_poses = self._kinematics.poses(q)[:, self._frame_indices] @ self._shapes.poses
        distances = np.empty((len(q), len(pairs)))
        for row, poses in zip(distances, shape_poses):
            for i, pose in enumerate(poses):
                data.oMg[i] = self._pin.SE3(pose)
            self._pin.computeDistances(model, data)
            row[:] = [result.min_distance for result in data.distanceResults]
        return distances


def shaped(tree: Tree) -> tuple[str, list[str]]:
    """Return a URDF with collision shapes, and links without one."""
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


def geometry(pin: Any, text: str, links: Sequence[str], floor: float) -> LinkShapes:
    """
    Return collision shapes, meshes as their hulls.

    Parameters
    ----------
    pin : module
        Pinocchio.
    text : str
        URDF whose link i is called ``link i``, as those of `Tree.bare`.
    links : sequence of str
        Names of these links.
    floor : float
        Height of a floor, or inf for none [m].

    """
    robot = pin.buildModelFromXML(text)
    model = pin.buildGeomFromUrdfString(robot, text, pin.GeometryType.COLLISION)
    names = []
    poses = []
    for shape in model.geometryObjects:
        link = robot.frames[shape.parentFrame]
        names.append(links[int(link.name.removeprefix('link '))])
        poses.append(link.placement.actInv(shape.placement).homogeneous)
        _replace_by_hull(shape)
    if floor < inf:
        coal: Any = importlib.import_module('coal')
        box = coal.Box(*[2.0 * _FLOOR_HALF_WIDTH_M] * 3)
        pose = pin.SE3(np.eye(3), np.array([0.0, 0.0, floor - _FLOOR_HALF_WIDTH_M]))
        model.addGeometryObject(pin.GeometryObject(FLOOR, 0, 0, pose, box))
        names.append(FLOOR)
        poses.append(pose.homogeneous)
    return LinkShapes(model, names, np.array(poses).reshape(-1, 4, 4))


def _replace_by_hull(shape: Any) -> None:
    """Replace the mesh of a shape by its convex hull."""
    if hasattr(shape.geometry, 'buildConvexHull'):
        try:
            shape.geometry.buildConvexHull(True, 'Qt')
        except (RuntimeError, ValueError):  # All points in a plane.
            return
        shape.geometry = shape.geometry.convex
