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

"""Positions from state to state: turns of continuous joints, and jumps, with the loop around."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from math import cos, pi, sin
from math import tau as TURN
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.controller.positions import find_jump, JointSample, LIMITS, PositionTracker
from ctc_chattering.controller.state_machine import Input, Mode
from ctc_chattering.errors import RejectedMessage
from ctc_chattering.numerics.angles import within_turn
from ctc_chattering.simulation.closed_loop import run_closed_loop
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.reference import ReferenceConfig
from hypothesis import given
from hypothesis import strategies as st
from loop_robot import MOTION, MS, Robot, ZERO
import numpy as np
import pytest

JOINTS = ['joint1', 'joint2']
LAWS = ('compensation', 'pd_gravity', 'slotine_li', 'observer_feedback')
#: Speed of the first joint [rad/s], and samples of a run: it crosses the window's end thrice.
SPEED, COUNT = 12.0, 1500


def turning(k: int) -> Point:
    """Return the point of sample k: the first joint begins at 3 rad and turns on."""
    t, x = 1e-3 * k, 2e-3 * k
    slow = min(t, 0.5)
    return ((3.0 + SPEED * (slow * slow + t - slow), 0.3 * sin(x)),
            (SPEED * 2.0 * slow, 0.6 * cos(x)), (2.0 * SPEED * (t < 0.5), -1.2 * sin(x)))


class Driven(Robot):
    """A simulated robot before the loop, whose driver reports a window of angles."""

    def __init__(self, least: float | None, **config: Any) -> None:
        super().__init__(False, **config)
        self.least = least
        self.plant = Plant(PlantConfig(
            coulomb_friction=(2.0, 1.0), initial_position=(3.0, 0.0), initial_velocity=(0.0, 0.6)))
        self.loop.motion.restart_duration = 0.0

    def run(self, lost: Sequence[int] = ()) -> list[list[float]]:
        """Return the torques of a run; the states of some samples do not arrive."""
        self.loop.take_reference(
            [k * MS for k in range(COUNT)], [turning(k) for k in range(COUNT)])
        for k in range(COUNT - 1):
            q, dq = self.plant.measured
            if self.least is not None:
                q = [within_turn(x, self.least) for x in q]
            if k not in lost:
                self.loop.take_state(JointSample(k * MS, q, dq), k * MS, False)
                self.loop.answer(True, k * MS)
            self.plant.step(self.sent[-1])
        return self.sent


@cache
def counted(law: str) -> list[list[float]]:
    """Return the torques where positions count turns."""
    return Driven(None, law=law, ka=[30.0, 15.0]).run()


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('least', [-pi, 0.0])
def test_a_driver_s_window_makes_no_difference(law: str, least: float) -> None:
    robot = Driven(least, law=law, continuous_joints=JOINTS, ka=[30.0, 15.0])
    np.testing.assert_allclose(robot.run(), counted(law), rtol=1e-6, atol=1e-6)
    assert robot.plant.q[0] > pi + 2.0 * TURN
    assert abs(robot.plant.q[0] - turning(COUNT - 1)[0][0]) < 0.1
    assert robot.status() == (0, 'running')


def test_without_them_being_continuous_the_same_states_are_refused_by_name() -> None:
    """What was passed on to the drives at both limits before."""
    robot = Driven(-pi, law='compensation')
    with pytest.raises(RejectedMessage) as raised:
        robot.run()
    assert raised.value.kind == 'position_jump'
    assert str(raised.value).startswith('joint1 is at -3.1')
    assert str(raised.value).endswith(
        'That is a whole turn: if it turns endlessly, add it to continuous_joints.')
    np.testing.assert_allclose(robot.sent, counted('compensation')[:len(robot.sent)], atol=1e-6)


def test_lost_states_around_the_wrap_make_no_difference() -> None:
    """18 at a stretch, during which the joint turns by 0.2 rad."""
    turns = [turning(k)[0][0] // TURN for k in range(COUNT)]
    wraps = [k for k in range(COUNT - 1) if turns[k] != turns[k + 1]]
    lost = [k for wrap in wraps for k in range(wrap - 8, wrap + 10)]
    assert len(wraps) == 2
    runs = [Driven(least, law='compensation', continuous_joints=JOINTS).run(lost)
            for least in (None, 0.0)]
    np.testing.assert_allclose(runs[1], runs[0], rtol=1e-6, atol=1e-6)


@given(st.lists(st.floats(-500.0, 500.0), min_size=2, max_size=30),
       st.sampled_from([1e-4, 1e-3, 4e-3, 2e-2]), st.integers(1, 3),
       st.sampled_from(['exact', 'difference']), st.floats(-20.0, 20.0))
def test_no_motion_of_an_arm_is_a_jump(
        accelerations: list[float], h: float, every: int, velocity: str, dq: float) -> None:
    """Of up to 500 rad/s², where only each `every`-th state arrives, with noise of an encoder."""
    q, states = 0.0, list[JointSample]()
    noise = np.random.default_rng(0).normal(0.0, 5e-3, len(accelerations))
    for k, (a, more) in enumerate(zip(accelerations, noise)):
        if k % every == 0:
            t = round(k * h * 1e9)
            seen = dq if velocity == 'exact' or not states else (
                (q + more - states[-1].q[0]) / (1e-9 * (t - states[-1].t)))
            states.append(JointSample(t, (q + more,), (seen,)))
        q, dq = q + h * (dq + 0.5 * h * a), dq + h * a
    # A velocity by differences that begins says nothing of the first one.
    assert not any(map(find_jump, states[1:], states[2:]))


@pytest.mark.parametrize('differenced', [False, True])
def test_a_jump_is_found_whatever_the_driver_makes_the_velocity_of(differenced: bool) -> None:
    before = JointSample(0, (0.5, 1.0), (0.0, 2.0))
    jump = find_jump(before, JointSample(
        MS, (0.5, 1.2), (0.0, 200.0 if differenced else 2.0)))
    assert jump is not None
    assert jump == (1, 1.0, 2.0, 1.2, 1e-3)
    assert not jump.is_whole_turns
    assert find_jump(before, JointSample(MS, (0.59, 1.0), (0.0, 2.0))) is None


def test_one_jump_is_refused_and_changes_nothing() -> None:
    """The states after it are answered as if it had not come."""
    robots = [Robot(False), Robot(False)]
    for robot in robots:
        robot.reference(0, 100)
        for k in range(5):
            robot.state(k)
    with pytest.raises(RejectedMessage) as raised:
        robots[0].state(5, (0.1, 0.7))
    assert raised.value.kind == 'position_jump'
    assert str(raised.value) == (
        'joint2 is at 0.7 rad, but 1 ms before it was at 0.2 rad with 0 rad/s.')
    assert len(robots[0].sent) == 5
    assert [robots[0].state(k) for k in (6, 7)] == [robots[1].state(k) for k in (6, 7)]


@pytest.mark.parametrize('simulated', [False, True])
def test_a_position_that_stays_elsewhere_ends_the_torques(simulated: bool) -> None:
    """As of an encoder that was set anew; after a reset the motion begins from there."""
    robot = Robot(simulated)
    robot.reference(0, 2000)
    for k in range(5):
        robot.state(k)
    for k in range(5, 8):
        with pytest.raises(RejectedMessage):
            robot.state(k, (0.1, 0.7))
    assert robot.loop.mode is Mode.TRIPPED
    assert robot.sent[5:] == ([] if simulated else [ZERO])
    level, text = robot.status()
    assert level == 2
    assert text.startswith('tripped: joint2 is at 0.7 rad, but ')
    assert 'It stays there: was its encoder set anew' in text
    assert robot.state(8, (0.1, 0.7)) == []
    robot.loop.request(Input.RESET)
    assert robot.state(9, (0.1, 0.7))


def test_jumps_that_do_not_agree_end_no_torques() -> None:
    robot = Robot(False)
    robot.reference(0, 2000)
    for k in range(300):
        if k % 2 and k % 7:
            with pytest.raises(RejectedMessage):
                robot.state(k, (0.1 + k % 5 + 1.0, 0.2))
        else:
            assert robot.state(k)
    assert robot.loop.mode is Mode.RUNNING


def test_in_lockstep_a_jump_is_answered_by_the_torque_before_until_it_ends_the_run() -> None:
    """The plant repeats a state that is not answered; the next one still jumps."""
    robot = Robot(simulated=True)
    robot.reference(0, 100)
    first = robot.state(0)
    for k in range(1, 4):
        for _ in range(2):
            with pytest.raises(RejectedMessage):
                robot.state(k, (0.1, 0.9))
    assert robot.sent == 3 * first
    assert robot.loop.mode is Mode.TRIPPED


def running(samples: int = 2000) -> Robot:
    """Return a robot of continuous joints that has been driven for 10 ms."""
    robot = Robot(False, continuous_joints=JOINTS)
    robot.reference(0, samples)
    for k in range(10):
        robot.state(k)
    return robot


def assert_short(robot: Robot, k: int, away: Sequence[float], motion: Point) -> None:
    """Check that a state is answered as the same pose within half a turn of the motion."""
    robot.loop.take_state(JointSample(k * MS, away, ZERO), k * MS, False)
    answer = robot.loop.answer(True, k * MS)
    assert answer is not None
    assert np.exp(1j * np.array(answer.state.q)) == pytest.approx(np.exp(1j * np.array(away)))
    for q in (answer.state.q, answer.point[0]):
        assert np.abs(np.array(q) - motion[0]).max() <= pi + 1e-9
    assert robot.loop.mode in (Mode.RUNNING, Mode.RESTARTING)


def test_after_an_outage_the_way_back_is_the_short_one() -> None:
    robot = running()
    robot.silence(200)
    assert_short(robot, 300, (MOTION[300][0][0] + 0.2 + TURN, 0.2), MOTION[300])


def test_an_outage_on_the_way_back_counts_no_turn() -> None:
    """The reference is more than half a turn ahead by then, the way back is not."""
    robot = Robot(False, continuous_joints=JOINTS, law='compensation')
    robot.loop.take_reference([k * MS for k in range(2000)], [turning(k) for k in range(2000)])
    pose = 3.0, 0.0
    for k in (*range(10), *range(210, 600)):
        robot.silence(k)
        robot.state(k, pose)
    mode_on_the_way_back = robot.loop.mode
    assert mode_on_the_way_back is Mode.RESTARTING
    assert turning(600)[0][0] - pose[0] > pi
    robot.silence(630)
    assert robot.loop.health.restarts == 1
    assert not robot.loop.mode.sends_torque
    robot.loop.take_state(JointSample(640 * MS, pose, ZERO), 640 * MS, False)
    answer = robot.loop.answer(True, 640 * MS)
    assert answer is not None and answer.state.q == pose
    assert abs(answer.point[0][0] - pose[0]) < 0.5


def test_joints_that_are_turned_while_it_is_disabled_are_no_jump() -> None:
    """Four turns by hand; the next torque leads back by the short way."""
    robot = running()
    robot.loop.request(Input.DISABLE)
    for k in range(10, 300):
        robot.state(k, (0.1, 0.2 + (k - 9) * 8.0 * pi / 290))
    robot.loop.request(Input.ENABLE)
    assert_short(robot, 300, (0.1, 0.2 + 8.0 * pi), MOTION[300])


def test_time_that_begins_anew_begins_with_the_nearest_turn() -> None:
    robot = running()
    with pytest.raises(RejectedMessage) as raised:
        robot.state(-5000)
    assert raised.value.kind == 'backward'
    assert robot.state(-4999, (9.0, 9.0)) == []
    robot.loop.take_reference([(k - 5000) * MS for k in range(2000)], MOTION)
    assert_short(robot, -4998, (9.0, 9.0), MOTION[2])


def test_a_pause_without_a_reference_ends_with_the_nearest_turn() -> None:
    """In real time the states go on meanwhile, and the joint is turned by hand."""
    robot = Robot(False, continuous_joints=JOINTS)
    robot.loop.take_reference([0], [(MOTION[0][0], ZERO, ZERO)])
    for k in range(10):
        robot.state(k)
    for k in range(10, 300):
        robot.loop.take_state(
            JointSample(k * MS, (0.1, 0.2 + (k - 9) * 8.0 * pi / 290), ZERO), k * MS, False)
        robot.loop.answer(False, k * MS)
    assert_short(robot, 300, (0.1, 0.2 + 8.0 * pi), (MOTION[0]))


def test_a_reference_that_begins_in_another_turn_is_the_same_motion() -> None:
    """As of a reference that was started again, from a state of the driver's window."""
    robots = [Robot(False, continuous_joints=JOINTS) for _ in range(2)]
    for robot, turns in zip(robots, (0.0, TURN)):
        robot.reference(0, 100)
        for k in range(90):
            robot.state(k)
        robot.loop.take_reference([k * MS for k in range(95, 200)], [
            ((q[0] - turns, q[1] + 2.0 * turns), dq, ddq) for q, dq, ddq in MOTION[95:200]])
        for k in range(90, 190):
            robot.state(k)
    np.testing.assert_allclose(robots[1].sent, robots[0].sent, rtol=1e-9, atol=1e-9)


