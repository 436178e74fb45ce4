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

"""Where the camera of the page stands, so that the arms fill the view."""

from __future__ import annotations

from collections.abc import Sequence
from math import tan
from typing import Any, NamedTuple

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Vertical angle of view [rad]; width of a view as a part of its height where it is not known.
FIELD, ASPECT = 0.8, 0.9
#: Part of the view that the arms fill, where they are now and wherever they will be.
_NOW, _EVER = 0.8, 0.98
#: From the arm to the camera: of one arm, in a wide view and in a narrow one, of which the second
#: is taken if it comes so much closer; and of several arms, which stand one behind the other.
_WIDE, _NARROW, _CLOSER, _SEVERAL = (0.2, -1.0, 0.15), (0.8, -0.8, 0.2), 0.85, (-0.8, -0.8, 0.25)
#: Between the roots of two arms, as a part of the reach.
_APART = 0.65


class Camera(NamedTuple):
    """Where a camera is, and what it looks at, each of shape (3,) [m]."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]


def roots(count: int, reach: float) -> list[tuple[float, float, float]]:
    """Return where the roots of `count` arms are in the scene [m]."""
    return [(0.0, _APART * reach * (i - 0.5 * (count - 1)), 0.0) for i in range(count)]


def camera_of(now: Array, ever: Array, count: int = 1, aspect: float = ASPECT) -> Camera:
    """
    Return the camera that shows all of some points as large as a view allows.

    Parameters
    ----------
    now : ndarray, shape (N, 3)
        Points of the arms where they are [m].
    ever : ndarray, shape (M, 3)
        Points of the arms where they may be [m].
    count : int
        Number of arms.
    aspect : float
        Width of the view as a part of its height.

    """
    if count > 1:
        return _seen_from(_SEVERAL, now, ever, aspect)[1]
    distance, camera = _seen_from(_WIDE, now, ever, aspect)
    closer, other = _seen_from(_NARROW, now, ever, aspect)
    return other if closer < _CLOSER * distance else camera


def _seen_from(direction: tuple[float, float, float], now: Array, ever: Array, aspect: float
               ) -> tuple[float, Camera]:
    """Return the least distance from which all can be seen, and the camera there."""
    back = np.array(direction)
    back /= np.linalg.norm(back)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    axes = np.stack((right, np.cross(back, right), back))
    points = np.concatenate((now, ever))
    seen = points @ axes.T
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    size = np.array((aspect, 1.0)) * tan(0.5 * FIELD)
    distance = 0.0
    for part, fills in ((now, _NOW), (points, _EVER)):
        x = part @ axes.T - middle
        # Of a point: |across| <= fills * size * (distance - depth).
        distance = max(distance, float((np.abs(x[:, :2]) / (fills * size) + x[:, 2:]).max()))
    target = middle @ axes
    return distance, Camera(_three(target + distance * back), _three(target))


def is_at(camera: Camera, other: Any, tolerance: float = 1e-2) -> bool:
    """Return whether a browser's camera, a handle of viser, is almost where this one is."""
    near = tolerance * float(np.linalg.norm(np.subtract(camera.position, camera.look_at)))
    return all(np.linalg.norm(np.subtract(a, b)) < near for a, b in (
        (camera.position, other.position), (camera.look_at, other.look_at)))


def _three(x: Array) -> tuple[float, float, float]:
    a, b, c = map(float, x)
    return a, b, c


def corners(vertices: Sequence[Array]) -> Array:
    """Return the corners of the box around points, shape (8, 3); of none, shape (0, 3)."""
    if not vertices:
        return np.empty((0, 3))
    points = np.concatenate(vertices)
    box = np.stack((points.min(axis=0), points.max(axis=0)))
    return np.array([[box[i, 0], box[j, 1], box[k, 2]]
                     for i in (0, 1) for j in (0, 1) for k in (0, 1)])
