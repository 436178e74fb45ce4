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

"""Shapes of an arm, what is drawn of them, and what cameras see."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from math import tan
import os
from pathlib import Path
import re
import threading
from types import SimpleNamespace
from typing import Any

from ctc_chattering.configuration.package_share import read_description
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.live import page, require_viser
from ctc_chattering.live import skeleton as shapes
from ctc_chattering.live.page_socket import PageSocket
from ctc_chattering.live.server import free_port, serve, stop
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pinocchio as pin
import pytest
import trimesh

#: Of both links of the paper's arm [m].
LENGTH = 0.51 / 0.63
DESCRIPTION = 'package://example-robot-data/robots/panda_description/urdf/panda.urdf'


def test_a_rotation_is_drawn_with_its_quaternion() -> None:
    rng = np.random.default_rng(1)
    for rotation in (pin.Quaternion(x / np.linalg.norm(x)).matrix()
                     for x in rng.normal(size=(5, 4))):
        w, x, y, z = shapes.quaternion(rotation)
        assert pin.Quaternion(w, x, y, z).matrix() == pytest.approx(rotation, abs=1e-12)


def test_two_links_stand_where_their_angles_say() -> None:
    """Check the model's: q = 0 hangs, both angles turn the same way, in the x-z plane."""
    skeleton = shapes.skeleton_of(ControllerConfig())
    assert skeleton is not None
    q1, q2 = 0.7, 0.4
    elbow = skeleton.tips((q1, q2))[2]
    assert elbow == pytest.approx([LENGTH * np.sin(q1), 0.0, -LENGTH * np.cos(q1)])
    end = skeleton.poses((q1, q2))[2] @ [0.0, 0.0, -LENGTH, 1.0]
    assert end[:3] - elbow == pytest.approx(
        [LENGTH * np.sin(q1 + q2), 0.0, -LENGTH * np.cos(q1 + q2)])


def test_a_model_without_description_has_no_shape() -> None:
    config = ControllerConfig(model='urdf')
    assert shapes.skeleton_of(config) is None
    assert shapes.skeleton_of(config, '<mujoco/>') is None
    with pytest.raises(CtcError):
        shapes.skeleton_of(config, '<robot/>')


def test_meshes_are_those_for_collisions_where_the_others_cannot_be_read() -> None:
    urdf = read_description(DESCRIPTION)
    names = [f'panda_joint{i}' for i in range(1, 8)]
    found = page.drawn(shapes.urdf_skeleton(urdf, names))
    assert sum(len(x.faces) for body in found for x in body) > 1000
    missing = urdf.replace('package://example-robot-data', 'package://no-such')
    gone = page.drawn(shapes.urdf_skeleton(missing, names))
    # Capsules stand for them: none is longer than the arm's longest link.
    corners = np.vstack([x.vertices for body in gone for x in body])
    assert 0 < np.abs(corners).max() < 0.5
    assert len([x for x in gone if x]) >= 7


@pytest.mark.parametrize('origin', ['xyz', 'rpy', ''])
def test_a_shape_without_its_numbers_is_drawn_as_if_it_were_not_found(origin: str) -> None:
    """Check that the arm has its capsules then, and the page goes on."""
    urdf = re.sub('<visual>.*?</visual>', '', shapes.two_link_urdf(), flags=re.DOTALL)
    plain = page.drawn(shapes.urdf_skeleton(urdf, ('joint1', 'joint2')))
    for value in ('0 0', '', 'nan 0 0', 'inf 0 0', '1e308 0 0', 'x y z', '1 2 3 4'):
        shape = (f'<visual><origin {origin}="{value}"/><geometry><sphere radius="1"/></geometry>'
                 if origin else f'<visual><geometry><box size="{value}"/></geometry>')
        changed = urdf.replace('<inertial>', f'{shape}</visual><inertial>')
        bad = page.drawn(shapes.urdf_skeleton(changed, ('joint1', 'joint2')))
        for one, other in zip(plain, bad, strict=True):
            assert [x.vertices.tolist() for x in one] == [x.vertices.tolist() for x in other]


def test_arm_and_ghost_are_hidden_until_their_positions_are_known() -> None:
    server, _ = serve(require_viser(), '127.0.0.1', free_port('127.0.0.1', 0), '', PageSocket())
    try:
        skeleton = shapes.skeleton_of(ControllerConfig())
        assert skeleton is not None
        view = page.ArmView(server, skeleton, 'arm0')

        def is_shown(part: str, at: Any) -> None:
            for i, pose in enumerate(skeleton.poses(at)):
                assert np.allclose(view._frames[part][i].wxyz, shapes.quaternion(pose[:3, :3]))
                assert np.allclose(view._frames[part][i].position, pose[:3, 3])
        q = np.array([0.3, -0.8])
        for arm, ghost, expected in ((None, None, [False, False]), (q, None, [True, False]),
                                     (q, 2.0 * q, [True, True])):
            view.show(arm, ghost)
            assert [view._parts[x].visible for x in ('arm', 'ghost')] == expected
        is_shown('arm', q)
        is_shown('ghost', 2.0 * q)
        # A small error, and one that would turn a joint by more than 1 rad.
        view.magnified = 100
        view.show(q, q + np.array([1e-3, -0.5]))
        is_shown('ghost', q + np.array([0.1, -1.0]))
    finally:
        stop(server)


