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

"""A computer that is too slow: it is measured before the first torque, and ends the torques."""

from __future__ import annotations

import os
from pathlib import Path
import time

from controller_process import ControllerUnderTest
from faults import Diagnostics, ERROR, JOINTS
from processes import Probe, probe
import pytest
from ros_messages import reference, stamp, state
from std_srvs.srv import Trigger

pytestmark = pytest.mark.ros
PERIOD, STEP = 0.01, 0.05
WINDOW = round(1.0 / PERIOD)
ZERO = [0.0, 0.0]
MEASURED = 'before the first torque'
#: A robot whose equations take five periods while a file is there.
MODEL = f"""
import os
import time
from ctc_chattering.dynamics.two_link import TwoLink

class Slow(TwoLink):
    def __init__(self, joint_names, gravity):
        super().__init__(gravity)

    def evaluate(self, q, dq):
        time.sleep({STEP} * os.path.exists(os.environ['SLOW_FILE']))
        return super().evaluate(q, dq)
"""


class SlowedController(ControllerUnderTest):
    """A controller that is slow while a file is there, and a robot that sends a state a period."""

    def __init__(self, it: Probe) -> None:
        self.reports = Diagnostics(it)
        it.node.create_timer(PERIOD, self._send)
        super().__init__(it, *(x for value in (
            'model:=slow_arm:Slow', 'law:=compensation', f'control_period:={PERIOD}',
            'state_timeout:=3600.0', 'least_answered:=0.1') for x in ('-p', value)),
            simulated=False)
        it.until_said(MEASURED)

    def _send(self) -> None:
        if hasattr(self, 'states'):
            self.states.publish(state(time.time_ns(), **dict.fromkeys(JOINTS, (0.1, 0.0))))

    def refer(self) -> None:
        """Send a motion that stands somewhere else."""
        chunk = reference([*JOINTS], [[[0.2, 0.2], ZERO, ZERO]] * 2)
        chunk.header.stamp = stamp(time.time_ns())
        self.references.publish(chunk)

    def measured(self) -> list[str]:
        """Return the lines of the measurement before the first torque."""
        return [line for line in self.probe.lines if MEASURED in line]

    def until_tripped(self) -> str:
        words = 'tripped: the computer is too slow: only '
        report = self.reports.until('controller', lambda r: (
            r.level == ERROR and r.message.startswith(words)), words)
        return report.message.removeprefix(words)


@pytest.fixture
def slow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the file that makes the model slow; it is not there yet."""
    (tmp_path / 'slow_arm.py').write_text(MODEL)
    monkeypatch.setenv('PYTHONPATH', str(tmp_path), prepend=os.pathsep)
    monkeypatch.setenv('SLOW_FILE', str(tmp_path / 'slow'))
    return tmp_path / 'slow'


def test_a_computer_that_becomes_too_slow_ends_the_torques_until_a_reset(slow: Path) -> None:
    """After a measurement without torques, and a window of states that were answered in time."""
    with probe() as it:
        robot = SlowedController(it)
        assert len(robot.commands) == 0 and len(robot.measured()) == 1
        robot.refer()
        report = robot.reports.until('controller', lambda r: r.message.startswith('running') and (
            r.values['states answered in time'].endswith(f' of {WINDOW}')), 'a window')
        assert report.count('samples') > 0
        # They are sent before the report, but topics come in no order.
        it.until(lambda: robot.commands and any(robot.commands[-1].data), 'torques')

        slow.touch()
        text = robot.until_tripped()
        in_time, states = int(text.split()[0]), int(text.split()[4])
        assert states >= WINDOW and in_time < 0.1 * states
        assert text.endswith('; call ~/reset')
        it.until(lambda: list(robot.commands[-1].data) == ZERO, 'a torque of 0')
        sent = len(robot.commands)
        slow.unlink()
        robot.reports.next('controller')
        robot.reports.next('controller')
        assert len(robot.commands) == sent

        assert it.call(Trigger, '/controller/reset', Trigger.Request()).success
        robot.refer()
        it.until(lambda: any(any(x.data) for x in robot.commands[sent:]), 'torques')
        assert len(robot.measured()) == 1


def test_a_computer_that_is_too_slow_at_first_gets_no_torque(slow: Path) -> None:
    slow.touch()
    with probe() as it:
        robot = SlowedController(it)
        [line] = robot.measured()
        assert '[WARN]' in line and ' 0 were answered within 10 ms' in line
        kept = float(line.split('this loop reaches ')[1].split(' Hz of the 100 Hz of ')[0])
        assert 0.0 < kept <= 1.0 / STEP + 1.0
        robot.refer()
        assert robot.until_tripped().startswith('0 of ')
        assert len(robot.commands) == 0
