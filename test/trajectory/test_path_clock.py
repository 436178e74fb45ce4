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

"""Scaled speed: smooth in time, on the path, and the same in the simulation."""

from __future__ import annotations

from ctc_chattering.numerics.time_grid import NANOSECONDS as S
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.joint_limits import JointLimits
from ctc_chattering.trajectory.motion_plan import MotionPlan
from ctc_chattering.trajectory.path_clock import PathClock, ScaledMotion
from ctc_chattering.trajectory.reference import reference_table, ReferenceConfig, Sinusoid
from ctc_chattering.trajectory.schedule import MotionSchedule
from ctc_chattering.trajectory.waypoints import Route
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

MS = S // 1000
rates = st.floats(0.0, 1.0)
#: Of these joints, at 100 Hz.
CONFIG = ReferenceConfig(phase=(0.3, 0.4), control_period=0.01)


@given(rates, rates, st.floats(0.1, 3.0))
def test_path_time_is_the_integral_of_a_rate_between_both(
        r0: float, r1: float, duration: float) -> None:
    clock = PathClock(r0, r0).slew(2 * S, r1, duration)
    t = np.linspace(S, 6 * S, 2001).astype(np.int64)
    s, rate, rate_change = np.array([clock.at(int(x)) for x in t]).T
    h = np.diff(t)
    # That of the trapezoidal rule, and two roundings to a nanosecond.
    error = S * 0.5 * (1e-9 * h.max()) ** 3 / duration ** 2 + 2.0
    assert np.abs(np.diff(s) - 0.5 * h * (rate[1:] + rate[:-1])).max() < error
    mean_change = 0.5 * (rate_change[1:] + rate_change[:-1])
    assert np.abs(np.diff(rate) - 1e-9 * h * mean_change).max() < 1e-4 / duration ** 3
    assert min(r0, r1) - 1e-12 <= rate.min() and rate.max() <= max(r0, r1) + 1e-12
    assert clock.at(clock.end + S).instant == pytest.approx(
        clock.at(clock.end).instant + r1 * S, abs=2)


def test_at_full_speed_a_motion_is_the_same_to_the_last_bit() -> None:
    motion = ScaledMotion(Sinusoid(CONFIG), PathClock())
    assert all(motion.at(t) == Sinusoid(CONFIG).at(t) for t in range(-S, S, 37 * MS))


def test_the_end_of_a_path_comes_later_at_a_lower_speed_and_never_at_none() -> None:
    clock = PathClock().slew(S, 0.25, 0.5)
    instant = clock.instant_of(4 * S)
    assert instant is not None
    assert clock.at(instant).instant == pytest.approx(4 * S, abs=2)
    assert clock.slew(9 * S, 0.0, 0.5).instant_of(20 * S) is None


def scaled_points(changes: dict[int, float], end: int, config: ReferenceConfig = CONFIG,
                  limits: list[JointLimits] | None = None) -> np.ndarray:
    """Return time, position, velocity and acceleration while the speed is set."""
    plan = MotionPlan(config, None)
    plan.limits = limits
    plan.prepare()
    schedule = MotionSchedule(plan, 10 * MS, 400 * MS)
    points: dict[int, Point] = {}
    for now in range(0, end, 50 * MS):
        schedule.follow_clock(now)
        if now in changes:
            plan.config = config.changed({'speed_scaling': changes[now]})
        schedule.update()
        for begin, chunk in schedule.chunks():
            points.update(zip(range(begin, begin + S, 10 * MS), chunk))
    return np.array([[np.full(2, 1e-9 * t), *points[t]] for t in sorted(points)], float)


def test_a_motion_slows_down_and_stands_on_its_own_path_without_a_jump() -> None:
    """Velocity and acceleration are the derivatives, no joint leaves its sinusoid."""
    rows = scaled_points({S: 0.5, 3 * S: 0.0, 5 * S: 1.0}, 8 * S)
    t, q, dq, ddq = rows[:-40].transpose(1, 0, 2)
    h = 0.01
    assert np.abs(np.diff(q, axis=0) / h - 0.5 * (dq[1:] + dq[:-1])).max() < 0.01
    assert np.abs(np.diff(dq, axis=0) / h - 0.5 * (ddq[1:] + ddq[:-1])).max() < 0.3
    stands = (t[:, 0] > 3.8) & (t[:, 0] < 5.0)
    assert not dq[stands].any() and not ddq[stands].any()
    assert np.ptp(q[stands], axis=0).max() == 0.0
    half = (t[:, 0] > 1.8) & (t[:, 0] < 3.0)
    assert np.abs(dq[half]).max() <= 0.5 * np.pi + 1e-9
    assert np.abs(q - (np.pi, 0.5 * np.pi)).max() <= 0.5 + 1e-9
    last = t[:, 0] > 6.5
    assert np.abs(dq[last]).max() == pytest.approx(np.pi, rel=0.01)


def test_a_change_of_speed_takes_the_time_that_the_limits_ask_for() -> None:
    config = CONFIG.changed({'frequency': (0.1, 0.1)})
    limits = [JointLimits(x, acceleration=(-0.3, 0.3)) for x in config.joint_names]
    free, limited = (scaled_points({S: 0.0}, 9 * S, config, x) for x in (None, limits))
    assert np.abs(free[:, 3]).max() > 0.45
    assert 0.2 < np.abs(limited[:, 3]).max() <= 0.3 * 1.001
    assert not limited[-1, 2].any()


@pytest.mark.parametrize('route', [None, Route(
    ('joint2', 'joint1'), (S, 2 * S), (((1.0, 2.0), (0.0, 0.0), ()), ((0.5, 3.0), (), ())))])
def test_the_simulation_has_the_published_motion_to_the_last_bit(route: Route | None) -> None:
    config = CONFIG.changed({
        'speed_scaling': 0.3, **({'trajectory_file': 'x'} if route else {'start_duration': 1.0})})
    start = (('joint1', (0.0, 0.0)), ('joint2', (0.1, 0.0)))
    plan = MotionPlan(config, route)
    schedule = MotionSchedule(plan, 10 * MS, 400 * MS)
    schedule.follow_clock(0)
    schedule.begin(dict(start), 0)
    rows = []
    for now in range(0, 6 * S, 100 * MS):
        schedule.follow_clock(now)
        schedule.update()
        rows += [point for _, points in schedule.chunks() for point in points]
    table = reference_table(config, route, start, config.joint_names, 10 * MS, len(rows))
    assert np.array_equal(table, np.array(rows, float).reshape(table.shape))


@pytest.mark.parametrize('rate', [1.0, 0.3, 0.02, 0.0])
def test_a_stop_takes_no_longer_at_a_lower_speed(rate: float) -> None:
    plan = MotionPlan(CONFIG.changed({'speed_scaling': rate}), None)
    plan.prepare()
    schedule = MotionSchedule(plan, 10 * MS, 400 * MS)
    schedule.follow_clock(S)
    followed = schedule.follow(Route((), [], []), 0)
    assert schedule.time_until(followed.end) == pytest.approx(0.6 if rate else 0.0, abs=1e-3)
    schedule.follow_clock(2 * S)
    assert schedule.at_rest
