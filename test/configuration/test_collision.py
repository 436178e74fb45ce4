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

"""Distances of links, of shapes whose distances can be written down."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.configuration.collision import SelfCollision
from ctc_chattering.errors import CtcError
import numpy as np
import numpy.typing as npt
import pytest

Array = npt.NDArray[np.float64]
#: Radii [m] of balls 1 m out on both arms, which turn about axes 0.5 m apart.
RADII, APART = (0.1, 0.15), 0.5


def shape(geometry: str, xyz: str = '0 0 0') -> str:
    return (f'<collision><origin xyz="{xyz}"/><geometry>{geometry}</geometry></collision>')


def arm(name: str, shapes: str, x: float, kind: str = 'revolute', axis: str = '0 0 1') -> str:
    return (f'<link name="{name}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" '
            f'ixy="0" ixz="0" iyz="0"/></inertial>{shapes}</link>'
            f'<joint name="turn {name}" type="{kind}"><origin xyz="{x} 0 0"/><parent link="base"/>'
            f'<child link="{name}"/><axis xyz="{axis}"/>'
            '<limit lower="-3" upper="3" velocity="1" effort="9"/></joint>')


def balls(more: str = '') -> str:
    return ('<robot name="r"><link name="base"/>' + ''.join(
        arm(name, shape(f'<sphere radius="{radius}"/>', '1 0 0'), x)
        for name, radius, x in zip('ab', RADII, (0.0, APART))) + more + '</robot>')


def between(q: Array) -> Array:
    """Return the distance of the balls, (N,), at angles q, (N, 2)."""
    ends = [np.column_stack([x + np.cos(a), np.sin(a)]) for a, x in zip(q.T, (0.0, APART))]
    found: Array = np.linalg.norm(ends[0] - ends[1], axis=1) - sum(RADII)
    return found


def checked(text: str, rest: tuple[float, ...] = (1.5, -1.5), clearance: float = 0.02,
            floor: float = np.inf) -> SelfCollision:
    return SelfCollision(text, ('turn a', 'turn b'), {}, np.array([rest]), clearance, floor)


def path(seed: int) -> Array:
    """Return angles of a random smooth motion, in steps of 10 ms."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 20.0, 0.01)[:, np.newaxis]
    sines = [rng.uniform(-0.4, 0.4, 2) * np.sin(
        rng.uniform(0.2, 2.0, 2) * t + rng.uniform(0.0, 6.0, 2)) for _ in range(3)]
    return np.asarray(np.array([1.5, -1.5]) + np.sum(sines, axis=0))


@pytest.mark.parametrize('seed', range(5))
def test_the_nearest_approach_of_balls_is_the_least_of_all_samples(seed: int) -> None:
    links, q = checked(balls()), path(seed)
    assert links.pairs == [('a', 'b')]
    expected = between(q)
    approach = links.nearest(np.arange(float(len(q))), q)
    assert approach.distance == pytest.approx(expected.min(), abs=2e-6)
    assert (approach.links, approach.t, approach.required) == (
        ('a', 'b'), float(expected.argmin()), 0.02)
    assert approach.spare == pytest.approx(expected.min() / 0.02 - 1.0, abs=1e-4)


def test_boxes_and_a_slide_are_at_the_distance_of_their_faces() -> None:
    text = ('<robot name="r"><link name="base">' + shape('<box size="0.2 0.2 0.2"/>') + '</link>'
            + arm('a', shape('<box size="0.2 0.4 0.4"/>'), 0.5, 'prismatic', '1 0 0')
            + arm('b', shape('<box size="0.2 0.4 0.4"/>'), 1.5, 'prismatic', '1 0 0') + '</robot>')
    links = checked(text, (0.0, 0.0))
    assert links.pairs == [('a', 'b')]  # Each is joined to the base.
    q = np.column_stack([np.linspace(0.0, 0.3, 100), np.linspace(0.0, -0.4, 100)])
    t = np.arange(100.0)
    assert links.nearest(t, q).spare == pytest.approx((1.0 - 0.7 - 0.2) / 0.02 - 1.0, abs=1e-4)
    q[:, 1] *= 2.0
    approach = links.nearest(t, q)
    assert approach.distance < 0.0 and approach.links == ('a', 'b')


def test_links_near_each_other_at_rest_keep_half_of_that_and_touching_ones_are_named() -> None:
    rest = (1.5, 1.6)
    distance = float(between(np.array([rest]))[0])
    assert 0.0 < distance < 0.5
    near = checked(balls(), rest, clearance=1.0)
    assert near.nearest(np.zeros(1), np.array([rest])).spare == pytest.approx(1.0, abs=1e-4)
    wide = balls(arm('c', shape('<sphere radius="0.1"/>', '1 0 0'), 9.0)).replace(
        'radius="0.1"', 'radius="0.6"', 1)
    assert checked(wide, rest).touching == ['a and b']
    assert checked(wide, rest).pairs == [('a', 'c'), ('b', 'c')]


def test_links_keep_their_distance_from_a_floor() -> None:
    links = checked(balls(), floor=-0.3)
    assert links.pairs == [('a', 'b'), ('a', 'the floor'), ('b', 'the floor')]
    q = path(0)
    assert links.nearest(np.zeros(1), q[:1]).spare == pytest.approx(0.15 / 0.02 - 1.0, abs=1e-3)


def test_missing_meshes_and_bare_links_are_named(tmp_path: Path) -> None:
    mesh = '<mesh filename="{}"/>'
    lost = balls(arm('c', shape(mesh.format('package://nowhere/no.stl')), 9.0)
                 + arm('d', shape(mesh.format(tmp_path / 'no.stl')), 19.0)
                 + arm('e', '<visual/>', 29.0))
    assert checked(lost).unseen == ['c', 'd', 'e']
    assert checked(lost).pairs == [('a', 'b')]
    broken = tmp_path / 'no.stl'
    broken.write_text('solid nothing')
    with pytest.raises(CtcError, match='collision shapes: Pinocchio refuses them'):
        checked(lost)


def test_a_mesh_counts_as_its_hull(tmp_path: Path) -> None:
    """An L of two squares; a ball in its corner is in the hull."""
    points = [(0, 0), (1, 0), (1, 0.1), (0.1, 0.1), (0.1, 1), (0, 1)]
    file = tmp_path / 'l.obj'
    file.write_text(''.join(f'v {x} {y} {z}\n' for z in (-0.05, 0.05) for x, y in points)
                    + 'f 1 2 3\nf 1 3 4\nf 1 4 5\nf 1 5 6\n'
                    + 'f 7 9 8\nf 7 10 9\nf 7 11 10\nf 7 12 11\n'
                    + ''.join(f'f {i} {i % 6 + 7} {i % 6 + 1}\nf {i} {i + 6} {i % 6 + 7}\n'
                              for i in range(1, 7)))
    text = ('<robot name="r"><link name="base"/>'
            + arm('a', shape(f'<mesh filename="{file}"/>'), 0.0)
            + arm('b', shape('<sphere radius="0.1"/>', '0.3 0.3 0'), 0.0) + '</robot>')
    with pytest.raises(CtcError, match='links touch at the centre: a and b'):
        checked(text, (0.0, 0.0))
