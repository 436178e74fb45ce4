"""
Comparison of the switchings over sample period, gain and the imperfections of a real loop.

A case is data; a run of it is a pure function of the case and the switching, so that the numbers
depend neither on the number of processes nor on their order. `study_figures` draws them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
import csv
import dataclasses
import io
import itertools
import json
import math
from multiprocessing import get_context
import signal
from typing import Any

from ctc_chattering.analysis.metrics import metrics
from ctc_chattering.analysis.output import markdown_table
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.errors import CtcError
from ctc_chattering.experiment import parameter_file
from ctc_chattering.experiment.package_share import config_directory
from ctc_chattering.experiment.parameter_file import Setup
from ctc_chattering.simulation.closed_loop import simulate

#: Groups of cases.
BASIC = 'Basic cases'
PERIOD, GAIN = 'Sample period', 'Gain'
NOISE, SHORT_NOISE = 'Velocity noise', 'Velocity noise, h = 0.5 ms'
#: What the tables show: attribute, heading, unit, format.
QUANTITIES = (('error', 'RMS e', 'rad', '.2e'),
              ('variation', 'torque variation', 'N·m/s', '.0f'))
_KA = 12.0
Pair = tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Case:
    """
    One experiment, run under every switching.

    Attributes
    ----------
    name, group : str
        What differs from the other cases of the group; the table that contains it.
    overrides : mapping
        Values by node and parameter above those of the file, as `parameter_file.load` takes them.
    file : str
        Parameter file in `config/`, without its ending.
    x : float, optional
        Abscissa in a figure over the group.

    """

    name: str
    group: str
    overrides: Mapping[str, Mapping[str, Any]]
    file: str = 'friction'
    x: float | None = None

    def setup(self) -> Setup:
        """Return the checked parameters; the switching is still that of the file."""
        return parameter_file.load(config_directory() / f'{self.file}.yaml', self.overrides)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """
    One run; the numbers are None if it diverged, and are of the second half of the run.

    Attributes
    ----------
    case, switching, control_period, ka
        What was run; h [s], gains [N·m].
    error, variation : (float, float), optional
        True RMS error [rad] and torque variation [N·m/s] of joints 1 and 2.
    failure : str
        Why it ended early; empty if it did not.

    """

    case: Case
    switching: str
    control_period: float
    ka: tuple[float, ...]
    error: Pair | None = None
    variation: Pair | None = None
    failure: str = ''


def _case(group: str, name: str, x: float | None = None, *, h: float = 1e-3, ka: float = _KA,
          plant: Mapping[str, Any] | None = None, controller: Mapping[str, Any] | None = None,
          file: str = 'friction') -> Case:
    return Case(name, group, {
        '/**': {'control_period': h}, 'plant': {'duration': 10.0, **(plant or {})},
        'controller': {'law': 'chattering', 'ka': [ka, ka], **(controller or {})}}, file, x)


def _scaled(factor: float) -> dict[str, float]:
    return {'inertia_scale': factor, 'gravity_scale': factor}


def _basic_cases() -> Iterator[Case]:
    delay = {'input_delay': 1}
    yield _case(BASIC, 'clean')
    yield _case(BASIC, '200 Hz', h=5e-3)
    yield _case(BASIC, 'ka = 20', ka=20.0)
    yield _case(BASIC, 'velocity noise 5e-3 rad/s', plant={'velocity_noise': [5e-3, 5e-3]})
    yield _case(BASIC, 'model × 0.9', controller=_scaled(0.9))
    yield _case(BASIC, 'delay of 1 sample, predicted', plant=delay, controller=delay)
    yield _case(BASIC, 'delay of 1 sample, not predicted', plant=delay)
    yield _case(BASIC, 'disturbance', file='disturbance')


def _sweep(group: str, name: str, parameter: str, values: Sequence[float], h: float = 1e-3
           ) -> Iterator[Case]:
    """Yield a case for each value of a parameter of the plant, the same on both joints."""
    for x in values:
        yield _case(group, name.format(x), x, h=h, plant={parameter: [x, x]})


def _sweeps() -> Iterator[Case]:
    for x in (0.5, 1.0, 2.0, 5.0, 10.0):
        yield _case(PERIOD, f'h = {x:g} ms', x, h=1e-3 * x)
    for x in (10.0, 12.0, 15.0, 20.0, 30.0, 40.0):
        yield _case(GAIN, f'ka = {x:g} N·m', x, ka=x)
    for group, h in ((NOISE, 1e-3), (SHORT_NOISE, 5e-4)):
        yield from _sweep(
            group, 'σ = {:.0e} rad/s', 'velocity_noise', (1e-4, 1e-3, 5e-3, 2e-2), h)
    yield from _sweep('Position noise', 'σ = {:.0e} rad', 'position_noise', (1e-5, 1e-4, 1e-3))
    yield from _sweep(
        'Encoder resolution', '{:.0e} rad', 'encoder_resolution', (1e-5, 1e-4, 1e-3))
    for kind, counts in (('predicted', (1, 2, 5)), ('not predicted', (1, 2))):
        for n in counts:
            yield _case('Input delay', f'{n} sample{"s" if n > 1 else ""}, {kind}', n,
                        plant={'input_delay': n},
                        controller={'input_delay': n if kind == 'predicted' else 0})
    on_track = {'initial_position': [math.pi, 0.5 * math.pi],
                'initial_velocity': [math.pi, math.pi]}
    tight, tighter = [300.0, 50.0], [200.0, 30.0]
    for limit, start in ((tight, {}), (tight, on_track), (tighter, on_track)):
        name = f'{limit[0]:g} / {limit[1]:g} N·m, from {"the reference" if start else "rest"}'
        for more, known in (('', {}), (', known', {'effort_limit': limit})):
            yield _case('Torque saturation', name + more, controller=known,
                        plant={'torque_saturation': limit, **start})
    yield from _sweep('Viscous friction', '{:g} N·m·s/rad', 'viscous_friction', (0.5, 1.0, 2.0))
    yield from _sweep('Stribeck friction', '{:g} N·m', 'stribeck_friction', (1.0, 2.0, 4.0))
    for x in (0.8, 0.9, 1.1, 1.2):
        yield _case('Model of the controller', f'× {x:g}', x, controller=_scaled(x))


#: Every case.
CASES = (*_basic_cases(), *_sweeps())


def evaluate(case: Case, switching: str, setup: Setup) -> Outcome:
    """Run `setup`, which is ``case.setup()``, under `switching`; return its numbers."""
    controller = setup.controller.changed({'switching': switching})
    outcome = Outcome(case, switching, controller.control_period, controller.ka)
    end = setup.plant.duration
    try:
        run = simulate(setup.plant, controller, setup.reference, setup.events, truth=True)
    except CtcError as failure:
        return dataclasses.replace(outcome, failure=str(failure))
    m = metrics(run, (0.5 * end, end))
    return dataclasses.replace(outcome, error=tuple(m['rms_error_rad']),
                               variation=tuple(m['torque_variation_nm_per_s']))


def run_cases(cases: Sequence[Case], switchings: Sequence[str] = SWITCHINGS, jobs: int = 1
              ) -> Iterator[Outcome]:
    """
    Yield the outcome of every case under every switching.

    Parameters
    ----------
    cases, switchings
        What to run; the outcomes are in this order, case by case.
    jobs : int
        Processes; 1 for this one alone.

    Raises
    ------
    CtcError
        If the parameters of a case are not allowed; before anything is run.

    """
    setups = [case.setup() for case in cases]
    tasks = [(case, switching, setup)
             for case, setup in zip(cases, setups) for switching in switchings]
    if jobs == 1:
        yield from itertools.starmap(evaluate, tasks)
        return
    try:
        # A fork of a process that has threads may wait for ever for what they hold. The processes
        # leave Ctrl-C to this one.
        with ProcessPoolExecutor(jobs, get_context('spawn'), signal.signal,
                                 (signal.SIGINT, signal.SIG_IGN)) as pool:
            yield from pool.map(evaluate, *zip(*tasks))
    except BrokenProcessPool:
        raise CtcError('a process of the study was killed; try fewer --jobs') from None


def rows(outcomes: Sequence[Outcome]) -> list[list[Outcome]]:
    """Return the outcomes case by case."""
    return [list(group) for _, group in itertools.groupby(
        outcomes, lambda outcome: (outcome.case.group, outcome.case.name))]


def to_csv(outcomes: Sequence[Outcome]) -> str:
    """Return one line per run, with a header; numbers in full, empty where there is none."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow((
        'group', 'case', 'x', 'switching', 'control_period_s', 'ka_1_nm', 'ka_2_nm',
        'rms_error_1_rad', 'rms_error_2_rad', 'torque_variation_1_nm_per_s',
        'torque_variation_2_nm_per_s', 'failure', 'file', 'overrides'))
    for o in outcomes:
        writer.writerow((
            o.case.group, o.case.name, o.case.x, o.switching, o.control_period, *o.ka,
            *(o.error or ('', '')), *(o.variation or ('', '')), o.failure, o.case.file,
            json.dumps(o.case.overrides, ensure_ascii=False, sort_keys=True)))
    return text.getvalue()


