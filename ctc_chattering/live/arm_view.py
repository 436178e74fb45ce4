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

"""An arm in the 3-D scene of the page, and where it should be as a ghost."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any, Literal, NamedTuple

from ctc_chattering.configuration.package_share import find_mesh
from ctc_chattering.live.cameras import outermost
from ctc_chattering.live.skeleton import LONGEST, quaternion, Shape, Skeleton
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Blue and orange of the palette of Okabe and Ito. Of the ghost, larger and transparent, only what
#: is behind the arm is drawn, so that the arm keeps its colour.
ARM_COLOUR, GHOST_COLOUR = (0, 114, 178), (230, 159, 0)
_GHOST_SCALE, _GHOST_OPACITY = 1.03, 0.6
#: What the ghost's distance from the arm may be multiplied by, and the largest that is drawn of a
#: joint then [rad or m].
Magnified = Literal[1, 10, 100, 1000]
_LARGEST = 1.0
#: Of more triangles a link is drawn by its other shapes.
_MOST = 200_000


class ArmView:
    """
    An arm and its ghost, each hidden until its position is known.

    Parameters
    ----------
    server : ViserServer
    skeleton : Skeleton
    name : str
        Of its nodes in the scene.
    place : sequence of float, shape (3,)
        Where its root is [m].

    Attributes
    ----------
    skeleton : Skeleton
    magnified : int
        What the error is multiplied by where the ghost is drawn; one of `Magnified`.

    """

    def __init__(self, server: Any, skeleton: Skeleton, name: str,
                 place: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        self.skeleton, self.magnified = skeleton, 1
        self._place = np.array(place)
        self._root = server.scene.add_frame(f'/{name}', show_axes=False, position=place)
        shapes = drawn(skeleton)
        self._outlines = [outermost([vertices for vertices, _ in body]) for body in shapes]
        self._parts, self._frames = {}, {}
        for part, colour, scale, opacity, side in (
                ('arm', ARM_COLOUR, 1.0, None, 'front'),
                ('ghost', GHOST_COLOUR, _GHOST_SCALE, _GHOST_OPACITY, 'back')):
            self._parts[part] = server.scene.add_frame(
                f'/{name}/{part}', show_axes=False, visible=False)
            frames = self._frames[part] = [
                server.scene.add_frame(f'/{name}/{part}/{i}', show_axes=False)
                for i in range(len(shapes))]
            for frame, body in zip(frames, shapes):
                for k, (vertices, faces) in enumerate(body):
                    middle = vertices.mean(axis=0)
                    server.scene.add_mesh_simple(
                        f'{frame.name}/{k}', middle + scale * (vertices - middle), faces,
                        color=colour, opacity=opacity, side=side, flat_shading=False,
                        cast_shadow=False, receive_shadow=False)

    def points(self, positions: Iterable[Array]) -> Array:
        """Return the outline of the arm at `positions`, each of shape (n,), shape (N, 3) [m]."""
        found = [np.empty((0, 3))]
        for q in positions:
            found += [outline @ pose[:3, :3].T + pose[:3, 3]
                      for outline, pose in zip(self._outlines, self.skeleton.poses(q))]
        points: Array = np.concatenate(found) + self._place
        return points

    def show(self, q: Array | None, q_d: Array | None) -> None:
        """Draw the arm at `q` and the ghost at `q_d`, each of shape (n,) [rad], where known."""
        if q is not None and q_d is not None and self.magnified != 1:
            q_d = q + np.clip(self.magnified * (q_d - q), -_LARGEST, _LARGEST)
        for part, position in (('arm', q), ('ghost', q_d)):
            if position is None:
                continue
            poses = self.skeleton.poses(position)
            for frame, pose in zip(self._frames[part], poses):
                frame.wxyz, frame.position = quaternion(pose[:3, :3]), pose[:3, 3]
            if not self._parts[part].visible:
                self._parts[part].visible = True

    def remove(self) -> None:
        """Take it from the scene."""
        self._root.remove()


class Triangles(NamedTuple):
    """Vertices in the frame of a body, shape (V, 3) [m], and faces, shape (F, 3)."""

    vertices: Array
    faces: Any


def drawn(skeleton: Skeleton) -> list[list[Triangles]]:
    """
    Return the triangles of every body.

    A body has its visual shapes; if one of their files is not found or not read, its shapes for
    collisions; and if these are not either, its capsules. An arm without shapes has capsules.
    """
    bare = not any(body.visual or body.collision for body in skeleton.bodies)
    found = []
    for body in skeleton.bodies:
        choices = [x for x in (body.visual, body.collision) if x]
        if choices or bare:
            choices.append(body.capsules)
        found.append(next((made for made in map(_all, choices) if made is not None), []))
    return found


def _all(shapes: Sequence[Shape]) -> list[Triangles] | None:
    """Return the triangles of all shapes; None if there is one without."""
    made = [triangles(shape) for shape in shapes]
    return None if None in made else [x for x in made if x is not None]


def triangles(shape: Shape) -> Triangles | None:
    """Return the triangles of a shape; None for a mesh that is not found or not read."""
    mesh = None
    with suppress(Exception):  # Of arbitrary files, readers raise arbitrary exceptions.
        mesh = _mesh(shape)
    if mesh is None or not 0 < len(mesh.faces) <= _MOST:
        return None
    vertices = np.asarray(mesh.vertices, float) @ shape.pose[:3, :3].T + shape.pose[:3, 3]
    if not np.abs(vertices).max() < LONGEST:
        return None
    return Triangles(vertices, np.asarray(mesh.faces, np.int64))


def _mesh(shape: Shape) -> Any:
    import trimesh
    sizes = shape.sizes
    if shape.kind == 'mesh':
        path = find_mesh(shape.file)
        if path is None:
            return None
        mesh: Any = trimesh.load(path, force='mesh')
        mesh.apply_scale(sizes)
        return mesh
    if shape.kind == 'box':
        return trimesh.creation.box(sizes)
    if shape.kind == 'cylinder':
        return trimesh.creation.cylinder(sizes[0], sizes[1], sections=24)
    if shape.kind == 'sphere':
        return trimesh.creation.icosphere(2, sizes[0])
    a, b = np.array(sizes[:3]), np.array(sizes[3:6])
    mesh = trimesh.creation.capsule(float(np.linalg.norm(b - a)), sizes[6], count=(12, 12))
    align: Any = trimesh.geometry.align_vectors
    mesh.apply_transform(align((0.0, 0.0, 1.0), b - a))
    mesh.apply_translation(a - mesh.vertices.mean(axis=0) + 0.5 * (b - a))
    return mesh
