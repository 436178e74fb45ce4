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

"""Shapes of an arm: links of URDFs, and meshes that are read or replaced."""

from __future__ import annotations

import os
from pathlib import Path
import re
import threading
from typing import Any
import xml.etree.ElementTree as ET

from ctc_chattering.configuration.package_share import read_description
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.live import skeleton as shapes
import numpy as np
import pinocchio as pin
import pytest
import trimesh

#: Length of both links of the paper's arm [m].
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
    elbow = skeleton.poses((q1, q2))[2, :3, 3]
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


def test_a_link_without_readable_meshes_has_a_capsule() -> None:
    urdf = read_description(DESCRIPTION)
    names = [f'panda_joint{i}' for i in range(1, 8)]
    meshes = shapes.body_meshes(shapes.urdf_skeleton(urdf, names))
    assert sum(len(mesh.faces) for body in meshes for mesh in body) > 1000
    missing = urdf.replace('package://example-robot-data', 'package://no-such')
    capsules = shapes.body_meshes(shapes.urdf_skeleton(missing, names))
    # None is longer than the arm's longest link.
    corners = np.vstack([mesh.vertices for body in capsules for mesh in body])
    assert 0 < np.abs(corners).max() < 0.5
    assert len(list(filter(None, capsules))) >= 7


@pytest.mark.parametrize('origin', ['xyz', 'rpy', ''])
def test_a_shape_without_its_numbers_is_replaced_by_a_capsule(origin: str) -> None:
    """Check that the arm has its capsules then, and the page goes on."""
    urdf = re.sub('<visual>.*?</visual>', '', shapes.two_link_urdf(), flags=re.DOTALL)
    plain = shapes.body_meshes(shapes.urdf_skeleton(urdf, ('joint1', 'joint2')))
    for value in ('0 0', '', 'nan 0 0', 'inf 0 0', '1e308 0 0', 'x y z', '1 2 3 4'):
        shape = (f'<visual><origin {origin}="{value}"/><geometry><sphere radius="1"/></geometry>'
                 if origin else f'<visual><geometry><box size="{value}"/></geometry>')
        changed = urdf.replace('<inertial>', f'{shape}</visual><inertial>')
        bad = shapes.body_meshes(shapes.urdf_skeleton(changed, ('joint1', 'joint2')))
        for one, other in zip(plain, bad, strict=True):
            assert [x.vertices.tolist() for x in one] == [x.vertices.tolist() for x in other]


def mesh(file: Any) -> Any:
    """Return the triangles of a mesh as a description names it."""
    return shapes.read_mesh(ET.Element('mesh', filename=str(file)), ET.Element('visual'))


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
    monkeypatch.setattr('ctc_chattering.live.skeleton._MAX_TRIANGLES', 11)
    assert mesh(good) is None
