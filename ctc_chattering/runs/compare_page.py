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

"""What a comparison writes: tables, CSV, figures, page, and a parameter file for every run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
import itertools
import json
from math import inf
from pathlib import Path
from statistics import geometric_mean, median

from ctc_chattering.analysis import drawing, output, page
from ctc_chattering.analysis.markup import Markup
from ctc_chattering.analysis.page import FigureFile
from ctc_chattering.analysis.tables import bold, csv_text, markdown, markdown_table, Table
from ctc_chattering.configuration import parameter_file
from ctc_chattering.parameters import check_some
from ctc_chattering.runs.compare import BASE, BEST, Outcome, RECOMMENDED, Variant
from ctc_chattering.runs.figures import law_styles, panels, trade_off
from ctc_chattering.runs.score import Score
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

#: A number with the text that shows it.
Number = tuple[float, str]
_HEAD = list(Variant._fields)
#: Columns of the numbers, and what they are of a score.
_NUMBERS = {'rms_error': 'rms', 'torque_variation_per_s': 'variation', 'max_torque_step': 'step',
            'max_torque_rate_per_s': 'rate', 'max_torque': 'peak',
            'slips_at_rest_per_s': 'slips'}
#: Names in the directory.
TABLE, CSV, PAGE, FIGURES, PARAMETERS = NAMES = (
    'compare.md', 'compare.csv', 'index.html', 'figures', 'parameters')
#: Most conditions whose tables are unfolded.
_MANY = 16
_LEAD = ('Every law with the same motion on the same robot: position error and torque of each '
         'joint, by the settings and under the conditions that the tables name.')


def groups(outcomes: Sequence[Outcome]) -> list[list[Outcome]]:
    """Return the outcomes of each robot and condition; all that are held out are one group."""
    return [list(group) for _, group in itertools.groupby(
        outcomes, lambda x: (x.task.path, x.task.held_out or x.task.condition))]


def tables(outcomes: Sequence[Outcome]) -> Iterator[Table]:
    """
    Yield tables for each robot, plant and condition: robustness, errors, changes of the torque.

    `least` is the smallest ratio of the errors of all joints to that of `BASE`; the first tables
    are there with held-out conditions only.
    """
    for group in sorted(groups(outcomes), key=lambda x: not x[0].task.held_out):
        first, title = group[0], group[0].name
        if first.task.held_out:
            yield _robustness(group)
            continue
        yield Table(
            bold(title) + ': RMS error [rad], 5 s ≤ t ≤ 10 s',
            [*_HEAD, *first.joints, 'least', 'peak torque [N·m]'],
            _rows(group, partial(_errors, base=first)), len(_HEAD))
        stops = first.task.condition.stops
        slips = ' / stick-slips at rest [1/s]' if stops else ''
        yield Table(
            bold(title) + ': torque variation [N·m/s] / largest step [N·m] / largest rate '
            f'[N·m/s]{slips}', [*_HEAD, *first.joints],
            _rows(group, partial(_changes, stops=stops)), len(_HEAD))


def _robustness(group: Sequence[Outcome]) -> Table:
    """
    Return the table of held-out conditions, the law that survives most of them first.

    Medians are over all conditions; one that is lost counts as the worst.
    """
    scores: dict[Variant, list[Score]] = {}
    for x in group:
        scores.setdefault(x.task.variant, []).append(x.score)
    best = scores.get(BEST, scores[group[0].task.variant])

    def row(variant: Variant, found: list[Score]) -> tuple[int, float, list[str]]:
        errors = sorted(x.error for x in found)
        lost = sum(bool(x.failure) for x in found)
        ratios = [median([a / b for a, b in zip(x.variation, y.variation)])
                  for x, y in zip(found, best) if not x.failure and not y.failure]
        return lost, median(errors), [
            *variant, f'{len(found) - lost} of {len(found)}',
            *(f'{x:.1e}' if x < inf else 'lost' for x in (errors[-1], median(errors))),
            f'{median(ratios):.2g}' if ratios else '']

    return Table(
        bold(group[0].experiment) + f': {len(best)} held-out conditions',
        [*_HEAD, 'survived', 'worst error [rad]', 'median error [rad]',
         f'variation over that of {BEST.law}, {BEST.settings}'],
        [x[2] for x in sorted((row(*x) for x in scores.items()), key=lambda x: x[:2])],
        len(_HEAD))


def _errors(outcome: Outcome, base: Outcome) -> list[list[Number]]:
    """Return the numbers of each cell of the first table; the smallest is the best."""
    found = outcome.score
    least = min(a / b if b else inf for a, b in zip(base.score.rms, found.rms))
    number = f'{least:.2g}' if least < 100.0 else f'{least:.0f}'
    ratio = '' if outcome.task.variant == BASE else f'{number}×'
    return [*([(x, f'{x:.1e}')] for x in found.rms), [(-least, ratio)],
            [(max(found.peak), f'{max(found.peak):.0f}')]]


def _changes(outcome: Outcome, stops: bool) -> list[list[Number]]:
    """Return the numbers of each cell of the second table."""
    found = outcome.score
    columns = [(found.variation, '.0f'), (found.step, '.2g'), (found.rate, '.0f'),
               *([(found.slips, '.2g')] if stops else [])]
    return [list(cell) for cell in zip(*([(x, f'{x:{form}}') for x in values]
                                         for values, form in columns))]


def _rows(group: Sequence[Outcome], cells: Callable[[Outcome], list[list[Number]]]
          ) -> list[list[str]]:
    """Return the rows of a table, the smallest number of every column bold."""
    content = [[] if x.score.failure else cells(x) for x in group]
    best = [[min(value for value, _ in numbers) for numbers in zip(*column)]
            for column in zip(*filter(None, content))]
    return [[*outcome.task.variant, *([
        Markup(' / ').join(bold(text) if value == least and text else text
                           for (value, text), least in zip(cell, leasts))
        for cell, leasts in zip(numbers, best)] or ('diverged' for _ in best))]
        for outcome, numbers in zip(group, content)]


def to_markdown(outcomes: Sequence[Outcome]) -> str:
    """Return all tables."""
    return '\n'.join(line for table in tables(outcomes) for line in (
        markdown(table.title), '', *markdown_table(table.heads, table.rows), ''))


def to_csv(outcomes: Sequence[Outcome]) -> str:
    """Return one line per run and joint, with a header; numbers in full, empty if it diverged."""
    return csv_text([{
        'experiment': x.experiment, 'condition': x.task.condition.name,
        **x.task.variant._asdict(), 'joint': joint,
        **{name: getattr(x.score, key)[i] if getattr(x.score, key) else None
           for name, key in _NUMBERS.items()},
        'failure': x.score.failure, 'controller': json.dumps(
            output.finite(x.runs[0].get('controller', {})), sort_keys=True)}
        for x in outcomes for i, joint in enumerate(x.joints)])


def compromises(outcomes: Sequence[Outcome], title: str) -> Figure:
    """Draw error against torque variation, means of the joints, a panel for each condition."""
    variants = list(dict.fromkeys(x.task.variant for x in outcomes))
    looks = {x: {**style, 'linestyle': '', 'markerfacecolor': 'none', 'markeredgewidth': 1.8,
                 **({'marker': '*', 'markersize': 15} if x.settings == RECOMMENDED else
                    {'markersize': 8})}
             for x, style in zip(variants, law_styles([x.law for x in variants]))}
    parts = groups(outcomes)
    figure, axes = panels(title, [x[0].name.rpartition(', ')[2] for x in parts],
                          'RMS error [rad]', 3.6)
    for ax, group in zip(axes, parts):
        trade_off(ax, [(_mean(x.score.variation), _mean(x.score.rms), looks[x.task.variant])
                       for x in group], 'diverged')
    drawing.legend(figure, [Line2D([], [], label=', '.join(
        filter(None, (x.switching or x.law, x.settings))), **style) for x, style in looks.items()])
    return figure


def _mean(values: Sequence[float]) -> float:
    """Return the geometric mean; inf without a number."""
    return geometric_mean([max(x, 1e-300) for x in values]) if values else inf


def figures(outcomes: Sequence[Outcome]) -> Iterator[tuple[str, Figure, str]]:
    """Yield name, figure and caption of each robot."""
    for experiment, mine in itertools.groupby(outcomes, lambda x: x.experiment):
        yield experiment, compromises(
            [x for x in mine if not x.task.held_out],
            f'{experiment}: error and torque variation'), (
                'Geometric means over the joints, 5 s to 10 s, a panel for each condition; lower '
                'left is better.')


def write_comparison(outcomes: Sequence[Outcome], out: str | Path, extra: str = 'svg',
                     command: str = '') -> None:
    """
    Write tables, figures, page, and a parameter file of every run.

    Parameters
    ----------
    outcomes : sequence of Outcome
        What `compare` has returned.
    out : str or Path
        Directory for ``compare.md``, ``compare.csv``, ``figures``, ``index.html``,
        ``parameters``.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        What was run, for the page.

    Raises
    ------
    CtcError
        If there is no outcome, a file exists already, or cannot be written.

    """
    check_some('outcomes', outcomes)
    output.check_format(extra)
    out = output.prepare(Path(out), NAMES)
    output.write_text(out / TABLE, to_markdown(outcomes))
    output.write_text(out / CSV, to_csv(outcomes))
    write_parameters(outcomes, out / PARAMETERS)
    write_page(outcomes, drawing.save(figures(outcomes), out / FIGURES, ('svg', extra)),
               out / PAGE, command)


def write_page(outcomes: Sequence[Outcome], files: Sequence[FigureFile], path: Path,
               command: str = '') -> None:
    """Write the page; raise `CtcError` if that cannot be done."""
    few = len(groups(outcomes)) <= _MANY
    numbers = [page.Folded(x.title, [x._replace(title='')], few) for x in tables(outcomes)]
    page.write_page(path, 'The laws compared', _LEAD, [
        page.Section('Figures', files), page.Section('Numbers', numbers)],
        [(name, name) for name in (CSV, TABLE, PARAMETERS)], command)


def write_parameters(outcomes: Sequence[Outcome], directory: Path) -> None:
    """Write a file for every run, as `ctc simulate` takes it."""
    used: set[str] = set()
    with output.writing(directory):
        directory.mkdir(parents=True, exist_ok=True)
        for x in outcomes:
            condition, variant = x.task.condition, x.task.variant
            for k, run in enumerate(x.runs):
                stem = '_'.join(filter(None, (
                    x.experiment, condition.name, variant.switching or variant.law,
                    variant.settings,
                    f'model_{condition.factors[k]:g}' if len(x.runs) > 1 else '')))
                parameter_file.dump(parameter_file.load(x.task.path, run).values,
                                    directory / f'{output.file_stem(stem, used)}.yaml')