def to_markdown(outcomes: Sequence[Outcome]) -> str:
    """Return a table for each group of cases, and the ranking of the switchings."""
    lines = ['# Study of the switchings', '',
             'Output of `ctc study`. True errors and torques sent, joints 1 / 2, over the second '
             f'half of each run; h = 1 ms and ka = {_KA:g} N·m unless the row says otherwise; '
             'every other parameter has its default. Bold: the best of a row.']
    for group, members in itertools.groupby(rows(outcomes), lambda row: row[0].case.group):
        cells = [line for row in members for line in _lines(row)]
        heads = ['case', 'quantity', *dict.fromkeys(o.switching for o in outcomes)]
        lines += ['', f'## {group}', '', *markdown_table(heads, cells)]
    return '\n'.join([*lines, *_ranking(rows(outcomes)), ''])


def _lines(row: Sequence[Outcome]) -> Iterator[list[str]]:
    """Yield a line of cells for each quantity of one case."""
    for k, (key, quantity, unit, form) in enumerate(QUANTITIES):
        texts = [[format(x, form) for x in getattr(o, key) or ()] for o in row]
        columns = list(zip(*filter(None, texts)))
        best = [min(column, key=float) if len(set(column)) > 1 else '' for column in columns]
        cells = [' / '.join(f'**{x}**' if x == y else x for x, y in zip(text, best)) or 'diverged'
                 for text in texts]
        yield ['' if k else row[0].case.name, f'{quantity} [{unit}]', *cells]


def _ranking(table: Sequence[Sequence[Outcome]]) -> Iterator[str]:
    """Yield the section on how often each switching is best and worst."""
    counts = Counter(('runs that diverged', o.switching) for row in table for o in row
                     if o.failure)
    for row, (key, quantity, _, _), joint in itertools.product(table, QUANTITIES, (0, 1)):
        ranked = sorted(row, key=lambda o: (getattr(o, key) or (math.inf, math.inf))[joint])
        counts[f'smallest {quantity}', ranked[0].switching] += 1
        counts[f'largest {quantity}', ranked[-1].switching] += 1
    heads = [*(f'{extreme} {quantity}' for extreme in ('smallest', 'largest')
               for _, quantity, _, _ in QUANTITIES), 'runs that diverged']
    yield from ('', '## Ranking', '',
                f'{2 * len(table)} comparisons: {len(table)} cases with two joints each.', '')
    yield from markdown_table(['switching', *heads], (
        [o.switching, *(str(counts[head, o.switching]) for head in heads)] for o in table[0]))
