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

"""The share of states that are answered in time, by counts and stamps."""

from __future__ import annotations

from ctc_chattering.control.controller import Controller
from ctc_chattering.controller.answers import AnsweredStates, shortfall
from ctc_chattering.controller.positions import JointSample
from ctc_chattering.controller.rehearsal import Rehearsal
from ctc_chattering.controller.state_machine import Mode
from loop_robot import MOTION, MS, Robot, ZERO
import pytest


def counted(period: int, *answers: tuple[int, bool, int]) -> AnsweredStates:
    """Return what is counted of answers: states missed before, whether in time, how often."""
    monitor = AnsweredStates(period)
    for missed, in_time, times in answers:
        for _ in range(times):
            if missed:
                monitor.miss(missed)
            monitor.answer(in_time)
    return monitor


@pytest.mark.parametrize(('period', 'window'), [(MS, 1000), (10 * MS, 100), (500 * MS, 20)])
def test_a_window_is_a_second_or_twenty_states(period: int, window: int) -> None:
    assert shortfall(counted(period, (0, False, window - 1)).total, 0.5, window) == ''
    text = shortfall(counted(period, (0, False, window)).total, 0.5, window)
    assert text.startswith(
        f'the computer is too slow: only 0 of the last {window} states were answered in time, ')
    assert 'least_answered requires 50 %' in text and 'docs/real_time.md' in text


def test_the_least_share_itself_is_allowed() -> None:
    assert shortfall(counted(MS, (0, False, 900), (0, True, 100)).total, 0.1, 1000) == ''
    assert shortfall(counted(MS, (0, False, 901), (0, True, 99)).total, 0.1, 1000) != ''
    assert shortfall(counted(MS, (0, False, 1000)).total, 0.0, 1000) == ''


def test_states_that_were_skipped_count_and_old_ones_are_forgotten() -> None:
    monitor = counted(MS, (0, True, 1000), (9, True, 50))
    assert monitor.total == (1000, 550)
    monitor = counted(MS, (19, False, 50), (0, True, 1000))
    assert monitor.total == (1000, 1000)


def test_one_stall_counts_as_a_tenth_of_a_second_at_most() -> None:
    once = counted(MS, (0, True, 1000), (5000, True, 1))
    assert once.total == (1000, 900)
    often = counted(MS, (0, True, 1000), (218, True, 10))
    assert often.total.in_time <= 10
    assert shortfall(often.total, 0.1, 1000) != '' == shortfall(once.total, 0.1, 1000)


def test_a_window_is_never_smaller_than_what_is_judged() -> None:
    monitor = AnsweredStates(MS)
    for k in range(5000):
        monitor.miss(37 * (k % 3 == 0))
        monitor.answer(k % 2 == 0)
        assert monitor.total.in_time <= monitor.total.states
        assert monitor.total.states < 1000 + 101
    assert monitor.complete


def slow(share: float) -> Robot:
    """Return a robot in real time of whose states a share was answered in time, for a second."""
    robot = Robot(simulated=False, law='compensation')
    robot.loop.least_answered = 0.5
    robot.reference(0, 1500)
    for k in range(1000):
        robot.state(k)
        late = k % 100 >= 100 * share
        robot.loop.note_answer(k * MS + 2 * MS * late)
    return robot


@pytest.mark.parametrize(('share', 'trips'), [(0.4, True), (0.5, False), (1.0, False)])
def test_too_few_states_in_time_end_the_torques(share: float, trips: bool) -> None:
    robot = slow(share)
    sent = robot.state(1000)
    assert (sent == [ZERO]) == trips
    assert (robot.status()[0] == 2) == trips
    if trips:
        assert robot.log.lines[-1].startswith(
            'the computer is too slow: only 400 of the last 1000 states were answered in time')
        assert robot.state(1001) == []


