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

import ast
import importlib
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from ctc_chattering.cli.bringup import make_parser
from ctc_chattering.cli.options import load_setup
from ctc_chattering.errors import CtcError
from ctc_chattering.launch.graph import node_values
from ctc_chattering.launch.requests import graph_monitor
from ctc_chattering.simulation.closed_loop import Event
from domains import own_domain
from faults import nodes_of
from processes import alive, bringup, CONFIG, PATIENCE, probe, RANGE, run_bringup, wait_for
import pytest
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future
from recorded_runs import reports_of

pytestmark = pytest.mark.ros
ENDLESS = ('--params-file', str(CONFIG / 'friction.yaml'), '--duration', '0')
NODES = ('plant', 'controller', 'reference', 'recorder')


def running(process: subprocess.Popen[str], bag: Path) -> dict[str, int]:
    """Wait until all nodes run and the recorder has samples; return their processes by name."""
    wait_for(lambda: len(nodes_of(process.pid)) == len(NODES), 'the nodes')
    # Some samples: the recorder has been heard by all, and hears all.
    wait_for(lambda: sum(x.stat().st_size for x in bag.glob('*.mcap')) > 50_000, 'samples')
    return nodes_of(process.pid)


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
    with bringup(*ENDLESS, '--record', str(bag), discovery=discovery) as process:
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


def started(*arguments: str) -> subprocess.Popen[str]:
    """Start another bringup in the domain of this process."""
    return subprocess.Popen(
        [sys.executable, '-m', 'ctc_chattering.cli.bringup', *arguments], text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT)


SHORT = 'friction', '--pacing', 'lockstep', '--duration', '0.1'


def test_a_second_bringup_is_refused_by_the_name_of_the_first_which_goes_on(tmp_path: Path
                                                                            ) -> None:
    """In another namespace it runs; and in this one once the first was killed."""
    bag = tmp_path / 'bag'
    with bringup(*ENDLESS, '--record', str(bag)) as process:
        pids = running(process, bag)
        size = sum(x.stat().st_size for x in bag.glob('*.mcap'))
        output, _ = (second := started(*SHORT)).communicate(timeout=PATIENCE)
        assert second.returncode == 1
        where = f'ROS_DOMAIN_ID {os.environ["ROS_DOMAIN_ID"]} and namespace /'
        assert f'bringup: another bringup runs in {where}: process {process.pid}, ' in output
        assert f'ctc_chattering.cli.bringup {" ".join(ENDLESS)}' in output
        assert '__ns:=/NAME' in output
        assert '[plant]' not in output
        output, _ = (other := started(*SHORT, '--ros-args', '-r', '__ns:=/other')).communicate(
            timeout=PATIENCE)
        assert other.returncode == 0, output
        wait_for(lambda: sum(x.stat().st_size for x in bag.glob('*.mcap')) > size + 50_000,
                 'more samples')
        assert nodes_of(process.pid) == pids
        process.kill()
        output, _ = (third := started(*SHORT)).communicate(timeout=PATIENCE)
        assert third.returncode == 0, output


def test_of_two_bringups_that_start_at_once_one_runs() -> None:
    with own_domain():
        both = [started(*SHORT) for _ in range(2)]
        outputs = [process.communicate(timeout=PATIENCE)[0] for process in both]
    assert sorted(process.returncode for process in both) == [0, 1], outputs


def test_nodes_that_no_bringup_has_started_are_named() -> None:
    with probe() as it:
        others = [rclpy.create_node(name, context=it.context, namespace=namespace)
                  for name, namespace in (('plant', '/'), ('reference', '/other'))]
        output, _ = (process := started(*SHORT)).communicate(timeout=PATIENCE)
        assert process.returncode == 1
        assert 'and namespace /: /plant; stop that one first' in output
        for node in others:
            node.destroy_node()
        output, _ = (process := started(*SHORT)).communicate(timeout=PATIENCE)
        assert process.returncode == 0, output


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
        with graph_monitor(events, lockstep=False, ros_args=()) as monitor:
            def carried_out() -> bool:
                monitor.look()
                return len(asked) == 3
            it.until(carried_out, 'the events')
    assert asked == [('lambda', 7.0), ('lambda', 7.0), ('lambda', 8.0)]


FILE = Path(__file__).resolve().parents[2] / 'launch' / 'bringup.launch.py'


def test_it_compiles_and_uses_what_there_is() -> None:
    """Check its syntax, what it imports, and that its arguments are options of bringup."""
    tree = ast.parse(FILE.read_text(encoding='utf-8'))
    compile(tree, FILE, 'exec')
    for line in (x for x in tree.body if isinstance(x, ast.ImportFrom)):
        assert line.module is not None
        if line.module.partition('.')[0] not in ('launch', 'launch_ros'):
            module = importlib.import_module(line.module)
            assert all(hasattr(module, x.name) for x in line.names)
    (arguments,) = (ast.literal_eval(x.value) for x in tree.body if isinstance(x, ast.Assign)
                    and ast.unparse(x.targets[0]) == 'ARGUMENTS')
    options = vars(make_parser().parse_args([]))
    assert set(options) - set(arguments) == {'live'}
    assert set(arguments) <= set(options)


def test_its_nodes_wait_for_one_another_and_not_for_bringup(tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    setup = load_setup(make_parser().parse_args(['--params-file', 'panda']))
    values = node_values(setup, bag, with_bringup=False)
    names = ['recorder', 'plant', 'controller', 'reference']
    assert list(values) == names
    assert [values[x]['wait_for'] for x in names[1:]] == [names] * 3
    assert values['recorder']['bag'] == str(bag)
    events = load_setup(make_parser().parse_args(['--params-file', 'switch']))
    with pytest.raises(CtcError, match='events are not allowed in a launch file; run bringup'):
        node_values(events, None, with_bringup=False)
    with pytest.raises(CtcError, match='exists already'):
        node_values(setup, tmp_path, with_bringup=False)
