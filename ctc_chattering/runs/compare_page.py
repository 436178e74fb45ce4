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
Tables, figures, page and parameter files of a comparison.

`compare` calls `write_comparison` with the rows of its runs. `outcomes` sums up the runs of each
law on a robot under a condition, and all tables and figures show these.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
import itertools
import json
from math import inf
from pathlib import Path
from statistics import geometric_mean, median
from typing import Any, NamedTuple

from ctc_chattering.analysis import drawing, page
from ctc_chattering.analysis.markup import Markup
from ctc_chattering.analysis.page import FigureFile
from ctc_chattering.analysis.tables import bold, csv_text, markdown, markdown_table, Table
from ctc_chattering.configuration import parameter_file
from ctc_chattering.number_format import format_number
from ctc_chattering.output_files import file_stem, write_text
from ctc_chattering.runs.conditions import CONDITIONS
from ctc_chattering.runs.law_figures import draw_panels, draw_trade_off, law_styles
from ctc_chattering.runs.recommended import BASELINE, BEST, LawSettings
from ctc_chattering.runs.run_lists import RunList
from ctc_chattering.runs.score import PassScore, PER_JOINT, Score
from ctc_chattering.runs.store import FIGURES, PAGE
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
import pandas  # type: ignore[import-untyped]

#: Columns that tell the laws.
LAW_COLUMNS = tuple(BASELINE.columns)
#: Files in the directory.
ROWS = 'compare.parquet'
CSV = 'compare.csv'
TABLE = 'compare.md'
#: Folder of the parameter files.
PARAMETERS = 'parameters'


@dataclasses.dataclass(frozen=True)
class Outcome:
    """
    Result of a law on a robot under a condition.

    Attributes
    ----------
    file, experiment : str
        Parameter file, and its name for the motion.
    condition : str
        Title of the condition.
    is_held_out : bool
        Whether it was drawn after all laws and rules were chosen.
    law : LawSettings
        Law, switching and source of the gains.
    joints : sequence of str
        Names.
    controller : str
        Parameters of the controller as JSON, of the first run.
    score : Score
        Worst numbers of the runs, or the failure of the first run without numbers.
    passes : sequence of PassScore
        Worst numbers of the runs in each pass. It is empty without ``passes``.
    learning : str
        State of the learning at the end, in words, or the failure.

    """

    file: str
    experiment: str
    condition: str
    is_held_out: bool
    law: LawSettings
    joints: Sequence[str]
    controller: str
    score: Score
    passes: Sequence[PassScore]
    learning: str

    @property
    def title(self) -> str:
        """Experiment and condition."""
        return ', '.join(filter(None, (self.experiment, self.condition)))


def outcomes(rows: pandas.DataFrame) -> list[Outcome]:
    """Return an outcome for each law, robot and condition."""
    groups = rows.groupby(['file', 'condition', *LAW_COLUMNS], sort=False)
    return [_outcome(runs) for _, runs in groups]


def _outcome(runs: pandas.DataFrame) -> Outcome:
    """Return the outcome of the runs of a law."""
    first = runs.iloc[0]
    joints = json.loads(first['joints'])
    failure = next(filter(None, runs['reason']), '')
    if failure:
        worst = Score(failure=failure)
    else:
        largest = runs.max(numeric_only=True)
        values: dict[str, Any] = {
            name: tuple(float(largest[f'{column}_{i}']) for i, _ in enumerate(joints, 1))
            for name, (column, _) in PER_JOINT.items()}
        worst = Score(**values)
    passes = [PassScore(*map(max, zip(*x))) for x in zip(*map(json.loads, runs['passes_of_run']))]
    return Outcome(
        file=first['file'], experiment=first['experiment'], condition=first['condition'],
        is_held_out=bool(first['held_out']), law=LawSettings(*first[list(LAW_COLUMNS)]),
        joints=joints, controller=first['controller'], score=worst, passes=passes,
        learning=failure or '; '.join(dict.fromkeys(runs['learning'])))


def grouped(results: Sequence[Outcome]) -> list[list[Outcome]]:
    """
    Return the outcomes of each robot and condition.

    All that are held out are one group.
    """
    return [list(group) for _, group in itertools.groupby(
        results, lambda x: (x.file, x.is_held_out or x.condition))]


