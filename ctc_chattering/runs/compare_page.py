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
from typing import Any

from ctc_chattering.analysis import drawing, page
from ctc_chattering.analysis.markup import Markup
from ctc_chattering.analysis.page import FigureFile
from ctc_chattering.analysis.tables import bold, csv_text, markdown, markdown_table, Table
from ctc_chattering.configuration import parameter_file
from ctc_chattering.number_format import format_number
from ctc_chattering.output_files import file_stem, write_text
from ctc_chattering.runs.conditions import CONDITIONS
from ctc_chattering.runs.figures import law_styles, panels, trade_off
from ctc_chattering.runs.points import Points
from ctc_chattering.runs.recommended import BASE, BEST, RECOMMENDED, Variant
from ctc_chattering.runs.score import PER_JOINT
from ctc_chattering.runs.store import FIGURES, PAGE
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
import pandas  # type: ignore[import-untyped]

#: A number with the text that shows it.
Number = tuple[float, str]
#: What a law does under a condition, by the names of columns and of `PER_JOINT`.
Outcome = dict[str, Any]
_HEAD = list(Variant._fields)
#: Columns of the numbers, and what they are of `PER_JOINT`.
_NUMBERS = {'rms_error': 'rms', 'torque_variation_per_s': 'variation', 'max_torque_step': 'step',
            'max_torque_rate_per_s': 'rate', 'max_torque': 'peak',
            'slips_at_rest_per_s': 'slips'}
#: Names in the directory.
ROWS, CSV, TABLE, PARAMETERS = 'compare.parquet', 'compare.csv', 'compare.md', 'parameters'
#: Most conditions whose tables are unfolded.
_MANY = 16
_LEAD = ('Every law with the same motion on the same robot: position error and torque of each '
         'joint, by the settings and under the conditions that the tables name.')


def outcomes(rows: pandas.DataFrame) -> list[Outcome]:
    """
    Return what each law does on each robot under each condition: the worst of its runs.

    Of every number the largest; of each joint in a tuple, which is empty if one of the runs has
    none, for the first `reason` of these.
    """
    found = rows.groupby(['file', 'condition', *_HEAD], sort=False, as_index=False).agg({
        name: 'max' if rows[name].dtype == float else 'first' for name in rows
        if name not in ('file', 'condition', *_HEAD)} | {
            'reason': lambda x: next(filter(None, x), '')})
    return [{
        **x, 'joints': json.loads(x['joints']), 'variant': Variant(*(x[key] for key in _HEAD)),
        'name': ', '.join(filter(None, (x['experiment'], x['condition']))),
        'error': inf if x['reason'] else x['error'], **{
            name: () if x['reason'] else tuple(
                x[f'{key}_{i}'] for i, _ in enumerate(json.loads(x['joints']), 1))
            for name, (key, _) in PER_JOINT.items()}} for x in found.to_dict('records')]


def groups(found: Sequence[Outcome]) -> list[list[Outcome]]:
    """Return the outcomes of each robot and condition; all that are held out are one group."""
    return [list(group) for _, group in itertools.groupby(
        found, lambda x: (x['file'], x['held_out'] or x['condition']))]


def tables(found: Sequence[Outcome]) -> Iterator[Table]:
    """
    Yield tables for each robot, plant and condition: robustness, errors, changes of the torque.

    `least` is the smallest ratio of the errors of all joints to that of `BASE`; the first tables
    are there with held-out conditions only.
    """
    for group in sorted(groups(found), key=lambda x: not x[0]['held_out']):
        first = group[0]
        if first['held_out']:
            yield _robustness(group)
            continue
        stops = first['condition'] in CONDITIONS and CONDITIONS[first['condition']].stops
        yield Table(
            bold(first['name']) + ': RMS error [rad], 5 s ≤ t ≤ 10 s',
            [*_HEAD, *first['joints'], 'least', 'peak torque [N·m]'],
            _rows(group, partial(_errors, base=first)), len(_HEAD))
        yield Table(
            bold(first['name']) + ': torque variation [N·m/s] / largest step [N·m] / largest rate '
            f'[N·m/s]{" / stick-slips at rest [1/s]" * stops}', [*_HEAD, *first['joints']],
            _rows(group, partial(_changes, stops=stops)), len(_HEAD))


