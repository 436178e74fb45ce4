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

from processes import PATIENCE, probe
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

pytestmark = pytest.mark.ros


def seconds(message: JointState) -> float:
    return float(message.header.stamp.sec + message.header.stamp.nanosec * 1e-9)


@pytest.mark.parametrize(
    'pacing', ['lockstep', pytest.param('real_time', marks=pytest.mark.slow)])
def test_killed_nodes_started_again_heal_the_graph(pacing: str) -> None:
    arguments = {'controller': (), 'reference': (), 'plant': ('-p', f'pacing:={pacing}')}
    with probe() as it:
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

        it.until(moved, 'motion')
        for victim, more in arguments.items():
            children[victim].signal(signal.SIGKILL)
            children[victim].process.wait(PATIENCE)
            if victim == 'plant':
                it.until(drained, 'the end of the old plant')
            before = 0.0 if victim == 'plant' else seconds(states[-1]) + 0.5
            states.clear()
            children[victim] = it.start(victim, *more)
            it.until(lambda before=before: states and moved()  # type: ignore[misc]
                     and seconds(states[-1]) > before, f'recovery of {victim}')
            assert all(child.status is None for child in children.values())
        assert not any('Traceback' in line for line in it.lines)


def test_a_controller_that_missed_states_can_be_disabled_and_enabled() -> None:
    with probe() as it:
        states = it.listen(JointState, 'joint_states')
        commands = it.listen(Float64MultiArray, 'effort_controller/commands')
        plant = it.start('plant', '-p', 'pacing:=real_time')
        controller = it.start('controller')
        it.start('reference')
        it.until(lambda: states and any(states[-1].effort), 'motion')
        plant.signal(signal.SIGSTOP)
        it.until(lambda: commands and not any(commands[-1].data), 'the last torque, of 0')
        plant.signal(signal.SIGCONT)
        for wanted in (False, True, False, True):
            response = it.call(SetBool, 'controller/enable', SetBool.Request(data=wanted))
            assert response.success
        states.clear()
        it.until(lambda: states and any(states[-1].effort), 'motion')
        assert controller.status is None
