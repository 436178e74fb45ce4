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

"""The control loop without ROS: what is sent for what comes, in both kinds of time."""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.controller.positions import JointSample
from ctc_chattering.controller.state_machine import Input, Mode
from ctc_chattering.errors import RejectedMessage
from loop_robot import MOTION, MS, Robot, ZERO
import pytest


def law(*qs: Sequence[float], first: int = 0, bumpless: bool = False) -> list[list[float]]:
    """Return the torques of a law that begins at sample `first`, a state at each sample."""
    it = Controller(ControllerConfig())
    it.reset(bumpless=bumpless)
    return [[float(x) for x in it.step(q, ZERO, *MOTION[first + i]).tau]
            for i, q in enumerate(qs)]


@pytest.mark.parametrize('simulated', [False, True])
def test_states_are_answered_by_the_law(simulated: bool) -> None:
    robot = Robot(simulated)
    robot.reference(0, 100)
    qs = [(0.1 + 0.01 * k, 0.2) for k in range(50)]
    assert [robot.state(k, q)[0] for k, q in enumerate(qs)] == law(*qs)
    assert robot.status() == (0, 'running')


@pytest.mark.parametrize('missing', ['reference', 'readers'])
@pytest.mark.parametrize('simulated', [False, True])
def test_a_state_waits_for_what_is_missing(simulated: bool, missing: str) -> None:
    robot = Robot(simulated)
    assert robot.status() == (1, 'waiting for joint_states')
    if missing == 'readers':
        robot.reference(0, 100)
    assert robot.state(0, matched=False) == []
    assert robot.status() == (1, 'waiting for reference')
    robot.reference(0, 100)
    robot.answer()
    assert robot.sent == law((0.1, 0.2))
    robot.answer()
    assert len(robot.sent) == 1


def test_simulated_time_waits_where_the_reference_ends_and_goes_on_as_if_it_had_not() -> None:
    robot = Robot(simulated=True)
    robot.reference(0, 3)
    for k in range(3):
        robot.state(k)
    assert robot.state(3) == []
    assert robot.status() == (1, 'waiting for reference')
    assert robot.silence(5000) == []  # However long it takes.
    robot.reference(3, 10)
    robot.answer()
    robot.state(4)
    assert robot.sent == law(*[(0.1, 0.2)] * 5)


def test_a_state_that_is_repeated_is_answered_as_before_in_simulated_time() -> None:
    robot = Robot(simulated=True)
    robot.reference(0, 10)
    first = robot.state(0)
    with pytest.raises(RejectedMessage) as raised:
        robot.state(0, (5.0, 5.0))
    assert raised.value.kind == 'repeated'
    assert robot.sent == 2 * first
    assert robot.state(1) == law((0.1, 0.2), (0.1, 0.2))[1:]


def test_silence_ends_the_torques_and_the_next_state_restarts_the_law() -> None:
    robot = Robot(simulated=False)
    robot.reference(0, 2000)
    for k in range(100):
        robot.state(k)
    assert robot.silence(118) == []
    assert robot.silence(120) == [ZERO]
    assert robot.silence(300) == []
    robot.k = 300
    assert robot.status() == (2, 'no state for 0.2 s')
    assert robot.loop.watchdog.outages == 1
    assert robot.state(301)
    assert robot.loop.mode is Mode.RESTARTING
    assert robot.loop.health.restarts == 1
    assert 'states again, after 0.202 s; meanwhile no torque' in robot.log.lines[-1]
    at_once = Robot(simulated=False)
    at_once.loop.motion.restart_duration = 0.0
    at_once.reference(0, 2000)
    at_once.state(0)
    at_once.silence(30)
    assert at_once.state(31) == law((0.1, 0.2), first=31, bumpless=True)


def test_the_first_torque_is_that_of_the_state_however_late_it_is_answered() -> None:
    """Predict no further periods: it is not known what moved the robot before."""
    robot = Robot(simulated=False)
    robot.loop.motion.restart_duration, robot.loop.lost_states.predicted_periods = 0.0, 8
    robot.reference(0, 2000)
    robot.state(0)
    assert robot.state(1) == law((0.1, 0.2), (0.1, 0.2))[1:]
    robot.silence(30)
    robot.loop.take_state(JointSample(31 * MS, (0.1, 0.2), ZERO), 31 * MS, False)
    robot.loop.answer(True, 36 * MS)
    assert robot.sent[-1:] == law((0.1, 0.2), first=31, bumpless=True)
    robot.loop.take_state(JointSample(37 * MS, (0.1, 0.2), ZERO), 37 * MS, False)
    robot.loop.answer(True, 40 * MS)  # That of a sample three periods later.
    assert robot.sent[-1:] != law(*[(0.1, 0.2)] * 7, first=31, bumpless=True)[-1:]


@pytest.mark.parametrize(('k', 'torques'), [(12, 1), (4000, 0)])
def test_nothing_is_sent_after_an_outage_of_the_controller_itself(k: int, torques: int) -> None:
    """Neither for a state that is predicted, nor for one that had to wait."""
    waiting = Robot(simulated=False)
    assert waiting.state(0) == []
    waiting.reference(0, 5000)
    waiting.loop.answer(True, k * MS)
    assert len(waiting.sent) == torques
    robot = Robot(simulated=False)
    robot.loop.lost_states.predicted_periods = 8
    robot.reference(0, 5000)
    for sample in range(10):
        robot.state(sample)
    assert robot.loop.due() is not None
    robot.loop.predict(k * MS)
    assert len(robot.sent) == 10 + torques


