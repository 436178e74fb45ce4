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

"""Guided by hand, held where it is left, and stopped before a joint limit."""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.control.controller import Controller
from ctc_chattering.controller.desired_motion import DesiredMotion
from ctc_chattering.controller.positions import JointSample
from ctc_chattering.controller.state_machine import Input
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.errors import CtcError, RejectedMessage
from ctc_chattering.trajectory.buffer import Point
from loop_robot import MOTION, MS, Robot, ZERO
import numpy as np
import pytest

LEFT = (0.5, 0.7)


def mode(robot: Robot) -> str:
    """Return the name of the present mode."""
    return robot.loop.mode.name


def rest(robot: Robot, first: int, last: int, q: Sequence[float]) -> None:
    """Send a reference that rests."""
    point: Point = (tuple(q), tuple(ZERO), tuple(ZERO))
    robot.loop.take_reference([k * MS for k in range(first, last)], [point] * (last - first))


def left_by_hand(simulated: bool) -> Robot:
    """Return a robot that is guided at `LEFT` while its reference goes on."""
    robot = Robot(simulated)
    robot.reference(0, 2000)
    robot.state(0, LEFT)
    assert robot.loop.guide(True) == 'The robot is guided by hand.'
    gravity = robot.loop.law.model.gravity_torque(LEFT)  # type: ignore[union-attr]
    for k in range(1, 20):
        assert robot.state(k, LEFT) == [pytest.approx(gravity)]
    assert robot.status() == (0, 'guided by hand')
    return robot


@pytest.mark.parametrize('simulated', [False, True])
def test_a_guided_robot_is_held_where_it_is_left_until_a_reference_rests_there(
        simulated: bool) -> None:
    robot = left_by_hand(simulated)
    gravity = robot.loop.law.model.gravity_torque(LEFT)  # type: ignore[union-attr]
    assert robot.loop.guide(False) == 'The robot is held until a reference rests there.'
    for k in range(20, 700):
        assert robot.state(k, LEFT) == [pytest.approx(gravity)]
    assert robot.status() == (1, 'holding the position until a reference rests there: it was '
                              'guided by hand')
    rest(robot, 700, 1000, (0.5, 0.71))
    robot.state(700, LEFT)
    assert mode(robot) == 'HELD'
    rest(robot, 701, 1000, (0.5, 0.7005))
    assert robot.state(701, LEFT) != [pytest.approx(gravity)]
    assert mode(robot) == 'RUNNING'


@pytest.mark.parametrize('event', [Input.DISABLE, Input.TRIP])
def test_a_robot_that_was_guided_is_held_after_a_trip_or_a_pause(event: Input) -> None:
    """It never goes back to its reference by itself."""
    robot = left_by_hand(simulated=False)
    if event is Input.TRIP:
        robot.loop._trip('a test')
        assert robot.state(20, LEFT) == []
        robot.loop.request(Input.RESET)
    else:
        robot.loop.request(event)
        assert robot.state(20, LEFT) == []
        robot.loop.request(Input.ENABLE)
    for k in range(200, 400):
        robot.state(k, (0.6, 0.7))
    assert mode(robot) == 'HELD'
    gravity = robot.loop.law.model.gravity_torque((0.6, 0.7))  # type: ignore[union-attr]
    assert robot.sent[-1] == pytest.approx(gravity)


def test_a_robot_that_moves_when_left_rests_within_the_margin_of_its_limits() -> None:
    motion = DesiredMotion(0, MS, 0)
    motion.hold()
    path = [motion.desired(k * MS, LEFT, (1.0, -0.5), wait=False) for k in range(400)]
    q, dq, _ = np.array([points[0] for points in path if points]).transpose(1, 0, 2)
    assert dq[0].tolist() == [1.0, -0.5] and not dq[-1].any()
    assert np.abs(q[-1] - LEFT).max() <= 0.1 + 1e-9


def test_lost_states_end_the_torque_and_the_robot_is_guided_again() -> None:
    robot = left_by_hand(simulated=False)
    assert robot.silence(60) == [ZERO]
    assert mode(robot) == 'NO_STATE'
    robot.state(70, LEFT)
    assert mode(robot) == 'GUIDED'


def test_only_a_controller_that_may_send_torques_is_guided() -> None:
    robot = Robot(simulated=True, enabled=False)
    with pytest.raises(CtcError, match='cannot be guided while the controller is disabled'):
        robot.loop.guide(True)
    assert robot.loop.guide(False) == 'The robot was not guided.'


