"""The soak test without the graph: what will be done to it, what was counted, the verdict."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
import dataclasses
import itertools
import random
import statistics
from typing import Any, NamedTuple, TypeVar

from ctc_chattering.core.controller import LAWS
from ctc_chattering.core.grid import NANOSECONDS, seconds
from ctc_chattering.core.parameters import Parameter
from ctc_chattering.core.switching import SWITCHINGS
from ctc_chattering.graph import (
    CLOCK,
    COMMANDS,
    DIAGNOSTICS,
    JOINT_STATES,
    JOINT_TRAJECTORY,
    REFERENCE,
)
from ctc_chattering.settings import LOOP, parameters_of

_Card = TypeVar('_Card')

#: The processes of the graph; the one that tests them is `SELF`.
PROCESSES = ('recorder', *LOOP)
SELF = 'soak'

KILL, STOP, MALFORMED, SECOND, TAKEOVER = (
    'SIGKILL', 'SIGSTOP', 'malformed messages', 'second publisher', 'malformed, owner stopped')
VALID, INVALID = 'valid parameters', 'invalid parameters'
ENABLE, RESET, TRIP = '~/enable', '~/reset', 'error_limit, ~/reset'
#: Waypoints: nobody else publishes them.
ROUTE = f'reference/{JOINT_TRAJECTORY}'
#: In what way messages are malformed, by topic.
FLAVOURS = {
    JOINT_STATES: ('nan', 'length', 'names', 'stamp', 'bytes'),
    COMMANDS: ('nan', 'length', 'names', 'bytes'),
    REFERENCE: ('nan', 'length', 'names', 'stamp', 'times', 'bytes'),
    ROUTE: ('nan', 'length', 'names', 'times', 'bytes'),
    CLOCK: ('stamp', 'bytes'),
    DIAGNOSTICS: ('bytes',),
}
#: A message that its topic's owner might have sent.
PLAUSIBLE = 'plausible'
#: Who publishes a topic.
OWNERS = {JOINT_STATES: 'plant', COMMANDS: 'controller', REFERENCE: 'reference'}

#: Between two faults [s], and before the first one.
PAUSE = (1.5, 4.0)
#: Part of the run in which processes are killed; afterwards they live on, so that it can be seen
#: whether their memory grows.
KILLING = 1.0 / 3.0
#: Time in which the graph must recover [s], and the part of its sample rate that it must reach.
PATIENCE = 10.0
RATE = 0.9
#: A machine that computes at less than so much of the speed at which the run began is too slow to
#: judge anybody by.
SLOW = 0.7
#: A generation's memory is fitted from so long after its start [s], and judged if the fit extends
#: over so long [s].
WARM_UP = 30.0
JUDGED = 30.0
#: Growth that fails the run [kB/min], where it comes to more than so much in all [kB].
GROWTH, GROWN = 100.0, 2000.0
#: A step between stamps of joint states, or from the last of them to the end of the bag, that is a
#: gap [ns], and what an outage reaches beyond its ends [ns].
GAP = NANOSECONDS // 5
MARGIN = NANOSECONDS // 2
#: Unrecovered faults and deaths that are reported one by one.
_MANY = 20


@dataclasses.dataclass(frozen=True)
class Fault:
    """
    Something that is done to the graph.

    Attributes
    ----------
    at : float
        When, at the earliest, since the graph runs [s].
    kind, target : str
        What, and to which process or topic.
    lasts : float
        How long [s].
    flavour : str
        In what way messages are malformed.
    values : tuple of (str, object)
        Parameters to set.
    seed : int
        For whatever else is random.

    """

    at: float
    kind: str
    target: str
    lasts: float = 0.0
    flavour: str = ''
    values: tuple[tuple[str, Any], ...] = ()
    seed: int = 0

    def __str__(self) -> str:
        """Return it on one line."""
        words = [self.kind, self.target, self.flavour, f'for {self.lasts:.2f} s',
                 ', '.join(f'{name} = {value!r}' for name, value in self.values)]
        return ' '.join(filter(None, words))


def plan(seed: int, duration: float) -> list[Fault]:
    """
    Return the faults of a run, the same for the same arguments.

    Every kind comes before all have come again, and so does every target of a kind. In the first
    third of the run every other fault is a kill.

    Parameters
    ----------
    seed : int
        For all that is random.
    duration : float
        [s].

    """
    rng = random.Random(seed)
    kinds = _deck(rng, _WEIGHTS)
    targets = {kind: _deck(rng, cards) for kind, cards in _TARGETS.items()}
    faults: list[Fault] = []
    t = 0.0
    while True:
        t += rng.uniform(*PAUSE)
        killing = t < KILLING * duration and len(faults) % 2 == 0
        kind = KILL if killing else next(kinds)
        target, flavour = next(targets[kind])
        lasts = rng.uniform(*_LASTS[kind]) if kind in _LASTS else 0.0
        values: tuple[tuple[str, Any], ...] = ()
        if kind == VALID:
            values = _valid(rng, target)
        elif kind == INVALID:
            values = _invalid(rng, target)
        if t + lasts >= duration:
            return faults
        faults.append(Fault(t, kind, target, lasts, flavour, values, rng.randrange(1 << 31)))
        t += lasts


#: How long a fault lasts, or a killed process stays away [s].
_LASTS = {KILL: (0.0, 1.0), STOP: (0.05, 2.0), MALFORMED: (0.2, 1.0), SECOND: (0.5, 2.0),
          TAKEOVER: (0.8, 2.0), VALID: (0.5, 2.0), ENABLE: (0.1, 2.0), TRIP: (0.1, 1.0)}
#: Targets and flavours of every kind.
_TARGETS: dict[str, list[tuple[str, str]]] = {
    **{kind: [(name, '') for name in PROCESSES] for kind in (KILL, STOP)},
    MALFORMED: [(topic, x) for topic, flavours in FLAVOURS.items() for x in flavours],
    SECOND: [(topic, PLAUSIBLE) for topic in (COMMANDS, JOINT_STATES)],
    TAKEOVER: [(topic, '') for topic in OWNERS],
    **{kind: [(node, '') for node in ('plant', 'controller')] for kind in (VALID, INVALID)},
    **{kind: [('controller', '')] for kind in (ENABLE, RESET, TRIP)}}
#: The kinds besides kills, as often as they come.
_WEIGHTS = [STOP, STOP, MALFORMED, MALFORMED, MALFORMED, MALFORMED, SECOND, TAKEOVER, VALID,
            INVALID, ENABLE, RESET, TRIP]


def _deck(rng: random.Random, cards: Sequence[_Card]) -> Iterator[_Card]:
    """Yield the cards in random order, shuffled anew whenever all of them were out."""
    while True:
        shuffled = list(cards)
        rng.shuffle(shuffled)
        yield from shuffled


#: What may be set to anything in between while the loop goes on: low and high, or choices.
_RANGES: dict[str, dict[str, Any]] = {
    'controller': {
        'law': LAWS, 'switching': SWITCHINGS, 'kp': (60.0, 150.0), 'kv': (30.0, 70.0),
        'ka': (10.0, 14.0), 'lambda': (5.0, 15.0), 'boundary_layer': (0.01, 0.1),
        'observer_bandwidth': (300.0, 1500.0), 'effort_limit': (300.0, 500.0),
        'effort_rate_limit': (1e4, 1e6), 'anti_windup': (False, True),
        'state_decimation': (5, 10, 50)},
    'plant': {
        'coulomb_friction': (5.0, 9.9), 'viscous_friction': (0.0, 1.0),
        'stribeck_friction': (0.0, 1.0), 'disturbance.amplitude': (0.0, 1.0),
        'disturbance.frequency': (0.0, 5.0), 'fault_damping': (10.0, 40.0),
        'command_timeout': (0.05, 0.2)},
}


def _valid(rng: random.Random, node: str) -> tuple[tuple[str, Any], ...]:
    """Return one to three parameters with values that are allowed."""
    result = []
    for name in rng.sample(sorted(_RANGES[node]), rng.randint(1, 3)):
        values, spec = _RANGES[node][name], parameters_of(node)[name]
        if not spec.kind.startswith('float'):
            result.append((name, rng.choice(values)))
        elif spec.kind == 'float':
            result.append((name, rng.uniform(*values)))
        else:
            result.append((name, [rng.uniform(*values) for _ in range(2)]))
    return tuple(result)


def _invalid(rng: random.Random, node: str) -> tuple[tuple[str, Any], ...]:
    """Return three parameters, each of which must be refused."""
    specs = parameters_of(node)
    names = rng.sample(sorted(specs), 2)
    return (('nonsense', 1.0), *((name, rng.choice(_wrong(specs[name]))) for name in names))


def _wrong(spec: Parameter) -> list[Any]:
    """Return values that are not allowed."""
    nan = float('nan')
    negative = spec.minimum >= 0.0
    if spec.kind == 'float':
        return [nan, 'many', [1.0, 2.0], *([-1.0] if negative else [])]
    if spec.kind == 'float[]':
        return [[nan, 1.0], [1.0, 2.0, 3.0], 1.0, 'many', *([[-1.0, 1.0]] if negative else [])]
    if spec.kind == 'int':
        return [1.5, 'one', [1], *([-1] if negative else [])]
    if spec.kind == 'bool':
        return ['yes', 1, [True]]
    if spec.kind == 'str':
        return ['nonsense', 7] if spec.choices or spec.read_only else [7]
    return ['nonsense', 7, [1.0]]


class Report(NamedTuple):
    """What a process said of itself: when [ns], in which words, and numbers by name."""

    t: int
    message: str
    values: Mapping[str, str]

    def number(self, key: str) -> float:
        """Return a number; 0 if it is not there."""
        try:
            return float(self.values.get(key, 0.0))
        except ValueError:
            return 0.0


def ailing(reports: Mapping[str, Report], since: int, rate: float) -> str:
    """
    Return why the graph has not recovered; an empty string if it has.

    Parameters
    ----------
    reports : mapping
        The last one of each process.
    since : int
        Those from before do not count [ns].
    rate : float
        Samples per second that the controller must answer, and the recorder must record.

    """
    for name in PROCESSES:
        report = reports.get(name)
        if report is None or report.t < since:
            return f'{name} says nothing'
        if name != 'recorder' and not report.message.startswith('running'):
            return f'{name}: {report.message}'
    found = reports['controller'].number('rate [Hz]')
    if found < rate:
        return f'controller: {found:.0f} samples per second of {rate:.0f}'
    recorder = reports['recorder']
    if not recorder.number('messages') or 'stopped' in recorder.message:
        return f'recorder: {recorder.message}'
    # For each sample there are a state and a torque at least.
    recorded = recorder.number('rate [Hz]')
    if recorded < 2.0 * rate:
        return f'recorder: {recorded:.0f} messages per second of {2.0 * rate:.0f}'
    return ''


class Fit:
    """A straight line through points that come one by one, and are not kept."""

    def __init__(self) -> None:
        self.count = 0
        self.first = self.last = 0.0
        self._x = self._y = self._xx = self._xy = 0.0

    def add(self, x: float, y: float) -> None:
        """Take a point, of a larger `x` than those before."""
        if not self.count:
            self.first = x
        self.last = x
        self.count += 1
        dx = x - self._x
        self._x += dx / self.count
        self._y += (y - self._y) / self.count
        self._xx += dx * (x - self._x)
        self._xy += dx * (y - self._y)

    @property
    def slope(self) -> float | None:
        """The least squares' slope; None if there is none."""
        return self._xy / self._xx if self._xx > 0.0 else None

    @property
    def span(self) -> float:
        """From the first to the last `x`."""
        return self.last - self.first