def tables(results: Sequence[Outcome]) -> Iterator[Table]:
    """
    Yield the tables of robustness, errors and torque.

    Those of robustness are there with held-out conditions only, and come first. With passes there
    is one of these instead.
    """
    for group in sorted(grouped(results), key=lambda group: not group[0].is_held_out):
        if group[0].is_held_out:
            yield _robustness_table(group)
        elif group[0].passes:
            yield _pass_table(group)
        else:
            yield _error_table(group)
            yield _torque_table(group)


def _robustness_table(group: Sequence[Outcome]) -> Table:
    """
    Return the table of held-out conditions, best law first.

    Medians are over all conditions. One that is lost counts as the worst.
    """
    by_law: dict[LawSettings, list[Outcome]] = {}
    for outcome in group:
        by_law.setdefault(outcome.law, []).append(outcome)
    best = by_law.get(BEST, by_law[group[0].law])
    ranked = sorted(by_law.values(), key=lambda results: (
        sum(bool(x.score.failure) for x in results), median(x.score.error for x in results)))
    return Table(
        bold(group[0].experiment) + f': {len(best)} held-out conditions',
        [*LAW_COLUMNS, 'survived', 'worst error [rad]', 'median error [rad]',
         f'variation over that of {BEST.law}, {BEST.gain_source}'],
        [_robustness_row(results, best) for results in ranked], len(LAW_COLUMNS))


def _robustness_row(results: Sequence[Outcome], best: Sequence[Outcome]) -> list[str]:
    """Return the row of a law beside the best one."""
    errors = [x.score.error for x in results]
    survived = len(errors) - errors.count(inf)
    texts = [f'{x:.1e}' if x < inf else 'lost' for x in (max(errors), median(errors))]
    ratios = []
    for x, y in zip(results, best):
        if not x.score.failure and not y.score.failure:
            joints = zip(x.score.variation, y.score.variation)
            ratios.append(median(a / b for a, b in joints))
    ratio = f'{median(ratios):.2g}' if ratios else ''
    return [*results[0].law.columns.values(), f'{survived} of {len(errors)}', *texts, ratio]


class Number(NamedTuple):
    """A number with the text that shows it."""

    value: float
    text: str


def _error_table(group: Sequence[Outcome]) -> Table:
    """Return errors, their smallest ratio to those of `BASELINE`, and largest torque."""
    lines = []
    for x in group:
        line = [Number(error, f'{error:.1e}') for error in x.score.rms]
        if line:
            gain = min(a / b if b else inf for a, b in zip(group[0].score.rms, x.score.rms))
            peak = max(x.score.peak)
            line.append(Number(-gain, '' if x.law == BASELINE else f'{format_number(gain, 2)}×'))
            line.append(Number(peak, f'{peak:.0f}'))
        lines.append(line)
    return Table(
        bold(group[0].title) + ': RMS error [rad], 5 s ≤ t ≤ 10 s',
        [*LAW_COLUMNS, *group[0].joints, 'least', 'peak torque [N·m]'],
        _rows(group, lines), len(LAW_COLUMNS))


def _torque_table(group: Sequence[Outcome]) -> Table:
    """Return changes of the torque, and stick-slips of a condition with stops."""
    condition = CONDITIONS.get(group[0].condition)
    has_stops = condition is not None and condition.stops
    lines = []
    for x in group:
        columns = [(x.score.variation, '.0f'), (x.score.step, '.2g'), (x.score.rate, '.0f')]
        if has_stops:
            columns.append((x.score.slips, '.2g'))
        lines.append([Number(value, f'{value:{form}}')
                      for values, form in columns for value in values])
    slips = ' / stick-slips at rest [1/s]' if has_stops else ''
    return Table(
        bold(group[0].title) + ': torque variation [N·m/s] / largest step [N·m] / largest rate '
        f'[N·m/s]{slips}', [*LAW_COLUMNS, *group[0].joints],
        _rows(group, lines, len(group[0].joints)), len(LAW_COLUMNS))


