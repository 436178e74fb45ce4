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


"""What is learned from passes, with made-up errors of an ideal loop."""

from __future__ import annotations

from collections.abc import Callable

from ctc_chattering.learning.learner import (
    LEAD_NS,
    Learner,
    LearningState,
    MAX_GAP_NS,
    MAX_MOTIONS,
)
from ctc_chattering.learning.learning_filter import LearningFilter
from ctc_chattering.learning.motion import motion_of, RepeatedMotion, waypoint_motion
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.trajectory.joint_limits import JointLimits, TOLERANCE
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig
from ctc_chattering.trajectory.waypoints import Route, Waypoints
import numpy as np
import pytest

SECOND = NANOSECONDS
#: Time between two errors [ns], and duration of a pass of both motions.
STEP, DURATION = SECOND // 100, 2 * SECOND
BOUND = 0.1
#: Error of a pass without a correction, by its time in the pass [s].
Errors = Callable[[float], Array]


def wave(size: float = 0.01) -> Errors:
    return lambda t: size * np.array([np.sin(np.pi * t), np.cos(np.pi * t)])


def learner_of(gain: float = 0.7, limits: list[JointLimits] | None = None, bound: float = BOUND
               ) -> Learner:
    """Return a learner for a loop that follows its reference."""
    L = np.full((2, 2, 2), gain * np.eye(2), np.complex128)
    learning_filter = LearningFilter(np.array([0.1, 50.0]), L, 10.0, 0.5)
    return Learner(2, bound, STEP // 10, lambda _: learning_filter, limits)


def periodic(frequency: float = 0.5) -> RepeatedMotion:
    config = ReferenceConfig(frequency=(frequency, 0.5))
    return motion_of(config, None, make_motion(config))


def goal(begin: int = 0, last: float = 1.0) -> RepeatedMotion:
    times = [begin + k * SECOND for k in (1, 2)]
    points = [((x, -x), (0.0, 0.0), (0.0, 0.0)) for x in (0.5, last)]
    motion = Waypoints(times, points, (begin, ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))))
    return waypoint_motion(Route(['a', 'b'], times, points), motion, begin)


def play(learner: Learner, motion: RepeatedMotion, begin: int, end: int, errors: Errors,
         lost: Callable[[int], bool] = lambda _: False) -> None:
    """Have an ideal loop follow the corrected motion, with an error that does not depend on it."""
    corrected = learner.corrected
    for s in range(begin, end, STEP):
        q_d = np.array(corrected(motion.motion).at(s)[0])
        if not lost(s):
            learner.add(s, q_d.tolist(), errors(seconds(motion.phase(s))).tolist())


def sizes(learner: Learner) -> list[float]:
    return [float(np.linalg.norm(run.rms)) for run in learner.passes]


def pass_end(learner: Learner) -> int:
    """Return the time at which the present pass ends."""
    known = learner.known_until()
    assert known is not None
    return known - LEAD_NS


