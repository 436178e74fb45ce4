"""
Comparison of the switchings over the cases of `cases.py`.

A run is a pure function of the case and the switching, so that the numbers depend neither on the
number of processes nor on their order. `study_files` writes them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
import csv
import dataclasses
from functools import partial
import io
import itertools
import json
import math

from ctc_chattering.analysis.engine import engine_text, simulated_by
from ctc_chattering.analysis.markup import fragment, Markup
from ctc_chattering.analysis.metrics import metrics
from ctc_chattering.analysis.tables import bold, Table
from ctc_chattering.configuration.parameter_file import Setup
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.errors import CtcError
from ctc_chattering.studies.cases import Case, KA
from ctc_chattering.studies.pool import in_parallel

#: What the tables show: attribute, heading, unit, format.
QUANTITIES = (('error', 'RMS e', 'rad', '.2e'),
              ('variation', 'torque variation', 'N·m/s', '.0f'))
Pair = tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Outcome:
    """
    One run; the numbers are None if it diverged, and are of the second half of the run.

    Attributes
    ----------
    case : Case
        What was run.
    variant : str
        Switching, or law.
    control_period, ka
        h [s], gains [N·m].
    error, variation : (float, float), optional
        True RMS error [rad] and torque variation [N·m/s] of joints 1 and 2.
    failure : str
        Why it ended early; empty if it did not.
    engine : str
        What simulated it, as `engine_text` says it.

    """

    case: Case
    variant: str
    control_period: float
    ka: tuple[float, ...]
    error: Pair | None = None
    variation: Pair | None = None
    failure: str = ''
    engine: str = ''


def evaluate(case: Case, switching: str, setup: Setup, engine: str | None = None) -> Outcome:
    """Run `setup`, which is ``case.setup()``, under `switching`; return its numbers."""
    controller = setup.controller.changed({'switching': switching})
    return run_setup(case, switching, dataclasses.replace(setup, controller=controller), engine)


def run_setup(case: Case, variant: str, setup: Setup, engine: str | None = None) -> Outcome:
    """Run `setup`, made of a case for a switching or a law; return its numbers."""
    controller, end = setup.controller, setup.plant.duration
    outcome = Outcome(case, variant, controller.control_period, controller.ka,
                      engine=engine_text(setup, engine))
    try:
        run = simulated_by(setup, engine, truth=True).run
    except CtcError as failure:
        return dataclasses.replace(outcome, failure=str(failure))
    m = metrics(run, (0.5 * end, end))
    return dataclasses.replace(outcome, error=tuple(m['rms_error_rad']),
                               variation=tuple(m['torque_variation_nm_per_s']))


def _evaluate(task: tuple[Case, str, Setup], engine: str | None) -> Outcome:
    return evaluate(*task, engine)


def run_cases(cases: Sequence[Case], switchings: Sequence[str] = SWITCHINGS, jobs: int = 1,
              engine: str | None = None) -> Iterator[Outcome]:
    """
    Yield the outcome of every case under every switching.

    Parameters
    ----------
    cases, switchings
        What to run; the outcomes are in this order, case by case.
    jobs : int
        Processes; 1 for this one alone.
    engine : str, optional
        As `engine_of` takes it.

    Raises
    ------
    CtcError
        If the parameters of a case are not allowed; before anything is run.

    """
    setups = [case.setup() for case in cases]
    tasks = [(case, switching, setup)
             for case, setup in zip(cases, setups) for switching in switchings]
    yield from in_parallel(partial(_evaluate, engine=engine), tasks, jobs)


def rows(outcomes: Sequence[Outcome]) -> list[list[Outcome]]:
    """Return the outcomes case by case."""
    return [list(group) for _, group in itertools.groupby(
        outcomes, lambda outcome: (outcome.case.group, outcome.case.name))]


def engines(outcomes: Sequence[Outcome]) -> str:
    """Return what simulated how many of the runs."""
    counts = Counter(o.engine for o in outcomes)
    return 'Runs by engine: ' + ', '.join(f'{name} {n}' for name, n in counts.items())


def to_csv(outcomes: Sequence[Outcome], variant: str = 'switching') -> str:
    """
    Return one line per run, with a header; numbers in full, empty where there is none.

    Parameters
    ----------
    outcomes : sequence of Outcome
        One a line.
    variant : str
        What their variants are.

    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow((
        'group', 'case', 'x', variant, 'control_period_s', 'ka_1_nm', 'ka_2_nm',
        'rms_error_1_rad', 'rms_error_2_rad', 'torque_variation_1_nm_per_s',
        'torque_variation_2_nm_per_s', 'failure', 'file', 'overrides', 'engine'))
    for o in outcomes:
        writer.writerow((
            o.case.group, o.case.name, o.case.x, o.variant, o.control_period, *o.ka,
            *(o.error or ('', '')), *(o.variation or ('', '')), o.failure, o.case.file,
            json.dumps(o.case.overrides, ensure_ascii=False, sort_keys=True), o.engine))
    return text.getvalue()


def about(outcomes: Sequence[Outcome]) -> Markup:
    """Return what the tables show."""
    return fragment(
        'Output of <code>ctc study</code>. True errors and torques sent, joints 1 / 2, over the '
        'second half of each run; h = 1 ms and ka = {{ ka }} N·m unless the row says otherwise; '
        'every other parameter has its default. Bold: the best of a row. {{ engines }}.',
        ka=f'{KA:g}', engines=engines(outcomes))


def tables(outcomes: Sequence[Outcome]) -> Iterator[Table]:
    """Yield a table for each group of cases, and the ranking of the switchings."""
    heads = ['case', 'quantity', *dict.fromkeys(o.variant for o in outcomes)]
    for group, members in itertools.groupby(rows(outcomes), lambda row: row[0].case.group):
        yield Table(group, heads, [line for row in members for line in _lines(row)], 2)
    yield _ranking(rows(outcomes))


def _lines(row: Sequence[Outcome]) -> Iterator[list[str]]:
    """Yield a line of cells for each quantity of one case."""
    for k, (key, quantity, unit, form) in enumerate(QUANTITIES):
        texts = [[format(x, form) for x in getattr(o, key) or ()] for o in row]
        columns = list(zip(*filter(None, texts)))
        best = [min(column, key=float) if len(set(column)) > 1 else '' for column in columns]
        cells = [Markup(' / ').join(bold(x) if x == y else x for x, y in zip(text, best))
                 or 'diverged' for text in texts]
        yield ['' if k else row[0].case.name, f'{quantity} [{unit}]', *cells]


def _ranking(table: Sequence[Sequence[Outcome]]) -> Table:
    """Return how often each switching is best and worst."""
    counts = Counter(('runs that diverged', o.variant) for row in table for o in row
                     if o.failure)
    for row, (key, quantity, _, _), joint in itertools.product(table, QUANTITIES, (0, 1)):
        ranked = sorted(row, key=lambda o: (getattr(o, key) or (math.inf, math.inf))[joint])
        counts[f'smallest {quantity}', ranked[0].variant] += 1
        counts[f'largest {quantity}', ranked[-1].variant] += 1
    heads = [*(f'{extreme} {quantity}' for extreme in ('smallest', 'largest')
               for _, quantity, _, _ in QUANTITIES), 'runs that diverged']
    return Table(
        'Ranking', ['switching', *heads],
        [[o.variant, *(str(counts[head, o.variant]) for head in heads)] for o in table[0]],
        note=f'{2 * len(table)} comparisons: {len(table)} cases with two joints each.')
