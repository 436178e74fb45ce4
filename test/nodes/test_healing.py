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

"""A killed process is started again, and the others go on without being restarted."""

from __future__ import annotations

import signal

from faults import Diagnostics, WARN
from processes import PATIENCE, probe
import pytest
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

pytestmark = pytest.mark.ros


def seconds(message: JointState) -> float:
    return float(message.header.stamp.sec + message.header.stamp.nanosec * 1e-9)


def test_killed_nodes_started_again_heal_the_graph() -> None:
    """Without the controller simulated time stands still, and the plant says what it waits for."""
    arguments = {'controller': (), 'reference': (), 'plant': ('-p', 'pacing:=lockstep')}
    with probe() as it:
        diagnostics = Diagnostics(it)
        states = it.listen(JointState, 'joint_states')
        children = {name: it.start(name, *more) for name, more in arguments.items()}

        def moved() -> bool:
            """Return whether the last states were driven by torques, over 0.2 s."""
            driven = [m for m in states[-2000:] if any(m.effort)]
            return len(driven) > 200

        def drained() -> bool:
            """Return whether nothing of the old plant is left to come."""
            count = len(states)
            it.executor.spin_once(timeout_sec=0.2)
            return len(states) == count

        def said() -> list[float]:
            """Return when the plant said what it waits for [s]."""
            return [float(line.split('[')[3].split(']')[0]) for line in it.lines if
                    'waiting for the answer on effort_controller/commands to the state' in line]

        it.until(moved, 'motion')
        for victim, more in arguments.items():
            waited = len(said())
            children[victim].signal(signal.SIGKILL)
            children[victim].process.wait(PATIENCE)
            if victim == 'plant':
                it.until(drained, 'the end of the old plant')
            if victim == 'controller':
                it.until(lambda: len(said()) >= waited + 2, 'two reports')
                assert said()[-1] - said()[-2] > 2.5
                report = diagnostics.next('plant')
                assert report.level == WARN
                assert 'waiting for the answer on effort_controller/commands' in report.message
            before = 0.0 if victim == 'plant' else seconds(states[-1]) + 0.5
            states.clear()
            children[victim] = it.start(victim, *more)
            it.until(lambda before=before: states and moved()  # type: ignore[misc]
                     and seconds(states[-1]) > before, f'recovery of {victim}')
            assert all(child.status is None for child in children.values())
        assert diagnostics.until('plant', lambda r: 'running' in r.message, 'health')
        assert not any('Traceback' in line for line in it.lines)


def test_a_controller_that_missed_states_can_be_disabled_and_enabled() -> None:
    """
    Wait for what the controller reports again and again, not for its last torque, of 0.

    That is sent once: who had no processor for longer than a lease does not hear it.
    """
    with probe() as it:
        diagnostics = Diagnostics(it)
        states = it.listen(JointState, 'joint_states')
        plant = it.start('plant', '-p', 'pacing:=real_time')
        controller = it.start('controller')
        it.start('reference')
        it.until(lambda: states and any(states[-1].effort), 'motion')
        plant.signal(signal.SIGSTOP)
        diagnostics.until('controller', lambda r: r.message.startswith('no state for'), 'silence')
        plant.signal(signal.SIGCONT)
        for wanted in (False, True, False, True):
            response = it.call(SetBool, 'controller/enable', SetBool.Request(data=wanted))
            assert response.success
        states.clear()
        it.until(lambda: states and any(states[-1].effort), 'motion')
        assert controller.status is None
