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

"""The reference on a real graph: its time, sinusoids, and waypoints as messages."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
import itertools
import math
import time

from builtin_interfaces.msg import Duration
from controller_process import ReferenceUnderTest
from ctc_chattering.trajectory.reference import ReferenceConfig, Sinusoid
from faults import Diagnostics, ERROR, OK, WARN
import numpy as np
from processes import probe
import pytest
from ros_messages import MS, ns, stamp, state
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

pytestmark = pytest.mark.ros
S = 1000 * MS
TOPIC = '~/joint_trajectory'


def waypoints(*points: tuple[float, Sequence[float]], begin: int = 0) -> JointTrajectory:
    """Return waypoints at rest, by time from the start [s] and positions."""
    message = JointTrajectory(joint_names=['joint1', 'joint2'], points=[
        JointTrajectoryPoint(
            positions=array('d', q), velocities=array('d', [0.0, 0.0]),
            time_from_start=Duration(sec=int(t // 1), nanosec=round(t % 1 * S)))
        for t, q in points])
    message.header.stamp = stamp(begin)
    return message


def test_waypoints_of_a_clock_that_is_behind_move_nothing() -> None:
    """
    In real time: all past, by an hour, refused with their age, shown until some are accepted.

    Before, they were gone through at once: at 6.6 rad/s, where they ask for 0.35.
    """
    with probe() as it:
        reports, chunks = Diagnostics(it), it.listen(JointTrajectory, 'reference')
        states = it.node.create_publisher(JointState, 'joint_states', 10)
        sent = it.node.create_publisher(JointTrajectory, 'reference/joint_trajectory', 10)
        it.start('reference', '-p', 'amplitude:=[0.0, 0.0]', '-p', 'start_duration:=0.1')

        def running() -> bool:
            states.publish(state(time.time_ns(), joint1=(3.14159, 0.0), joint2=(1.5708, 0.0)))
            return bool(chunks)

        it.until(running, 'the motion')
        it.until(sent.get_subscription_count, 'the reference')
        begin = time.time_ns() - 3600 * S
        past = waypoints((5.0, (4.9, 1.5)), (10.0, (4.9, 3.2)), begin=begin)
        sent.publish(past)
        report = reports.until('reference', lambda r: r.refused(TOPIC), 'the refusal')
        assert report.refused(TOPIC) == {'waypoints': 1}
        report = reports.next('reference')
        assert report.level == WARN
        assert 'motion continues, because joint_trajectory was refused: all waypoints are ' in (
            report.message)
        it.until_said('all waypoints are past: the last one was due 3')

        moved = len(chunks)
        sent.publish(waypoints((1.0, (4.0, 1.5708)), (2.0, (4.1, 1.5708))))
        it.until_said('joint_trajectory is accepted: 2 waypoints, 0 of them past; '
                      'the robot is at rest in 2.')
        assert reports.until('reference', lambda r: r.level == OK, 'that all is well')
        it.until(lambda: chunks[-1].points[-1].positions[0] == 4.1, 'the last waypoint')
        rows = [p for m in chunks[:moved] for p in m.points]
        assert max(abs(x) for p in rows for x in p.velocities) < 1e-3


def test_without_points_the_motion_stops_and_goes_on_with_the_next_ones() -> None:
    """In the middle of a sinusoid: on its path, without a jump, to a place that it holds."""
    with probe() as it:
        reports = Diagnostics(it)
        sent = it.node.create_publisher(JointTrajectory, 'reference/joint_trajectory', 10)
        node = ReferenceUnderTest(it, '-p', 'control_period:=0.01')
        it.until(sent.get_subscription_count, 'the reference')
        sent.publish(JointTrajectory())
        reports.until('reference', lambda r: r.refused(TOPIC) == {'early': 1}, 'the refusal')
        node.run_to(2 * S)
        begun = dict(node.points)
        sent.publish(JointTrajectory())
        it.until_said('joint_trajectory is accepted: it has no waypoints, so the motion stops; ')
        node.run_to(5 * S)
        points = dict(sorted(node.points.items()))
        changed = min(t for t, p in points.items() if t in begun and p != begun[t])
        assert node.now - 3 * S < changed < node.now - 3 * S + 200 * MS
        q, dq, ddq = (np.array([getattr(p, x) for t, p in points.items() if t >= changed - S])
                      for x in ('positions', 'velocities', 'accelerations'))
        assert np.abs(np.diff(q, axis=0) / 0.01 - 0.5 * (dq[1:] + dq[:-1])).max() < 0.02
        assert np.abs(dq).max() <= np.pi + 1e-9 and np.abs(ddq).max() < 2.0 * np.pi ** 2 + 10.0
        rests = points[changed + S]
        assert list(rests.velocities) == list(rests.accelerations) == [0.0, 0.0]
        assert points[max(points)].positions == rests.positions
        assert all(abs(x - c) <= 0.5 for x, c in zip(rests.positions, (np.pi, 0.5 * np.pi)))

        sent.publish(waypoints((1.0, (3.0, 1.0)), (2.0, (3.2, 1.1))))
        node.run_to(8 * S)
        assert list(node.points[max(node.points)].positions) == [3.2, 1.1]
        report = reports.until('reference', lambda r: r.level == OK, 'that all is well')
        assert report.message == 'running'


def test_what_is_late_negative_or_out_of_order_is_told_apart() -> None:
    """Points that are past are left out, and the others met in time."""
    with probe() as it:
        reports = Diagnostics(it)
        sent = it.node.create_publisher(JointTrajectory, 'reference/joint_trajectory', 10)
        node = ReferenceUnderTest(
            it, '-p', 'control_period:=0.01', '-p', 'amplitude:=[0.0, 0.0]')
        it.until(sent.get_subscription_count, 'the reference')
        node.run_to(10 * S)
        negative = waypoints((1.0, (3.0, 1.0)))
        negative.points[0].time_from_start.sec = -1
        for count, (wrong, why) in enumerate((
                (negative, 'points[0].time_from_start: -1.0 is not allowed; allowed: 0 s or more'),
                (waypoints((1.0, (3.0, 1.0)), (1.0, (3.0, 1.0))), 'points[1].time_from_start'),
                (waypoints((1.0, (3.0, 1.0)), begin=8 * S), 'all waypoints are past: the last one '
                 'was due 1.000 s ago')), 1):
            sent.publish(wrong)
            report = reports.until('reference', lambda r, count=count:  # type: ignore[misc]
                                   r.refused(TOPIC).get('waypoints') == count
                                   and r.level == WARN, 'the refusal')
            assert why in report.message
        sent.publish(waypoints((1.0, (9.0, 9.0)), (3.5, (3.3, 1.2)), (4.5, (3.0, 1.4)),
                               begin=8 * S))
        it.until_said('accepted: 3 waypoints, 1 of them past; the robot is at rest in 2.5 s')
        node.run_to(13 * S)
        at = node.points
        assert list(at[11_500 * MS].positions) == pytest.approx([3.3, 1.2])
        assert list(at[12_500 * MS].positions) == [3.0, 1.4]
        assert ns(node.chunks[-1].header.stamp) >= 12_500 * MS
        fastest = max(abs(x) for t, p in at.items() if t >= 10 * S for x in p.velocities)
        assert fastest < 1.0


def route(*points: tuple[float, Sequence[float], Sequence[float]]) -> JointTrajectory:
    """Return waypoints as MoveIt sends them: time [s], positions, and velocities, if any."""
    return JointTrajectory(joint_names=['joint2', 'joint1'], points=[
        JointTrajectoryPoint(
            positions=array('d', q[::-1]), velocities=array('d', dq[::-1]),
            time_from_start=Duration(sec=int(t), nanosec=round(t % 1 * S)))
        for t, q, dq in points])


def test_the_reference_is_ahead_of_the_clock_and_goes_on_without_a_jump() -> None:
    """
    A sinusoid, another one that is set parameter by parameter, then waypoints.

    The motion goes through every waypoint and rests at the last one; what is refused is counted,
    and moves nothing.
    """
    h = 10 * MS
    first = ReferenceConfig(phase=(0.3, 0.4), control_period=1e-2)
    other = first.changed({
        'amplitude': (0.2, 0.9), 'center': (1.0, -1.0), 'frequency': (0.4, 1.7)})
    with probe() as it:
        reports = Diagnostics(it)
        waypoints = it.node.create_publisher(JointTrajectory, 'reference/joint_trajectory', 10)
        node = ReferenceUnderTest(it, '-p', 'phase:=[0.3, 0.4]', '-p', 'control_period:=0.01')
        it.until(waypoints.get_subscription_count, 'the reference')
        node.run_to(S)
        for t, point in node.points.items():
            assert [[*x] for x in (point.positions, point.velocities, point.accelerations)] == [
                [*x] for x in Sinusoid(first).at(t)]
        for name in ('amplitude', 'center', 'frequency'):
            assert it.set('reference', name, list(getattr(other, name))).successful
        assert not it.set('reference', 'frequency', [-1.0, 1.0]).successful
        node.run_to(6 * S)
        times = sorted(node.points)
        assert times == list(range(0, times[-1] + 1, h))
        last = node.points[times[-1]]
        assert list(last.positions) == list(Sinusoid(other).at(times[-1])[0])

        begun, a, b = node.now, (0.7, -0.9), (0.5, -0.5)
        waypoints.publish(route((3.0, a, (0.1, 0.2)), (4.0, b, (0.0, 0.0))))
        for wrong in (JointTrajectory(joint_names=['joint1', 'elbow']), route((-1.0, a, ())),
                      route((0.2, (1.0, math.nan), ())), route((0.2, (1.0, 1.0), (1.0,)))):
            waypoints.publish(wrong)
        refused = '~/joint_trajectory'
        report = reports.until(
            'reference', lambda r: sum(r.refused(refused).values()) == 4, 'the refusals')
        assert report.refused(refused) == {'waypoints': 4}

        def rests() -> bool:
            node.run_to(node.now + 200 * MS)
            return tuple(node.points[max(node.points)].positions) == b
        it.until(rests, 'the end of the waypoints')
        points = [p for t, p in sorted(node.points.items()) if t >= begun]
        desired = np.array([p.positions for p in points])
        assert np.abs(np.diff(desired, axis=0)).max() < 0.1  # Pure tests have what is between.
        end = int(np.flatnonzero((desired != b).any(axis=1))[-1]) + 1
        assert desired[end - 100] == pytest.approx(a, abs=1e-6)


def test_the_reference_follows_the_time_of_the_states_where_there_is_no_clock() -> None:
    """
    As of a simulator that publishes none: it begins where the robot is.

    States with stamps of other times do not begin it.
    """
    with probe() as it:
        reports, chunks = Diagnostics(it), it.listen(JointTrajectory, 'reference')
        states = it.node.create_publisher(JointState, 'joint_states', 10)
        it.start('reference', '-p', 'start_duration:=2.0')
        count, begin = itertools.count(), time.monotonic_ns()

        def sent(t: int) -> bool:
            states.publish(state(t, joint1=(0.4, 0.0), joint2=(-0.3, 0.0)))
            return True
        it.until(states.get_subscription_count, 'the reference')
        it.until(lambda: sent(next(count) * 10 ** 6 * S)
                 and time.monotonic_ns() - begin > 2 * S, 'states of other times')
        assert chunks == []
        it.until(lambda: sent(5 * S + time.monotonic_ns() - begin) and chunks, 'the motion')
        assert 5 * S < ns(chunks[0].header.stamp) < 5 * S + time.monotonic_ns() - begin
        assert list(chunks[0].points[0].positions) == pytest.approx([0.4, -0.3], abs=0.02)
        report = reports.next('reference')
        assert report.level != ERROR  # A busy computer is a warning.
        assert report.values['time'] == 'real'
