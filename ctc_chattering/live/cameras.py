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

"""Cameras of the browsers: they show the arms until somebody moves them."""

from __future__ import annotations

from collections import deque
from contextlib import suppress
import time
from typing import Any

from ctc_chattering.live.framing import ASPECT, Camera, camera_of, FIELD, is_at

#: Between two looks at the browsers [s].
_PERIOD = 0.2
#: Cameras of browsers that have just come.
_KEPT = 8
#: Width of a view as a part of its height that a camera is made for.
_NARROW, _WIDE = 0.3, 3.0


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

    def look(self, points: Any, count: int) -> None:
        """Show points, as `camera_of` takes them, to all who have not moved their camera."""
        if not len(points):
            return
        self._shown = points, count
        self._initial.append(camera_of(points, count))
        initial = self._server.initial_camera
        initial.fov = FIELD
        initial.position, initial.look_at = self._initial[-1]
        self._due = 0.0
        self.follow()

    def follow(self) -> None:
        """Give those who have not moved their camera the one for the shape of their view."""
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + _PERIOD
        clients = self._server.get_clients()
        self._given = {number: x for number, x in self._given.items() if number in clients}
        for number, client in clients.items():
            known = [self._given[number]] if number in self._given else self._initial
            if any(is_at(camera, client.camera) for camera in known):
                self.fit(client)

    def fit(self, client: Any) -> None:
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
