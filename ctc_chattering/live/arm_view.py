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

from typing import Any

from ctc_chattering.live.meshes import drawn
from ctc_chattering.live.skeleton import quaternion, Skeleton
from ctc_chattering.numerics.linear_algebra import Array

#: Blue and orange of the palette of Okabe and Ito. Of the ghost, larger and transparent, only what
#: is behind the arm is drawn, so that the arm keeps its colour.
ARM_COLOUR, GHOST_COLOUR = (0, 114, 178), (230, 159, 0)
_GHOST_SCALE, _GHOST_OPACITY = 1.03, 0.6


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

    """

    def __init__(self, server: Any, skeleton: Skeleton, name: str,
                 place: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        self.skeleton = skeleton
        self._root = server.scene.add_frame(f'/{name}', show_axes=False, position=place)
        shapes = drawn(skeleton)
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

    def show(self, q: Array | None, q_d: Array | None) -> None:
        """Draw the arm at `q` and the ghost at `q_d`, each of shape (n,) [rad], where known."""
        for part, position in (('arm', q), ('ghost', q_d)):
            if position is None:
                continue
            for frame, pose in zip(self._frames[part], self.skeleton.poses(position)):
                frame.wxyz, frame.position = quaternion(pose[:3, :3]), pose[:3, 3]
            if not self._parts[part].visible:
                self._parts[part].visible = True

    def remove(self) -> None:
        """Take it from the scene."""
        self._root.remove()
