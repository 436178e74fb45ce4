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

"""The cameras of the browsers: where they show the arms, until somebody moves them."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from itertools import product
from math import cos, radians, sin, tan
import time
from typing import Any, NamedTuple

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Vertical angle of view [rad]; width of a view as a part of its height where it is not known.
FIELD, ASPECT = 0.8, 0.9
#: Part of the width or of the height of the view, whichever is less room, that the arms fill.
_FILLS = 0.85
#: Directions from the arms to the camera, those that are preferred first: azimuths of one arm and
#: of several, which would hide each other from the side, and elevations [rad].
_AZIMUTHS, _ELEVATIONS = tuple(map(radians, (
    -75, -60, -45, -30, -15, 75, 60, 45, 30, 15))), (radians(12), radians(25))
_SEVERAL = tuple(x for x in _AZIMUTHS if abs(x) < radians(50))
#: The first direction is taken from which the arms fill so large a part of the best.
_GOOD = 0.9
#: Between the roots of two arms, as a part of the reach.
_APART = 0.65
#: Where a body is furthest out, seen from its middle: corners, edges and faces of a cube.
_WAYS = np.array([x for x in product((-1.0, 0.0, 1.0), repeat=3) if any(x)])
_WAYS /= np.linalg.norm(_WAYS, axis=1)[:, None]
#: Between two looks at the browsers [s].
_PERIOD = 0.2
#: Cameras of browsers that have just come.
_KEPT = 8
#: Width of a view as a part of its height that a camera is made for.
_NARROW, _WIDE = 0.3, 3.0


class Camera(NamedTuple):
    """Where a camera is, and what it looks at, each of shape (3,) [m]."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]


def roots(count: int, reach: float) -> list[tuple[float, float, float]]:
    """Return where the roots of `count` arms are in the scene [m]."""
    return [(0.0, _APART * reach * (i - 0.5 * (count - 1)), 0.0) for i in range(count)]


def camera_of(points: Array, count: int = 1, aspect: float = ASPECT) -> Camera:
    """
    Return the camera that shows all of some points as large as a view allows.

    Parameters
    ----------
    points : ndarray, shape (N, 3)
        Of the arms, where they are and where they may be [m].
    count : int
        Number of arms.
    aspect : float
        Width of the view as a part of its height.

    """
    found = [_seen_from(azimuth, elevation, points, aspect)
             for elevation in _ELEVATIONS for azimuth in (_AZIMUTHS if count == 1 else _SEVERAL)]
    best = max(area for area, _ in found)
    return next(camera for area, camera in found if area >= _GOOD * best)


def _seen_from(azimuth: float, elevation: float, points: Array, aspect: float
               ) -> tuple[float, Camera]:
    """Return the part of the view that the points' box fills, and the nearest camera."""
    back = np.array((cos(elevation) * cos(azimuth), cos(elevation) * sin(azimuth), sin(elevation)))
    right = np.array((-sin(azimuth), cos(azimuth), 0.0))
    axes = np.stack((right, np.cross(back, right), back))
    seen = points @ axes.T
    across, depth = seen[:, :2], seen[:, 2:]
    # A point is seen if |across - middle| <= size (distance - depth).
    size = _FILLS * tan(0.5 * FIELD) * np.array((aspect, 1.0))
    least, most = (depth - across / size).max(axis=0), (depth + across / size).max(axis=0)
    middle, distance = 0.5 * size * (most - least), float((0.5 * (most + least)).max())
    area = float(np.ptp((across - middle) / (size * (distance - depth)), axis=0).prod())
    position, target = (np.append(middle, x) @ axes for x in (distance, depth.mean()))
    return area, Camera(_three(position), _three(target))


def is_at(camera: Camera, other: Any, tolerance: float = 1e-2) -> bool:
    """Return whether a browser's camera, a handle of viser, is almost where this one is."""
    near = tolerance * float(np.linalg.norm(np.subtract(camera.position, camera.look_at)))
    return all(np.linalg.norm(np.subtract(a, b)) < near for a, b in (
        (camera.position, other.position), (camera.look_at, other.look_at)))


def _three(x: Array) -> tuple[float, float, float]:
    a, b, c = map(float, x)
    return a, b, c


def outermost(vertices: Sequence[Array]) -> Array:
    """Return those of some points that are furthest out, shape (N, 3); of none, shape (0, 3)."""
    if not vertices:
        return np.empty((0, 3))
    points: Array = np.concatenate(vertices)
    furthest: Array = points[np.unique(np.argmax(points @ _WAYS.T, axis=0))]
    return furthest


class Cameras:
    """
    What browsers look at.

    Parameters
    ----------
    server : ViserServer

    """

    def __init__(self, server: Any) -> None:
        self._server = server
        #: Points that are shown, and the number of arms.
        self._shown: tuple[Any, int] | None = None
        #: The camera that each browser was given last, by its number.
        self._given: dict[int, Camera] = {}
        #: The last cameras that browsers were given when they came, of which they know one.
        self._initial: deque[Camera] = deque(maxlen=_KEPT)
        self._due = 0.0

    def look(self, points: Any, count: int, everybody: bool = False) -> None:
        """
        Show points, as `camera_of` takes them, to all who have not moved their camera.

        With `everybody` they are shown to those who have, too.
        """
        if not len(points):
            return
        self._shown = points, count
        self._initial.append(camera_of(points, count))
        initial = self._server.initial_camera
        initial.fov = FIELD
        initial.position, initial.look_at = self._initial[-1]
        self._due = 0.0
        self.follow(everybody)

    def follow(self, everybody: bool = False) -> None:
        """Give those who have not moved their camera the one for the shape of their view."""
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + _PERIOD
        clients = self._server.get_clients()
        self._given = {number: x for number, x in self._given.items() if number in clients}
        for number, client in clients.items():
            known = [self._given[number]] if number in self._given else self._initial
            if everybody or any(is_at(camera, client.camera) for camera in known):
                self._fit(client)

    def _fit(self, client: Any) -> None:
        """Give a browser the camera that shows the arms in its view."""
        if self._shown is None:
            return
        camera = camera_of(*self._shown, aspect=_aspect(client.camera))
        self._given[client.client_id] = camera
        if not is_at(camera, client.camera, 1e-4):
            with suppress(Exception), client.atomic():  # Of what a browser says of its camera.
                client.camera.position, client.camera.look_at = camera


def _aspect(camera: Any) -> float:
    try:
        return float(min(max(camera.aspect, _NARROW), _WIDE))
    except (AssertionError, ZeroDivisionError):  # It has not said so yet.
        return ASPECT