class Memory:
    """
    The memory of one process over its generations.

    Attributes
    ----------
    now : float
        At last [kB].
    start, end : float
        Of the longest-lived generation: after `WARM_UP`, or at its start if it did not live so
        long, and at last [kB].
    fit : Fit
        Of the longest-lived generation, after `WARM_UP`: [s] and [kB].

    """

    def __init__(self) -> None:
        self.now = self.start = self.end = 0.0
        self.fit = Fit()
        self._longest = -1.0
        self.begin(0.0)

    def begin(self, t: float) -> None:
        """Begin a new generation at `t` [s]."""
        self._begun, self._first, self._fit = t, 0.0, Fit()

    def add(self, t: float, size: float) -> None:
        """Take a measurement: `t` [s], `size` [kB]."""
        self._first, self.now = self._first or size, size
        if t - self._begun >= WARM_UP:
            self._first = self._first if self._fit.count else size
            self._fit.add(t, size)
        if t - self._begun > self._longest:
            self._longest = t - self._begun
            self.start, self.end, self.fit = self._first, size, self._fit

    @property
    def growth(self) -> float | None:
        """Growth [kB/min]."""
        slope = self.fit.slope
        return None if slope is None else 60.0 * slope


class Totals:
    """Numbers that a process counts from 0 in each of its generations, summed over them."""

    def __init__(self) -> None:
        self._past: Counter[str] = Counter()
        self._present: dict[str, int] = {}

    def update(self, values: Mapping[str, str]) -> None:
        """Take the last word of the present generation."""
        self._present = {key: int(value) for key, value in values.items() if value.isdecimal()}

    def retire(self) -> None:
        """Count the present generation among the past ones."""
        self._past.update(self._present)
        self._present = {}

    def __getitem__(self, key: str) -> int:
        """Return one number."""
        return self._past[key] + self._present.get(key, 0)

    def starting(self, *prefixes: str) -> dict[str, int]:
        """Return the numbers other than 0 whose names start so."""
        return {key: self[key] for key in sorted({*self._past, *self._present})
                if key.startswith(prefixes) and self[key]}

    def containing(self, text: str) -> dict[str, int]:
        """Return the numbers other than 0 in whose names `text` stands, without it."""
        return {key.replace(text, ': '): self[key] for key in sorted({*self._past, *self._present})
                if text in key and self[key]}


