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

"""The life and death of the processes that bringup starts."""

from __future__ import annotations

import itertools
import os
from pathlib import Path
import signal
import subprocess
import time

from ctc_chattering.launch.requests import graph_monitor
from ctc_chattering.simulation.closed_loop import Event
from processes import alive, bringup, CONFIG, descendants, PATIENCE, probe, run_bringup, wait_for
import pytest
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future
from recorded_runs import reports_of

pytestmark = pytest.mark.ros
ENDLESS = ('--params-file', str(CONFIG / 'friction.yaml'), '--duration', '0')
NODES = ('plant', 'controller', 'reference', 'recorder')


def running(process: subprocess.Popen[str], bag: Path) -> dict[str, int]:
    """Wait until all nodes run and the recorder has samples; return their processes by name."""
    def found() -> dict[str, int]:
        return {node: pid for pid, line in descendants(process.pid).items()
                for node in NODES if f'ctc_chattering.cli.node {node} ' in line}
    wait_for(lambda: len(found()) == len(NODES), 'the nodes')
    # Some samples: the recorder has been heard by all, and hears all.
    wait_for(lambda: sum(x.stat().st_size for x in bag.glob('*.mcap')) > 50_000, 'samples')
    return found()


@pytest.mark.parametrize('numbers', [
    (signal.SIGINT, signal.SIGTERM),
    pytest.param((signal.SIGHUP, signal.SIGQUIT), marks=pytest.mark.slow)])
def test_a_signal_stops_all_of_them_cleanly(
        tmp_path: Path, numbers: tuple[signal.Signals, ...]) -> None:
    """The first one does; a second one that is not handled would kill it."""
    bag = tmp_path / 'bag'
    with bringup(*ENDLESS, '--record', str(bag)) as process:
        pids = running(process, bag)
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


@pytest.mark.parametrize('victim', ['plant', pytest.param('recorder', marks=pytest.mark.slow)])
def test_the_death_of_any_is_reported_and_ends_all(tmp_path: Path, victim: str) -> None:
    bag = tmp_path / 'bag'
    with bringup(*ENDLESS, '--record', str(bag)) as process:
        pids = running(process, bag)
        os.kill(pids[victim], signal.SIGKILL)
        output, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    assert f'bringup: {victim} ended with signal SIGKILL; its last output:' in output
    assert 'Traceback' not in output
    assert alive(list(pids.values())) == []
    if victim != 'recorder':
        assert reports_of(bag, 'bringup')[-1]['ended'].startswith(
            f'{victim} ended with signal SIGKILL')


def test_no_process_outlives_a_killed_bringup(tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    with bringup(*ENDLESS, '--record', str(bag)) as process:
        pids = running(process, bag)
        process.kill()
        process.wait(PATIENCE)
        wait_for(lambda: not alive(list(pids.values())), 'the end of the nodes')
    assert (bag / 'metadata.yaml').exists()


@pytest.mark.slow
def test_real_time_takes_its_time(tmp_path: Path) -> None:
    begin = time.monotonic()
    with bringup('--params-file', str(CONFIG / 'friction.yaml'), '--pacing', 'real_time',
                 '--duration', '1.0', '--record', str(tmp_path / 'bag')) as process:
        assert process.stdout is not None
        said = 'the experiment has ended at t = 1 s after 1001 samples'
        output = list(itertools.takewhile(lambda line: said not in line, process.stdout))
        ended = time.monotonic()
        last = list(process.stdout)
        output += last
        assert process.wait(PATIENCE) == 0, output
        assert [line for line in last if '[ERROR]' in line] == []
    assert ended - begin > 1.0


def test_a_trip_ends_lockstep_with_its_reason() -> None:
    """Nobody could call ~/reset for a run that waits in simulated time."""
    status, output = run_bringup('friction', '--ros-args', '-p', 'error_limit:=[0.5, 9.0]')
    assert status == 1
    _, end = output.split('bringup: controller ended with status 1')
    assert 'exceeded error_limit; no torque until ~/reset' in end
    assert 'waiting for the answer' not in output


def test_an_event_is_asked_for_again_where_no_answer_comes() -> None:
    """The middleware drops an answer to a client that the server has not met yet."""
    asked: list[tuple[str, object]] = []

    async def answer(request: SetParameters.Request, response: SetParameters.Response
                     ) -> SetParameters.Response:
        asked.extend((x.name, parameter_value_to_python(x.value)) for x in request.parameters)
        if len(asked) == 1:
            await Future()  # For ever.
        response.results = [SetParametersResult(successful=True) for _ in request.parameters]
        return response

    with probe() as it:
        it.node.create_service(SetParameters, '/controller/set_parameters', answer,
                               callback_group=ReentrantCallbackGroup())
        events = [Event(0.0, 'controller', {'lambda': x}) for x in (7.0, 8.0)]
        with graph_monitor(events, lockstep=False, ros_args=()) as (look, _):
            def carried_out() -> bool:
                look()
                return len(asked) == 3
            it.until(carried_out, 'the events')
    assert asked == [('lambda', 7.0), ('lambda', 7.0), ('lambda', 8.0)]
