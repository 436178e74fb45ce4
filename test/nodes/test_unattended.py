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

"""Nodes that are left alone: without a plant, stopped, or with their output blocked."""

from __future__ import annotations

import itertools
import signal
import time

from faults import Diagnostics, ERROR, Report
from processes import probe
import pytest
from ros_messages import MS, ns, reference, stamp, state
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

pytestmark = pytest.mark.ros
JOINTS, ZERO = ['joint1', 'joint2'], [0.0, 0.0]
CHUNK = 1000


def test_unused_references_are_discarded_and_a_time_without_a_clock_is_reported() -> None:
    """Send more than a minute to a controller that is disabled, without a state and with one."""
    with probe() as it:
        reports = Diagnostics(it)
        states = it.node.create_publisher(JointState, 'joint_states', 10)
        chunks = it.node.create_publisher(JointTrajectory, 'reference', 1000)
        it.start('controller', '-p', 'enabled:=false')
        it.start('reference', '-p', 'use_sim_time:=true', '-r', 'reference:=elsewhere')
        reports.until('reference', lambda r: 'but /clock has no publisher' in r.message,
                      'the warning')
        it.until(lambda: states.get_subscription_count() and chunks.get_subscription_count(),
                 'the controller')
        chunk = reference(JOINTS, [[[0.1, 0.2], [0.3, 0.4], ZERO]] * CHUNK)
        for k in range(1, 71):
            chunk.header.stamp = stamp(k * CHUNK * MS)
            chunks.publish(chunk)
        held = 'points of the reference'
        reports.until('controller', lambda r: r.count(held) == 60_000, 'a full memory')
        later = itertools.count(70_500)

        def ahead(report: Report) -> bool:
            # References may still be on their way: each state forgets what is past by then.
            states.publish(state(next(later) * MS, joint1=(0.0, 0.0), joint2=(0.0, 0.0)))
            return 0 < report.count(held) <= CHUNK

        reports.until('controller', ahead, 'what is ahead')


def test_a_state_of_another_time_does_not_begin_that_of_the_reference() -> None:
    """Nor its motion: of five states one has a stamp of 1970."""
    with probe() as it:
        states = it.node.create_publisher(JointState, 'joint_states', 10)
        chunks = it.listen(JointTrajectory, 'reference')
        it.start('reference')
        count = itertools.count()

        def begun() -> bool:
            t = time.time_ns() if next(count) % 5 else 10 ** 9
            states.publish(state(t, joint1=(0.0, 0.0), joint2=(0.0, 0.0)))
            return bool(chunks)
        it.until(begun, 'the motion')
        assert abs(chunks[0].header.stamp.sec - time.time()) < 60.0


@pytest.mark.slow
def test_a_node_that_was_stopped_for_longer_than_its_lease_is_heard_again() -> None:
    """Stop each until the others have given it up; the plant's stamps never go back."""
    with probe() as it:
        reports = Diagnostics(it)
        states = it.listen(JointState, 'joint_states', 10_000)
        period = ('-p', 'control_period:=0.004')
        children = {
            'plant': it.start('plant', *period, '-p', 'command_timeout:=0.1'),
            'controller': it.start('controller', *period, '-p', 'state_timeout:=0.25'),
            'reference': it.start('reference')}

        def well() -> None:
            for node in children:
                reports.until(node, lambda r: r.level < ERROR and r.message.startswith('running'),
                              'health')
            seen = len(states)
            it.until(lambda: any(any(m.effort) for m in states[seen:]), 'torques')

        well()
        answer = it.set('plant', 'use_sim_time', True)
        assert not answer.successful
        assert answer.reason.endswith('/clock has no publisher, and time would stand still')
        for node, child in children.items():
            child.signal(signal.SIGSTOP)
            try:
                it.until(lambda node=node: node not in it.node.get_node_names(),  # type: ignore
                         'the end of the lease')
            finally:
                child.signal(signal.SIGCONT)
            well()
        stamps = [ns(m.header.stamp) for m in states]
        assert len(stamps) > 500
        assert all(b > a for a, b in itertools.pairwise(stamps))
        assert [child.status for child in children.values()] == [None] * 3