def test_errors_of_a_periodic_motion_fall_from_pass_to_pass() -> None:
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    play(learner, motion, 0, 15 * SECOND, wave())
    assert [(run.begin, run.end - run.begin) for run in learner.passes] == [
        (SECOND + k * (DURATION + 3 * SECOND // 4), DURATION) for k in range(5)]
    assert sizes(learner) == pytest.approx([0.01 * 0.3 ** k for k in range(5)], abs=2e-6)
    assert learner.rows is not None
    t = DURATION / SECOND * np.arange(len(learner.rows)) / len(learner.rows)
    ideal = np.array([wave()(x) for x in t])
    assert learner.rows == pytest.approx((1.0 - 0.3 ** 5) * ideal, abs=2e-5)


def test_nothing_that_is_known_changes() -> None:
    """Neither `known_until` goes back, nor the motion before it."""
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    known: list[int] = []
    ahead: dict[int, Array] = {}
    for k in range(0, 15 * SECOND, STEP):
        now = learner.corrected(motion.motion).at(k)
        if k in ahead:
            assert np.array(now) == pytest.approx(ahead[k], abs=1e-12)
        until = learner.known_until()
        assert until is not None and until > k
        known.append(until)
        for t in range(k, until, 7 * STEP):
            ahead.setdefault(t, np.array(learner.corrected(motion.motion).at(t)))
        play(learner, motion, k, k + STEP, wave())
    assert known == sorted(known)
    assert len(set(known)) > 4


def test_corrections_pass_into_each_other_smoothly() -> None:
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    points = []
    for s in range(0, 10 * SECOND, STEP // 10):
        if s % STEP == 0:
            play(learner, motion, s, s + STEP, wave(0.05))
        points.append(learner.corrected(motion.motion).at(s))
    q, dq, _ = np.array(points).transpose(1, 0, 2)
    rate = np.gradient(q, 1e-3, axis=0)[1:-1]
    assert rate == pytest.approx(dq[1:-1], abs=1e-3)


def test_the_correction_of_waypoints_ends_without_a_jolt() -> None:
    """A robot that has not come to rest at the end leaves a rate of 0.03 rad/s there."""
    learner = learner_of()
    for begin in (0, 10 * SECOND):
        motion = goal(begin)
        learner.follow(motion, begin)
        play(learner, motion, begin, begin + 3 * SECOND, wave())
    end = 12 * SECOND
    window = range(end - SECOND // 10, end + SECOND // 10, STEP // 40)
    _, dq, ddq = np.array([learner.applied.at(t) for t in window]).transpose(1, 0, 2)
    assert np.abs(dq).max() > 0.01 and not dq[-1].any()
    assert np.abs(ddq).max() < 3.0


def test_waypoints_are_learned_when_they_are_sent_again() -> None:
    learner = learner_of()
    for k in range(4):
        begin = k * 10 * SECOND
        motion = goal(begin)
        learner.follow(motion, begin)
        assert learner.known_until() is None
        play(learner, motion, begin, begin + 3 * SECOND, wave())
    first, second, third, fourth = sizes(learner)
    assert 0.3 * first < second < 0.45 * first  # Its offset from no correction fades out.
    assert 0.08 * first < third < 0.13 * first
    assert 0.02 * first < fourth < 0.05 * first
    other = goal(40 * SECOND, last=2.0)
    learner.follow(other, 40 * SECOND)
    assert learner.passes == [] and learner.rows is None
    learner.follow(goal(50 * SECOND), 50 * SECOND)
    assert len(learner.passes) == 4


def test_after_waypoints_the_correction_stays_until_the_next_motion() -> None:
    learner = learner_of()
    motion = goal()
    learner.follow(motion, 0)
    play(learner, motion, 0, 3 * SECOND, wave())
    learner.follow(goal(10 * SECOND), 10 * SECOND)
    at_end, later = (learner.corrected(goal(10 * SECOND).motion).at(t)
                     for t in (12 * SECOND, 20 * SECOND))
    assert later[0] == at_end[0]
    assert np.array(later[1:]) == pytest.approx(0.0)
    assert np.abs(np.array(later[0]) - [1.0, -1.0]).max() > 1e-3
    learner.follow(None, 20 * SECOND)
    assert learner.corrected(motion.motion).at(21 * SECOND)[0] == pytest.approx([1.0, -1.0])


@pytest.mark.parametrize('bound', [0.1, 0.02])
def test_the_correction_of_waypoints_begins_smoothly_and_within_its_bound(bound: float) -> None:
    """Also where the offset would exceed the bound."""
    learner = learner_of(bound=bound)
    points: list[Array] = []
    for k in range(3):
        begin = k * 10 * SECOND
        motion = goal(begin)
        learner.follow(motion, begin)
        for s in range(begin - SECOND, begin + 3 * SECOND, STEP // 10):
            if s % STEP == 0 and s >= begin:
                play(learner, motion, s, s + STEP, wave(0.03))
            points.append(np.subtract(learner.corrected(motion.motion).at(s), motion.motion.at(s)))
    q, dq, _ = np.array(points).transpose(1, 0, 2)
    assert 0.9 * min(bound, 0.03) < np.abs(q).max() < bound + 1e-9
    assert len(learner.passes) == 3
    of_one = 4000
    for k in range(3):
        run = slice(k * of_one, (k + 1) * of_one)
        rate = np.gradient(q[run], 1e-3, axis=0)[1:-1]
        assert rate == pytest.approx(dq[run][1:-1], abs=5e-3)


def test_a_pass_that_ends_without_a_further_error_counts() -> None:
    learner = learner_of()
    learner.follow(goal(), 0)
    play(learner, goal(), 0, 2 * SECOND, wave())
    assert learner.passes == []
    learner.follow(None, 2 * SECOND)
    learner.follow(goal(10 * SECOND), 10 * SECOND)
    assert len(learner.passes) == 1


def test_growing_errors_end_it_with_the_best_correction() -> None:
    """Two passes with more than before; the correction is then that of the best pass."""
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    play(learner, motion, 0, 5 * SECOND, wave())
    best = learner.rows
    play(learner, motion, 5 * SECOND, 6 * SECOND, wave())  # The second pass has ended.
    growth = [2.0, 3.0, 4.0]
    for size in growth:
        end = pass_end(learner) + STEP
        begin = learner.passes[-1].end + STEP
        grown: Errors = lambda t, size=size: size * wave()(t)  # type: ignore[misc] # noqa: E731
        play(learner, motion, begin, end, grown)
        if learner.state is LearningState.STOPPED:
            break
    assert learner.state is LearningState.STOPPED
    assert len(learner.passes) == 4
    assert learner.rows is best
    last = learner.passes[-1].end
    now = learner.corrected(motion.motion).at(last + SECOND)
    desired = motion.motion.at(last + SECOND)
    play(learner, motion, last + STEP, last + 8 * SECOND, wave())
    assert learner.rows is best
    assert len(learner.passes) > 5
    again = learner.corrected(motion.motion).at(last + SECOND + 2 * DURATION)
    assert np.array(again) == pytest.approx(np.array(now), abs=1e-9)
    assert np.abs(np.array(now) - desired).max() > 1e-3


def test_a_best_correction_that_is_worse_than_none_ends_as_well() -> None:
    """Errors need not come again with the correction that had the least."""
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    for k in range(60):  # The errors grow from pass to pass, whatever the correction is.
        size = 1.0 + 2.0 * len(learner.passes)
        play(learner, motion, k * SECOND // 2, (k + 1) * SECOND // 2,
             lambda t, size=size: size * wave()(t))  # type: ignore[misc]
        known = learner.known_until()
        if known is None:
            break
    assert learner.state is LearningState.STOPPED
    assert learner.rows is None
    end = learner.passes[-1].end
    corrected, desired = (x.at(end + SECOND) for x in (
        learner.corrected(motion.motion), motion.motion))
    assert np.array(corrected) == pytest.approx(np.array(desired), abs=1e-12)


def test_a_jump_of_the_load_does_not_end_it() -> None:
    """An error above that of the first pass that then falls again is another load."""
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    play(learner, motion, 0, 9 * SECOND + SECOND // 4, wave())
    play(learner, motion, 9 * SECOND + SECOND // 4, 26 * SECOND, wave(0.03))
    found = sizes(learner)
    assert found[3] > 1.1 * found[0]
    assert found[-1] < 0.05 * found[3]
    assert learner.state is LearningState.LEARNING


def test_a_pass_with_missing_errors_is_left_out() -> None:
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    play(learner, motion, 0, 4 * SECOND, wave(), lambda s: 2 * SECOND < s < 2.2 * SECOND)
    assert learner.passes == [] and learner.rows is None
    assert learner.problem == 'errors of 0.2 s are missing in the pass'
    play(learner, motion, 4 * SECOND, 6 * SECOND, wave(), lambda s: s // STEP % 10 == 0)
    assert len(learner.passes) == 1
    assert learner.problem == ''


def test_the_report_does_not_ascribe_missing_errors_to_the_pass_before() -> None:
    """The error of the report is that of a whole pass, and the pass after it was left out."""
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    play(learner, motion, 0, 6 * SECOND, wave(), lambda s: 4 * SECOND < s < 4.2 * SECOND)
    assert len(learner.passes) == 1
    assert learner.report.endswith(
        '; the latest pass was not learned from: errors of 0.2 s are missing in the pass')


def test_a_long_silence_does_not_end_it() -> None:
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    silence = range(2 * SECOND, 20 * SECOND)
    play(learner, motion, 0, 27 * SECOND, wave(), lambda s: s in silence)
    assert len(learner.passes) >= 2
    assert all(run.begin >= 20 * SECOND - STEP for run in learner.passes)


@pytest.mark.parametrize('frequency', [20.0, 5.0])
def test_a_short_pass_without_errors_is_left_out(frequency: float) -> None:
    config = ReferenceConfig(frequency=(frequency, frequency))
    motion, learner = motion_of(config, None, make_motion(config)), learner_of()
    learner.follow(motion, 0)
    learner.add(0, motion.motion.at(0)[0], [0.0, 0.0])
    later = 3 * SECOND
    learner.add(later, motion.motion.at(later)[0], [0.0, 0.0])
    assert learner.passes == []
    assert 'are missing in the pass' in learner.problem


def test_the_correction_never_exceeds_its_bound() -> None:
    motion, learner = periodic(), learner_of(bound=0.02)
    learner.follow(motion, 0)
    largest = 0.0
    for s in range(0, 15 * SECOND, STEP):
        play(learner, motion, s, s + STEP, wave(0.2))
        corrected = learner.corrected(motion.motion).at(s)
        gap = np.array(corrected[0]) - motion.motion.at(s)[0]
        largest = max(largest, float(np.abs(gap).max()))
    assert len(learner.passes) == 5
    assert 0.0199 < largest < 0.020001


def test_the_correction_is_within_its_bound_between_the_samples() -> None:
    """Samples of a pass that is no multiple of the control period lie between those of others."""
    motion = periodic()
    learning_filter = LearningFilter(np.array([0.1, 50.0]), np.stack([np.eye(2) + 0.0j] * 2),
                                     10.0, 0.5)
    learner = Learner(2, 0.02, 3 * STEP, lambda _: learning_filter)
    learner.follow(motion, 0)
    fast = 14.0 * np.pi
    play(learner, motion, 0, 5 * SECOND, lambda t: np.sin([fast * t + 0.1, fast * t + 1.0]))
    q = [learner.applied.at(4 * SECOND + k * STEP // 10)[0] for k in range(2000)]
    assert 0.005 < np.abs(q).max() <= 0.02


def test_a_correction_at_its_bound_is_as_smooth_as_the_error() -> None:
    """A bound that cuts it off would have it accelerate ten times as fast."""
    motion, learner = periodic(), learner_of(bound=0.02)
    learner.follow(motion, 0)
    play(learner, motion, 0, 15 * SECOND, wave(0.2))
    ddq = [learner.applied.at(14 * SECOND + k * STEP)[2] for k in range(200)]
    assert np.abs(ddq).max() < 1.1 * 0.02 * np.pi ** 2


def test_the_motions_that_are_oldest_are_forgotten() -> None:
    """Of a planner that plans anew, each is another."""
    learner = learner_of()
    goals = [goal(k * 10 * SECOND, last=1.0 + max(k - 1, 0)) for k in range(MAX_MOTIONS + 1)]
    for motion in goals:
        learner.follow(motion, motion.begin)
        play(learner, motion, motion.begin, motion.begin + 2 * SECOND + STEP, wave())
    remembered = []
    for motion in reversed(goals):
        learner.follow(motion, 10 ** 3 * SECOND)
        remembered.append(len(learner.passes))
    assert remembered == [1] * (MAX_MOTIONS - 1) + [2, 2]
    learner.follow(goal(0, last=0.5), 10 ** 3 * SECOND)
    learner.follow(goals[-1], 10 ** 3 * SECOND)
    assert learner.passes == []


def test_an_error_may_be_lost_at_the_slowest_rate_of_reports() -> None:
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    lost = SECOND + SECOND // 2
    play(learner, motion, 0, 4 * SECOND, wave(), lambda s: s % MAX_GAP_NS != 0 or s == lost)
    assert len(learner.passes) == 1 and learner.problem == ''


@pytest.mark.filterwarnings('ignore:overflow')
def test_errors_beyond_all_numbers_are_left_out() -> None:
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    play(learner, motion, 0, 4 * SECOND, wave(1.7e308))
    assert learner.passes == [] and learner.rows is None
    assert learner.problem == 'the errors of the pass are too large'


def test_waypoints_of_less_than_a_control_period_are_learned() -> None:
    """The reference may have a longer period than the controller."""
    learner, duration = learner_of(), STEP // 20
    points = [((1e-3, 1e-3), (0.0, 0.0), (0.0, 0.0))]
    motion = Waypoints([duration], points, (0, ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))))
    learner.follow(waypoint_motion(Route(['a', 'b'], [duration], points), motion, 0), 0)
    for s in range(0, duration + STEP, STEP // 100):
        learner.add(s, motion.at(s)[0], [0.01, 0.02])
    assert learner.rows is not None and learner.rows.shape == (1, 2)


def test_a_state_between_two_samples_is_on_the_motion() -> None:
    """Also where a joint turns back: the correction moves, and the joint accelerates."""
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    sample, fast = STEP // 10, 5.0 * np.pi
    for k, s in enumerate(range(0, 15 * SECOND, STEP)):
        q_d = learner.corrected(motion.motion).at(s)[0]
        stamp = s + k * 7 % 10 * sample // 10
        phase = seconds(motion.phase(stamp))
        e = 0.01 * np.sin([fast * phase, fast * phase + 1.0])
        learner.add(stamp, q_d, e.tolist())
        assert learner.problem == ''
    assert len(learner.passes) == 5


def test_another_reference_in_force_is_no_pass() -> None:
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    for s in range(0, 4 * SECOND, STEP):
        q_d = np.array(motion.motion.at(s)[0]) + 0.2
        learner.add(s, q_d.tolist(), wave()(seconds(s)).tolist())
    assert learner.passes == []
    assert learner.problem == 'the controller or its reference left the motion'


def test_an_angle_of_more_turns_is_the_same_angle() -> None:
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    for s in range(0, 4 * SECOND, STEP):
        q_d = np.array(motion.motion.at(s)[0]) + 2.0 * np.pi
        learner.add(s, q_d.tolist(), wave()(seconds(s)).tolist())
    assert len(learner.passes) == 1


def test_a_joint_whose_correction_exceeds_limits_gets_a_share_of_it() -> None:
    highest = float(np.pi + 0.5)  # Of the motion of joint 1.
    limits = [JointLimits('joint1', position=(-9.0, highest + 0.002)), JointLimits('joint2')]
    motion, learner = periodic(), learner_of(limits=limits)
    learner.follow(motion, 0)
    play(learner, motion, 0, 4 * SECOND, wave(0.05))
    free = learner_of()
    free.follow(motion, 0)
    play(free, motion, 0, 4 * SECOND, wave(0.05))
    assert learner.rows is not None and free.rows is not None
    limited, whole = learner.rows.T, free.rows.T
    assert limited[1] == pytest.approx(whole[1], abs=1e-15)
    share = limited[0].max() / whole[0].max()
    assert 0.0 < share < 0.6
    assert limited[0] == pytest.approx(share * whole[0], abs=1e-12)
    instants = range(4 * SECOND, 8 * SECOND, STEP)
    highest_of = [max(x.corrected(motion.motion).at(t)[0][0] for t in instants)
                  for x in (learner, free)]
    assert highest_of[0] <= (highest + 0.002) * (1.0 + TOLERANCE) < highest_of[1]


def test_frozen_it_measures_and_changes_nothing() -> None:
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    play(learner, motion, 0, 5 * SECOND, wave())
    rows, learner.is_frozen = learner.rows, True
    assert learner.state is LearningState.FROZEN
    assert learner.known_until() is None
    play(learner, motion, 5 * SECOND, 20 * SECOND, wave(0.03))
    assert learner.rows is rows
    assert len(learner.passes) > 6
    learner.is_frozen = False
    assert pass_end(learner) > 20 * SECOND - STEP
    play(learner, motion, 20 * SECOND, 25 * SECOND, wave())
    assert learner.rows is not rows


@pytest.mark.parametrize('ahead', [SECOND // 100, 2 * SECOND])
def test_reset_forgets_all(ahead: int) -> None:
    """Also where it is in force from after the end of the present pass only."""
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    play(learner, motion, 0, 5 * SECOND, wave())
    learner.reset(5 * SECOND + ahead)
    assert learner.passes == [] and learner.rows is None
    t = 6 * SECOND + ahead
    assert learner.corrected(motion.motion).at(t) == motion.motion.at(t)
    play(learner, motion, 5 * SECOND, 14 * SECOND, wave())
    assert sizes(learner)[0] == pytest.approx(0.01, rel=1e-3)
    assert sizes(learner)[1] == pytest.approx(0.003, rel=1e-2)


def test_reset_after_waypoints_forgets_their_pass() -> None:
    learner = learner_of()
    learner.follow(goal(), 0)
    play(learner, goal(), 0, 2 * SECOND, wave())
    learner.reset(3 * SECOND)
    learner.follow(goal(10 * SECOND), 10 * SECOND)
    assert learner.passes == [] and learner.rows is None


def test_an_interrupted_pass_is_left_out() -> None:
    motion, learner = periodic(), learner_of()
    learner.follow(motion, 0)
    play(learner, motion, 0, 5 * SECOND, wave())
    rows = learner.rows
    learner.interrupt(None)
    play(learner, motion, 7 * SECOND, 9 * SECOND, wave(0.5))
    assert learner.rows is rows
    assert pass_end(learner) == 10 * SECOND
    learner.interrupt(11 * SECOND)
    play(learner, motion, 9 * SECOND, 14 * SECOND + STEP, wave())
    assert [run.begin for run in learner.passes] == [SECOND, 12 * SECOND]
    assert learner.rows is not rows
    assert learner.state is LearningState.LEARNING


def test_interrupted_waypoints_are_measured_when_sent_again() -> None:
    learner = learner_of()
    learner.follow(goal(), 0)
    play(learner, goal(), 0, SECOND, wave())
    learner.interrupt(None)
    play(learner, goal(), SECOND, 3 * SECOND, wave())
    assert learner.passes == []
    learner.follow(goal(10 * SECOND), 10 * SECOND)
    play(learner, goal(10 * SECOND), 10 * SECOND, 13 * SECOND, wave())
    assert len(learner.passes) == 1


def test_a_kept_correction_is_in_force_at_once() -> None:
    motion, learner = periodic(), learner_of()
    kept = np.full((200, 2), 0.02)
    learner.follow(motion, 0, kept)
    now = learner.corrected(motion.motion).at(SECOND)
    assert np.array(now[0]) - motion.motion.at(SECOND)[0] == pytest.approx([0.02, 0.02])


def test_without_the_law_it_only_measures() -> None:
    motion = periodic()
    learner = Learner(2, BOUND, STEP // 10, lambda _: None)
    learner.follow(motion, 0)
    play(learner, motion, 0, 4 * SECOND, wave())
    assert len(learner.passes) == 1 and learner.rows is None
    assert learner.problem == 'the parameters of the controller are not known'
