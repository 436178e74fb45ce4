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
The study: switchings, or laws with recommended settings, over period, gain and imperfections.

A run is a pure function of the case and the variant, so that the numbers depend neither on the
number of processes nor on their order.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
import dataclasses
import itertools
import json
import math
from typing import NamedTuple

from ctc_chattering.analysis.markup import fragment, Markup
from ctc_chattering.analysis.tables import bold, csv_text, Table
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.control.laws.registry import LAWS
from ctc_chattering.runs.conditions import Case, read_cases
from ctc_chattering.runs.pool import processes
from ctc_chattering.runs.recommended import recommended_setup
from ctc_chattering.runs.score import Score, score

#: Groups of cases.
BASIC = 'Basic cases'
PERIOD = 'Sample period'
GAIN = 'Gain'
NOISE = 'Velocity noise'
SHORT_NOISE = 'Velocity noise, h = 0.5 ms'
#: Gain of the chattering term, unless a case has another [N·m].
KA = 12.0


def case_setup(case: Case) -> Setup:
    """
    Return the checked parameters of a case; the switching is still that of the file.

    A controller knows what the drives give only where the case says so, not from the file.
    """
    controller = {'effort_limit': math.inf, **case.overrides.get('controller', {})}
    return parameter_file.load(config_directory() / 'friction.yaml',
                               {**case.overrides, 'controller': controller})


#: Every case.
CASES = read_cases(config_directory() / 'cases' / 'imperfections.yaml')


#: What the tables show: attribute, heading, unit, format.
QUANTITIES = (('rms', 'RMS e', 'rad', '.2e'),
              ('variation', 'torque variation', 'N·m/s', '.0f'))
#: Laws of the study, but those whose gains must be searched first.
EVERY_LAW = tuple(law for law in LAWS if law not in ('pid_kalman', 'extended_state_observer'))
#: Those of them whose gains are by the rule of `runs/recommended.py`.
BY_RULE = ('observer_feedback', 'integral')
#: Title of the table that sums up the others.
RANKING = 'Ranking'


class CaseOutcome(NamedTuple):
    """A case under a switching or law, h [s] and gains [N·m] of it, and its numbers."""

    case: Case
    variant: str
    control_period: float
    ka: tuple[float, ...]
    score: Score


def settled(setup: Setup, law: str) -> Setup:
    """
    Return a setup under a law that knows drives and friction, as docs/study/laws.md says.

    `observer_feedback` and `integral` have their rule, other laws the gains of the file.
    """
    made = recommended_setup(setup, law)
    if law in BY_RULE:
        return made
    values = made.controller.as_mapping()
    return dataclasses.replace(setup, controller=setup.controller.changed({'law': law, **{
        name: values[name] for name in (
            'actuator_lag', 'torque_rate_limit', 'effort_rate_limit', 'friction_level',
            'switching')}}))


def setup_of(case: Case, variant: str) -> Setup:
    """Return a case under a switching, or under a law as `settled`."""
    setup = case_setup(case)
    if variant in LAWS:
        return settled(setup, variant)
    return dataclasses.replace(setup, controller=setup.controller.changed({'switching': variant}))


def evaluate(task: tuple[Case, str]) -> CaseOutcome:
    """Run a case under a variant; the numbers are of the second half of the run."""
    setup = setup_of(*task)
    controller, end = setup.controller, setup.plant.duration
    return CaseOutcome(*task, controller.control_period, controller.ka, score(
        setup, (0.5 * end, end), across_gaps=True))


def run_cases(cases: Sequence[Case], variants: Sequence[str], jobs: int = 1
              ) -> Iterator[CaseOutcome]:
    """
    Yield the outcome of every case under every variant.

    Parameters
    ----------
    cases, variants
        What to run; the outcomes are in this order, case by case.
    jobs : int
        Processes; 1 for this one alone.

    Raises
    ------
    CtcError
        If the parameters of a case are not allowed; before anything is run.

    """
    for case in cases:
        case_setup(case)
    with processes(jobs) as each:
        yield from each(evaluate, list(itertools.product(cases, variants)))


def rows(outcomes: Sequence[CaseOutcome]) -> list[list[CaseOutcome]]:
    """Return the outcomes case by case."""
    return [list(group) for _, group in itertools.groupby(
        outcomes, lambda outcome: (outcome.case.group, outcome.case.name))]


def engines(outcomes: Sequence[CaseOutcome]) -> str:
    """Return what simulated how many of the runs."""
    counts = Counter(o.score.engine for o in outcomes)
    return 'Runs: ' + ', '.join(f'{name} {n}' for name, n in counts.items())


