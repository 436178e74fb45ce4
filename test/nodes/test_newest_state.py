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

"""A controller that is slower than its robot answers the newest state, and says why it is slow."""

from __future__ import annotations

import os
from pathlib import Path
import time

from controller_process import ControllerUnderTest
from faults import Diagnostics, ERROR
from processes import probe
import pytest
from ros_messages import MS, ns, reference, state
from sensor_msgs.msg import JointState

pytestmark = pytest.mark.ros
#: Time that the model's terms take on a processor [s]: twenty control periods.
STEP = 0.02
MODEL = f"""
import time
from ctc_chattering.dynamics.two_link import TwoLink

class Slow(TwoLink):
    def __init__(self, joint_names, gravity):
        super().__init__(gravity)

    def evaluate(self, q, dq):
        end = time.thread_time() + {STEP}
        while time.thread_time() < end:
            pass
        return super().evaluate(q, dq)
"""
#: States that are sent, and torques that answer them, at least.
STATES, TORQUES = 300, 8
#: States that wait, at most: of more than a queue holds, 1000, some would be dropped uncounted.
WAITING = 500


def test_a_slow_controller_answers_the_newest_state(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """States come each millisecond, every tenth twice; that none waits in a queue is counted."""
    (tmp_path / 'slow_arm.py').write_text(MODEL)
    monkeypatch.setenv('PYTHONPATH', str(tmp_path), prepend=os.pathsep)
    with probe() as it:
        reports = Diagnostics(it)
        tracking = it.listen(JointState, 'controller/tracking')
        controller = ControllerUnderTest(
            it, '-p', 'model:=slow_arm:Slow', '-p', 'state_decimation:=1', '-p',
            'state_timeout:=3600.0', '-p', 'restart_duration:=0.0', '-p', 'predicted_periods:=0',
            simulated=False)
        still = [[0.1, 0.2], [0.0, 0.0], [0.0, 0.0]]
        controller.references.publish(reference(['joint1', 'joint2'], [still, still]))
        # A state that waits for it is neither answered nor skipped.
        reports.until('controller', lambda r: r.count('points of the reference') == 2, 'it')
        k = sent = 0
        error = ''
        while k < STATES or len(tracking) < TORQUES or not error:
            if k - (ns(tracking[-1].header.stamp) // MS if tracking else 0) > WAITING:
                it.executor.spin_once(timeout_sec=0.01)  # It may stand still on a busy machine.
                continue
            k += 1
            for _ in range(2 if k % 10 == 0 else 1):
                controller.states.publish(state(k * MS, joint1=(0.1, 0.0), joint2=(0.2, 0.0)))
                sent += 1
            it.executor.spin_once(timeout_sec=0.0)
            time.sleep(1e-3)
            if reports.latest['controller'].level == ERROR:
                error = reports.latest['controller'].message
        it.until(lambda: ns(tracking[-1].header.stamp) == k * MS, 'the last torque')
        answered = [ns(m.header.stamp) // MS for m in tracking]
        assert answered == sorted(set(answered))
        skipped = 'joint_states: skipped for newer ones'
        report = reports.until('controller', lambda r: len(answered) + r.count(skipped) + sum(
            r.refused('joint_states').values()) == sent, 'that all are counted')
        assert report.count('samples') == len(controller.commands) == len(answered)
        assert set(report.refused('joint_states')) <= {'repeated'}
        assert report.count(skipped) > sent / 2
        assert 'of the states were skipped for newer ones: half of the steps take ' in error
        assert ' ms at a period of 1 ms, which is too slow for the sample rate' in error
        assert 'busy' not in error
        assert float(report.values['computing time, p50 [ms]']) >= 1e3 * STEP
