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

"""Waypoints of motions, and all motions of the same times."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.configuration.trajectory_file import read_trajectory, write_trajectory
from ctc_chattering.identification.excitation.best_motion import PathBuilder, Shapes
from ctc_chattering.identification.excitation.fourier_series import at_rest
from ctc_chattering.identification.excitation.limits import Bounds, ExcitationConfig
from ctc_chattering.trajectory.waypoints import Route, Waypoints
import numpy as np
import pytest


def test_between_waypoints_the_motion_is_the_series() -> None:
    series = at_rest(13, 27.0)
    fastest = np.abs(series.at(np.linspace(0.0, 27.0, 500))[1]).max(axis=0)
    path = PathBuilder(np.zeros(23))
    path.rest(np.ones(23), 3.0)
    path.series(series)
    t = np.linspace(3.0, 30.0, 5000)
    for rows, exact, most in zip(path.path().at(t), series.at(t - 3.0), (1e-6, 1e-5, 2e-4)):
        offset = 1.0 if most == 1e-6 else 0.0
        assert (np.abs(rows - offset - exact) / fastest).max() < most


def test_a_motion_is_what_the_reference_plays_of_its_waypoints() -> None:
    n = 3
    config = ExcitationConfig(('a', 'b', 'c'), 45.0, (0.3, 0.0, -0.2), (0.0, 0.1, 0.2), poses=2)
    bounds = Bounds(np.array(config.center), *(np.full(n, x) for x in (0.8, 1.0, 4.0)))
    shapes = Shapes(config, bounds)
    motion = shapes.motion(shapes.random(np.random.default_rng(0)))
    route = motion.route
    rest = (0.0,) * n
    played = Waypoints(route.times, route.points, (0, (config.start, rest, rest)))
    t = np.linspace(0.0, 45.0, 997)
    expected = np.array([played.at(round(x * 1e9)) for x in t]).transpose(1, 0, 2)
    assert motion.path.at(t) == pytest.approx(expected, abs=1e-7)


def test_a_long_motion_repeats_a_series() -> None:
    config = ExcitationConfig(('a', 'b'), 3600.0)
    bounds = Bounds(np.zeros(2), *(np.full(2, x) for x in (0.8, 1.0, 4.0)))
    shapes = Shapes(config, bounds)
    begin, end = shapes.fourier
    path = shapes.motion(shapes.random(np.random.default_rng(0))).path
    assert shapes.path.points.shape[2] < 60
    period = (end - begin) / np.ceil((end - begin) / 45.0)
    t = begin + np.linspace(0.0, period, 50)
    assert path.at(t) == pytest.approx(path.at(t + 7.0 * period), abs=1e-6)


def test_waypoints_are_read_as_they_were_written(tmp_path: Path) -> None:
    route = Route(('b', 'a'), (100_000_001, 2_000_000_000), (
        ((1.0, -2.5e-7), (1e8, 0.0), (3.0, -4.0)), ((1.5, 2.0), (), ())))
    write_trajectory(route, tmp_path / 'way.yaml')
    read = read_trajectory(tmp_path / 'way.yaml', ('b', 'a'))
    assert read.times == route.times
    assert read.points == route.points
    turned = read_trajectory(tmp_path / 'way.yaml', ('a', 'b'))
    assert turned.points[0][0] == (-2.5e-7, 1.0)