class Speed:
    """
    How fast the machine computes, in terms of how fast it did when the run began.

    Attributes
    ----------
    least : float
        At worst; 1 before anything was measured.
    slow : int
        Number of measurements below `SLOW`.

    """

    def __init__(self) -> None:
        self.least, self.slow = 1.0, 0
        self._costs: list[float] = []
        self._base = 0.0

    def add(self, cost: float) -> None:
        """Take what a piece of work has just cost [s of processor time]."""
        self._costs.append(cost)
        if self._base:
            found = self._base / cost
            self.least = min(self.least, found)
            self.slow += found < SLOW

    def begin(self) -> None:
        """Take the median of what was measured so far for the speed at the beginning."""
        self._base = statistics.median(self._costs)
        self._costs.clear()

    def since(self, count: int) -> float:
        """Return the speed over the last `count` measurements, one at least."""
        costs = self._costs[-max(1, count):]
        return self._base * len(costs) / sum(costs) if costs and self._base else 1.0


class Tally:
    """How often a kind of fault was injected, and how the graph recovered."""

    def __init__(self) -> None:
        self.injected: Counter[str] = Counter()
        self.recovered: Counter[str] = Counter()
        self.unjudged: Counter[str] = Counter()
        self.longest: dict[str, float] = {}
        self.failures: list[str] = []
        self.failed = 0

    def add(self, fault: Fault, took: float, failure: str, speed: float = 1.0) -> None:
        """
        Count a fault: recovered after `took` [s], or `failure` says what is wrong.

        It is not judged if the `speed` of the machine was less than `SLOW` meanwhile.
        """
        kind = f'{fault.kind} {fault.target}' if fault.kind in (KILL, STOP) else fault.kind
        self.injected[kind] += 1
        if failure and speed < SLOW:
            self.unjudged[kind] += 1
            return
        if failure:
            self.failed += 1
            if len(self.failures) < _MANY:
                self.failures.append(f'at {fault.at:.1f} s, {fault}: {failure}')
            return
        self.recovered[kind] += 1
        self.longest[kind] = max(self.longest.get(kind, 0.0), took)

    def as_mapping(self) -> dict[str, dict[str, Any]]:
        """Return it by kind."""
        return {kind: {'injected': self.injected[kind], 'recovered': self.recovered[kind],
                       'not_judged': self.unjudged[kind],
                       'longest_recovery_s': self.longest.get(kind)}
                for kind in sorted(self.injected)}