def _robustness(group: Sequence[Outcome]) -> Table:
    """
    Return the table of held-out conditions, the law that survives most of them first.

    Medians are over all conditions; one that is lost counts as the worst.
    """
    by: dict[Variant, list[Outcome]] = {}
    for x in group:
        by.setdefault(x['variant'], []).append(x)
    best = by.get(BEST, by[group[0]['variant']])

    def row(variant: Variant, found: list[Outcome]) -> tuple[int, float, list[str]]:
        errors = sorted(x['error'] for x in found)
        lost = errors.count(inf)
        ratios = [median([a / b for a, b in zip(x['variation'], y['variation'])])
                  for x, y in zip(found, best) if not x['reason'] and not y['reason']]
        return lost, median(errors), [
            *variant, f'{len(found) - lost} of {len(found)}',
            *(f'{x:.1e}' if x < inf else 'lost' for x in (errors[-1], median(errors))),
            f'{median(ratios):.2g}' if ratios else '']

    return Table(
        bold(group[0]['experiment']) + f': {len(best)} held-out conditions',
        [*_HEAD, 'survived', 'worst error [rad]', 'median error [rad]',
         f'variation over that of {BEST.law}, {BEST.settings}'],
        [x[2] for x in sorted((row(*x) for x in by.items()), key=lambda x: x[:2])],
        len(_HEAD))


def _errors(outcome: Outcome, base: Outcome) -> list[list[Number]]:
    """Return the numbers of each cell of the first table; the smallest is the best."""
    least = min(a / b if b else inf for a, b in zip(base['rms'], outcome['rms']))
    ratio = '' if outcome['variant'] == BASE else f'{format_number(least, 2)}×'
    peak = max(outcome['peak'])
    return [*([(x, f'{x:.1e}')] for x in outcome['rms']), [(-least, ratio)],
            [(peak, f'{peak:.0f}')]]


def _changes(outcome: Outcome, stops: bool) -> list[list[Number]]:
    """Return the numbers of each cell of the second table."""
    columns = [('variation', '.0f'), ('step', '.2g'), ('rate', '.0f'), ('slips', '.2g')]
    return [list(cell) for cell in zip(*([(x, f'{x:{form}}') for x in outcome[name]]
                                         for name, form in columns[:3 + stops]))]


def _rows(group: Sequence[Outcome], cells: Callable[[Outcome], list[list[Number]]]
          ) -> list[list[str]]:
    """Return the rows of a table, the smallest number of every column bold."""
    content = [[] if x['reason'] else cells(x) for x in group]
    best = [[min(value for value, _ in numbers) for numbers in zip(*column)]
            for column in zip(*filter(None, content))]
    return [[*outcome['variant'], *([
        Markup(' / ').join(bold(text) if value == least and text else text
                           for (value, text), least in zip(cell, leasts))
        for cell, leasts in zip(numbers, best)] or ('diverged' for _ in best))]
        for outcome, numbers in zip(group, content)]


def to_markdown(found: Sequence[Outcome]) -> str:
    """Return all tables."""
    return '\n'.join(line for table in tables(found) for line in (
        markdown(table.title), '', *markdown_table(table.heads, table.rows), ''))


def to_csv(found: Sequence[Outcome]) -> str:
    """Return one line per law and joint, with a header; numbers in full, empty if it diverged."""
    return csv_text([{
        **{name: x[name] for name in ('experiment', 'condition', *_HEAD)}, 'joint': joint,
        **{name: x[key][i] if x[key] else None for name, key in _NUMBERS.items()},
        'failure': x['reason'], 'controller': x['controller']}
        for x in found for i, joint in enumerate(x['joints'])])