def test_states_that_nobody_could_answer_do_not_count() -> None:
    """Those skipped while there is no reference; then those while it runs, also if it stalls."""
    robot = Robot(simulated=False)
    robot.loop.least_answered = 0.5

    def take(k: int, unanswered: int) -> None:
        robot.loop.take_state(JointSample(k * MS, (0.1, 0.2), ZERO), k * MS, False, unanswered)
        if robot.loop.answer(True, k * MS):
            robot.loop.note_answer(k * MS)

    for k in range(10):
        take(k, 100 * k)
    assert robot.loop.answered == (0, 0)
    robot.reference(0, 2000)
    take(10, 903)
    assert robot.loop.answered == (1, 1)
    take(11, 910)
    assert robot.loop.answered == (9, 2)
    robot.silence(40)
    take(250, 1140)
    assert robot.loop.answered == (110, 3)
    for k in range(400, 1900, 150):  # Stalls in a row, and no state is answered in between.
        robot.loop.take_state(
            JointSample(k * MS, (0.1, 0.2), ZERO), k * MS, False, 1140 + k - 250)
        robot.loop.mode = Mode.NO_STATE
    take(1900, 2800)
    assert robot.status()[0] == 2 and 'the computer is too slow: ' in robot.loop.tripped


def test_in_simulated_time_nothing_is_counted_or_measured() -> None:
    robot = Robot(simulated=True)
    robot.loop.least_answered = 1.0
    robot.loop.rehearsal = Rehearsal(Controller(robot.config), MS, 20 * MS)
    robot.reference(0, 100)
    assert robot.loop.take_state(JointSample(0, (0.1, 0.2), ZERO), 0, True)
    assert not robot.loop.rehearse(0)
    robot.answer()
    robot.loop.note_answer(10 ** 9)
    assert len(robot.sent) == 1 and robot.loop.answered == (0, 0)


def rehearsed(late: bool, every: int = 1) -> Robot:
    """Return a robot whose loop was measured, each nth of its states taken."""
    robot = Robot(simulated=False, input_delay=2)
    robot.loop.least_answered = 0.1
    robot.loop.rehearsal = Rehearsal(Controller(robot.config), MS, 20 * MS)
    robot.reference(0, 2000)
    k = 0
    while robot.loop.rehearses:
        robot.loop.take_state(
            JointSample(k * MS, (0.1, 0.2), ZERO), k * MS, False, k - k // every)
        if robot.loop.rehearse(k * MS):
            robot.loop.note_answer(k * MS + 2 * MS * late)
            assert not robot.loop.rehearse(k * MS)
        robot.answer()
        k += every
    return robot


def test_the_loop_is_measured_for_a_second_before_the_first_torque() -> None:
    robot = rehearsed(late=False)
    [line] = [x for x in robot.log.lines if 'torque' in x]
    assert line == ('before the first torque 1000 states came in 1.00 s; 1000 were answered '
                    'within 1 ms, with 0 outages; this loop reaches 1000 Hz')
    assert robot.loop.last is not None and robot.loop.last.t == 999 * MS
    first = Controller(robot.config).step(
        (0.1, 0.2), ZERO, *MOTION[999], MOTION[1000:1002]).tau  # The law remembers nothing.
    assert robot.sent == [list(first)]


def test_a_robot_that_sends_fewer_states_is_told_apart_from_a_slow_computer() -> None:
    robot = Robot(simulated=False)
    robot.loop.least_answered = 0.1
    robot.loop.rehearsal = Rehearsal(Controller(robot.config), MS, 20 * MS)
    for t in range(0, 2005 * MS, 5 * MS):
        robot.loop.take_state(JointSample(t, (0.1, 0.2), ZERO), t, False)
        if robot.loop.rehearse(t):
            robot.loop.note_answer(t)
    assert not robot.loop.rehearses
    assert 'before the first torque 400 states came in 2.00 s; 400 were answered' in ' '.join(
        robot.log.lines)
    assert robot.log.lines[-1].endswith(
        'reaches 200 Hz of the 1000 Hz of control_period; states come less often; set '
        'control_period to the period of the robot')


def test_a_loop_that_keeps_too_little_is_told_so_and_gets_no_torque() -> None:
    robot = rehearsed(late=True, every=25)
    text = ' '.join(robot.log.lines)
    assert '0 were answered within 1 ms, with 39 outages; this loop reaches 40 Hz of the' in text
    assert 'control_period; give the controller a real-time priority' in text
    assert 'the computer is too slow: only 0 of the last 10' in text
    assert robot.sent == []