class Outage(NamedTuple):
    """When a process was away, by the fault that did it [ns]."""

    begin: int
    end: int


class Gap(NamedTuple):
    """Two stamps that do not follow each other [ns], and whether an outage explains it."""

    begin: int
    end: int
    explained: bool


def gaps(stamps: Iterable[int], outages: Sequence[Outage]) -> list[Gap]:
    """
    Return where stamps are more than `GAP` apart, or go back.

    Parameters
    ----------
    stamps : iterable of int
        As they were recorded [ns].
    outages : sequence of Outage
        Of those who publish and record them.

    """
    return [Gap(a, b, any(o.begin - MARGIN < max(a, b) and min(a, b) < o.end + MARGIN
                          for o in outages))
            for a, b in itertools.pairwise(stamps) if not 0 < b - a <= GAP]


def complaints(document: Mapping[str, Any]) -> list[str]:
    """Return what makes the run a failure."""
    result = list(document['failures'])
    missing = sum(x['injected'] - x['recovered'] - x['not_judged']
                  for x in document['faults'].values())
    if missing > len(result):
        result.append(f'{missing} faults were not recovered from, in all')
    result += document['deaths']
    for name, p in document['processes'].items():
        if _grows(p):
            result.append(f'{name}: memory grows by {p["growth_kb_per_min"]:.0f} kB/min over '
                          f'{p["fitted_s"]:.0f} s')
    bags = document['bags']
    if bags['unexplained_gaps']:
        result.append(f'{bags["unexplained_gaps"]} gaps in the stamps of {JOINT_STATES} that no '
                      'fault explains')
    if bags['unexplained_dropped']:
        result.append(f'{bags["unexplained_dropped"]} messages were dropped while nothing was '
                      'stopped')
    return [*result, *bags['unreadable']]