def _pass_table(group: Sequence[Outcome]) -> Table:
    """Return errors and torque variation before and after learning."""
    lines = []
    for x in group:
        passes = x.passes or [PassScore(inf, inf, inf)]
        before, after = passes[0], passes[-1]
        columns = [(before.error, '.1e'), (after.error, '.1e'), (after.error_without, '.1e'),
                   (after.error / after.error_without, '.2g'),
                   (before.variation, '.0f'), (after.variation, '.0f')]
        lines.append([Number(value, f'{value:{form}}' if value < inf else '')
                      for value, form in columns])
    head_after = f'after {len(group[0].passes) - 1} passes'
    return Table(
        bold(group[0].title) + ': RMS error [rad] and torque variation [N·m/s] of the worst joint',
        [*LAW_COLUMNS, 'learning', 'error before', head_after, 'then, without learning', 'ratio',
         'variation before', head_after],
        [[*x.law.columns.values(), x.learning, *row[len(LAW_COLUMNS):]]
         for row, x in zip(_rows(group, lines), group)], len(LAW_COLUMNS) + 1)


def _rows(group: Sequence[Outcome], lines: Sequence[Sequence[Number]], cells: int = 0
          ) -> list[list[str]]:
    """
    Return rows with the smallest numbers bold.

    Parameters
    ----------
    group : sequence of Outcome
        Laws of the rows.
    lines : sequence of sequence of Number
        Numbers of each row, none of a law that diverged.
    cells : int
        Cells that share the numbers in turn, by default one for each.

    """
    columns = list(zip(*filter(None, lines)))
    smallest = [min(column).value for column in columns]
    cells = cells or len(columns)
    rows = []
    for outcome, line in zip(group, lines):
        texts = [bold(text) if value == best and text else text
                 for (value, text), best in zip(line, smallest)]
        row = [Markup(' / ').join(texts[k::cells]) for k in range(cells)]
        rows.append([*outcome.law.columns.values(), *(row if line else ['diverged'] * cells)])
    return rows


def to_markdown(results: Sequence[Outcome]) -> str:
    """Return all tables."""
    return '\n'.join(line for table in tables(results) for line in (
        markdown(table.title), '', *markdown_table(table.heads, table.rows), ''))


def to_csv(results: Sequence[Outcome]) -> str:
    """
    Return a line per law and joint, with a header. With passes it is one per law and pass.

    Numbers are in full, and empty for a law that diverged.
    """
    if results[0].passes:
        return csv_text([
            {'experiment': x.experiment, 'condition': x.condition, **x.law.columns, 'pass': k,
             'rms_error': error, 'torque_variation_per_s': variation,
             'rms_error_without_learning': without, 'learning': x.learning,
             'controller': x.controller}
            for x in results
            for k, (error, variation, without) in enumerate(x.passes or [(None, None, None)])])
    numbers = {'rms_error': 'rms', 'torque_variation_per_s': 'variation',
               'max_torque_step': 'step', 'max_torque_rate_per_s': 'rate', 'max_torque': 'peak',
               'slips_at_rest_per_s': 'slips'}
    lines: list[dict[str, object]] = []
    for x in results:
        for i, joint in enumerate(x.joints):
            values = {column: getattr(x.score, name)[i] if x.score.rms else None
                      for column, name in numbers.items()}
            lines.append({'experiment': x.experiment, 'condition': x.condition, **x.law.columns,
                          'joint': joint, **values, 'failure': x.score.failure,
                          'controller': x.controller})
    return csv_text(lines)


def draw_passes(group: Sequence[Outcome], title: str) -> Figure:
    """Draw error and torque variation by pass, a line for each law."""
    figure, axes = draw_panels(title, ['error', 'torque variation'], 'RMS error [rad]', 3.6)
    for x, style in zip(group, law_styles([x.law.law for x in group])):
        name = f'{x.law.switching or x.law.law}, {x.law.gain_source}'
        for ax, values in zip(axes, zip(*x.passes)):
            ax.plot(values, **style, markersize=5, label=name, clip_on=False)
            ax.set(xlabel='passes learned from')
            ax.locator_params('x', integer=True)
        without = [numbers.error_without for numbers in x.passes]
        axes[0].plot(without, color=style['color'], linestyle=':', clip_on=False)
    axes[0].set(yscale='log')
    axes[1].set(ylabel='torque variation [N·m/s]', ylim=(0.0, None))
    drawing.legend_of(*axes)
    return figure


