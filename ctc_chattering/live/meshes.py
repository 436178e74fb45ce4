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

"""Triangles of the shapes of an arm, from the files of a description where they are found."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NamedTuple

from ctc_chattering.configuration.robot_description import find_file
from ctc_chattering.live.skeleton import LONGEST, Shape, Skeleton
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import trimesh

#: Files of more triangles than this are drawn by the other shapes of their link.
_MOST = 200_000


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
    sizes = shape.sizes
    if shape.kind == 'mesh':
        mesh: Any = trimesh.load(find_file(shape.file.removeprefix('file://')), force='mesh')
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
