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

"""A person leads the arm of a real graph by hand: plant, controller and reference."""

from __future__ import annotations

from faults import Diagnostics
from processes import Probe, probe
import pytest
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

pytestmark = pytest.mark.ros
LOOP = ('-p', 'control_period:=0.01')


def start_arm(it: Probe) -> list[JointState]:
    """Start an arm with friction in real time at 100 Hz, and return its states."""
    states = it.listen(JointState, 'joint_states')
    friction = '-p', 'coulomb_friction:=[9.0, 9.0]', '-p', 'integration_step:=0.001'
    it.start('plant', *LOOP, '-p', 'pacing:=real_time', '-p', 'command_timeout:=0.5',
             '-p', 'initial_position:=[3.14, 1.57]', *friction)
    it.start('controller', *LOOP, '-p', 'law:=pd_gravity', '-p', 'least_answered:=0.0',
             '-p', 'state_timeout:=0.5', '-p', 'friction_level:=[9.0, 9.0]')
    it.start('reference', *LOOP, '-p', 'center:=[3.14, 1.57]', '-p', 'amplitude:=[0.0, 0.0]')
    return states


def test_a_hand_leads_the_arm_and_its_reference_follows_to_where_it_is_left() -> None:
    with probe() as it:
        reports, states = Diagnostics(it), start_arm(it)

        def until_mode(mode: str) -> None:
            reports.until('controller', lambda x: x.values.get('mode') == mode, mode)

        def guide(on: bool) -> str:
            response = it.call(SetBool, '/controller/guide', SetBool.Request(data=on))
            assert response.success, response.message
            return str(response.message)

        until_mode('RUNNING')
        assert guide(True) == 'The robot is guided by hand.'
        until_mode('GUIDED')
        assert it.set('plant', 'disturbance.push_duration', 60.0).successful
        assert it.set('plant', 'disturbance.push', [60.0, 0.0]).successful
        it.until(lambda: states[-1].position[0] > 3.6, 'the arm that is pushed')
        assert it.set('plant', 'disturbance.push', [0.0, 0.0]).successful
        it.until(lambda: max(map(abs, states[-1].velocity)) < 1e-3, 'the rest')
        left = list(states[-1].position)
        released = len(states)
        assert guide(False) == 'The robot is held until a reference rests there.'
        until_mode('RUNNING')
        it.until_said('the robot is held, and the reference rests at its position')
        it.until(lambda: len(states) > released + 300, 'states of three seconds')
        moved = [abs(x - y) for state in states[released:] for x, y in zip(state.position, left)]
        assert max(moved) < 0.02