def _grows(process: Mapping[str, Any]) -> bool:
    growth, span = process['growth_kb_per_min'], process['fitted_s']
    return (growth is not None and span >= JUDGED and growth > GROWTH
            and growth * span / 60.0 > GROWN)


def to_markdown(document: Mapping[str, Any]) -> str:
    """Return the tables and the verdict."""
    machine, bags, faults = document['machine'], document['bags'], document['faults']
    longest = [x['longest_recovery_s'] for x in faults.values() if x['longest_recovery_s']]
    totals = [sum(x[key] for x in faults.values())
              for key in ('injected', 'recovered', 'not_judged')]
    speed = machine['speed']
    lines = ['# Soak', '', *_table(('', ''), (
        ('duration', f'{document["duration_s"] / 60.0:.1f} min of '
                     f'{document["asked_s"] / 60.0:.1f}'),
        ('seed', document['seed']),
        ('control period', f'{1e3 * document["control_period_s"]:g} ms'),
        ('machine', f'{machine["processor"]}, {machine["cores"]} cores'),
        ('system', f'Python {machine["python"]}, {machine["kernel"]}'),
        ('speed', f'{speed["least"]:.0%} of that at the beginning at worst, below {SLOW:.0%} '
                  f'for {speed["slow_s"]} s')))]
    lines += ['', '## Faults', '',
              f'Recovered: within {PATIENCE:g} s all nodes say that they run, the controller at '
              f'{RATE:.0%} of its rate or more, the recorder at as much. They say so once a '
              f'second. Not judged: not recovered, while the machine computed at less than '
              f'{SLOW:.0%} of its speed at the beginning.', '']
    lines += _table(('fault', 'injected', 'recovered', 'not judged', 'longest recovery [s]'), (
        *((kind, x['injected'], x['recovered'], x['not_judged'],
           _shown(x['longest_recovery_s'], '.1f'))
          for kind, x in faults.items()),
        ('**all**', *totals, _shown(max(longest, default=None), '.1f'))))
    lines += ['', '## Processes', '',
              'Samples, misses, refused messages and timeouts over all generations of a process; '
              f'memory (resident) of the longest-lived one and its growth, fitted, from '
              f'{WARM_UP:g} s on. Allowed: {GROWTH:g} kB/min, or {GROWN:g} kB in all.', '']
    lines += _table(
        ('process', 'samples', 'misses', 'refused', 'timeouts', 'restarts', 'deaths',
         'waited for a processor [s]', 'memory [MB]', 'growth [kB/min]', 'over [s]'),
        ((name, _shown(p['samples']), _shown(p['misses']), sum(p['refused'].values()),
          sum(p['timeouts'].values()), p['restarts'], p['deaths'], f'{p["waited_s"]:.1f}',
          f'{p["memory_start_kb"] / 1e3:.1f} → {p["memory_end_kb"] / 1e3:.1f}',
          _shown(p['growth_kb_per_min'], '.1f'), f'{p["fitted_s"]:.0f}')
         for name, p in document['processes'].items()))
    kinds = [(name, what, count) for name, p in document['processes'].items()
             for group in ('refused', 'timeouts') for what, count in p[group].items()]
    lines += ['', '## Refused messages and timeouts', '', *_table(
        ('process', 'what', 'count'), kinds)]
    lines += ['', '## Bags', '',
              f'Gaps: more than {seconds(GAP):g} s between two stamps of {JOINT_STATES}. '
              'Explained: the plant or the recorder was stopped or killed then.', '']
    lines += _table(
        ('bags', 'salvaged', 'messages', 'joint states', 'gaps', 'longest [s]', 'unexplained',
         'dropped', 'unexplained'),
        [(bags['count'], bags['salvaged'], bags['messages'], bags['states'], bags['gaps'],
          f'{bags["longest_gap_s"]:.2f}', bags['unexplained_gaps'], bags['dropped'],
          bags['unexplained_dropped'])])
    found = complaints(document)
    verdict = [f'- {line}' for line in found] or ['Passed.']
    return '\n'.join([*lines, '', '## Verdict', '', *verdict, ''])


def _table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    return [f'| {" | ".join(map(str, cells))} |'
            for cells in (heads, ['---'] * len(heads), *rows)]


def _shown(value: float | None, form: str = 'd') -> str:
    return '' if value is None else format(value, form)
