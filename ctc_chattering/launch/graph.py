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

"""Running the whole graph once: start the processes, watch them, stop them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack
import os
from pathlib import Path
import random
import signal
import sys
import tempfile
from typing import Any, BinaryIO

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.node_parameters import LOOP
from ctc_chattering.errors import CtcError
from ctc_chattering.launch import child_process
from ctc_chattering.ros.process import check_security, stop_signals, use_profile


class Stopped(CtcError):
    """The run was stopped by SIGINT or SIGTERM."""


def run_graph(setup: Setup, record: Path | None = None, ros_args: Sequence[str] = (),
              progress: Callable[[float], object] = lambda _: None,
              show: Callable[[str], None] = print, live: bool = False) -> None:
    """
    Run the graph until the plant ends the experiment, and leave no process behind.

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
        Whether a page in the browser shows the graph; its end is not the graph's.

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
    # They take turns: on one processor that is faster.
    turns = one_processor() if lockstep else None
    children: dict[str, child_process.Child] = {}
    with (stop_signals() as caught, ExitStack() as leaving,
          tempfile.TemporaryDirectory(prefix='ctc_chattering_') as scratch):
        file = Path(scratch) / 'params.yaml'
        parameter_file.dump(values, file)
        start, hold = leaving.enter_context(_pipe())
        try:
            for name in values:
                argv = child_process.node_command(
                    name, *ros_args, '--ros-args', '--params-file', str(file))
                children[name] = child_process.Child(
                    name, argv, show, turns if name in ('plant', 'controller') else None,
                    start.fileno())
            # Another graph is looked for while they load their modules.
            look, report_end = leaving.enter_context(
                graph_monitor(setup.events, lockstep, ros_args))
            hold.close()
            if live:
                children['live'] = child_process.Child('live', child_process.node_command(
                    'live', '--open' if sys.stdout.isatty() else '--no-open', *ros_args,
                    program='ctc'), show)
            try:
                _watch({name: children[name] for name in values}, look, caught,
                       setup.plant.duration > 0.0, progress)
                report_end('the experiment has ended')
            except CtcError as error:
                report_end(' '.join(str(error).split()))
                raise
        finally:
            if not hold.closed:  # They have not joined the graph.
                for child in children.values():
                    child.signal(signal.SIGKILL)
            child_process.stop([children[x] for x in LOOP if x in children])
            # Later: it shows how the graph has ended.
            child_process.stop([children[x] for x in children if x == 'live'])
            child_process.stop(list(children.values()), patience=20.0)
    for name in values:
        if children[name].status:
            raise CtcError(children[name].exit_report())


@contextmanager
def _pipe() -> Iterator[tuple[BinaryIO, BinaryIO]]:
    """Yield the ends of a pipe."""
    read, write = os.pipe()
    with os.fdopen(read, 'rb') as start, os.fdopen(write, 'wb') as hold:
        yield start, hold


def node_values(setup: Setup, record: Path | None, with_bringup: bool = True
                ) -> dict[str, dict[str, Any]]:
    """
    Return the parameters of the nodes that are to run, in the order of their start.

    Parameters
    ----------
    setup : Setup
        Of the parameter file.
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
    names = (*(('recorder',) if record else ()), *LOOP)
    values = {name: dict(setup.values[name]) for name in names}
    for name in LOOP:
        values[name]['wait_for'] = [*(['bringup'] if with_bringup else []), *names]
    if setup.plant.pacing == 'lockstep' and setup.events:
        values['plant']['hold_at'] = setup.events[0].time
    if record:
        values['recorder']['bag'] = str(record)
    return values


def _watch(children: Mapping[str, child_process.Child], look: Callable[[], float],
           caught: Sequence[int], ends: bool, progress: Callable[[float], object]) -> None:
    """Return when the plant has ended the experiment."""
    while True:
        if caught:
            raise Stopped(f'stopped by {signal.Signals(caught[0]).name}')
        for name, child in children.items():
            if child.status is not None:
                if name == 'plant' and child.status == 0 and ends:
                    return
                raise CtcError(child.exit_report())
        progress(look())


def one_processor() -> set[int]:
    """Return one of the processors that we may use, any."""
    return {random.choice(sorted(os.sched_getaffinity(0)))}
