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

"""Replacement of a motion that runs: by waypoints, late and past ones, and by a stop."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi, sin
from typing import Any

from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.joint_limits import JointLimits, read_limits
from ctc_chattering.trajectory.motion_plan import Followed, MotionPlan
from ctc_chattering.trajectory.path_clock import Stop
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig, Sinusoid
from ctc_chattering.trajectory.transitions import BRAKING_TIME, TimedMotion
from ctc_chattering.trajectory.waypoints import Route, Waypoints
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from urdfs import joint, link, urdf

S = 1_000_000_000
MS = 1_000_000
NAMES = ('a', 'b')
CONFIG = ReferenceConfig(joint_names=NAMES, center=(0.5, -0.3), frequency=(0.5, 0.8))
#: Present instant, and that from which on the motion may be another one [ns].
NOW, BEGIN = 10 * S, 10 * S + 125 * MS


def limits(kind: str = 'revolute', **values: float) -> list[JointLimits]:
    """Return limits of both joints."""
    text = ' '.join(f'{name}="{value}"' for name, value in {
        'lower': -9.0, 'upper': 9.0, 'velocity': 0.0, **values}.items())
    more = f'<limit effort="0" {text}/>'
    return read_limits(urdf([
        link('base'), link('one'), link('two'), joint('a', kind, 'base', 'one', more=more),
        joint('b', kind, 'one', 'two', more=more)]), NAMES)


def plan_of(described: list[JointLimits] | None = None, **config: Any) -> MotionPlan:
    """Return the plan of a sinusoid that has begun."""
    plan = MotionPlan(CONFIG.changed(config), None)
    plan.limits = described
    plan.prepare()
    return plan


def route(*points: tuple[float, Sequence[float]], stamp: int = NOW) -> Route:
    """Return waypoints by time after the stamp [s] and positions."""
    return Route(NAMES, [stamp + round(t * S) for t, _ in points], [
        (tuple(q), (), ()) for _, q in points])


def path(motion: TimedMotion | None, first: int, last: int, step: int = 5 * MS) -> Array:
    """Return what a motion does, shape (N, 3, n)."""
    assert motion is not None
    return np.array([motion.at(t) for t in range(first, last, step)])


@given(st.floats(0.05, 5.0), st.integers(0, 10 * S))
def test_a_stop_stays_on_the_path_and_ends_at_rest(duration: float, t0: int) -> None:
    """Velocity and acceleration are its derivatives, continuous, and within what is promised."""
    before = Sinusoid(CONFIG)
    stop = Stop(before, t0, duration)
    assert stop.at(t0) == before.at(t0)
    assert stop.at(t0 - 77) == before.at(t0 - 77)
    q, dq, ddq = stop.at(stop.end)
    assert (dq, ddq) == ((0.0, 0.0), (0.0, 0.0))
    assert stop.at(stop.end + 100 * S) == (q, dq, ddq)
    assert q == pytest.approx(before.at(t0 + round(0.5 * duration * S))[0])
    rows = path(stop, t0, stop.end, max(MS, round(duration * S) // 500))
    h = max(MS, round(duration * S) // 500) / S
    assert rows[1:-1, 1] == pytest.approx((rows[2:, 0] - rows[:-2, 0]) / (2.0 * h), abs=0.02)
    assert rows[1:-1, 2] == pytest.approx((rows[2:, 1] - rows[:-2, 1]) / (2.0 * h), abs=0.2)
    _, speed, push = map(np.array, before.extremes()[0])
    assert (np.abs(rows[:, 1]) <= speed + 1e-9).all()
    assert (np.abs(rows[:, 2]) <= push + 1.5 * speed / duration + 1e-9).all()


def test_without_waypoints_the_motion_stops_and_holds() -> None:
    """In the middle of a sinusoid, and of a motion through waypoints; again changes nothing."""
    for first in (None, route((1.0, (2.0, 1.0)))):
        plan = plan_of()
        if first is not None:
            plan.follow(first, NOW, BEGIN)
        begin = BEGIN + 500 * MS
        before = plan.motion
        assert before is not None
        followed = plan.follow(Route((), [], []), begin - 125 * MS, begin)
        assert followed == Followed(0, 0, begin + round(BRAKING_TIME * S))
        assert plan.motion is not None
        assert plan.motion.at(begin) == before.at(begin)
        end = plan.motion.at(followed.end)
        assert end[1:] == ((0.0, 0.0), (0.0, 0.0))
        assert plan.follow(Route(NAMES, [], []), begin, begin + 125 * MS) == followed
        for now in range(begin, begin + 5 * S, S):
            assert not plan.update(now, now + 125 * MS)
            assert plan.motion.at(now + 10 * S) == end


def test_a_stop_keeps_the_limits_of_acceleration() -> None:
    """It lasts as long as it must; without any it takes half a second."""
    for most in (10.0, 1.0):
        plan = plan_of(limits(acceleration=most), amplitude=(2.0, 2.0), frequency=(0.1, 0.1))
        followed = plan.follow(Route((), [], []), NOW, NOW)
        rows = path(plan.motion, NOW, followed.end + S)
        assert np.abs(rows[:, 2]).max() <= 1.001 * most
        assert (followed.end - NOW > BRAKING_TIME * S) == (most < 5.0)


def test_after_a_stop_waypoints_and_other_parameters_move_it_again() -> None:
    plan = plan_of()
    end = plan.follow(Route((), [], []), NOW, BEGIN).end
    plan.update(end + S, end + S)
    followed = plan.follow(route((2.0, (1.0, 1.0)), stamp=end + S), end + S, end + S + 125 * MS)
    assert followed == Followed(1, 0, end + 3 * S)
    assert plan.motion is not None
    assert plan.motion.at(end + 4 * S)[0] == (1.0, 1.0)
    plan.update(end + 5 * S, end + 5 * S)
    plan.config = plan.config.changed({'amplitude': (0.1, 0.2)})
    assert plan.update(end + 6 * S, end + 6 * S)
    assert plan.motion.at(end + 20 * S) == Sinusoid(plan.config).at(end + 20 * S)


@pytest.mark.parametrize('names', [('a',), ('a', 'c')])
def test_a_stop_of_other_joints_is_refused(names: tuple[str, ...]) -> None:
    plan = plan_of()
    before = plan.motion
    with pytest.raises(CtcError, match='each of these once: a, b'):
        plan.follow(Route(names, [], []), NOW, BEGIN)
    assert plan.motion is before


@pytest.mark.parametrize('age', [0.0, 1e-9, 3600.0])
def test_waypoints_that_are_all_past_are_refused_with_their_age(age: float) -> None:
    plan = plan_of()
    before = plan.motion
    with pytest.raises(CtcError) as error:
        plan.follow(route((-5.0 - age, (0.0, 0.0)), (-age, (3.0, 3.0))), NOW, BEGIN)
    assert str(error.value) == (
        f'all waypoints are past: the last one was due {age:.3f} s ago; '
        'are the clocks synchronised?')
    assert plan.motion is before


def test_waypoints_that_are_past_are_left_out_and_the_others_met_in_time() -> None:
    plan = plan_of(amplitude=(0.0, 0.0))
    points = ((-1.0, (9.0, -9.0)), (0.1, (7.0, 7.0)), (1.5, (0.9, 0.1)), (2.5, (0.2, -0.3)))
    followed = plan.follow(route(*points), NOW, BEGIN)
    assert followed == Followed(4, 2, NOW + 5 * S // 2)
    assert plan.motion is not None
    for t, q in points[2:]:
        assert plan.motion.at(NOW + round(t * S))[0] == pytest.approx(q, abs=1e-12)
    rows = path(plan.motion, NOW, NOW + 3 * S)
    assert np.abs(rows[:, 0] - (0.5, -0.3)).max() < 0.5
    assert np.abs(rows[:, 1]).max() < 0.701


@pytest.mark.parametrize('remaining', [0.05, 0.15, 0.6])
def test_what_is_late_is_not_made_up_for_by_speed(remaining: float) -> None:
    """
    A motion of 0.3 rad/s whose clock is ahead, so that all but its last moment is past.

    It is gone through with half as much again, or the 0.5 rad/s that are never too fast; by the
    join of before it went at 11 rad/s.
    """
    plan = plan_of(amplitude=(0.0, 0.0))
    points = ((remaining - 10.0, (0.5, -0.3)), (remaining, (3.5, -0.3)))
    followed = plan.follow(route(*points), NOW, BEGIN)
    assert followed.past == (1 if remaining > 0.125 else 2)
    rows = path(plan.motion, NOW, followed.end + S, 20 * MS)
    assert np.abs(rows[:, 1]).max() <= 0.51
    assert rows[-1, 0] == pytest.approx((3.5, -0.3))
    assert followed.end > NOW + 5 * S


def test_what_is_late_also_keeps_the_limits_of_the_description() -> None:
    points = ((-2.0, (0.5, -0.3)), (0.0, (2.5, -0.3)), (0.3, (2.8, -0.3)), (4.0, (3.0, -0.3)))
    plan = plan_of(limits(velocity=1.05, acceleration=1.0), amplitude=(0.0, 0.0))
    followed = plan.follow(route(*points), NOW, BEGIN)
    rows = path(plan.motion, NOW, followed.end + S)
    assert np.abs(rows[:, 1]).max() <= 1.05 * 1.002
    assert rows[-1, 0] == pytest.approx((3.0, -0.3))


def test_from_a_first_waypoint_at_once_it_is_left_out_too() -> None:
    """As MoveIt sends it: the state at the start, which the motion has, and then the way."""
    plan = plan_of()
    assert plan.motion is not None
    q, dq, _ = plan.motion.at(BEGIN)
    sent = Route(NAMES, [BEGIN, BEGIN + S, BEGIN + 2 * S], [
        (q, dq, ()), ((0.8, 0.0), (0.1, 0.2), ()), ((1.0, 0.3), (0.0, 0.0), ())])
    exact = Waypoints(sent.times, sent.points)
    assert plan.follow(sent, NOW, BEGIN) == Followed(3, 1, BEGIN + 2 * S)
    for t in range(BEGIN, BEGIN + 3 * S, 50 * MS):
        for row, wanted in zip(plan.motion.at(t), exact.at(t)):
            assert row == pytest.approx(wanted, abs=1e-9)


def endless(**config: Any) -> MotionPlan:
    return plan_of(limits('continuous'), **config)


@pytest.mark.parametrize('turns', [-2, -1, 0, 3])
def test_a_continuous_joint_takes_the_short_way(turns: int) -> None:
    """From 3.2 rad to 3.1 rad, however that is written; a revolute one goes as it is written."""
    still: dict[str, Any] = {'center': (3.2, 0.0), 'amplitude': (0.0, 0.0)}
    target = 3.1 + 2.0 * pi * turns
    for plan, way in ((endless(**still), 0.1), (plan_of(**still), abs(3.2 - target))):
        followed = plan.follow(route((5.0, (target, 0.2))), NOW, BEGIN)
        assert followed.turned == (('a',) if plan.limits and turns else ())
        rows = path(plan.motion, NOW, NOW + 6 * S)
        assert np.ptp(rows[:, 0, 0]) == pytest.approx(way)
        assert rows[-1, 0, 1] == pytest.approx(0.2)
        assert cos(rows[-1, 0, 0] - 3.1) == pytest.approx(1.0)


def test_the_short_way_leads_from_each_waypoint_to_the_next() -> None:
    """Across the ends of a planner's window, twice; a full turn takes a waypoint on its way."""
    plan = endless(center=(3.0, 0.0), amplitude=(0.0, 0.0))
    plan.follow(route((1.0, (-3.0, 0.0)), (2.0, (3.0, 2.0)), (3.0, (-3.0, 4.0)),
                      (4.0, (-1.0, 6.0))), NOW, BEGIN)
    rows = path(plan.motion, NOW, NOW + 5 * S, 500 * MS)
    assert rows[[2, 4, 6, 8], 0, 0] == pytest.approx(
        [2.0 * pi - 3.0, 3.0, 2.0 * pi - 3.0, 2.0 * pi - 1.0])
    assert rows[[2, 4, 6, 8], 0, 1] == pytest.approx([0.0, 2.0, 4.0, 6.0])


