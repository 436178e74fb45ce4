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

"""A killed or stopped process comes back, and the others go on without being restarted."""

from __future__ import annotations

import itertools
import signal

from faults import Diagnostics, ERROR, WARN
from processes import PATIENCE, probe
import pytest
from ros_messages import COMMANDS, ns
from sensor_msgs.msg import JointState

pytestmark = pytest.mark.ros


@pytest.mark.parametrize('victims', [
    ['controller'], pytest.param(['reference', 'plant'], marks=pytest.mark.slow)])
def test_killed_nodes_started_again_heal_the_graph(victims: list[str]) -> None:
    """Without the controller simulated time stands still, and the plant says what it waits for."""
    arguments = {'controller': (), 'reference': (), 'plant': ('-p', 'pacing:=lockstep')}
    with probe() as it:
        diagnostics = Diagnostics(it)
        states = it.listen(JointState, 'joint_states')
        children = {name: it.start(name, *more) for name, more in arguments.items()}

        def moved() -> bool:
            """Return whether the last states were driven by torques, over 0.2 s."""
            return len([m for m in states[-2000:] if any(m.effort)]) > 200

        it.until(moved, 'motion')
        for victim in victims:
            children[victim].signal(signal.SIGKILL)
            children[victim].process.wait(PATIENCE)
            if victim == 'controller':
                report = diagnostics.until(
                    'plant', lambda r: f'waiting for the answer on {COMMANDS}' in r.message,
                    'what it waits for')
                assert report.level == WARN
            diagnostics.next('controller' if victim == 'plant' else 'plant')
            before = 0 if victim == 'plant' else ns(states[-1].header.stamp) + 500_000_000
            states.clear()
            children[victim] = it.start(victim, *arguments[victim])
            it.until(lambda before=before: states and moved()  # type: ignore[misc]
                     and ns(states[-1].header.stamp) > before, f'recovery of {victim}')
            assert all(child.status is None for child in children.values())
        assert diagnostics.until('plant', lambda r: 'running' in r.message, 'health')
        assert not any('Traceback' in line for line in it.lines)


@pytest.mark.slow
def test_in_real_time_who_was_away_for_longer_than_a_lease_is_heard_again() -> None:
    """
    Stop each node until the others have given it up; the plant's stamps never go back.

    A second controller, which is killed, is a publisher until its lease has run out: meanwhile no
    torque is obeyed.
    """
    period, little = ('-p', 'control_period:=0.004'), 1e-3
    with probe() as it:
        reports = Diagnostics(it)
        states = it.listen(JointState, 'joint_states', 10_000)
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
        for node, child in children.items():
            child.signal(signal.SIGSTOP)
            try:
                it.until(lambda node=node: node not in it.node.get_node_names(),  # type: ignore
                         'the end of the lease')
            finally:
                child.signal(signal.SIGCONT)
            well()
        second = it.start('controller', '-r', '__node:=second', '-p',
                          f'effort_limit:=[{little}, {little}]')
        both = f'{COMMANDS} has several publishers, none is obeyed: /controller, /second'
        reports.until('plant', lambda r: 'torque 0, brakes on' in r.message
                      and r.message.endswith(both), 'both')
        second.signal(signal.SIGKILL)
        second.process.wait(PATIENCE)
        reports.until('plant', lambda r: r.message.endswith(both), 'the dead')
        well()
        assert not any(0.0 < max(map(abs, m.effort)) <= little for m in states)
        stamps = [ns(m.header.stamp) for m in states]
        assert len(stamps) > 500
        assert all(b > a for a, b in itertools.pairwise(stamps))
        assert [child.status for child in children.values()] == [None] * 3
