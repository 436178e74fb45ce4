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

from collections.abc import Callable, Iterable
from typing import Any

from ctc_chattering.live.framing import outermost
from ctc_chattering.live.meshes import drawn
from ctc_chattering.live.skeleton import quaternion, Skeleton
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Blue and orange of the palette of Okabe and Ito. Of the ghost, larger and transparent, only what
#: is behind the arm is drawn, so that the arm keeps its colour.
ARM_COLOUR, GHOST_COLOUR = (0, 114, 178), (230, 159, 0)
_GHOST_SCALE, _GHOST_OPACITY = 1.03, 0.6
#: What the ghost's distance from the arm may be multiplied by, and the largest that is drawn of a
#: joint then [rad or m].
MAGNIFIED, _LARGEST = (1, 10, 100, 1000), 1.0


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
        What the error is multiplied by where the ghost is drawn; one of `MAGNIFIED`.

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
        self._label = server.scene.add_label(
            f'/{name}/ghost/label', '', visible=False, anchor='bottom-left')

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
            if part == 'ghost':
                self._show_label(poses[:, :3, 3])

    def _show_label(self, joints: Array) -> None:
        """Say at the ghost by how much its distance from the arm is magnified, if it is."""
        text = f'ghost: error × {self.magnified}'
        if self._label.visible != (self.magnified != 1):
            self._label.visible = self.magnified != 1
        if self._label.visible:
            self._label.position = joints[-1]
            if self._label.text != text:
                self._label.text = text

    def remove(self) -> None:
        """Take it from the scene."""
        self._root.remove()


class View:
    """
    What the page has of the picture: how the ghost is magnified, and a button for the camera.

    Parameters
    ----------
    gui : GuiApi
        In the container to fill.
    fit : callable
        Called with viser's event of a click on "fit the view".

    """

    def __init__(self, gui: Any, fit: Callable[[Any], None]) -> None:
        self._chosen = gui.add_dropdown('magnify the error', [f'× {k}' for k in MAGNIFIED], hint=(
            'the ghost is drawn at q + k (q_d - q), where the error of a joint is at most '
            f'{_LARGEST:g} rad'))
        gui.add_button('fit the view').on_click(fit)

    @property
    def magnified(self) -> int:
        """Return what the error is multiplied by."""
        return int(str(self._chosen.value).removeprefix('× '))