def mesh(file: Any) -> Any:
    """Return the triangles of a mesh as a description names it."""
    return page.triangles(shapes.Shape('mesh', (1.0, 1.0, 1.0), np.eye(4), str(file)))


def test_a_mesh_is_a_file_of_a_known_kind_and_size(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Check what a description from a bag may name: it must neither hang nor fill the memory."""
    good = tmp_path / 'part.stl'
    trimesh.creation.box((1.0, 2.0, 3.0)).export(good)
    assert len(mesh(good).faces) == len(mesh(f'file://{good}').faces) == 12
    os.mkfifo(tmp_path / 'pipe.stl')
    with (tmp_path / 'huge.stl').open('wb') as huge:
        huge.truncate(10 ** 10)
    (tmp_path / 'odd.stl').write_bytes(b'\0' * 80 + b'\xff' * 4 + b'x' * 100)
    (tmp_path / 'bomb.dae').write_text(
        '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">' + ''.join(
            f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip('abcdefgh', 'bcdefghi'))
        + ']><COLLADA>&i;</COLLADA>')
    (tmp_path / 'other.zip').write_bytes(good.read_bytes())
    found: list[Any] = []
    files = ('file:///etc/passwd', '/dev/zero', 'file:///proc/self/mem',
             'http://127.0.0.1:1/x.stl', tmp_path, 'a\0.stl', '',
             *(tmp_path / x for x in ('pipe.stl', 'huge.stl', 'odd.stl', 'bomb.dae', 'other.zip')))
    it = threading.Thread(target=lambda: found.extend(map(mesh, files)), daemon=True)
    it.start()
    it.join(60.0)
    assert found == [None] * len(files)
    monkeypatch.setattr('ctc_chattering.live.page._MOST', 11)  # Triangles that are drawn.
    assert mesh(good) is None


def seen(camera: page.Camera, points: Array, aspect: float) -> Array:
    """Return where a camera with z up sees points, ±1 at the edges of a view."""
    ahead = np.subtract(camera.look_at, camera.position)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    x = points - camera.position
    across: Array = np.stack((x @ right, x @ np.cross(right, ahead)), axis=1)
    across /= ((x @ ahead) * tan(0.5 * page.FIELD))[:, None]
    return across / (aspect, 1.0)


@pytest.mark.parametrize(('count', 'aspect'), [(1, 1.6), (2, 0.5)])
def test_the_arms_fill_the_view(count: int, aspect: float) -> None:
    skeleton = shapes.skeleton_of(ControllerConfig())
    assert skeleton is not None
    bodies = page.drawn(skeleton)
    motion = [np.array([3.1, 1.6]) + shift for shift in np.linspace(-0.3, 0.3, 7)]

    def placed(parts: Sequence[Sequence[Array]]) -> Array:
        arm = np.concatenate([
            vertices @ pose[:3, :3].T + pose[:3, 3] for x in motion
            for pose, body in zip(skeleton.poses(x), parts) for vertices in body])
        return np.concatenate([arm + place for place in shapes.places(count, skeleton.reach)])
    vertices = [[x.vertices for x in body] for body in bodies]
    camera = page.camera_of(placed([[page.outermost(body)] for body in vertices]), aspect)
    across = seen(camera, placed(vertices), aspect)
    assert np.abs(across).max() < 0.9
    assert np.ptp(across, axis=0).max() > 1.6  # 80 % of the width or of the height.


def test_cameras_show_the_arms_until_one_is_moved() -> None:
    """Check with a server of one browser: a view of another shape, a hand, a click on fit."""
    client = SimpleNamespace(camera=SimpleNamespace(position=None), atomic=nullcontext)
    server = SimpleNamespace(initial_camera=SimpleNamespace(), get_clients=lambda: {0: client})
    socket, found = PageSocket(), []
    cameras = page.Cameras(server, socket)

    def say(words: str) -> None:
        socket.hear(words)
        socket.poll(tuple)
        found.append((client.camera.position, server.initial_camera.position))
    cameras.look(np.eye(3))
    for words in ('{}', '{"aspect": 0.3}', '{"moved": null}', '{"aspect": 2}'):
        say(words)
    first, narrow, hand, wide = found
    assert first == (page.camera_of(np.eye(3)).position,) * 2
    assert narrow == hand == (page.camera_of(np.eye(3), 0.3).position,) * 2
    assert wide == (narrow[0], page.camera_of(np.eye(3), 2.0).position)
    cameras.look(2.0 * np.eye(3), again=False)
    assert client.camera.position == narrow[0]
    cameras.look(2.0 * np.eye(3))
    assert client.camera.position == page.camera_of(2.0 * np.eye(3), 2.0).position