def test_a_step_that_always_takes_more_than_a_period_makes_no_periods_good() -> None:
    """A processor that is taken away for some answers is no reason not to."""
    robot = Robot(simulated=False)
    robot.loop.lost_states.predicted_periods = 8
    robot.reference(0, 100)
    robot.state(0)
    robot.loop.computing_times.extend([3 * MS, MS // 10, 3 * MS])
    assert robot.loop.due() is not None
    robot.loop.computing_times.remove(MS // 10)
    assert robot.loop.due() is None


@pytest.mark.parametrize('begun', [False, True])
def test_gaps_of_the_start_are_no_faults(begun: bool) -> None:
    """Let states jump and pause, before the reference is heard, and after a torque."""
    robot = Robot(False)
    if begun:
        robot.reference(0, 1000)
    robot.state(0)
    assert bool(robot.sent) == begun
    with pytest.raises(RejectedMessage) as jump:
        robot.loop.take_state(JointSample(100 * MS, ZERO, ZERO), 1 * MS, False)
    assert bool(str(jump.value)) == begun
    robot.silence(1100)
    robot.state(1101)
    assert any('states again, after 1.101 s' in line for line in robot.log.lines) == begun
    assert robot.loop.health.restarts == int(begun)


def test_a_reference_that_is_late_is_held_and_followed_again() -> None:
    robot = Robot(simulated=False)
    robot.reference(0, 50)
    for k in range(300):
        assert robot.state(k)
        held = robot.loop.mode is Mode.HOLDING
        assert held == (k > 149)  # The last point is that of 49 ms; 0.1 s are granted.
    assert robot.status() == (2, 'no reference for 0.1 s; holding the position')
    assert robot.loop.reference_outages == 1
    robot.reference(290, 400)
    assert robot.state(300)
    assert robot.loop.mode is Mode.RUNNING


def test_a_position_error_trips_until_reset() -> None:
    robot = Robot(simulated=False, error_limit=[4.0, 1.4])
    robot.reference(0, 100)
    assert robot.state(0)
    assert robot.state(1, (0.1, 0.11)) == [ZERO]
    assert robot.status() == (
        2, 'tripped: the position error of joint2, 1.464 rad, exceeded error_limit; call ~/reset')
    assert robot.state(2) == []
    robot.loop.request(Input.DISABLE)
    robot.loop.request(Input.ENABLE)
    assert robot.state(3) == []
    assert robot.loop.request(Input.RESET)
    assert not robot.loop.request(Input.RESET)
    assert robot.log.lines[-3:] == [
        f'{word} by a service' for word in ('disable', 'enable', 'reset')]
    assert robot.state(4) == law((0.1, 0.2), first=4, bumpless=True)


@pytest.mark.parametrize('simulated', [False, True])
def test_disabled_it_sends_nothing(simulated: bool) -> None:
    """In real time a last torque of zero; in simulated time the robot waits for an answer."""
    robot = Robot(simulated)
    robot.reference(0, 100)
    robot.state(0)
    robot.loop.request(Input.DISABLE)
    assert robot.sent[1:] == ([] if simulated else [ZERO])
    before = len(robot.sent)
    assert robot.state(1) == []
    assert robot.status() == (1, 'disabled; call ~/enable')
    robot.loop.request(Input.ENABLE)
    robot.answer()
    assert robot.sent[before:] == law((0.1, 0.2), first=1, bumpless=True)


def test_time_that_goes_back_begins_a_new_run() -> None:
    robot = Robot(simulated=True)
    robot.reference(500, 600)
    for k in range(500, 510):
        robot.state(k)
    with pytest.raises(RejectedMessage) as raised:
        robot.state(0)
    assert raised.value.kind == 'backward'
    assert not robot.restarted
    assert robot.state(1) == []  # Two in a row are believed; there is no reference yet.
    assert robot.restarted
    robot.reference(0, 100)
    robot.answer()
    assert robot.sent[-1:] == law((0.1, 0.2), first=1)


def test_without_a_finite_torque_nothing_is_sent_and_the_loop_goes_on() -> None:
    robot = Robot(simulated=False)
    robot.reference(0, 100)
    with pytest.raises(RejectedMessage) as raised:
        robot.state(0, (1e308, -1e308))
    assert raised.value.kind == 'overflow'
    assert not robot.sent
    assert robot.state(1)


def test_a_way_back_that_is_not_finite_is_none() -> None:
    robot = Robot(simulated=False)
    robot.reference(0, 1000)
    robot.state(0)
    robot.silence(500)
    robot.loop.take_state(JointSample(500 * MS, (1.7e308, 0.0), (1.7e308, 0.0)), 500 * MS, False)
    with pytest.raises(RejectedMessage) as raised:
        robot.answer()
    assert raised.value.kind == 'overflow'
    assert robot.state(501)
    assert robot.loop.mode is Mode.RESTARTING


def test_references_without_states_do_not_fill_the_memory() -> None:
    robot = Robot(simulated=False)
    for k in range(100):
        robot.loop.take_reference([(1000 * k + i) * MS for i in range(1000)], MOTION[:1000])
    assert len(robot.loop.motion) == 60_000
    for k in range(10):
        robot.state(99_500 + k)
    robot.loop.take_reference([(100_000 + i) * MS for i in range(500)], MOTION[:500])
    assert len(robot.loop.motion) <= 1000
