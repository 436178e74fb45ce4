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

"""The services of the reference: stop and hold, and home."""

from __future__ import annotations

from array import array
from collections.abc import Sequence

from builtin_interfaces.msg import Duration
from controller_process import ReferenceUnderTest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import numpy as np
from processes import CONFIG, Probe, probe
import pytest
from ros_messages import MS, stamp
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

pytestmark = pytest.mark.ros
S = 1000 * MS
PANDA = ('--params-file', str(CONFIG / 'panda.yaml'), '-p', 'start_duration:=0.0',
         '-p', 'control_period:=0.01')


def test_a_stop_holds_where_the_motion_comes_to_rest_and_home_leads_to_its_start() -> None:
    """Home asks for a stop first. Links are checked, and joints stay within 0.5 rad/s."""
    with probe() as it:
        node = ReferenceUnderTest(it, *PANDA)
        refused = it.call(Trigger, '/reference/stop', Trigger.Request())
        assert not refused.success and 'has not begun' in refused.message
        node.run_to(2 * S)
        home = list(node.points[0].positions)
        stop = it.call(Trigger, '/reference/stop', Trigger.Request())
        assert stop.success and 'It rests in 0.' in stop.message
        node.run_to(4 * S)
        held = node.points[max(node.points)]
        assert not any(held.velocities) and list(held.positions) != home
        going = it.call(Trigger, '/reference/home', Trigger.Request())
        assert going.success and 'The nearest approach' in going.message, going.message
        begin = node.now
        node.run_to(begin + 6 * S)
        times = sorted(t for t in node.points if t >= begin)
        dq = np.array([node.points[t].velocities for t in times])
        assert list(node.points[times[-1]].positions) == pytest.approx(home, abs=1e-12)
        assert not dq[-1].any()
        assert 0.02 < np.abs(dq).max() <= 0.5 * 1.001


def test_home_from_a_motion_stops_it_first() -> None:
    with probe() as it:
        node = ReferenceUnderTest(it, '-p', 'control_period:=0.01')
        node.run_to(2 * S)
        home = list(node.points[0].positions)
        response = it.call(Trigger, '/reference/home', Trigger.Request())
        assert response.success and response.message.endswith('Then it goes home.')
        node.run_to(9 * S)
        assert list(node.points[max(node.points)].positions) == pytest.approx(home, abs=1e-12)
        it.until_said('The motion goes home.', 'Links were not checked for collisions')


class Controller:
    """The controller as the reference sees it: its mode and its errors."""

    def __init__(self, it: Probe) -> None:
        self.probe = it
        self.modes = it.node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.errors = it.node.create_publisher(JointState, 'controller/tracking', 10)

    def report(self, mode: str, name: str = '/controller') -> None:
        self.probe.until(self.modes.get_subscription_count, 'the reader of the modes')
        self.modes.publish(DiagnosticArray(status=[DiagnosticStatus(
            name=name, message=mode, values=[KeyValue(key='mode', value=mode)])]))

    def track(self, t: int, q: Sequence[float]) -> None:
        """Report a robot that is led to rest at q."""
        names = [f'{name}/{x}' for x in ('desired', 'error') for name in ('joint1', 'joint2')]
        self.probe.until(self.errors.get_subscription_count, 'the reader of the errors')
        message = JointState(name=names, position=array('d', [*q, 0.0, 0.0]),
                             velocity=array('d', [0.0] * 4))
        message.header.stamp = stamp(t)
        self.errors.publish(message)


def positions(node: ReferenceUnderTest, begin: int) -> np.ndarray:
    """Return the published positions from an instant on."""
    return np.array([node.points[t].positions for t in sorted(node.points) if t >= begin])


def test_only_a_robot_that_is_held_elsewhere_moves_the_reference_there() -> None:
    """A report that it is held may be old: the robot then is where the motion leads it."""
    with probe() as it:
        node = ReferenceUnderTest(it, '-p', 'control_period:=0.01', '-p', 'amplitude:=[0.0, 0.0]')
        controller = Controller(it)
        node.run_to(2 * S)
        start = list(node.points[S].positions)
        controller.report('HELD', '/other/controller')
        controller.report('HELD')
        controller.track(S, [float('nan')] * 2)
        controller.track(S, [1.0, 2.0])
        it.until_said('the robot is held, and the reference rests at its position')
        for service in 'home', 'stop':
            response = it.call(Trigger, f'/reference/{service}', Trigger.Request())
            assert response.success is (service == 'stop'), response.message
        controller.report('RUNNING')
        node.run_to(4 * S)
        going = it.call(Trigger, '/reference/home', Trigger.Request())
        assert going.success, going.message
        controller.report('HELD')
        controller.track(4 * S, [1.0, 2.0])
        begin = node.now
        node.run_to(begin + 12 * S)
        q = positions(node, begin)
        assert np.abs(np.diff(q, axis=0)).max() < 0.006
        assert list(q[-1]) == pytest.approx(start)


def test_waypoints_that_come_before_home_are_not_followed_by_it() -> None:
    with probe() as it:
        node = ReferenceUnderTest(it, '-p', 'control_period:=0.01')
        sent = it.node.create_publisher(JointTrajectory, 'reference/joint_trajectory', 10)
        it.until(sent.get_subscription_count, 'the reference')
        node.run_to(2 * S)
        it.call(Trigger, '/reference/home', Trigger.Request())
        sent.publish(JointTrajectory(joint_names=['joint1', 'joint2'], points=[
            JointTrajectoryPoint(positions=array('d', [3.0, 1.5]),
                                 time_from_start=Duration(sec=1))]))
        it.until_said('joint_trajectory is accepted: 1 waypoints')
        node.run_to(9 * S)
        assert list(node.points[max(node.points)].positions) == [3.0, 1.5]


def test_a_stop_at_no_speed_leaves_nothing_for_a_later_speed() -> None:
    with probe() as it:
        node = ReferenceUnderTest(it, '-p', 'control_period:=0.01')
        node.run_to(2 * S)
        assert it.set('reference', 'speed_scaling', 0.0).successful
        node.run_to(4 * S)
        stop = it.call(Trigger, '/reference/stop', Trigger.Request())
        assert stop.success and 'It rests in 0 s' in stop.message, stop.message
        assert it.set('reference', 'speed_scaling', 1.0).successful
        begin = node.now
        node.run_to(begin + 2 * S)
        assert np.ptp(positions(node, begin), axis=0).max() == 0.0
