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

"""Arm and ghost in the scene, and the cameras of browsers."""

from __future__ import annotations

from contextlib import nullcontext
from math import tan
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.live import page, require_viser
from ctc_chattering.live import skeleton as shapes
from ctc_chattering.live.page_socket import PageSocket
from ctc_chattering.live.server import free_port, serve
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest


def test_arm_and_ghost_are_hidden_until_their_positions_are_known() -> None:
    server = serve(require_viser(), '127.0.0.1', free_port('127.0.0.1', 0), '', PageSocket())
    try:
        skeleton = shapes.skeleton_of(ControllerConfig())
        assert skeleton is not None
        view = page.ArmView(server.viser.scene, skeleton, '/arm0')
        parts = (view._arm, view._ghost)

        def is_shown(part: Any, q: Any) -> None:
            for frame, pose in zip(part.frames, skeleton.poses(q), strict=True):
                assert np.allclose(frame.wxyz, shapes.quaternion(pose[:3, :3]))
                assert np.allclose(frame.position, pose[:3, 3])
        q = np.array([0.3, -0.8])
        for arm, ghost, expected in ((None, None, [False, False]), (q, None, [True, False]),
                                     (q, 2.0 * q, [True, True])):
            view.show(arm, ghost)
            assert [part.root.visible for part in parts] == expected
        is_shown(view._arm, q)
        is_shown(view._ghost, 2.0 * q)
        # A small error, and one that would turn a joint by more than 1 rad.
        view.show(q, q + np.array([1e-3, -0.5]), 100)
        is_shown(view._ghost, q + np.array([0.1, -1.0]))
    finally:
        server.stop()


def seen(camera: page.CameraPose, points: Array, aspect: float) -> Array:
    """Return where a camera with z up sees points, ±1 at the edges of a view."""
    ahead = np.subtract(camera.look_at, camera.position)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    x = points - camera.position
    across: Array = np.stack((x @ right, x @ np.cross(right, ahead)), axis=1)
    across /= ((x @ ahead) * tan(0.5 * page.FIELD_OF_VIEW))[:, None]
    return across / (aspect, 1.0)


@pytest.mark.parametrize(('count', 'aspect'), [(1, 1.6), (2, 0.5)])
def test_the_arms_fill_the_view(count: int, aspect: float) -> None:
    skeleton = shapes.skeleton_of(ControllerConfig())
    assert skeleton is not None
    meshes = shapes.body_meshes(skeleton)
    motion = [np.array([3.1, 1.6]) + shift for shift in np.linspace(-0.3, 0.3, 7)]
    roots = shapes.root_positions(count, skeleton.reach)
    server: Any = SimpleNamespace(add_frame=Mock(), add_mesh_simple=Mock())
    views = [page.ArmView(server, skeleton, '/arm', root) for root in roots]
    camera = page.fit_camera(np.concatenate([view.points(motion) for view in views]), aspect)
    arm = np.concatenate([
        mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
        for q in motion
        for pose, body in zip(skeleton.poses(q), meshes)
        for mesh in body])
    across = seen(camera, np.concatenate([arm + root for root in roots]), aspect)
    assert np.abs(across).max() < 0.9
    assert np.ptp(across, axis=0).max() > 1.6  # 80 % of the width or of the height.


def test_cameras_show_the_arms_until_one_is_moved() -> None:
    """Check with a server of one browser: a view of another shape, a hand, a click on fit."""
    client = SimpleNamespace(camera=SimpleNamespace(position=None), atomic=nullcontext)
    server = SimpleNamespace(initial_camera=SimpleNamespace(), get_clients=lambda: {0: client})
    socket = PageSocket()
    positions = []
    cameras = page.Cameras(server, socket)

    def request(message: str) -> None:
        socket.on_message(message)
        socket.poll(tuple)
        positions.append((client.camera.position, server.initial_camera.position))
    cameras.look(np.eye(3))
    for message in ('{}', '{"aspect": 0.3}', '{"moved": null}', '{"aspect": 2}'):
        request(message)
    first, narrow, hand, wide = positions
    assert first == (page.fit_camera(np.eye(3)).position,) * 2
    assert narrow == hand == (page.fit_camera(np.eye(3), 0.3).position,) * 2
    assert wide == (narrow[0], page.fit_camera(np.eye(3), 2.0).position)
    cameras.look(2.0 * np.eye(3), after_move=False)
    assert client.camera.position == narrow[0]
    cameras.look(2.0 * np.eye(3))
    assert client.camera.position == page.fit_camera(2.0 * np.eye(3), 2.0).position