def test_velocities_tell_how_often_it_turns_between_waypoints() -> None:
    """At 10 rad/s, sparse waypoints are more than half a turn apart; nothing of that is lost."""
    plan = endless(center=(0.0, 0.0), amplitude=(0.0, 0.0))
    times = [BEGIN + k * S // 2 for k in range(1, 6)]
    points: list[Point] = [((5.0 * k - 5.0, 0.0), (10.0, 0.0), ()) for k in range(1, 6)]
    plan.follow(Route(NAMES, times, points), NOW, BEGIN)
    assert plan.motion is not None
    assert [plan.motion.at(t)[0][0] for t in times[1:]] == pytest.approx([5.0, 10.0, 15.0, 20.0])


@pytest.mark.parametrize('start', [-3.0, 9.5, 3.0])
def test_a_start_is_that_nearest_to_the_motion(start: float) -> None:
    """As the driver has it within its window; of a revolute joint it stays as it is."""
    described = limits('continuous')
    config = CONFIG.changed({
        'center': (3.2, 0.0), 'amplitude': (0.0, 0.0), 'start_duration': 1.0})
    for given_limits, nearest in ((described, True), (None, False)):
        motion = make_motion(config, None, {'a': (start, 0.0)}, 0, given_limits)
        begin = motion.at(0)[0][0]
        assert (abs(begin - 3.2) <= pi) == (nearest or start == 3.0)
        assert sin(begin) == pytest.approx(sin(start))
    waypoints = make_motion(
        config, route((2.0, (3.2, 0.0)), (3.0, (-2.9, 0.0)), stamp=0), {'a': (start, 0.0)}, 0,
        described)
    rows = path(waypoints, 0, 4 * S)
    assert np.abs(rows[:, 0, 0] - 3.2).max() <= pi
    assert rows[-1, 0, 0] == pytest.approx(2.0 * pi - 2.9)
