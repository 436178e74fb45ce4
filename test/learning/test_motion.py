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


"""Motions that are repeated."""

from __future__ import annotations

from typing import Any

from ctc_chattering.errors import CtcError
from ctc_chattering.learning.motion import motion_of, RepeatedMotion, waypoint_motion
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig
from ctc_chattering.trajectory.waypoints import Route, Waypoints
import numpy as np
import pytest

START = {'joint1': (0.0, 0.0), 'joint2': (0.0, 0.0)}


def periodic(*frequency: float, **values: Any) -> RepeatedMotion:
    names = [f'joint{k + 1}' for k in range(len(frequency))]
    config = ReferenceConfig.from_mapping({
        'joint_names': names, 'frequency': list(frequency), 'center': [0.0] * len(names),
        **values})
    return motion_of(config, None, make_motion(config, start=START))


def waypoints(begin: int = 0, last: float = 1.0, start: tuple[float, ...] = ()
              ) -> RepeatedMotion:
    times = [begin + NANOSECONDS, begin + 3 * NANOSECONDS]
    points = [((x, -x), (0.0, 0.0), (0.0, 0.0)) for x in (0.5, last)]
    route = Route(['a', 'b'], times, points)
    return waypoint_motion(route, Waypoints(times, points), begin, start)


@pytest.mark.parametrize('frequency, period', [
    ((0.5, 0.4, 0.6), 10.0), ((1.0, 1.0), 1.0), ((0.5, 1.5), 2.0), ((1 / 3, 0.5), 6.0),
    ((0.0, 0.25), 4.0), ((1.001, 1.0), None), ((2 ** -0.5, 1.0), None), ((0.01, 0.0), None)])
def test_the_period_is_common_to_all_joints(frequency: tuple[float, ...], period: float | None
                                            ) -> None:
    if period is None:
        with pytest.raises(CtcError, match='no common period of up to 60 s'):
            periodic(*frequency)
        return
    motion = periodic(*frequency)
    assert motion.duration == round(period * NANOSECONDS)
    for t in (0, 123_456_789):
        later = motion.motion.at(t + motion.duration)
        assert np.array(later) == pytest.approx(np.array(motion.motion.at(t)), abs=1e-6)


def test_joints_without_amplitude_do_not_count() -> None:
    assert periodic(2 ** 0.5, 1.0, amplitude=[0.0, 0.5]).duration == NANOSECONDS
    with pytest.raises(CtcError, match='no joint moves'):
        periodic(0.0, 1.0, amplitude=[0.5, 0.0])


def test_a_trapezoid_has_moves_of_twice_the_period_there_and_back() -> None:
    motion = periodic(1.0, 0.5, profile='trapezoid')
    assert motion.duration == 8 * NANOSECONDS
    half, whole = (np.array(motion.motion.at(100_000_000 + t))
                   for t in (motion.duration // 2, motion.duration))
    assert whole == pytest.approx(np.array(motion.motion.at(100_000_000)), abs=1e-9)
    assert np.abs(half - whole).max() > 0.1


def test_a_smooth_start_is_not_part_of_a_pass() -> None:
    motion = periodic(1.0, 0.5, start_duration=1.5)
    assert motion.start == round(1.5 * NANOSECONDS)
    assert motion.phase(motion.start) == motion.start


def test_a_name_tells_motions_apart_and_not_their_start() -> None:
    names = {periodic(1.0, 0.5).name, periodic(1.0, 0.25).name, periodic(1.0, 0.5, phase=0.1).name,
             periodic(1.0, 0.5, profile='trapezoid').name, waypoints().name,
             waypoints(last=2.0).name}
    assert len(names) == 6
    assert periodic(1.0, 0.5, start_duration=1.5).name == periodic(1.0, 0.5).name
    assert waypoints(begin=7).name == waypoints().name


def test_the_name_of_a_goal_has_its_start_on_any_turn() -> None:
    near = {waypoints(start=(turn + x, -1.0)).name
            for turn in (0.0, 2.0 * np.pi, -4.0 * np.pi) for x in (np.pi, np.pi + 1e-9, 3.1415)}
    assert len(near) == 1
    assert near != {waypoints(start=(3.0, -1.0)).name} != {waypoints(start=(-3.0, -1.0)).name}


def test_the_phase_of_waypoints_ends_with_them() -> None:
    motion = waypoints(begin=5)
    assert [motion.phase(t) for t in (0, 5, 6, 4 * NANOSECONDS)] == [0, 0, 1, 3 * NANOSECONDS]
    first, *_, last = motion.positions()
    assert tuple(first) == (0.5, -0.5)
    assert tuple(last) == (1.0, -1.0)
