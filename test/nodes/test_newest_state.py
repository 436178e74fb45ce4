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

from bisect import bisect
from collections.abc import Mapping
import os
from pathlib import Path
import time

from faults import Diagnostics, ERROR
from processes import Probe, probe
import pytest
from ros_messages import COMMANDS, MS, ns, reference, state
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

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
STATES, TORQUES = 500, 10
#: In which a message that the kernel has dropped comes again, by `config/fastdds.xml`, with time
#: for a busy machine; those after it wait for it [ns].
RESENT = 300_000_000


class Robot:
    """Publishes states every millisecond, and keeps what is answered."""

    def __init__(self, it: Probe) -> None:
        self.probe = it
        self.states = it.node.create_publisher(JointState, 'joint_states', 1000)
        self.references = it.node.create_publisher(JointTrajectory, 'reference', 10)
        self.torques = it.listen(Float64MultiArray, COMMANDS)
        #: Number of the state that each torque answers, and when that was sent [ns].
        self.answered: list[tuple[int, int]] = []
        #: When each state had been published [ns].
        self.times: list[int] = []
        it.node.create_subscription(JointState, 'controller/tracking', self._on_tracking, 1000)
        self.published = self.sent = 0

    def _on_tracking(self, message: JointState, info: Mapping[str, int]) -> None:
        self.answered.append((ns(message.header.stamp) // MS, info['source_timestamp']))

    def publish(self) -> None:
        """Send the next state, every tenth twice."""
        self.published += 1
        message = state(self.published * MS, joint1=(0.1, 0.0), joint2=(0.2, 0.0))
        for _ in range(2 if self.published % 10 == 0 else 1):
            self.states.publish(message)
            self.sent += 1
        self.times.append(time.time_ns())


def test_a_slow_controller_answers_the_newest_state(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """
    Check by numbers of states that none waits in a queue, and that all of them are counted.

    What was published before torque n was sent has arrived when step n + 2 begins, a step later,
    unless it was dropped on the way and had to be sent again.
    """
    (tmp_path / 'slow_arm.py').write_text(MODEL)
    monkeypatch.setenv('PYTHONPATH', str(tmp_path), prepend=os.pathsep)
    with probe() as it:
        reports, robot = Diagnostics(it), Robot(it)
        it.start('controller', '-p', 'model:=slow_arm:Slow', '-p', 'state_decimation:=1', '-p',
                 'state_timeout:=3600.0', '-p', 'restart_duration:=0.0', '-p',
                 'predicted_periods:=0')
        it.until(lambda: robot.states.get_subscription_count()
                 and robot.references.get_subscription_count()
                 and it.node.count_publishers(COMMANDS), 'the controller')
        still = [[0.1, 0.2], [0.0, 0.0], [0.0, 0.0]]
        robot.references.publish(reference(['joint1', 'joint2'], [still, still]))

        def first() -> bool:  # The reference must have been heard.
            robot.publish()
            return bool(robot.answered)

        it.until(first, 'a torque')
        due = time.monotonic()
        while robot.published < STATES or len(robot.answered) < TORQUES:
            robot.publish()
            due = max(due + 1e-3, time.monotonic())
            it.executor.spin_once(timeout_sec=0.0)
            time.sleep(max(0.0, due - time.monotonic()))
        it.until(lambda: robot.answered[-1][0] == robot.published, 'the last torque')
        numbers = [number for number, _ in robot.answered]
        assert numbers == sorted(set(numbers))
        assert len(robot.torques) == len(numbers) >= TORQUES
        for (_, sent), (number, _) in zip(robot.answered, robot.answered[2:]):
            assert number >= bisect(robot.times, sent - RESENT)

        report = reports.until('controller', lambda r: r.count('samples') == len(numbers)
                               and r.level == ERROR, 'the counts')
        refused = report.refused('joint_states')
        assert set(refused) <= {'repeated'}
        skipped = report.count('joint_states: skipped for newer ones')
        assert len(numbers) + skipped + sum(refused.values()) == robot.sent
        assert skipped > robot.sent / 2
        assert 'of the states skipped for newer ones: the step takes ' in report.message
        assert ' ms (p50) at a period of 1 ms: too slow for the sample rate' in report.message
        assert 'busy' not in report.message
        assert float(report.values['computing time, p50 [ms]']) >= 1e3 * STEP
