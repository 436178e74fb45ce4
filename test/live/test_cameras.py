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

"""The camera shows all of the arms, as large as the view allows."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from math import tan
from types import SimpleNamespace

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.live.page import Camera, camera_of, Cameras, drawn, FIELD, outermost
from ctc_chattering.live.page_socket import PageSocket
from ctc_chattering.live.skeleton import places, skeleton_of, urdf_skeleton
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest
from urdfs import PANDA, panda


def seen(camera: Camera, points: Array, aspect: float) -> Array:
    """Return where a camera with z up sees points, ±1 at the edges of a view."""
    ahead = np.subtract(camera.look_at, camera.position)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    x = points - camera.position
    across: Array = np.stack((x @ right, x @ np.cross(right, ahead)), axis=1)
    across /= ((x @ ahead) * tan(0.5 * FIELD))[:, None]
    return across / (aspect, 1.0)


@pytest.mark.parametrize(('name', 'q', 'count', 'aspect'), [
    ('two_link', [3.1, 1.6], 1, 1.6), ('two_link', [3.1, 1.6], 2, 0.5),
    ('panda', [0, -0.6, 0, -2.0, 0, 1.5, 0.8], 2, 1.0)])
def test_the_arms_fill_the_view(name: str, q: list[float], count: int, aspect: float) -> None:
    skeleton = (skeleton_of(ControllerConfig()) if name == 'two_link'
                else urdf_skeleton(panda(), PANDA))
    assert skeleton is not None
    bodies = drawn(skeleton)
    motion = [np.add(q, shift) for shift in np.linspace(-0.3, 0.3, 7)]

    def placed(shapes: Sequence[Sequence[Array]]) -> Array:
        arm = np.concatenate([
            vertices @ pose[:3, :3].T + pose[:3, 3] for x in motion
            for pose, body in zip(skeleton.poses(x), shapes) for vertices in body])
        return np.concatenate([arm + place for place in places(count, skeleton.reach)])
    vertices = [[x.vertices for x in body] for body in bodies]
    camera = camera_of(placed([[outermost(body)] for body in vertices]), aspect)
    across = seen(camera, placed(vertices), aspect)
    assert np.abs(across).max() < 0.9
    assert np.ptp(across, axis=0).max() > 1.6  # 80 % of the width or of the height.


def test_cameras_show_the_arms_until_one_is_moved() -> None:
    """Check with a server of one browser: a view of another shape, a hand, a click on fit."""
    client = SimpleNamespace(camera=SimpleNamespace(position=None), atomic=nullcontext)
    server = SimpleNamespace(initial_camera=SimpleNamespace(), get_clients=lambda: {0: client})
    socket, found = PageSocket(), []
    cameras = Cameras(server, socket)

    def say(words: str) -> None:
        socket.hear(words)
        socket.poll(tuple)
        found.append((client.camera.position, server.initial_camera.position))
    cameras.look(np.eye(3))
    for words in ('{}', '{"aspect": 0.3}', '{"moved": null}', '{"aspect": 2}'):
        say(words)
    first, narrow, hand, wide = found
    assert first == (camera_of(np.eye(3)).position,) * 2
    assert narrow == hand == (camera_of(np.eye(3), 0.3).position,) * 2
    assert wide == (narrow[0], camera_of(np.eye(3), 2.0).position)
    cameras.look(2.0 * np.eye(3), again=False)
    assert client.camera.position == narrow[0]
    cameras.look(2.0 * np.eye(3))
    assert client.camera.position == camera_of(2.0 * np.eye(3), 2.0).position