def to_csv(outcomes: Sequence[CaseOutcome], variant: str = 'switching') -> str:
    """
    Return one line per run, with a header; numbers in full, empty where there is none.

    Parameters
    ----------
    outcomes : sequence of Outcome
        One a line.
    variant : str
        What their variants are.

    """
    return csv_text([{
        'group': o.case.group, 'case': o.case.name, 'x': o.case.x, variant: o.variant,
        'control_period_s': o.control_period, **_pair('ka_{}_nm', o.ka),
        **_pair('rms_error_{}_rad', o.score.rms),
        **_pair('torque_variation_{}_nm_per_s', o.score.variation), 'failure': o.score.failure,
        'overrides': json.dumps(o.case.overrides, ensure_ascii=False, sort_keys=True),
        'engine': o.score.engine}
        for o in outcomes])


def _pair(name: str, values: Sequence[float]) -> dict[str, object]:
    return dict(zip(map(name.format, (1, 2)), values or (None, None)))


def about(outcomes: Sequence[CaseOutcome]) -> Markup:
    """Return what the tables show."""
    return fragment(
        'Output of <code>make validate</code>. True errors and torques sent, joints 1 / 2, '
        'over the second half of each run; h = 1 ms and ka = {{ ka }} N·m unless the row says '
        'otherwise; '
        'every other parameter has its default. Bold: the best of a row. {{ engines }}.',
        ka=f'{KA:g}', engines=engines(outcomes))


def tables(outcomes: Sequence[CaseOutcome]) -> Iterator[Table]:
    """Yield the ranking of the switchings, and a table for each group of cases."""
    yield _ranking(rows(outcomes))
    heads = ['case', 'quantity', *dict.fromkeys(o.variant for o in outcomes)]
    for group, members in itertools.groupby(rows(outcomes), lambda row: row[0].case.group):
        yield Table(group, heads, [line for row in members for line in _lines(row)], 2)


def _lines(row: Sequence[CaseOutcome]) -> Iterator[list[str]]:
    """Yield a line of cells for each quantity of one case."""
    for k, (key, quantity, unit, form) in enumerate(QUANTITIES):
        texts = [[format(x, form) for x in getattr(o.score, key)] for o in row]
        columns = list(zip(*filter(None, texts)))
        best = [min(column, key=float) if len(set(column)) > 1 else '' for column in columns]
        cells = [Markup(' / ').join(bold(x) if x == y else x for x, y in zip(text, best))
                 or 'diverged' for text in texts]
        yield ['' if k else row[0].case.name, f'{quantity} [{unit}]', *cells]


def _ranking(table: Sequence[Sequence[CaseOutcome]]) -> Table:
    """Return how often each switching is best and worst."""
    counts = Counter(('runs that diverged', o.variant) for row in table for o in row
                     if o.score.failure)
    for row, (key, quantity, _, _), joint in itertools.product(table, QUANTITIES, (0, 1)):
        ranked = sorted(row, key=lambda o: (getattr(o.score, key) or (math.inf, math.inf))[joint])
        counts[f'smallest {quantity}', ranked[0].variant] += 1
        counts[f'largest {quantity}', ranked[-1].variant] += 1
    heads = [*(f'{extreme} {quantity}' for extreme in ('smallest', 'largest')
               for _, quantity, _, _ in QUANTITIES), 'runs that diverged']
    return Table(
        RANKING, ['switching', *heads],
        [[o.variant, *(str(counts[head, o.variant]) for head in heads)] for o in table[0]],
        note=f'{2 * len(table)} comparisons: {len(table)} cases with two joints each.')


BASE = 'compensation'


def ratio(outcome: CaseOutcome, base: CaseOutcome) -> float:
    """Return the RMS error over that of `base`, of the joint where it is larger; inf: diverged."""
    if outcome.score.failure or base.score.failure:
        return math.inf
    return max(mine / theirs for mine, theirs in zip(outcome.score.rms, base.score.rms))


def law_about(outcomes: Sequence[CaseOutcome]) -> Markup:
    """Return what the table shows."""
    return fragment(
        'Output of <code>make validate</code>: RMS error of each law over that of '
        '<code>{{ base }}</code>; of the two joints the larger ratio. True errors, the second '
        'half of each run. Gains are those of the paper, of <code>observer_feedback</code> and '
        '<code>integral</code> those of their rule; <code>chattering</code> has '
        '<code>implicit_observer</code>. Delay, lag and rate limit of the drives are given where '
        'a law takes them, unless the case says otherwise; Coulomb friction is given to '
        '<code>slotine_li</code> and <code>friction_feedforward</code>. Bold: worse than '
        '<code>{{ base }}</code> by more than 1 %; inf: diverged. {{ engines }}.', base=BASE,
        engines=engines(outcomes))


def law_tables(outcomes: Sequence[CaseOutcome]) -> Iterator[Table]:
    """Yield the table of ratios; a law that is worse than `compensation` in a case is bold."""
    table = [{o.variant: o for o in row} for row in rows(outcomes)]
    laws = [law for law in table[0] if law != BASE]
    lines = []
    for row in table:
        case, base = row[BASE].case, row[BASE]
        cells = [ratio(row[law], base) for law in laws]
        lines.append([case.title, *(
            bold(f'{x:.2g}') if x > 1.01 else f'{x:.2g}' for x in cells)])
    yield Table('', ['case', *laws], lines)
