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

"""The outcomes of a comparison in tables and as CSV; the best is bold, whoever it is."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
import itertools
import json
from math import inf
from statistics import median

from ctc_chattering.analysis.markup import Markup
from ctc_chattering.analysis.output import finite
from ctc_chattering.analysis.tables import bold, csv_text, markdown, markdown_table, Table
from ctc_chattering.studies.comparison import BASE, BEST, Outcome, Variant

#: A number with the text that shows it.
Number = tuple[float, str]
_HEAD = list(Variant._fields)
#: Columns of the numbers, and what they are of a score.
_NUMBERS = {'rms_error': 'rms', 'torque_variation_per_s': 'variation', 'max_torque_step': 'step',
            'max_torque_rate_per_s': 'rate', 'max_torque': 'peak',
            'slips_at_rest_per_s': 'slips'}


def tables(outcomes: Sequence[Outcome]) -> Iterator[Table]:
    """
    Yield tables for each robot, plant and condition: robustness, errors, changes of the torque.

    `least` is the smallest ratio of the errors of all joints to that of `BASE`; the first table is
    there with held-out conditions only.
    """
    for group in groups(outcomes):
        if group[0].judged:
            yield _robustness(group)
        joints = group[0].joints
        title = bold(heading(group[0]))
        engines = ' and '.join(dict.fromkeys(x.score.engine for x in group if x.score.engine))
        engine = f'; {engines}' if engines else ''
        yield Table(
            title + f': RMS error [rad], 5 s ≤ t ≤ 10 s{engine}',
            [*_HEAD, *joints, 'least', 'peak torque [N·m]'],
            _rows(group, partial(_errors, base=group[0])), len(_HEAD))
        slips = ' / stick-slips at rest [1/s]' if _stops(group[0]) else ''
        yield Table(
            title + ': torque variation [N·m/s] / largest step [N·m] / largest rate [N·m/s]'
            + slips + engine, [*_HEAD, *joints], _rows(group, _changes), len(_HEAD))


def _robustness(group: Sequence[Outcome]) -> Table:
    """
    Return the table of held-out conditions, the law that survives most of them first.

    Medians are over all conditions; one that is lost counts as the worst.
    """
    best = next((x for x in group if x.task.variant == BEST), group[0])

    def row(outcome: Outcome) -> tuple[float, float, list[str]]:
        found = [x.score for x in outcome.judged]
        errors = sorted(x.error for x in found)
        lost = sum(bool(x.failure) for x in found)
        ratios = [median([a / b for a, b in zip(x.variation, y.score.variation)])
                  for x, y in zip(found, best.judged) if not x.failure and not y.score.failure]
        return lost, median(errors), [
            *outcome.task.variant, f'{len(found) - lost} of {len(found)}',
            *(f'{x:.1e}' if x < inf else 'lost' for x in (errors[-1], median(errors))),
            f'{median(ratios):.2g}' if ratios else '']

    return Table(
        bold(heading(group[0])) + f': {len(group[0].judged)} held-out conditions',
        [*_HEAD, 'survived', 'worst error [rad]', 'median error [rad]',
         f'variation over that of {BEST.law}, {BEST.settings}'],
        [x[2] for x in sorted(map(row, group), key=lambda x: x[:2])], len(_HEAD))


def groups(outcomes: Sequence[Outcome]) -> list[list[Outcome]]:
    """Return the outcomes of each robot, plant and condition."""
    return [list(group) for _, group in itertools.groupby(
        outcomes, lambda x: (x.task.path, x.backend, x.task.condition))]


def heading(outcome: Outcome) -> str:
    """Return robot, plant and condition of an outcome."""
    condition = outcome.task.condition
    return f'{outcome.experiment}, plant {outcome.backend}' + (
        f', {condition.name}' if condition else '')


def _errors(outcome: Outcome, base: Outcome) -> list[list[Number]]:
    """Return the numbers of each cell of the first table; the smallest is the best."""
    found, original = outcome.score, base.score
    least = min(a / b if b else float('inf') for a, b in zip(original.rms, found.rms))
    ratio = '' if outcome.task.variant == BASE else f'{least:.2g}×' if least < 100.0 else (
        f'{least:.0f}×')
    cells = [*((x, f'{x:.1e}') for x in found.rms), (-least, ratio),
             (max(found.peak), f'{max(found.peak):.0f}')]
    return [[cell] for cell in cells]


def _changes(outcome: Outcome) -> list[list[Number]]:
    """Return the numbers of each cell of the second table."""
    found = outcome.score
    slips = [[(x, f'{x:.2g}')] for x in found.slips] if _stops(outcome) else [[]] * len(found.rate)
    return [[(a, f'{a:.0f}'), (b, f'{b:.2g}'), (c, f'{c:.0f}'), *more]
            for a, b, c, more in zip(found.variation, found.step, found.rate, slips)]


def _stops(outcome: Outcome) -> bool:
    """Return whether the motion of a condition has stops."""
    return bool(outcome.task.condition and outcome.task.condition.stops)


def _rows(group: Sequence[Outcome], cells: Callable[[Outcome], list[list[Number]]]
          ) -> list[list[str]]:
    """Return the rows of a table, the smallest number of every column bold."""
    content = [[] if x.score.failure else cells(x) for x in group]
    complete = [row for row in content if row]
    best = [[min(value for value, _ in numbers) for numbers in zip(*column)]
            for column in zip(*complete)]

    def row(outcome: Outcome, numbers: list[list[Number]]) -> list[str]:
        texts = [Markup(' / ').join(bold(text) if value == least and text else text
                                    for (value, text), least in zip(cell, leasts))
                 for cell, leasts in zip(numbers, best)]
        return [*outcome.task.variant, *(texts or ('diverged' for _ in best))]

    return [row(outcome, numbers) for outcome, numbers in zip(group, content)]


def to_markdown(outcomes: Sequence[Outcome]) -> str:
    """Return all tables."""
    return '\n'.join(line for table in tables(outcomes) for line in (
        markdown(table.title), '', *markdown_table(table.heads, table.rows), ''))


def to_csv(outcomes: Sequence[Outcome]) -> str:
    """Return one line per run and joint, with a header; numbers in full, empty if it diverged."""
    rows = []
    for x in outcomes:
        task, found = x.task, x.score
        for i, joint in enumerate(x.joints):
            numbers = {name: getattr(found, key)[i] if getattr(found, key) else None
                       for name, key in _NUMBERS.items()}
            rows.append({
                'experiment': x.experiment, 'backend': x.backend,
                'condition': task.condition.name if task.condition else '',
                **task.variant._asdict(), 'joint': joint, **numbers,
                'failure': found.failure, 'controller': json.dumps(
                    finite(x.runs[0].get('controller', {})), sort_keys=True),
                'engine': found.engine})
    return csv_text(rows)


def held_out_csv(outcomes: Sequence[Outcome]) -> str:
    """Return one line per law and held-out condition: its numbers and all that was changed."""
    rows = []
    for x in outcomes:
        for other, run, found in x.judged:
            rows.append({
                'experiment': x.experiment, 'backend': x.backend, **x.task.variant._asdict(),
                'seed': other.seed, 'index': other.index,
                **{name: json.dumps(getattr(found, key)) if not found.failure else None
                   for name, key in _NUMBERS.items()}, 'failure': found.failure,
                **{node.strip('/*') or 'all': json.dumps(finite(values), sort_keys=True)
                   for node, values in run.items()}, 'engine': found.engine})
    return csv_text(rows)
