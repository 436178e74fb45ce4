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

"""Runs the graph of a soak test: its processes, its faults, and what is counted of them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
import os
from pathlib import Path
import platform
import tempfile
import time
from typing import Any, TextIO

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.errors import CtcError
from ctc_chattering.launch import child_process
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.process import use_profile
from faults import Diagnostics, Report
from processes import Probe, probe
from soak import measurements, plan
from soak.fault_injector import FaultInjector
from soak.measurements import Outage
from soak.plan import Fault, PROCESSES
from stopwatch import Stopwatch

#: The run: the paper's first experiment in real time, with limits on the torque.
OVERRIDES: dict[str, dict[str, Any]] = {
    'plant': {'pacing': 'real_time', 'duration': 0.0,
              # Changed bytes may mean 1e200 N·m, with which no motion can be computed.
              'torque_saturation': [800.0, 200.0]},
    'controller': {'ka': [12.0, 12.0], 'switching': 'implicit_observer',
                   'effort_limit': [400.0, 100.0]}}
#: Time in which the graph must start [s].
START = 30.0
#: Time in which it must recover from a fault [s].
RECOVERY = 10.0
#: Messages dropped so long after the recorder was stopped were dropped because of that [s].
_AFTERMATH = 5.0
#: Time in which a process that has exited is started again [ns].
_RESTART = 10 * NANOSECONDS
#: Time in which all processes end [ns].
_END = 60 * NANOSECONDS
#: Length of the middleware's turn in each step [s].
_STEP = 0.02


class Stopped(Exception):
    """A signal has ended the run."""


class Graph:
    """
    The processes under test, and what is counted of them.

    Parameters
    ----------
    it : Probe
        A node beside them.
    file, bags : Path
        Parameter file; directory for bags.
    log : file
        For the output of all processes.
    caught : sequence of int
        Signals that ask for the end.

    Attributes
    ----------
    at_each_step : callable or None
        Called in each step.

    """

    def __init__(self, it: Probe, file: Path, bags: Path, log: TextIO,
                 caught: Sequence[int]) -> None:
        self.probe, self._file, self._bags, self._log, self._caught = it, file, bags, log, caught
        self.begun = time.monotonic()
        self.diagnostics = Diagnostics(it)
        self.children: dict[str, child_process.Child] = {}
        self.at_each_step: Callable[[], None] | None = None
        self.outages: list[Outage] = []
        self.crashes: dict[str, list[str]] = {name: [] for name in PROCESSES}
        self.generations: defaultdict[str, list[Report]] = defaultdict(list)
        self.memory: defaultdict[str, list[list[tuple[float, float]]]] = defaultdict(list)
        #: When each process was stopped for long, since the graph runs [s].
        self._long_stops: dict[str, list[float]] = {name: [] for name in PROCESSES}
        self.dropped = self.unexplained_dropped = 0
        self._last_dropped = 0
        self._measured = 0.0
        #: When the recorder was last stopped or started.
        self.disturbed = 0.0

    def start(self, name: str) -> None:
        """Start a process."""
        more: tuple[str, ...] = ()
        if name == 'recorder':
            more = '-p', f'bag:={self._bags / f"{len(self.memory[name]):04}"}'
            self._last_dropped = 0
        self.memory[name].append([])
        self.children[name] = child_process.Child(
            name, child_process.node_command(
                name, '--ros-args', '--params-file', str(self._file), *more),
            lambda line: print(line, file=self._log))

    def kill(self, name: str) -> None:
        """Kill a process and wait for its end."""
        self.children[name].process.kill()
        self.children[name].process.wait()
        self._retire(name)

    def _retire(self, name: str) -> None:
        """Count a process that has ended among the past generations."""
        del self.children[name]
        if name in self.diagnostics.latest:
            self.generations[name].append(self.diagnostics.latest.pop(name))

    def _note_crash(self, name: str) -> None:
        report = self.children[name].exit_report()
        self.crashes[name].append(' '.join(report.split()))
        self.note(f'CRASH: {report}')

    def note_long_stop(self, name: str) -> None:
        """Note that a process was stopped for so long that others kept all they do for it."""
        self._long_stops[name].append(time.monotonic() - self.begun)

    def note(self, line: str) -> None:
        """Write a line into the log."""
        self._log.write(f'{time.monotonic() - self.begun:9.3f} {line}\n')

    def wait(self, lasts: float) -> None:
        """Let the graph run for `lasts` [s]."""
        end = time.monotonic() + lasts
        while time.monotonic() < end:
            self.step()

    def step(self) -> None:
        """Serve the graph; measure once a second; start again what has crashed."""
        if self._caught:
            raise Stopped
        self.probe.executor.spin_once(timeout_sec=_STEP)
        if self.at_each_step is not None:
            self.at_each_step()
        for name, child in list(self.children.items()):
            if child.status is not None:
                self._note_crash(name)
                if name in ('plant', 'recorder'):
                    t = time.time_ns()
                    self.outages.append(Outage(t - NANOSECONDS, t + _RESTART))
                self._retire(name)
                self.start(name)
        now = time.monotonic()
        if now - self._measured >= 1.0:
            self._measured = now
            self._measure(now)

    def _measure(self, now: float) -> None:
        for name, child in self.children.items():
            size = _anonymous(child.process.pid)
            if size:
                self.memory[name][-1].append((now - self.begun, size))
        recorder = self.diagnostics.latest.get('recorder')
        if recorder:
            more = recorder.count('dropped') - self._last_dropped
            self._last_dropped += more
            self.dropped += more
            self.unexplained_dropped += more * (now > self.disturbed + _AFTERMATH)

    def recover(self, since: int, rate: float, patience: float) -> tuple[str, float]:
        """
        Wait until the graph is healthy.

        Parameters
        ----------
        since : int
            Reports from before do not count [ns].
        rate : float
            Samples per second that must be reached.
        patience : float
            Longest time, without what the processes wait for a processor [s].

        Returns
        -------
        (str, float)
            What is still wrong at the end, and how long it took [s].

        """
        begin = time.monotonic()
        watch = Stopwatch(*(child.process.pid for child in self.children.values()))
        noted = ''
        while True:
            failure = measurements.unhealthy(self.diagnostics.latest, since, rate)
            if failure not in ('', noted):
                noted = failure
                self.note(f'   {failure}')
            if not failure or watch.read() > patience:
                return failure, time.monotonic() - begin
            self.step()

    def close(self) -> None:
        """Stop all processes, the recorder last."""
        self.outages.append(Outage(time.time_ns(), time.time_ns() + _END))
        for names, patience in (([x for x in self.children if x != 'recorder'], 5.0),
                                (['recorder'], 20.0)):
            child_process.stop([self.children[x] for x in names if x in self.children], patience)
        for name, child in list(self.children.items()):
            if child.status:
                self._note_crash(name)
            self._retire(name)

    def process(self, name: str) -> dict[str, Any]:
        """Return what was counted of a process."""
        counts = measurements.totals(self.generations[name])
        return {'samples': counts['samples'], 'misses': counts['deadline misses'],
                'refused': {key.replace(': refused, ', ': '): count
                            for key, count in counts.items() if ': refused, ' in key},
                'timeouts': {key: count for key, count in counts.items()
                             if key.startswith('timeouts, ')},
                'restarts': len(self.memory[name]) - 1,
                'crashes': len(self.crashes[name]),
                **measurements.memory(max(self.memory[name], key=len), self._long_stops)}


def run(duration: float, seed: int, out: Path, control_period: float | None,
        caught: Sequence[int]) -> dict[str, Any]:
    """
    Run the graph, inject all faults of the plan, and return what was counted.

    Parameters
    ----------
    duration : float
        [s].
    seed : int
        Of the plan.
    out : Path
        Directory for the bags and the log.
    control_period : float, optional
        In place of the file's [s].
    caught : sequence of int
        Fills with the signals that ask for an early end.

    Raises
    ------
    CtcError
        If the graph does not start.

    """
    overrides = {**OVERRIDES, '/**': {'control_period': control_period} if control_period else {}}
    setup = parameter_file.load(config_directory() / 'friction.yaml', overrides)
    use_profile()
    bags = out / 'bags'
    bags.mkdir(parents=True, exist_ok=True)
    with (tempfile.TemporaryDirectory() as scratch, probe() as it,
          (out / 'soak.log').open('w', encoding='utf-8', buffering=1) as log):
        file = Path(scratch) / 'params.yaml'
        parameter_file.dump({name: setup.values[name] for name in PROCESSES}, file)
        graph = Graph(it, file, bags, log, caught)
        faults: list[dict[str, Any]] = []
        rate = measurements.RATE / setup.plant.control_period
        try:
            for name in PROCESSES:
                graph.start(name)
            failure, _ = graph.recover(0, rate, START)
            if failure:
                raise CtcError(f'the graph did not start within {START:g} s: {failure}; for a '
                               'slow machine, choose a larger --control-period')
            graph.outages.append(Outage(0, time.time_ns()))  # While they start.
            graph.begun = time.monotonic()
            _inject(graph, FaultInjector(graph, setup.values), plan.plan(seed, duration), duration,
                    rate, faults)
        except Stopped:
            graph.note('stopped by a signal')
        finally:
            ran = time.monotonic() - graph.begun
            graph.close()
    return {'seed': seed, 'asked_s': duration, 'duration_s': ran, 'machine': _machine(),
            'control_period_s': setup.plant.control_period, 'faults': faults,
            'crashes': [x for texts in graph.crashes.values() for x in texts],
            'processes': {name: graph.process(name) for name in PROCESSES},
            'bags': {**measurements.examine(sorted(bags.iterdir()), graph.outages),
                     'dropped': graph.dropped, 'unexplained_dropped': graph.unexplained_dropped}}


def _inject(graph: Graph, injector: FaultInjector, faults: Sequence[Fault], duration: float,
            rate: float, results: list[dict[str, Any]]) -> None:
    """Inject each fault after the graph has recovered from the one before."""
    for fault in faults:
        graph.wait(graph.begun + fault.at - time.monotonic())
        # Recoveries may have delayed it: kills must not come too late.
        left = duration - (time.monotonic() - graph.begun)
        if left < fault.lasts or (
                fault.kind == plan.KILL and left < (1.0 - plan.KILLING) * duration):
            continue
        graph.note(f'FAULT {fault}')
        begin = time.time_ns()
        victim = plan.OWNERS.get(fault.target, fault.target)
        interrupts = fault.kind in (plan.KILL, plan.STOP, plan.ALONE)
        if interrupts and victim == 'recorder':
            graph.disturbed = time.monotonic() + fault.lasts
        answers = injector.inject(fault)
        since = time.time_ns()
        unhealthy, took = graph.recover(since, rate, RECOVERY)
        if interrupts and victim in ('plant', 'recorder'):
            graph.outages.append(Outage(
                begin, time.time_ns() if fault.kind == plan.KILL else since))
        failure = '; '.join(filter(None, (answers, unhealthy)))
        graph.note(f'-> {failure or "recovered"} after {took:.2f} s')
        results.append({'at_s': fault.at, 'kind': fault.kind, 'target': fault.target,
                        'text': str(fault), 'recovery_s': took, 'failure': failure})
    graph.wait(graph.begun + duration - time.monotonic())


def _anonymous(pid: int) -> float:
    """Return the resident memory of a process that is no file's [kB]; 0 if it has gone."""
    try:
        with Path(f'/proc/{pid}/status').open(encoding='ascii', errors='replace') as lines:
            return next((float(x.split()[1]) for x in lines if x.startswith('RssAnon:')), 0.0)
    except OSError:
        return 0.0


def _machine() -> str:
    lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
    processor = next((x.split(':', 1)[1].strip() for x in lines if x.startswith('model name')),
                     platform.machine())
    return (f'{processor}, {len(os.sched_getaffinity(0))} cores, Python '
            f'{platform.python_version()}, {platform.system()} {platform.release()}')
