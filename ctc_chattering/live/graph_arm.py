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

"""The arm of a running graph, and the camera that shows it."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.live.arm_view import ArmView
from ctc_chattering.live.graph_reader import GraphReader
from ctc_chattering.live.page import Page
from ctc_chattering.live.skeleton import skeleton_of
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.trajectory.reference import ReferenceConfig, Sinusoid
import numpy as np

#: After which a motion has settled [s].
_SETTLED = 3.0
#: Parameters of the desired motion, and positions of it that the camera shows.
_MOTION = ('joint_names', 'center', 'amplitude', 'frequency', 'phase')
_POSES = 24
#: Further than this out of what the camera shows, as a part of its size, the arm is shown anew.
_OUT = 0.05


class GraphArm:
    """
    Draws the arm of a graph, once it is known.

    Parameters
    ----------
    page : Page
    reader : GraphReader

    """

    def __init__(self, page: Page, reader: GraphReader) -> None:
        self._page, self._reader = page, reader
        self._view: ArmView | None = None
        #: When the camera is to look anew: where the arm begins it may never be again.
        self._looks: list[float] = []
        #: Points that the camera shows.
        self._shown: Array | None = None

    def make(self, config: ControllerConfig, description: str, now: float) -> None:
        """Draw another robot from now on."""
        try:
            skeleton = skeleton_of(config, description)
        except CtcError as error:
            skeleton = None
            self._reader.get_logger().warning(f'no picture of the arm: {error}')
        (self._view,) = self._page.show_arms([skeleton])
        self._looks, self._shown = [now, now + _SETTLED], None

    def show(self, magnified: int, now: float) -> None:
        """Draw it where it is, and the ghost by how much its error is magnified."""
        if self._view is None:
            return
        self._view.magnified = magnified
        instant = self._reader.instant()
        if instant is not None:
            q, q_d = instant.q, instant.q_d
        else:  # The controller waits, or is disabled.
            q, q_d = self._reader.position, None
        self._view.show(q, q_d)
        if self._looks and q is not None and now >= self._looks[0]:
            del self._looks[0]
            self.look()
        self._follow()

    def look(self) -> None:
        """Have cameras show the arm, and the desired motion if it is on it."""
        poses = self._poses()
        if self._view is not None and poses:
            self._look_at(self._view.points(poses + self._motion()))

    def _follow(self) -> None:
        """Have cameras show more if the arm leaves what they show."""
        if self._view is None or self._shown is None:
            return
        now = self._view.points(self._poses())
        least, most = self._shown.min(axis=0), self._shown.max(axis=0)
        if max((now - most).max(), (least - now).max()) > _OUT * (most - least).max():
            self._look_at(np.concatenate((self._shown, now)))

    def _look_at(self, points: Array) -> None:
        if len(points):
            self._shown = points
            self._page.cameras.look(points, 1)

    def _poses(self) -> list[Array]:
        """Return positions of the arm and of the ghost, where they are known."""
        instant, q = self._reader.instant(), self._reader.position
        return [x for x in (q, None if instant is None else instant.q_d) if x is not None]

    def _motion(self) -> list[Any]:
        """Return positions of the desired motion, where it is known."""
        values = self._reader.parameters['reference']
        if values.get('trajectory_file'):
            return []
        with suppress(CtcError, KeyError):
            known = ReferenceConfig.from_mapping({name: values[name] for name in _MOTION})
            if known.joint_names == self._reader.names:
                motion = Sinusoid(known)
                slow = min((x for x in known.frequency if x), default=1.0)
                return [np.array(motion.at(round(k / _POSES / slow * NANOSECONDS))[0])
                        for k in range(_POSES)]
        return []
