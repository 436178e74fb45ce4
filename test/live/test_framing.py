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

from math import tan
from types import SimpleNamespace

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.live.framing import Camera, camera_of, corners, FIELD, is_at, roots
from ctc_chattering.live.meshes import drawn
from ctc_chattering.live.skeleton import skeleton_of, urdf_skeleton
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest
from urdfs import PANDA, panda, UR5, ur5


def seen(camera: Camera, points: Array) -> Array:
    """Return where a camera with z up sees points, ±1 at the edges of a square view."""
    ahead = np.subtract(camera.look_at, camera.position)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    x = points - camera.position
    across: Array = np.stack((x @ right, x @ np.cross(right, ahead)), axis=1)
    across /= ((x @ ahead) * tan(0.5 * FIELD))[:, None]
    return across


@pytest.mark.parametrize('count', [1, 2])
@pytest.mark.parametrize(('name', 'q'), [
    ('two_link', [3.1, 1.6]), ('panda', [0, -0.6, 0, -2.0, 0, 1.5, 0.8]),
    ('ur5', [0, -1.2, 1.5, -1.5, -1.5, 0])])
def test_the_arms_fill_the_view(name: str, q: list[float], count: int) -> None:
    skeleton = (skeleton_of(ControllerConfig()) if name == 'two_link' else
                urdf_skeleton(*((panda(), PANDA) if name == 'panda' else (ur5(), UR5))))
    assert skeleton is not None
    arm = np.concatenate([
        vertices @ pose[:3, :3].T + pose[:3, 3] for pose, body in zip(
            skeleton.poses(q), drawn(skeleton)) for vertices, _ in body])
    points = np.concatenate([arm + place for place in roots(count, skeleton.reach)])
    camera = camera_of(corners([points]), np.empty((0, 3)), count)
    across = np.abs(seen(camera, points))
    assert across.max() < 0.9
    assert max(np.ptp(x) for x in seen(camera, points).T) > 1.0  # Half of the view.
    above = points + np.array([0.0, 0.0, 3.0])
    moved = camera_of(points, above, count)
    assert np.abs(seen(moved, above)).max() < 1.0


def test_a_camera_that_was_moved_is_known() -> None:
    camera = camera_of(np.eye(3), np.empty((0, 3)))
    for shift, same in ((1e-4, True), (0.1, False)):
        other = SimpleNamespace(position=np.add(camera.position, shift), look_at=camera.look_at)
        assert is_at(camera, other) == same
