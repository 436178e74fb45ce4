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

"""Waypoints of motions, random motions, what they must keep, and what sticks in them."""

from __future__ import annotations

from itertools import product
from pathlib import Path

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.trajectory_file import read_trajectory, write_trajectory
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import ParameterError
from ctc_chattering.identification.excite import AssumedFriction, LoopGains, sticking
from ctc_chattering.identification.random_motions import (
    Bounds,
    bounds_of,
    Excitation,
    ExcitationConfig,
    Multisine,
    random_motion,
)
from ctc_chattering.trajectory.joint_limits import read_limits
from ctc_chattering.trajectory.waypoints import Route, Waypoints
import numpy as np
import pytest
from urdfs import joint, link, urdf


def test_a_multisine_has_its_frequencies_and_is_at_rest_at_its_ends() -> None:
    t, points, largest = Multisine.draw(40.0, 3, np.random.default_rng(0))
    assert np.abs(points[[0, -1]]).max() < 1e-9 * largest.max()
    assert (np.abs(points).max(axis=0) <= 1.001 * largest).all()
    assert (np.abs(points).max(axis=0) > 0.9 * largest).all()
    # Between waypoints it is smooth, and its derivatives are those of its positions.
    path = Excitation(('a', 'b', 'c'), t, points, ())
    fine = np.arange(0.01, 39.99, 1e-3)
    q, dq, ddq = path.at(fine)
    for low, high in ((q, dq), (dq, ddq)):
        change = (low[2:] - low[:-2]) / 2e-3
        assert np.abs(change - high[1:-1]).max() < 1e-3 * np.abs(high).max()
    power = np.square(np.abs(np.fft.rfft(q[:-1], axis=0))).sum(axis=1)
    frequency = np.fft.rfftfreq(len(q) - 1, 1e-3)
    assert power[frequency < 0.55].sum() > 0.99 * power.sum()


def test_the_reference_plays_a_motion_from_its_waypoints() -> None:
    n = 3
    config = ExcitationConfig(('a', 'b', 'c'), 45.0, (0.3, 0.0, -0.2), (0.0, 0.1, 0.2), poses=2)
    bounds = Bounds(np.array(config.center), *(np.full(n, x) for x in (0.8, 1.0, 4.0)))
    motion = random_motion(config, bounds, np.ones(n), 1.0, 0)
    route = motion.route
    rest = (0.0,) * n
    played = Waypoints(route.times, route.points, (0, (config.start, rest, rest)))
    t = np.linspace(0.0, 45.0, 997)
    expected = np.array([played.at(round(x * 1e9)) for x in t]).transpose(1, 0, 2)
    assert motion.at(t) == pytest.approx(expected, abs=1e-6)


def test_waypoints_are_read_as_they_were_written(tmp_path: Path) -> None:
    route = Route(('b', 'a'), (100_000_001, 2_000_000_000), (
        ((1.0, -2.5e-7), (1e8, 0.0), (3.0, -4.0)), ((1.5, 2.0), (), ())))
    write_trajectory(route, tmp_path / 'way.yaml')
    read = read_trajectory(tmp_path / 'way.yaml', ('b', 'a'))
    assert read.times == route.times
    assert read.points == route.points
    turned = read_trajectory(tmp_path / 'way.yaml', ('a', 'b'))
    assert turned.points[0][0] == (-2.5e-7, 1.0)


ARM = urdf([
    link('base'), link('a', 2.0, (0.2, 0.0, 0.0), (0.1, 0.1, 0.1)),
    link('b', 1.0, (0.1, 0.0, 0.0), (0.05, 0.05, 0.05)),
    joint('turn', 'revolute', 'base', 'a', '0 1 0', more=(
        '<limit lower="-1" upper="3" velocity="2" effort="30" acceleration="5"/>')),
    joint('slide', 'prismatic', 'a', 'b', '1 0 0', more=(
        '<limit lower="0" upper="0.2" velocity="0.1" effort="40"/>'))])


def test_bounds_of_a_description_with_acceleration_and_a_short_slide() -> None:
    limits = read_limits(ARM, ('turn', 'slide'))
    config = ExcitationConfig(('turn', 'slide'), center=(1.0, 0.08), start=(0.0, 0.0))
    bounds = bounds_of(config, limits)
    assert bounds.room == pytest.approx([0.8, 0.07])
    assert bounds.velocity == pytest.approx([1.0, 0.05])
    assert bounds.acceleration == pytest.approx([2.5, 0.2])
    bounds = bounds_of(config.changed({'velocity_scale': 0.2}), limits)
    assert bounds.velocity == pytest.approx([0.4, 0.02])
    assert bounds.acceleration == pytest.approx([1.0, 0.08])
    with pytest.raises(ParameterError, match=r'center of slide: 0\.3 is not allowed'):
        bounds_of(config.changed({'center': [1.0, 0.3]}), limits)


def test_joints_creep_at_every_pose() -> None:
    """Slow enough for Stribeck friction at 0.02 rad/s, in windows of 0.1 s."""
    config = ExcitationConfig(('a', 'b'), 60.0)
    bounds = Bounds(np.zeros(2), *(np.full(2, x) for x in (0.8, 1.0, 4.0)))
    motion = random_motion(config, bounds, np.ones(2), 1.0, 0)
    assert len(motion.slow) == 3
    for (_, begin, end), speed in zip(motion.slow, (0.02, 0.01, 0.005)):
        q, dq, _ = motion.at(np.arange(begin, end, 0.01))
        creeps = np.abs(np.abs(dq) - speed) < 0.05 * speed
        for i in range(2):
            for way in (1.0, -1.0):
                mine = np.flatnonzero(creeps[:, i] & (dq[:, i] * way > 0.0))
                assert len(mine) * 0.01 > 0.5
                # It has come a way before it creeps, so that it slides already.
                middle = mine[len(mine) // 2]
                assert np.ptp(q[max(middle - 200, 0):middle, i]) > 0.4 * bounds.slow[i]


ROOT = Path(__file__).parents[2]


def test_friction_holds_most_at_a_corner_of_its_box() -> None:
    setup = parameter_file.load(ROOT / 'config' / 'ur5.yaml')
    robot = model_of(setup.controller, setup.descriptions['controller'])
    kp = np.linspace(50.0, 100.0, 6)
    friction = AssumedFriction(np.array([8.0, 8.0, 6.0, 1.5, 1.5, 1.0]), np.zeros(6))
    q = np.array(setup.reference.center)
    mass = np.array(robot.mass_matrix(q.tolist()))
    corners = [np.abs(np.linalg.solve(mass, friction.coulomb * signs)) / kp
               for signs in product((-1.0, 1.0), repeat=6)]
    hold = sticking(robot, q[np.newaxis], kp, friction)
    assert hold == pytest.approx(np.max(corners, axis=0), rel=1e-9)


def test_gains_rise_only_where_friction_holds_too_much_and_with_the_delay() -> None:
    gains, slow = LoopGains(np.full(3, 100.0), np.full(3, 50.0)), np.full(3, 0.3)
    hold = np.array([0.01, 0.6, 60.0])
    higher, damping = gains.raised(hold, slow, 0.001)
    assert higher == pytest.approx([100.0, 1000.0, 2500.0])
    assert damping == pytest.approx([50.0, 64.0, 100.0])
    higher, damping = gains.raised(hold, slow, 0.01)
    assert higher == pytest.approx([100.0, 100.0, 100.0])
    assert damping == pytest.approx(gains.kv)
