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

"""The arm is not drawn where it is not known to be; its ghost may be magnified."""

from __future__ import annotations

import os
from pathlib import Path
import threading
from typing import Any

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.live import require_viser
from ctc_chattering.live.page import ArmView, triangles
from ctc_chattering.live.page_socket import PageSocket
from ctc_chattering.live.server import free_port, serve, stop
from ctc_chattering.live.skeleton import quaternion, Shape, skeleton_of
import numpy as np
import pytest
import trimesh


def test_arm_and_ghost_are_hidden_until_their_positions_are_known() -> None:
    server, _ = serve(require_viser(), '127.0.0.1', free_port('127.0.0.1', 0), '', PageSocket())
    try:
        made: dict[str, Any] = {}
        add = server.scene.add_frame

        def add_frame(name: str, **options: Any) -> Any:
            made[name] = add(name, **options)
            return made[name]
        server.scene.add_frame = add_frame
        skeleton = skeleton_of(ControllerConfig())
        assert skeleton is not None
        view = ArmView(server, skeleton, 'arm0')

        def is_shown(part: str, at: Any) -> None:
            for i, pose in enumerate(skeleton.poses(at)):
                assert np.allclose(made[f'/arm0/{part}/{i}'].wxyz, quaternion(pose[:3, :3]))
                assert np.allclose(made[f'/arm0/{part}/{i}'].position, pose[:3, 3])
        q = np.array([0.3, -0.8])
        for arm, ghost, expected in ((None, None, [False, False]), (q, None, [True, False]),
                                     (q, 2.0 * q, [True, True])):
            view.show(arm, ghost)
            assert [made[f'/arm0/{x}'].visible for x in ('arm', 'ghost')] == expected
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
    return triangles(Shape('mesh', (1.0, 1.0, 1.0), np.eye(4), str(file)))


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
