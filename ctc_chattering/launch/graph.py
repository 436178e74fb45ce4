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

"""
Run of the whole graph by `bringup`.

It starts the processes, watches them, and stops them.

The parameters come from a checked `Setup`, written as a parameter file for the nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
import os
from pathlib import Path
import random
import signal
import sys
import tempfile
from typing import Any, TYPE_CHECKING

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.node_parameters import LOOP
from ctc_chattering.errors import CtcError
from ctc_chattering.launch.child_process import Child, node_command, stop
from ctc_chattering.ros.process import check_security, stop_signals, use_profile

if TYPE_CHECKING:
    from ctc_chattering.launch.requests import ParameterEventScheduler

#: Time that the recorder and other nodes have to end after the loop [s].
_LAST_PATIENCE_S = 20.0


class Stopped(CtcError):
    """End of a run by SIGINT or SIGTERM."""


def run_graph(setup: Setup, record: Path | None = None, ros_args: Sequence[str] = (),
              progress: Callable[[float], object] = lambda _: None,
              show: Callable[[str], None] = print, live: bool = False) -> None:
    """
    Run the graph, and leave no process behind.

    Parameters
    ----------
    setup : Setup
        Parameters of all nodes.
    record : Path, optional
        Directory to create for a bag.
    ros_args : sequence of str
        More arguments for every node, each list beginning with ``--ros-args``.
    progress : callable, optional
        Called now and then with the time of the run [s].
    show : callable
        Called with every line that a process prints.
    live : bool
        Whether a page in the browser shows the graph. The graph goes on without it.

    Raises
    ------
    CtcError
        If a parameter is not allowed, a process dies, or an event is refused.
    Stopped
        After SIGINT or SIGTERM.

    """
    values = node_values(setup, record)
    check_security()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    use_profile()
    from ctc_chattering.launch.requests import graph_monitor
    lockstep = setup.plant.pacing == 'lockstep'
    # Plant and controller take turns in lockstep: on one processor that is faster.
    processors = dict.fromkeys(('plant', 'controller'), one_processor() if lockstep else None)
    nodes: dict[str, Child] = {}
    page: list[Child] = []
    with (stop_signals() as caught, ExitStack() as context,
          tempfile.TemporaryDirectory(prefix='ctc_chattering_') as scratch):
        file = Path(scratch) / 'params.yaml'
        parameter_file.dump(values, file)
        # The nodes read the pipe, and join the graph when its other end is closed.
        read, write = os.pipe()
        start = context.enter_context(os.fdopen(read, 'rb'))
        hold = context.enter_context(os.fdopen(write, 'wb'))
        try:
            for name in values:
                command = node_command(
                    name, *ros_args, '--ros-args', '--params-file', str(file))
                nodes[name] = Child(name, command, show, processors.get(name), start.fileno())
            # It looks for another graph while the nodes load their modules.
            monitor = context.enter_context(graph_monitor(setup.events, lockstep, ros_args))
            hold.close()
            if live:
                opening = '--open' if sys.stdout.isatty() else '--no-open'
                page.append(Child(
                    'live', node_command('live', opening, *ros_args, program='ctc'), show))
            try:
                _watch(nodes, monitor, caught, setup.plant.duration > 0.0, progress)
                monitor.report_end('the experiment has ended')
            except CtcError as error:
                monitor.report_end(' '.join(str(error).split()))
                raise
        finally:
            if not hold.closed:  # They have not joined the graph.
                for child in nodes.values():
                    child.process.kill()
            stop([nodes[name] for name in LOOP if name in nodes])
            stop(page)  # It shows how the graph has ended.
            stop(list(nodes.values()), _LAST_PATIENCE_S)
    for child in nodes.values():
        if child.status:
            raise CtcError(child.exit_report())


def node_values(setup: Setup, record: Path | None, with_bringup: bool = True
                ) -> dict[str, dict[str, Any]]:
    """
    Return the nodes' parameters, in the order of start.

    Parameters
    ----------
    setup : Setup
        Contents of the parameter file.
    record : Path or None
        Directory to create for a bag.
    with_bringup : bool
        Whether the nodes wait for bringup, which sets the parameters of ``events``.

    Raises
    ------
    CtcError
        If the bag exists, or there are events and no bringup.

    """
    if record is not None and os.path.lexists(record):
        raise CtcError(f'{record}: exists already, not overwritten')
    if setup.events and not with_bringup:
        raise CtcError('bringup: events are not allowed in a launch file; run bringup: '
                       'ros2 run ctc_chattering bringup')
    names = ['recorder', *LOOP] if record else list(LOOP)
    values = {name: dict(setup.values[name]) for name in names}
    for name in LOOP:
        values[name]['wait_for'] = ['bringup', *names] if with_bringup else names
    if setup.plant.pacing == 'lockstep' and setup.events:
        values['plant']['hold_at'] = setup.events[0].time
    if record:
        values['recorder']['bag'] = str(record)
    return values


def _watch(nodes: Mapping[str, Child], monitor: ParameterEventScheduler, caught: Sequence[int],
           ends: bool, progress: Callable[[float], object]) -> None:
    """Return when the plant has ended the experiment."""
    while not caught:
        for name, child in nodes.items():
            if child.status is None:
                continue
            if name == 'plant' and child.status == 0 and ends:
                return
            raise CtcError(child.exit_report())
        progress(monitor.look())
    raise Stopped(f'stopped by {signal.Signals(caught[0]).name}')


def one_processor() -> set[int]:
    """Return a processor that this process may use."""
    return {random.choice(sorted(os.sched_getaffinity(0)))}
