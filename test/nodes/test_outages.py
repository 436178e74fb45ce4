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

"""Outages before a controller that stands alone, and in lockstep, where time waits."""

from __future__ import annotations

import os
from pathlib import Path
import signal
import time

from bags import reports_of
from controller_process import after_an_outage
from ctc_chattering.analysis.result import simulate
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.numerics.linear_algebra import Vector
from faults import Diagnostics, ERROR, nodes_of
from processes import bringup, CONFIG, PATIENCE, Probe, probe, wait_for
import pytest
from recorded_runs import assert_equal
from ros_messages import COMMANDS, MS, reference, state
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

pytestmark = pytest.mark.ros
ZERO = [0.0, 0.0]


class PlayedPlant:
    """The test as the plant in real time, before a controller."""

    def __init__(self, it: Probe, timeout: float) -> None:
        self.probe = it
        self.diagnostics = Diagnostics(it)
        self.commands = it.listen(Float64MultiArray, COMMANDS)
        self.states = it.node.create_publisher(JointState, 'joint_states', 1000)
        self.references = it.node.create_publisher(JointTrajectory, 'reference', 1000)
        it.start('controller', '-p', f'state_timeout:={timeout}', '-p', 'restart_duration:=0.0',
                 '-p', 'predicted_periods:=0')
        it.until(lambda: self.states.get_subscription_count()
                 and self.references.get_subscription_count()
                 and it.node.count_publishers(COMMANDS), 'the controller')
        self.references.publish(reference(
            ['joint1', 'joint2'], [[[1.0, -0.5], ZERO, ZERO]]))

    def answer(self, t: int, q: Vector, dq: Vector) -> list[float]:
        before = len(self.commands)
        self.states.publish(state(t, joint1=(q[0], dq[0]), joint2=(q[1], dq[1])))
        self.probe.until(lambda: len(self.commands) > before, 'a torque')
        return list(self.commands[-1].data)


def test_every_outage_restarts_the_law_and_a_motion_at_rest_is_held() -> None:
    """The last point of the reference, long past, is at rest: nothing is missing."""
    point, law = ([1.0, -0.5], ZERO, ZERO), Controller(ControllerConfig())
    with probe() as it:
        plant = PlayedPlant(it, 1.0)
        for outage in range(2):
            law.reset(bumpless=outage > 0)
            begin = time.time_ns()
            for k in range(5):
                q, dq = [0.1 * k, 0.2 + outage], [0.3, -0.1 * k]
                expected = law.step(q, dq, *point)
                assert plant.answer(begin + k * MS, q, dq) == list(expected.tau)
                if outage and not k:
                    assert list(expected.tau) == after_an_outage(q, dq, point)
            sent = len(plant.commands)
            report = plant.diagnostics.until(
                'controller', lambda r: 'no state for' in r.message, 'the error')
            assert report.level == ERROR
            assert report.count('timeouts, state') == outage + 1
            assert report.count('timeouts, reference') == 0
            assert report.count('restarts') == outage
            it.until(lambda sent=sent: len(plant.commands) > sent, 'the last')  # type: ignore
            plant.diagnostics.next('controller')
            assert [list(m.data) for m in plant.commands[sent:]] == [ZERO]


@pytest.mark.slow
def test_in_lockstep_nothing_trips_and_nothing_changes(tmp_path: Path) -> None:
    """Hold each process still for half a second, as long as 25 timeouts."""
    bag, file = tmp_path / 'bag', CONFIG / 'friction.yaml'
    with bringup('--params-file', str(file), '--duration', '2', '--record', str(bag)) as process:
        wait_for(lambda: (bag / 'bag_0.mcap').exists()
                 and (bag / 'bag_0.mcap').stat().st_size > 20_000, 'a part of the bag')
        pids = nodes_of(process.pid)
        for victim in ('plant', 'controller'):
            os.kill(pids[victim], signal.SIGSTOP)
            time.sleep(0.5)
            os.kill(pids[victim], signal.SIGCONT)
        output, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, output
    assert_equal(read_bag(bag), simulate(parameter_file.load(file, {'plant': {'duration': 2.0}})))
    reports = reports_of(bag, 'controller')
    assert reports
    for report in reports:
        assert report['restarts'] == report['timeouts, state'] == '0'
        assert report['timeouts, reference'] == '0'