def test_the_margin_is_that_of_an_encoder() -> None:
    """What is told of the rule in docs/safety.md."""
    assert LIMITS.margin == 0.1
    tracker = PositionTracker()
    tracker.take(JointSample(0, (0.0,), (0.0,)))
    assert not tracker.agrees(JointSample(MS, (1.0,), (0.0,)))
    assert not tracker.agrees(JointSample(2 * MS, (2.0,), (0.0,)))
    assert not tracker.agrees(JointSample(3 * MS, (2.01,), (0.0,)))
    assert tracker.agrees(JointSample(4 * MS, (2.0,), (0.0,)))


def test_numbers_are_the_same_to_the_last_bit_where_nothing_turns() -> None:
    runs = []
    for continuous in ([''], JOINTS):
        robot = Robot(True, continuous_joints=continuous, law='slotine_li')
        robot.reference(0, 300)
        for k in range(200):
            robot.state(k, (3.0 + 1e-4 * k, 1.5 - 2e-4 * k))
        runs.append(robot.sent)
    assert runs[0] == runs[1]
    law = Controller(ControllerConfig(law='slotine_li'))
    assert runs[0] == [list(map(float, law.step(
        (3.0 + 1e-4 * k, 1.5 - 2e-4 * k), ZERO, *MOTION[k]).tau)) for k in range(200)]


def test_a_simulation_begins_with_the_same_turn_to_the_last_bit() -> None:
    """Of a robot that starts more than half a turn away from its reference."""
    joints: dict[str, Any] = {'continuous_joints': JOINTS, 'compiled': False}
    plant = PlantConfig(**joints, duration=0.1, initial_position=(9.0, -12.0))
    robot, body = Robot(True, **joints), Plant(plant)
    robot.reference(0, 200)
    for k in range(101):
        robot.loop.take_state(JointSample(k * MS, *body.measured), k * MS, True)
        robot.answer()
        body.step(robot.sent[-1])
    run = run_closed_loop(plant, robot.config, ReferenceConfig())
    assert run.tau.tolist() == robot.sent
    assert np.abs(run.e).max() <= pi
    assert run.q[0] == pytest.approx([9.0 - TURN, -12.0 + 2.0 * TURN])
    counted = run_closed_loop(plant.changed({'continuous_joints': ['']}), robot.config.changed(
        {'continuous_joints': ['']}), ReferenceConfig())
    assert np.abs(counted.e[0]).tolist() == pytest.approx([9.0 - pi, 12.0 + 0.5 * pi])
