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

"""The motion that a reference publishes while it learns."""

from __future__ import annotations

import itertools
from math import pi, sin

from ctc_chattering.learning.learner import FADE_S, LEAD_NS
from ctc_chattering.learning.learning_filter import LearningFilter
from ctc_chattering.learning.learning_schedule import LearningSchedule
from ctc_chattering.numerics.time_grid import NANOSECONDS as S
from ctc_chattering.numerics.time_grid import seconds
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.motion_plan import MotionPlan
from ctc_chattering.trajectory.path_clock import ScaledMotion
from ctc_chattering.trajectory.reference import ReferenceConfig
from ctc_chattering.trajectory.waypoints import Route
import numpy as np
import pytest

MS = S // 1000
PERIOD = 10 * MS
CHUNK = 120 * MS
CONFIG = ReferenceConfig(amplitude=(0.3, 0.2), control_period=0.01, learning=True)
#: Begin and end of the first pass of a motion from t = 0 on, whose period is 1 s.
BEGIN, END = S, 2 * S
FADE = round(FADE_S * S)
FILTER = LearningFilter(
    np.array([0.1, 50.0]), np.stack([np.diag([0.7 + 0.0j] * 2)] * 2), 8.0, 0.5)


def waypoints(*points: tuple[float, tuple[float, float]]) -> Route:
    rest = (0.0, 0.0)
    return Route(CONFIG.joint_names, [round(t * S) for t, _ in points],
                 [(q, rest, rest) for _, q in points])