@pytest.mark.parametrize('lead', [100, 700])
def test_a_reference_beyond_a_limit_is_stopped_before_it_and_held(lead: int) -> None:
    """The upper limit of joint 1 is reached after `lead` samples."""
    first = 100
    limit = MOTION[first + lead][0][0] if lead < 200 else max(q[0] for q, _, _ in MOTION) - 0.01
    beyond = next(k for k in range(first, 2000) if MOTION[k][0][0] > limit + 1e-3)
    robot = Robot(simulated=True)
    model = TwoLink(9.81)  # One of its own: the others are shared.
    model.position_limits = ((-limit, limit), (-9.0, 9.0))
    robot.loop.law = Controller(robot.config, model)
    robot.reference(0, first)
    for k in range(first - 20):
        robot.state(k, MOTION[k][0])
    with pytest.raises(RejectedMessage, match=r'joint1: .* is beyond its limits') as raised:
        robot.reference(first, beyond + 5)
    assert raised.value.kind == 'limit'
    desired = []
    for k in range(first - 20, 2000):
        robot.state(k, MOTION[min(k, beyond - 1)][0])
        points = robot.loop.motion.desired(k * MS, LEFT, ZERO, wait=True)
        assert points is not None
        desired.append(points[0])
    q, dq, _ = np.array(desired).transpose(1, 0, 2)
    assert q[:, 0].max() < limit
    assert not dq[-1].any()
    assert np.abs(np.diff(q, axis=0)[:, 0]).max() < 1e-3 * 1.05 * np.pi
    assert mode(robot) == 'HELD'
    assert 'beyond its limits' in robot.status()[1]
    with pytest.raises(RejectedMessage):
        robot.reference(beyond, beyond + 100)
    rest(robot, 2000, 2100, q[-1])
    robot.state(2000, q[-1])
    assert mode(robot) == 'RUNNING'


def test_a_held_joint_that_turns_endlessly_takes_over_a_reference_at_its_own_turn() -> None:
    """The reference has gone on by most of a turn before it rests where the robot is."""
    robot = Robot(True, continuous_joints=['joint1'])
    turning = [((0.5 + 4e-3 * k, 0.7), (4.0, 0.0), (0.0, 0.0)) for k in range(1500)]
    robot.loop.take_reference([k * MS for k in range(1500)], turning)
    robot.state(0, LEFT)
    robot.loop.guide(True)
    robot.state(1, LEFT)
    robot.loop.guide(False)
    for k in range(2, 1300):
        robot.state(k, LEFT)
    rest(robot, 1300, 1400, LEFT)
    robot.state(1301, LEFT)
    assert mode(robot) == 'RUNNING'
    gravity = robot.loop.law.model.gravity_torque(LEFT)  # type: ignore[union-attr]
    assert robot.sent[-1] == pytest.approx(gravity)


def test_a_joint_that_turns_endlessly_has_no_limits() -> None:
    robot = Robot(True, continuous_joints=['joint1'])
    model = TwoLink(9.81)
    model.position_limits = ((-1.0, 1.0), (-9.0, 9.0))
    robot.loop.law = Controller(robot.config, model)
    rest(robot, 0, 100, (7.0, 0.7))
    assert len(robot.loop.motion) == 100


def test_a_state_without_a_finite_torque_for_a_hand_is_refused() -> None:
    robot = left_by_hand(simulated=True)
    before = len(robot.sent)
    robot.loop.take_state(JointSample(20 * MS, LEFT, [1e308, 0.0]), 20 * MS, True)
    with pytest.raises(RejectedMessage, match='no finite torque'):
        robot.answer()
    assert len(robot.sent) == before


def test_a_reference_that_jumps_beyond_a_limit_is_stopped_smoothly() -> None:
    """It moves at 1 rad/s, far from the limit, and only a sample more of it is known."""
    robot = Robot(simulated=True)
    model = TwoLink(9.81)
    model.position_limits = ((-3.0, 3.0), (-9.0, 9.0))
    robot.loop.law = Controller(robot.config, model)
    moving = [((1e-3 * k, 0.7), (1.0, 0.0), (0.0, 0.0)) for k in range(102)]
    robot.loop.take_reference([k * MS for k in range(102)], moving)
    for k in range(100):
        robot.state(k, moving[k][0])
    with pytest.raises(RejectedMessage):
        robot.loop.take_reference([102 * MS], [((50.0, 0.7), (0.0, 0.0), (0.0, 0.0))])
    dq = []
    for k in range(100, 600):
        points = robot.loop.motion.desired(k * MS, LEFT, ZERO, wait=True)
        assert points is not None
        dq.append(points[0][1][0])
    assert dq[0] == pytest.approx(1.0, abs=0.01) and not dq[-1]
    assert np.abs(np.diff(dq)).max() < 0.01


def test_limits_that_are_set_while_a_robot_is_guided_hold_at_once() -> None:
    robot = left_by_hand(simulated=True)
    law = robot.loop.law
    assert law is not None
    law.configure(law.config.changed({'effort_limit': [1.0, 1.0]}))
    assert np.abs(robot.state(20, LEFT)).max() <= 1.0