def draw_compromises(results: Sequence[Outcome], title: str) -> Figure:
    """Draw error against torque variation for each condition."""
    laws = list(dict.fromkeys(x.law for x in results))
    looks = {}
    for law, style in zip(laws, law_styles([law.law for law in laws])):
        mark = {'marker': '*', 'markersize': 15} if law.is_recommended else {'markersize': 8}
        looks[law] = {**style, 'linestyle': '', 'markerfacecolor': 'none', 'markeredgewidth': 1.8,
                      **mark}
    groups = grouped(results)
    figure, axes = draw_panels(title, [group[0].condition or group[0].experiment
                                       for group in groups], 'RMS error [rad]', 3.6)
    for ax, group in zip(axes, groups):
        draw_trade_off(ax, [(_mean(x.score.variation), _mean(x.score.rms), looks[x.law])
                            for x in group], 'diverged')
    drawing.legend(figure, [
        Line2D([], [], label=f'{law.switching or law.law}, {law.gain_source}', **look)
        for law, look in looks.items()])
    return figure


def _mean(values: Sequence[float]) -> float:
    """Return the geometric mean, or inf without a number."""
    return geometric_mean([max(x, 1e-300) for x in values]) if values else inf


def figures(results: Sequence[Outcome]) -> Iterator[tuple[str, Figure, str]]:
    """Yield name, figure and caption of each robot."""
    for group in grouped([x for x in results if x.passes]):
        title = f'{group[0].title}: error by pass'
        yield title, draw_passes(group, title), (
            'The worst joint; 0 is before learning. Dotted: without learning.')
    results = [] if results[0].passes else results
    for experiment, robot_results in itertools.groupby(results, lambda x: x.experiment):
        shown = [x for x in robot_results if not x.is_held_out]
        yield experiment, draw_compromises(shown, f'{experiment}: error and torque variation'), (
            'Geometric means over the joints, 5 s to 10 s, a panel for each condition; lower '
            'left is better.')


def write_comparison(comparison: RunList, rows: pandas.DataFrame, out: Path,
                     extra: str = 'svg', command: str = '') -> None:
    """
    Write tables, figures, page, and a parameter file of every run.

    Parameters
    ----------
    comparison : RunList
        The runs.
    rows : pandas.DataFrame
        Their rows.
    out : Path
        Directory of ``index.html``, ``figures`` and the files named above.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        Command line, for the page.

    Raises
    ------
    CtcError
        If a file cannot be written.

    """
    results = outcomes(rows)
    write_text(out / TABLE, to_markdown(results))
    write_text(out / CSV, to_csv(results))
    write_parameters(comparison, out / PARAMETERS)
    files = drawing.save(figures(results), out / FIGURES, ('svg', extra))
    write_page(results, files, out / PAGE, command)


def write_page(results: Sequence[Outcome], files: Sequence[FigureFile], path: Path,
               command: str = '') -> None:
    """
    Write the page.

    Raise `CtcError` if that cannot be done.
    """
    unfolded = len(grouped(results)) <= 16
    numbers = [page.Folded(table.title, [_with_short_names(table)], unfolded)
               for table in tables(results)]
    page.write_page(
        path, 'The laws compared',
        'Every law with the same motion on the same robot: position error and torque of each '
        'joint, by the settings and under the conditions that the tables name.',
        [page.Section('Figures', files), page.Section('Numbers', numbers)],
        [(name, name) for name in (CSV, TABLE, ROWS, PARAMETERS)], command)


def _with_short_names(table: Table) -> Table:
    """
    Return an untitled table with one column for the names of a law.

    That column stays where a table scrolls sideways.
    """
    n = len(LAW_COLUMNS)
    rows = [[f'{" ".join(row[:2]).strip()}, {row[2]}', *row[n:]] for row in table.rows]
    return table._replace(title='', heads=['law', *table.heads[n:]], rows=rows,
                          names=table.names - n + 1)


def write_parameters(comparison: RunList, directory: Path) -> None:
    """Write a file of every run for `ctc simulate`."""
    used: set[str] = set()
    for columns, setup in comparison.listed:
        names = (columns['experiment'], columns['condition'],
                 columns['switching'] or columns['law'], columns['settings'], columns['part'])
        stem = '_'.join(filter(None, names))
        parameter_file.dump(setup.values, directory / f'{file_stem(stem, used)}.yaml')
