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

"""The life and death of the processes that bringup starts, and the launch file."""

from __future__ import annotations

import os
from pathlib import Path
import signal
import time

from faults import endless, running
from processes import alive, bringup, PATIENCE, RANGE, run_bringup, wait_for
import pytest
from recorded_runs import reports_of

pytestmark = pytest.mark.ros
NODES = ('plant', 'controller', 'reference', 'recorder')


def environment(pid: int) -> dict[str, str]:
    """Return the environment that a process was started with."""
    text = Path(f'/proc/{pid}/environ').read_text()
    return dict(item.split('=', 1) for item in text.split('\0') if '=' in item)


@pytest.mark.parametrize(('numbers', 'discovery'), [
    ((signal.SIGINT, signal.SIGTERM), ''),
    pytest.param((signal.SIGHUP, signal.SIGQUIT), 'SUBNET', marks=pytest.mark.slow)])
def test_a_graph_is_confined_to_this_host_and_a_signal_stops_it_cleanly(
        tmp_path: Path, numbers: tuple[signal.Signals, ...], discovery: str) -> None:
    """
    By its environment, unless that says otherwise.

    The first signal ends all; a second one that is not handled would kill bringup.
    """
    bag = tmp_path / 'bag'
    with bringup(*endless(bag), discovery=discovery) as process:
        pids = running(process, bag)
        assert {name: environment(pid)[RANGE] for name, pid in pids.items()} == (
            dict.fromkeys(NODES, discovery or 'LOCALHOST'))
        for number in numbers:
            process.send_signal(number)
            time.sleep(0.05)  # Two at once are one.
        output, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, output
    assert 'Traceback' not in output
    assert alive(list(pids.values())) == []
    assert (bag / 'metadata.yaml').exists()
    assert reports_of(bag, 'plant')[-1]['ended'] == 'SIGINT'
    assert reports_of(bag, 'bringup')[-1]['ended'] == f'stopped by {numbers[0].name}'


@pytest.mark.slow
@pytest.mark.parametrize('victim', ['plant', 'recorder'])
def test_the_death_of_any_is_reported_and_ends_all(tmp_path: Path, victim: str) -> None:
    bag = tmp_path / 'bag'
    with bringup(*endless(bag)) as process:
        pids = running(process, bag)
        os.kill(pids[victim], signal.SIGKILL)
        output, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    assert f'bringup: {victim} ended with signal SIGKILL. Its last output is:' in output
    assert 'Traceback' not in output
    assert alive(list(pids.values())) == []
    if victim != 'recorder':
        assert reports_of(bag, 'bringup')[-1]['ended'].startswith(
            f'{victim} ended with signal SIGKILL')


def test_no_process_outlives_a_killed_bringup(tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    with bringup(*endless(bag)) as process:
        pids = running(process, bag)
        process.kill()
        process.wait(PATIENCE)
        wait_for(lambda: not alive(list(pids.values())), 'the end of the nodes')
    assert (bag / 'metadata.yaml').exists()


def test_a_trip_ends_lockstep_with_its_reason() -> None:
    """Nobody could call ~/reset for a run that waits in simulated time."""
    status, output = run_bringup('friction', '--ros-args', '-p', 'error_limit:=[0.5, 9.0]')
    assert status == 1
    _, end = output.split('bringup: controller ended with status 1')
    assert 'exceeded error_limit; no torque until ~/reset' in end
    assert 'waiting for the answer' not in output
