"""The soak test on the graph: keeps its processes, injects faults, and counts what comes of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
import os
from pathlib import Path
import platform
import signal
import tempfile
import time
from typing import Any, TextIO

from ctc_chattering import params, soak, supervisor
from ctc_chattering.core.grid import NANOSECONDS
from ctc_chattering.domain import own_domain
from ctc_chattering.errors import CtcError
from ctc_chattering.middleware import use_profile
from ctc_chattering.orchestra import stop_signals
from ctc_chattering.share import config_directory
from ctc_chattering.soak import Fault, Outage, PROCESSES, Report, SELF

#: The run: the paper's first experiment, in real time, with a tame start.
OVERRIDES: dict[str, dict[str, Any]] = {
    'plant': {'pacing': 'real_time', 'duration': 0.0,
              # Bytes changed at random may say 1e200 N·m, under which no motion can be computed.
              'torque_saturation': [800.0, 200.0]},
    'controller': {'ka': [12.0, 12.0], 'switching': 'implicit_observer',
                   'effort_limit': [400.0, 100.0]}}
#: What is waited for the graph to begin, and for the answer of a service [s].
_START, _ANSWER = 30.0, 5.0
#: What is left of an attack when its topic's owner goes on [s].
_OVERLAP = 0.3
#: An error limit that trips at once [rad].
_TINY = 1e-12
#: What was dropped so long after the recorder was stopped was dropped because of that [s].
_AFTERMATH = 5.0
#: The work by which the machine's speed is measured: so many numbers are summed up.
_WORK = 20_000
#: In which one that has died begins anew [ns].
_REVIVAL = 10 * NANOSECONDS
#: What the speed at the beginning is measured over [s].
_SETTLE = 5.0
#: In which all have ended [ns].
_END = 60 * NANOSECONDS
#: Between two lines of the log about memory [s].
_NOTES = 30.0
#: Deaths that are reported one by one.
_MANY = 20


class _Ended(Exception):
    """The run is over, before its time."""


def perform(duration: float, seed: int, out: Path, control_period: float | None = None,
            progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """
    Run the graph, do everything to it that `soak.plan` says, and return what came of it.

    SIGINT and SIGTERM end it early.

    Parameters
    ----------
    duration : float
        [s].
    seed : int
        Of the plan.
    out : Path
        Directory for the bags and the processes' output.
    control_period : float, optional
        In place of the file's [s].
    progress : callable, optional
        Called now and then with the time since the graph runs [s].

    Raises
    ------
    CtcError
        If the graph does not begin, or ROS is missing.

    """
    overrides = dict(OVERRIDES)
    if control_period is not None:
        overrides['/**'] = {'control_period': control_period}
    setup = params.load(config_directory() / 'friction.yaml', overrides)
    use_profile()
    bags = out / 'bags'
    bags.mkdir(parents=True, exist_ok=True)
    with (stop_signals() as caught, own_domain(), tempfile.TemporaryDirectory() as scratch,
          (out / 'soak.log').open('w', encoding='utf-8', buffering=1) as log):
        file = Path(scratch) / 'params.yaml'
        params.dump({name: setup.values[name] for name in PROCESSES}, '/', file)
        graph = _Graph(setup, file, bags, log, caught, progress)
        try:
            graph.run(soak.plan(seed, duration), duration)
        finally:
            graph.close()
        document = graph.document()
    # Signals do again what they did: reading the bags may take a while.
    from ctc_chattering.soak_bags import examine
    found = examine(sorted(bags.iterdir()), setup.plant.joint_names, graph.outages)
    return {'seed': seed, 'asked_s': duration, **document,
            'bags': {**found, **graph.drops}}


class _Graph:
    """The processes under test, and all that is counted of them."""

    def __init__(self, setup: params.Setup, file: Path, bags: Path, log: TextIO,
                 caught: Sequence[int], progress: Callable[[float], None] | None) -> None:
        try:
            from ctc_chattering.nodes.saboteur import Saboteur
        except ImportError as error:
            raise CtcError(f'ROS 2 is missing: {error}') from None
        self._setup, self._file, self._bags, self._log = setup, file, bags, log
        self._caught, self._progress = caught, progress
        self._children: dict[str, supervisor.Child] = {}
        self._spawned: dict[str, int] = {}
        self._reports: dict[str, Report] = {}
        self._recorders = 0
        self._totals = {name: soak.Totals() for name in PROCESSES}
        self._memory = {name: soak.Memory() for name in (*PROCESSES, SELF)}
        self._waited: dict[str, list[float]] = {name: [0.0, 0.0] for name in (*PROCESSES, SELF)}
        self._kills = dict.fromkeys(PROCESSES, 0)
        self._died = dict.fromkeys(PROCESSES, 0)
        self._deaths: list[str] = []
        self._tally = soak.Tally()
        self._speed = soak.Speed()
        self._measured = self._noted = 0.0
        self._begun = self._ended = time.monotonic()
        self._disturbed = 0.0
        self.outages: list[Outage] = []
        self.drops = {'dropped': 0, 'unexplained_dropped': 0}
        self._rate = soak.RATE / setup.plant.control_period
        self._saboteur = Saboteur(self._on_report, setup.plant.joint_names)

    # What is heard and measured.

    def _on_report(self, name: str, report: Report) -> None:
        if report.t <= self._spawned.get(name, 0):
            return
        if name == 'recorder':
            before = self._reports.get(name)
            more = int(report.number('dropped') - (before.number('dropped') if before else 0))
            self.drops['dropped'] += more
            if time.monotonic() > self._disturbed + _AFTERMATH:
                self.drops['unexplained_dropped'] += more
        self._reports[name] = report
        self._totals[name].update(report.values)

    def _look(self) -> None:
        """Serve the graph for a moment; measure once a second; begin anew what has died."""
        if self._caught:
            raise _Ended
        self._saboteur.look()
        now = time.monotonic()
        if self._progress is not None:
            self._progress(now - self._begun)
        for name, child in list(self._children.items()):
            if child.status is not None:
                self._died[name] += 1
                if len(self._deaths) < _MANY:
                    self._deaths.append(f'{" ".join(child.exit_report().split())}')
                self._note(f'DIED: {child.exit_report()}')
                if name in ('plant', 'recorder'):
                    t = time.time_ns()
                    self.outages.append(Outage(t - NANOSECONDS, t + _REVIVAL))
                self._bury(name)
                self._start(name)
        if now - self._measured >= 1.0:
            self._measured = now
            self._speed.add(_cost())
            self._memory[SELF].add(now - self._begun, _resident(os.getpid()))
            self._waited[SELF][1] = _waited(os.getpid())
            for name, child in self._children.items():
                size = _resident(child.process.pid)
                if size:
                    self._memory[name].add(now - self._begun, size)
                    self._waited[name][1] = _waited(child.process.pid)
            if self._measured >= self._noted + _NOTES:
                self._noted = self._measured
                self._note('memory [kB]: ' + ', '.join(
                    f'{name} {memory.now:.0f}' for name, memory in self._memory.items())
                    + f'; speed {self._speed.since(round(_NOTES)):.2f}')

    def _wait(self, lasts: float) -> None:
        end = time.monotonic() + lasts
        while time.monotonic() < end:
            self._look()

    def _wait_until(self, t: float) -> None:
        self._wait(self._begun + t - time.monotonic())

    def _note(self, line: str) -> None:
        self._log.write(f'{time.monotonic() - self._begun:9.3f} {line}\n')

    # Processes.

    def _start(self, name: str) -> None:
        more = []
        if name == 'recorder':
            more = ['-p', f'bag:={self._bags / f"{self._recorders:04}"}']
            self._recorders += 1
        self._spawned[name] = time.time_ns()
        self._memory[name].begin(time.monotonic() - self._begun)
        self._children[name] = supervisor.Child(
            name, supervisor.node_command(
                name, '--ros-args', '--params-file', str(self._file), *more),
            lambda line: print(line, file=self._log))

    def _bury(self, name: str) -> None:
        """Count a generation among the past ones."""
        del self._children[name]
        self._reports.pop(name, None)
        self._totals[name].retire()
        waited = self._waited[name]
        waited[:] = waited[0] + waited[1], 0.0

    # The run.

    def run(self, faults: Sequence[Fault], duration: float) -> None:
        """Inject all `faults`, each after the graph has recovered from the one before."""
        try:
            for name in PROCESSES:
                self._start(name)
            failure, _ = self._recover(0, _START)
            if failure:
                raise CtcError(f'the graph did not begin within {_START:g} s: {failure}; for a '
                               'slow machine, choose a larger --control-period')
            self._wait(_SETTLE)
            self._speed.begin()
            self._begun = time.monotonic()
            self.outages.append(Outage(0, time.time_ns()))  # While they all start.
            for name in PROCESSES:
                self._memory[name].begin(0.0)
            for fault in faults:
                self._wait_until(fault.at)
                # Late because of the recoveries before, maybe: kills must not come too late.
                left = duration - (time.monotonic() - self._begun)
                killing = left > (1.0 - soak.KILLING) * duration
                if left > fault.lasts and (fault.kind != soak.KILL or killing):
                    self._suffer(fault)
            self._wait_until(duration)
        except _Ended:
            self._note('stopped by a signal')
        finally:
            self._ended = time.monotonic()

    def _suffer(self, fault: Fault) -> None:
        """Inject one fault and wait for the recovery."""
        self._note(f'FAULT {fault}')
        begin = time.time_ns()
        failure = getattr(self, _DOERS[fault.kind])(fault) or ''
        since, waited = time.time_ns(), self._idle_time()
        ailing, took = self._recover(since, soak.PATIENCE)
        if fault.kind in (soak.KILL, soak.STOP, soak.TAKEOVER):
            self._away(fault, begin, time.time_ns() if fault.kind == soak.KILL else since)
        if ailing:
            share = (self._idle_time() - waited) / took
            ailing += (f' (threads of plant and controller waited {share:.0%} of that time for a '
                       'processor)')
        failure = '; '.join(filter(None, (failure, ailing)))
        speed = self._speed.since(round(took))
        self._note(f'-> {failure or "recovered"} after {took:.2f} s, speed {speed:.2f}')
        self._tally.add(fault, took, failure, speed)

    def _away(self, fault: Fault, begin: int, end: int) -> None:
        victim = soak.OWNERS.get(fault.target, fault.target)
        if victim in ('plant', 'recorder'):
            self.outages.append(Outage(begin, end))
        if victim == 'recorder':
            self._disturbed = time.monotonic()

    def _recover(self, since: int, patience: float) -> tuple[str, float]:
        """Return what is still wrong at the end, and after how long nothing was any more [s]."""
        begin = time.monotonic()
        noted = ''
        while True:
            failure = soak.ailing(self._reports, since, self._rate)
            if failure not in ('', noted):
                noted = failure
                self._note(f'   {failure}')
            took = time.monotonic() - begin
            if not failure or took > patience:
                return failure, took
            self._look()

    def _idle_time(self) -> float:
        """Return how long plant and controller have waited for a processor [s]."""
        return sum(_waited(child.process.pid) for name, child in self._children.items()
                   if name in ('plant', 'controller'))

    def _kill(self, fault: Fault) -> None:
        child = self._children[fault.target]
        child.signal(signal.SIGKILL)
        child.process.wait()
        self._kills[fault.target] += 1
        self._bury(fault.target)
        self._wait(fault.lasts)
        self._start(fault.target)

    def _stop(self, fault: Fault) -> None:
        child = self._children[fault.target]
        if fault.target == 'recorder':
            self._disturbed = time.monotonic() + fault.lasts
        child.signal(signal.SIGSTOP)
        try:
            self._wait(fault.lasts)
        finally:
            child.signal(signal.SIGCONT)

    def _attack(self, fault: Fault) -> None:
        self._saboteur.begin(fault.target, fault.flavour, fault.seed)
        try:
            self._wait(fault.lasts)
        finally:
            self._saboteur.end()

    def _take_over(self, fault: Fault) -> None:
        """Send malformed messages while nobody else does, and a while longer."""
        child = self._children[soak.OWNERS[fault.target]]
        child.signal(signal.SIGSTOP)
        self._saboteur.begin(fault.target, fault.flavour, fault.seed)
        try:
            self._wait(fault.lasts)
            child.signal(signal.SIGCONT)
            self._wait(_OVERLAP)
        finally:
            child.signal(signal.SIGCONT)
            self._saboteur.end()

    def _answer(self, ask: Callable[[], Any]) -> Any:
        """Return the answer of a service; None if there is none."""
        end = time.monotonic() + _ANSWER
        future = None
        while time.monotonic() < end:
            future = ask() if future is None else future
            if future is not None and future.done():
                return future.result()
            self._look()
        return None

    def _set(self, node: str, name: str, value: object, allowed: bool) -> str:
        """Set a parameter; return what is wrong with the answer."""
        answer = self._answer(lambda: self._saboteur.node.set(node, name, value))
        if answer is None:
            return f'{node} does not answer'
        result = answer.results[0]
        if result.successful == allowed:
            return ''
        return (f'{name} = {value!r} was refused: {result.reason}' if allowed
                else f'{name} = {value!r} was accepted')

    def _restore(self, node: str, names: Sequence[str]) -> list[str]:
        values = self._setup.values[node]
        return [self._set(node, name, list(value) if isinstance(value, tuple) else value, True)
                for name in names if (value := values[name]) is not None]

    def _set_valid(self, fault: Fault) -> str:
        found = [self._set(fault.target, name, value, True) for name, value in fault.values]
        self._wait(fault.lasts)
        return '; '.join(filter(None, [
            *found, *self._restore(fault.target, [name for name, _ in fault.values])]))

    def _set_invalid(self, fault: Fault) -> str:
        return '; '.join(filter(None, [
            self._set(fault.target, name, value, False) for name, value in fault.values]))

    def _disable(self, fault: Fault) -> str:
        answers = [self._answer(lambda: self._saboteur.node.enable(False))]
        self._wait(fault.lasts)
        answers.append(self._answer(lambda: self._saboteur.node.enable(True)))
        return '' if all(x is not None and x.success for x in answers) else 'no success'

    def _reset(self, _fault: Fault) -> str:
        answer = self._answer(self._saboteur.node.reset)
        return '' if answer is not None and answer.success else 'no success'

    def _trip(self, fault: Fault) -> str:
        n = len(self._setup.plant.joint_names)
        found = [self._set('controller', 'error_limit', [_TINY] * n, True)]
        self._wait(fault.lasts)
        found += self._restore('controller', ['error_limit'])
        return '; '.join(filter(None, [*found, self._reset(fault)]))

    # The end.

    def close(self) -> None:
        """Stop everything."""
        self._saboteur.end()
        self._saboteur.close()
        self.outages.append(Outage(time.time_ns(), time.time_ns() + _END))
        supervisor.stop([x for name, x in self._children.items() if name != 'recorder'])
        supervisor.stop([x for name, x in self._children.items() if name == 'recorder'], 20.0)
        for child in self._children.values():
            if child.status:
                self._deaths.append(f'at the end, {" ".join(child.exit_report().split())}')

    def document(self) -> dict[str, Any]:
        """Return all numbers."""
        return {'duration_s': self._ended - self._begun,
                'machine': {**_machine(), 'speed': {
                    'least': self._speed.least, 'slow_s': self._speed.slow}},
                'control_period_s': self._setup.plant.control_period,
                'faults': self._tally.as_mapping(), 'failures': self._tally.failures,
                'deaths': self._deaths,
                'processes': {name: self._process(name) for name in (*PROCESSES, SELF)}}

    def _process(self, name: str) -> dict[str, Any]:
        totals, memory = self._totals.get(name, soak.Totals()), self._memory[name]
        paced = name in ('plant', 'controller')
        return {'samples': totals['samples'] if paced else None,
                'misses': totals['deadline misses'] if paced else None,
                'refused': totals.containing(': refused, '),
                'timeouts': totals.starting('timeouts, '),
                'restarts': self._kills.get(name, 0) + self._died.get(name, 0),
                'deaths': self._died.get(name, 0), 'waited_s': sum(self._waited[name]),
                'memory_start_kb': memory.start, 'memory_end_kb': memory.end,
                'growth_kb_per_min': memory.growth, 'fitted_s': memory.fit.span}


_DOERS = {soak.KILL: '_kill', soak.STOP: '_stop', soak.MALFORMED: '_attack',
          soak.SECOND: '_attack', soak.TAKEOVER: '_take_over', soak.VALID: '_set_valid',
          soak.INVALID: '_set_invalid', soak.ENABLE: '_disable', soak.RESET: '_reset',
          soak.TRIP: '_trip'}


def _resident(pid: int) -> float:
    """Return the resident memory of a process [kB]; 0 if it has gone."""
    try:
        with Path(f'/proc/{pid}/status').open(encoding='ascii', errors='replace') as lines:
            return next((float(x.split()[1]) for x in lines if x.startswith('VmRSS:')), 0.0)
    except OSError:
        return 0.0


def _waited(pid: int) -> float:
    """Return how long a process' threads, summed, were ready, but had no processor [s]."""
    total = 0
    for path in Path(f'/proc/{pid}/task').glob('*/schedstat'):
        with suppress(OSError, IndexError):  # A thread that has gone.
            total += int(path.read_text(encoding='ascii').split()[1])
    return total / NANOSECONDS


def _cost() -> float:
    """Return what a piece of work costs, others' use of the processors not counted [s]."""
    costs = []
    for _ in range(3):
        begin = time.thread_time()
        sum(range(_WORK))
        costs.append(time.thread_time() - begin)
    return min(costs)


def _machine() -> dict[str, Any]:
    processor = platform.machine()
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
        processor = next((x.split(':', 1)[1].strip() for x in lines
                          if x.startswith('model name')), processor)
    except OSError:
        pass
    return {'processor': processor, 'cores': len(os.sched_getaffinity(0)),
            'python': platform.python_version(),
            'kernel': f'{platform.system()} {platform.release()}'}
