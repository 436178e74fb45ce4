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

"""Masses and inertias that no rigid body has: found in URDFs, link by link."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.dynamics.model_check import inertia_faults
from ctc_commands import ctc
import numpy as np
import pytest
from urdfs import joint, link, PANDA, panda, two_links, UR5, ur5, urdf

LOWER = '<inertia ixx="0.05" iyy="0.05" izz="0.01" ixy="0" ixz="0" iyz="0"/>'


def lower(inertia: str, mass: str = '1.5') -> str:
    """Return the two-link arm with another inertia of its second link."""
    changed = two_links().replace(LOWER, inertia).replace(
        '<mass value="1.5"/>', f'<mass value="{mass}"/>')
    assert changed != two_links() or inertia == LOWER
    return changed


def of_points(points: list[list[float]], scale: float = 1.0) -> str:
    """Return the inertia of point masses of 1 kg, times a factor on its largest moment."""
    tensor = sum(np.dot(x, x) * np.eye(3) - np.outer(x, x) for x in np.array(points))
    values, vectors = np.linalg.eigh(tensor)
    values[-1] *= scale
    t = vectors @ np.diag(values) @ vectors.T
    return (f'<inertia ixx="{t[0, 0]}" ixy="{t[0, 1]}" ixz="{t[0, 2]}" iyy="{t[1, 1]}" '
            f'iyz="{t[1, 2]}" izz="{t[2, 2]}"/>')


def test_robots() -> None:
    """Sound ones have no fault; the UR5 carries a box without mass."""
    assert inertia_faults(two_links(), ('a', 'b')) == inertia_faults(panda(), PANDA) == []
    assert inertia_faults(ur5(), UR5) == ['link ee_link moves and has a shape, but no mass']


@pytest.mark.parametrize('seed', range(10))
def test_every_body_of_point_masses_is_sound_and_none_beyond_a_plane_is(seed: int) -> None:
    """A flat body is at the limit: its largest moment is the sum of the others."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(4, 3))
    flat = points @ np.diag([1.0, 1.0, 0.0]) @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    for body in (points, flat):
        assert inertia_faults(lower(of_points(body.tolist())), ('a', 'b')) == []
    (fault,) = inertia_faults(lower(of_points(flat.tolist(), 1.01)), ('a', 'b'))
    assert fault.startswith('link lower has principal moments ')
    assert fault.endswith(': the largest exceeds the sum of the others')


@pytest.mark.parametrize(('text', 'words'), [
    (lower(LOWER.replace('ixx="0.05"', 'ixx="-0.05"')), 'none may be negative'),
    (lower(LOWER.replace('ixy="0"', 'ixy="0.06"')), 'none may be negative'),
    (lower(LOWER, '-1.5'), 'a mass of -1.5 kg'), (lower(LOWER, '0'), 'a shape, but no mass'),
    (two_links().replace('<link name="tool"/>', '<link name="tool"><visual/></link>'),
     'link tool moves and has a shape, but no inertia')])
def test_faults(text: str, words: str) -> None:
    (fault,) = inertia_faults(text, ('a', 'b'))
    assert words in fault


def test_what_does_not_move_may_have_any_inertia() -> None:
    """The base, and what is before the first joint of the model; a frame has no shape."""
    text = urdf([link('base', 1.0, inertia=(1.0, 1.0, 9.0)), link('arm', 1.0, (0.1, 0, 0)),
                 link('tip', 1.0, (0.1, 0, 0), (1.0, 1.0, 9.0)), '<link name="frame"/>',
                 joint('j', 'revolute', 'base', 'arm'), joint('k', 'revolute', 'arm', 'tip'),
                 joint('f', 'fixed', 'tip', 'frame')])
    assert [x.split()[1] for x in inertia_faults(text, ('j', 'k'))] == ['tip']
    assert [x.split()[1] for x in inertia_faults(text, ('k',))] == ['tip']
    assert inertia_faults(text, ()) == []


def test_the_command_says_so(tmp_path: Path) -> None:
    file = tmp_path / 'arm.urdf'
    file.write_text(lower(of_points([[1.0, 0, 0], [0, 1.0, 0]], 1.5)))
    result = ctc('check-model', '--urdf', file)
    assert 'warning: link lower has principal moments 1, 1, 3 kg*m^2' in result.stdout