class Robot:
    """A robot that lags behind its reference by the same in each period of 1 s."""

    def __init__(self, config: ReferenceConfig = CONFIG) -> None:
        self.plan = MotionPlan(config, None)
        self.plan.prepare()
        self.schedule = LearningSchedule(self.plan, PERIOD, S // 2, lambda _: FILTER)
        self.learner = self.schedule.learner
        self.points: dict[int, Point] = {}
        self.now = 0
        self.reports = True
        #: Time at which a period of the lag begins [ns].
        self.origin = 0
        self.publish()

    def publish(self) -> None:
        if self.schedule.simulated or self.now == 0:
            self.schedule.follow_clock(self.now)
        self.schedule.update()
        for begin, points in self.schedule.chunks():
            self.points.update(zip(range(begin, begin + S, PERIOD), points))

    def run_to(self, end: int) -> None:
        """Advance time, with an error at each sample."""
        while self.now < end:
            self.report()
            self.now += PERIOD
            self.publish()

    def report(self) -> None:
        if self.reports:
            lag = 0.02 * sin(2.0 * pi * seconds(self.now - self.origin))
            self.learner.add(
                self.schedule.path_time_of(self.now), self.points[self.now][0], (lag, -lag))

    def array(self, begin: int = 0) -> np.ndarray:
        """Return time [s], position, velocity and acceleration that were published."""
        return np.array([[[seconds(t)] * 2, *self.points[t]] for t in sorted(self.points)
                         if t >= begin])

    def correction(self, t: int) -> np.ndarray:
        """Return what the published position has beyond the present plan."""
        assert self.plan.motion is not None
        return np.array(self.points[t][0]) - self.plan.motion.at(t)[0]


def assert_smooth(rows: np.ndarray, largest: float, step: float = 1.5) -> None:
    """
    Check that velocity and acceleration are derivatives, and the latter bounded.

    A step of the acceleration is at most twice `step` [rad/s²].
    """
    _, q, dq, ddq = rows.transpose(1, 0, 2)
    h = seconds(PERIOD)
    jump = np.diff(q, axis=0) / h - 0.5 * (dq[1:] + dq[:-1])
    assert np.abs(jump).max() < 0.02
    assert np.abs(np.diff(dq, axis=0) / h - 0.5 * (ddq[1:] + ddq[:-1])).max() < step
    assert np.abs(ddq).max() < largest


def test_errors_shrink_from_pass_to_pass_without_a_jump() -> None:
    robot = Robot()
    robot.run_to(9 * S)
    errors = [max(x.rms) for x in robot.learner.passes]
    assert len(errors) == 4
    assert all(later < 0.5 * earlier for earlier, later in itertools.pairwise(errors))
    assert_smooth(robot.array(), largest=16.0)


def test_a_chunk_is_held_back_until_its_correction_is_final() -> None:
    """Simulated time stands, as in lockstep: nothing is left out, however long errors take."""
    robot = Robot()
    robot.run_to(END - PERIOD)
    robot.reports = False
    robot.run_to(END)
    robot.reports = True
    for _ in range(20):
        robot.publish()
    assert END + LEAD_NS - CHUNK <= max(robot.points) < END + LEAD_NS
    robot.now = END
    robot.report()
    robot.publish()
    assert not robot.learner.passes[0].rms[0] < 0.01
    robot.run_to(END + LEAD_NS)
    assert not robot.correction(END + LEAD_NS).any()
    robot.run_to(END + LEAD_NS + FADE)
    assert np.abs(robot.correction(END + LEAD_NS + FADE)).max() > 1e-3


@pytest.mark.parametrize('simulated', [True, False])
def test_a_motion_does_not_wait_for_a_controller_that_is_silent(simulated: bool) -> None:
    """In real time it is published a chunk ahead, and in simulated time hardly late."""
    robot = Robot()
    if not simulated:
        robot.schedule = LearningSchedule(robot.plan, PERIOD, S // 2, lambda _: FILTER)
        robot.schedule.follow_states(0, 0)
    robot.reports = False
    late = []
    for now in range(PERIOD, 8 * S, PERIOD):
        robot.now = now
        robot.schedule.follow_real_time(now)
        robot.publish()
        late.append(now - max(robot.points))
    assert max(late) <= (60 * MS if simulated else -CHUNK + PERIOD)
    learner = robot.schedule.learner
    assert 'reported no errors' in learner.outcome and not learner.passes


def learned(config: ReferenceConfig = CONFIG) -> Robot:
    """Return a robot in the middle of its third pass."""
    robot = Robot(config)
    robot.run_to(6 * S)
    assert len(robot.learner.passes) >= 2
    return robot


def test_a_stop_in_the_middle_of_a_pass_fades_the_correction_out() -> None:
    robot = learned()
    passes = len(robot.learner.passes)
    robot.schedule.follow(Route((), [], []), 0)
    robot.run_to(8 * S)
    assert_smooth(robot.array(5 * S), largest=16.0)
    assert robot.plan.motion is not None
    assert list(robot.points[max(robot.points)][0]) == pytest.approx(
        robot.plan.motion.at(robot.now)[0], abs=1e-12)
    assert robot.schedule.at_rest
    assert robot.learner.outcome == 'waiting for a motion that is repeated'
    assert robot.learner.passes == [] and passes


def test_a_stop_while_a_chunk_is_held_back_leaves_no_gap() -> None:
    robot = Robot()
    robot.run_to(END - PERIOD)
    robot.reports = False
    robot.run_to(max(robot.points))
    robot.schedule.follow(Route((), [], []), 0)
    robot.publish()
    assert sorted(robot.points) == list(range(0, max(robot.points) + PERIOD, PERIOD))
    assert_smooth(robot.array(), largest=16.0)


def test_the_errors_of_a_goal_are_those_from_the_desired_motion() -> None:
    """Also of the velocity, at another speed."""
    robot = Robot(CONFIG.changed({'speed_scaling': 0.5}))
    robot.run_to(8 * S)
    clock = robot.schedule._clock
    assert robot.plan.motion is not None
    q, dq, _ = ScaledMotion(robot.plan.motion, clock).at(robot.now)
    correction = robot.schedule.correction(robot.now)
    published = robot.points[robot.now]
    assert np.abs(correction[:2]).max() > 1e-3
    np.testing.assert_allclose(np.subtract(published[:2], (q, dq)), correction[:2], atol=1e-12)


def test_a_robot_that_is_held_gets_no_correction() -> None:
    robot = learned()
    robot.schedule.rest_at((1.0, 2.0))
    robot.run_to(6 * S + 2 * PERIOD)
    begin = 6 * S + CHUNK
    assert {tuple(x[0]) for t, x in robot.points.items() if t >= begin} == {(1.0, 2.0)}
    robot.run_to(7 * S)
    assert robot.schedule.was_at(robot.now, (1.0, 2.0))


def test_the_same_goal_again_begins_with_what_was_learned() -> None:
    """Its first point is often where the robot is, at 0 s."""
    robot = Robot()
    goals = [waypoints((0.0, (3.0, 1.0)), (1.0, (3.3, 1.2)), (2.0, (3.0, 1.0)))] * 3
    other = waypoints((1.0, (2.9, 1.0)), (2.0, (3.0, 1.0)))
    sizes = []
    for goal in (waypoints((1.0, (3.0, 1.0))), *goals, other, goals[0]):
        followed = robot.schedule.follow(goal, 0)
        robot.origin = begin = followed.end - goal.times[-1]
        robot.run_to(begin + 400 * MS)
        sizes.append(np.abs(robot.correction(begin + 400 * MS)).max())
        robot.run_to(followed.end + 200 * MS)
    first, again, third, of_other, last = sizes[1:]
    assert first == of_other == 0.0
    assert min(again, third, last) > 1e-3
    assert_smooth(robot.array(4 * S), largest=16.0, step=3.0)  # At the end of a correction.


def test_a_goal_from_elsewhere_does_not_begin_with_what_was_learned() -> None:
    """Its errors are others."""
    robot = Robot()
    goal = waypoints((1.0, (3.0, 1.0)))
    counts = []
    for start in ((2.9, 1.0), (2.9, 1.0), (2.9, 1.2), (2.9, 1.0), (2.9, 1.2)):
        end = robot.schedule.follow(waypoints((1.0, start)), 0).end
        robot.run_to(end + 200 * MS)
        end = robot.schedule.follow(goal, 0).end
        robot.run_to(end + 200 * MS)
        counts.append(len(robot.learner.passes))
    assert counts == [1, 2, 1, 3, 2]


def test_waypoints_that_begin_in_the_past_are_not_learned() -> None:
    robot = Robot()
    robot.run_to(2 * S)
    robot.schedule.follow(waypoints((2.0, (3.0, 1.0))), S)
    robot.run_to(4 * S)
    assert robot.schedule.repeated is None


def test_another_sinusoid_is_learned_after_its_transition_and_the_first_one_remembered() -> None:
    robot = learned()
    first = robot.learner.rows
    robot.plan.config = CONFIG.changed({'amplitude': (0.1, 0.1)})
    robot.run_to(7 * S)
    assert robot.learner.rows is None
    robot.run_to(12 * S)
    assert robot.learner.passes and robot.learner.rows is not first
    robot.plan.config = CONFIG
    robot.run_to(14 * S + 500 * MS)
    assert robot.learner.rows is first
    assert_smooth(robot.array(), largest=16.0)


def test_a_profile_without_a_common_period_is_followed_without_learning() -> None:
    robot = Robot(CONFIG.changed({'frequency': (1.0, 0.70710678)}))
    robot.run_to(4 * S)
    assert 'no common period' in robot.learner.outcome
    assert not any(robot.correction(t).any() for t in range(0, 4 * S, PERIOD))


def test_a_change_of_speed_leaves_out_the_pass() -> None:
    robot = learned()
    robot.run_to(6 * S + 200 * MS)
    count = len(robot.learner.passes)
    robot.plan.config = CONFIG.changed({'speed_scaling': 0.5})
    robot.run_to(8 * S)
    assert len(robot.learner.passes) == count
    robot.run_to(12 * S)
    begin, end, _ = robot.learner.passes[count]
    assert end - begin == S and begin >= 6 * S + 200 * MS
    assert_smooth(robot.array(), largest=16.0)


def test_what_is_frozen_stays_and_learning_goes_on_without_a_jump() -> None:
    robot = learned()
    robot.run_to(6 * S + 700 * MS)
    robot.schedule.freeze(True)
    frozen = robot.learner.rows
    for end in range(7 * S, 10 * S, 130 * MS):
        robot.run_to(end)
        robot.schedule.freeze(False)
        robot.run_to(end + 30 * MS)
        robot.schedule.freeze(True)
    assert robot.learner.rows is frozen and robot.learner.outcome == 'frozen'
    robot.schedule.freeze(False)
    robot.run_to(14 * S)
    assert robot.learner.rows is not frozen
    assert_smooth(robot.array(), largest=16.0)


@pytest.mark.parametrize('begin', [6 * S, 6 * S + 250 * MS, 6 * S + 620 * MS])
def test_a_reset_ends_the_correction_at_once(begin: int) -> None:
    robot = learned()
    robot.run_to(begin)
    robot.schedule.reset_learning()
    robot.run_to(begin + S)
    assert not any(robot.correction(t).any() for t in range(
        begin + CHUNK + FADE + PERIOD, begin + S, PERIOD))
    assert_smooth(robot.array(), largest=16.0)


def test_a_refused_law_holds_nothing_back() -> None:
    robot = Robot()
    robot.learner.refusal = 'unstable'
    robot.reports = False
    for now in range(PERIOD, 5 * S, PERIOD):
        robot.now = now
        robot.publish()
        assert max(robot.points) >= now + S // 2 - CHUNK
    assert robot.learner.outcome == 'unstable'