def compromises(found: Sequence[Outcome], title: str) -> Figure:
    """Draw error against torque variation, means of the joints, a panel for each condition."""
    variants = list(dict.fromkeys(x['variant'] for x in found))
    looks = {x: {**style, 'linestyle': '', 'markerfacecolor': 'none', 'markeredgewidth': 1.8,
                 **({'marker': '*', 'markersize': 15} if x.settings == RECOMMENDED else
                    {'markersize': 8})}
             for x, style in zip(variants, law_styles([x.law for x in variants]))}
    parts = groups(found)
    figure, axes = panels(title, [x[0]['name'].rpartition(', ')[2] for x in parts],
                          'RMS error [rad]', 3.6)
    for ax, group in zip(axes, parts):
        trade_off(ax, [(_mean(x['variation']), _mean(x['rms']), looks[x['variant']])
                       for x in group], 'diverged')
    drawing.legend(figure, [Line2D([], [], label=', '.join(
        filter(None, (x.switching or x.law, x.settings))), **style) for x, style in looks.items()])
    return figure


def _mean(values: Sequence[float]) -> float:
    """Return the geometric mean; inf without a number."""
    return geometric_mean([max(x, 1e-300) for x in values]) if values else inf


def figures(found: Sequence[Outcome]) -> Iterator[tuple[str, Figure, str]]:
    """Yield name, figure and caption of each robot."""
    for experiment, mine in itertools.groupby(found, lambda x: str(x['experiment'])):
        yield experiment, compromises(
            [x for x in mine if not x['held_out']], f'{experiment}: error and torque variation'), (
                'Geometric means over the joints, 5 s to 10 s, a panel for each condition; lower '
                'left is better.')


def write_comparison(comparison: Points, rows: pandas.DataFrame, out: Path,
                     extra: str = 'svg', command: str = '') -> None:
    """
    Write tables, figures, page, and a parameter file of every run.

    Parameters
    ----------
    comparison : Points
        What was run.
    rows : pandas.DataFrame
        Its rows.
    out : Path
        Directory of ``index.html``, ``figures`` and the files named above.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        What was run, for the page.

    Raises
    ------
    CtcError
        If a file cannot be written.

    """
    found = outcomes(rows)
    write_text(out / TABLE, to_markdown(found))
    write_text(out / CSV, to_csv(found))
    write_parameters(comparison, out / PARAMETERS)
    write_page(found, drawing.save(figures(found), out / FIGURES, ('svg', extra)), out / PAGE,
               command)


def write_page(found: Sequence[Outcome], files: Sequence[FigureFile], path: Path,
               command: str = '') -> None:
    """
    Write the page; raise `CtcError` if that cannot be done.

    Law, switching and settings are one column, which stays where a table scrolls sideways.
    """
    numbers = [page.Folded(x.title, [x._replace(
        title='', heads=['law', *x.heads[len(_HEAD):]], names=1, rows=[
            [f'{" ".join(row[:2]).strip()}, {row[2]}', *row[len(_HEAD):]] for row in x.rows])],
        len(groups(found)) <= _MANY) for x in tables(found)]
    page.write_page(path, 'The laws compared', _LEAD, [
        page.Section('Figures', files), page.Section('Numbers', numbers)],
        [(name, name) for name in (CSV, TABLE, ROWS, PARAMETERS)], command)


def write_parameters(comparison: Points, directory: Path) -> None:
    """Write a file for every run, as `ctc simulate` takes it."""
    used: set[str] = set()
    for x, setup in comparison.listed:
        stem = '_'.join(filter(None, (x['experiment'], x['condition'], x['switching'] or (
            x['law']), x['settings'], x['part'])))
        parameter_file.dump(setup.values, directory / f'{file_stem(stem, used)}.yaml')
