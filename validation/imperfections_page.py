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
The switchings, and the laws, under one imperfection at a time: the pages of docs/study.

Tables, CSV and figures of each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import dataclasses
import itertools
import os
from pathlib import Path
import shutil
from textwrap import fill
from typing import Any

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.drawing import legend
from ctc_chattering.analysis.markup import Markup
from ctc_chattering.analysis.metrics import within
from ctc_chattering.analysis.page import FigureFile
from ctc_chattering.analysis.result import simulate
from ctc_chattering.analysis.run_names import LAW_COLOURS
from ctc_chattering.analysis.tables import markdown, markdown_table, Table
from ctc_chattering.configuration.compilation import compile_setups
from ctc_chattering.control.laws.registry import LAWS, SWITCHINGS
from ctc_chattering.errors import shorten
from ctc_chattering.output_files import write_text
from imperfections import (
    about,
    BASIC,
    Case,
    CaseOutcome,
    CASES,
    engines,
    EVERY_LAW,
    GAIN,
    law_about,
    law_tables,
    NOISE,
    PERIOD,
    rows,
    run_cases,
    setup_of,
    SHORT_NOISE,
    tables,
    to_csv,
)
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, NullFormatter
import numpy as np
from PIL import Image

_DASHED, _BROKEN, _DOTTED = (0, (5, 1.5)), (0, (2.5, 1.2)), (0, (1, 1))
#: Colour, marker and dashes of each switching (after Okabe and Ito) and of each law, distinct
#: without colour as well.
STYLES: dict[str, dict[str, Any]] = {
    variant: {'color': colour, 'marker': marker, 'linestyle': dashes, 'markeredgecolor': 'white'}
    for variant, (colour, marker, dashes) in (
        *zip(SWITCHINGS, itertools.cycle((
            ('#D55E00', 's', '-'), ('#CC79A7', '^', _DASHED), ('#009E73', 'D', _BROKEN),
            ('#0072B2', 'o', '-'), ('#E69F00', 'v', _DOTTED), ('#56B4E9', 'P', '-.')))),
        *zip(LAW_COLOURS, zip(LAW_COLOURS.values(), itertools.cycle('soD^vP<X>'), itertools.cycle(
            ('-', '-', _DASHED, _BROKEN, '-.', _DOTTED)))))}
#: Attribute of an outcome, and its title and unit.
QUANTITIES = (('rms', 'RMS error of joint 2', 'rad'),
              ('variation', 'torque variation of joint 2', 'N·m/s'))
#: The slice drawn of the time domain: friction of joint 2 changes its sign at 7.75 s [s].
SLICE = (7.70, 7.85)
#: Characters of a line in a panel, and in a row of `overview`.
_LINE, _NARROW = 70, 40
_OVERVIEW = ('RMS error and torque variation of joint 2 over the second half of each run. A row a '
             'case, a mark a run; grey: from the least to the greatest.')


def sweep(outcomes: Sequence[CaseOutcome], groups: Sequence[str], title: str, xlabel: str
          ) -> Figure:
    """Draw both quantities against the abscissa of the cases in `groups`, one panel row each."""
    figure, grid = drawing.sheet(title, len(groups), (1.0, 1.0), 3.1)
    for (k, group), (column, (key, name, unit)) in itertools.product(
            enumerate(groups), enumerate(QUANTITIES)):
        mine = [o for o in outcomes if o.case.group == group]
        suffix = group.partition(', ')[2] or 'h = 1 ms'
        ax = drawing.panel(figure, grid[k, column],
                           f'{name}, {suffix}' if len(groups) > 1 else name, f'{name} [{unit}]')
        ax.set(xlabel=xlabel, xscale='log', yscale='log')
        for variant, style in _styles(outcomes).items():
            points = [(o.case.x, value[1]) for o in mine
                      if o.variant == variant and o.case.x and (value := getattr(o.score, key))]
            ax.plot([x for x, _ in points], [y for _, y in points], **style, linewidth=1.5,
                    markersize=5.5, markeredgewidth=0.6)
        xs = sorted({o.case.x for o in mine if o.case.x})
        ax.set_xticks(xs, [f'{x:g}' for x in xs])  # Those that were run, and no others.
        ax.set_xticks([], minor=True)
        failed = [f'{o.variant} at {o.case.x:g}' for o in mine if o.score.failure]
        if failed:
            drawing.label(ax, 0.01, 0.04, fill(f'diverged: {shorten(failed, 6)}', _LINE))
    for column in (0, 1):
        _same_ordinate(figure.axes[column::2])
    _legend(figure, outcomes)
    return figure


def _end_at_decades(ax: Axes, values: Sequence[float]) -> None:
    """Let the logarithmic axis of x begin and end at whole decades, with labels there only."""
    positive = [x for x in values if 0.0 < x < np.inf]
    if positive:
        ax.set_xlim(10.0 ** np.floor(np.log10(min(positive) / 1.15)),
                    10.0 ** np.ceil(np.log10(max(positive) * 1.15)))
    ax.xaxis.set_minor_formatter(NullFormatter())


def overview(outcomes: Sequence[CaseOutcome], title: str) -> Figure:
    """Draw both quantities of every case in `outcomes`, a line per case, a mark per variant."""
    table, look = rows(outcomes), _styles(outcomes)
    cases = [row[0].case for row in table]
    names = [case.name if case.group == BASIC else f'{case.group}: {case.name}'
             for case in cases]
    figure, grid = drawing.sheet(
        title, 1, (1.0, 1.0), (0.17 + 0.02 * len(look)) * len(table) + 0.3,
        left=0.4 + 0.067 * max(map(len, names)))
    for column, (key, name, unit) in enumerate(QUANTITIES):
        ax = drawing.panel(figure, grid[0, column], name, '')
        ax.set(xlabel=f'{name} [{unit}]', xscale='log', ylim=(len(table) - 0.4, -0.6))
        for y, row in enumerate(table):
            values = {o.variant: value[1] for o in row if (value := getattr(o.score, key))}
            if values:
                ax.plot([min(values.values()), max(values.values())], [y, y], color='#dddddd',
                        linewidth=5.0, zorder=1, solid_capstyle='round')
            for k, (variant, style) in enumerate(look.items()):
                if variant in values:
                    ax.plot([values[variant]], [y + (k + 0.5) / len(look) * 0.8 - 0.4], **style,
                            markersize=5.0 if style['marker'] == 'D' else 6.0,
                            markeredgewidth=0.6, zorder=3)
            failed = [o.variant for o in row if o.score.failure]
            if failed:
                ax.text(0.995, y, fill(f'diverged: {shorten(failed, 2)}', _NARROW), ha='right',
                        va='center', fontsize=7.5, color='#444444',
                        transform=ax.get_yaxis_transform())
        for y, (before, case) in enumerate(itertools.pairwise(cases)):
            if case.group != before.group:
                ax.axhline(y + 0.5, color='#999999', linewidth=0.6)
        _end_at_decades(ax, [x[1] for o in outcomes if (x := getattr(o.score, key))])
        ax.set_yticks(range(len(table)), [''] * len(table) if column else names)
        ax.tick_params(axis='y', length=0, labelsize=8)
    _legend(figure, outcomes)
    return figure


def chattering(case: Case, switchings: Sequence[str] = SWITCHINGS) -> Figure:
    """Draw v and the chattering term of joint 2 over `SLICE`, one column per switching."""
    ka = case.setup().controller.ka[1]
    figure, _ = drawing.sheet(
        f'Filtered error and chattering term of joint 2, ka = {ka:g} N·m, 1 kHz, clean', 2,
        (1.0,) * len(switchings), 2.2)
    grid = figure.add_gridspec(2, len(switchings), left=0.07, right=0.985, bottom=0.09, top=0.86,
                               hspace=0.14, wspace=0.09)
    for column, switching in enumerate(switchings):
        setup = setup_of(case, switching)
        plant = setup.plant.changed({'duration': round(SLICE[1] + 0.01, 3)})
        result = simulate(dataclasses.replace(setup, plant=plant))
        run = result.run
        part = within(run.t, SLICE)
        t, v = run.t[part], run.v[part, 1]
        term = result.terms.robust[part, 1]
        colour, variation = STYLES[switching]['color'], float(np.abs(np.diff(term)).sum())
        for line, (name, unit, y, caption) in enumerate((
                ('v₂', 'rad/s', v, f'largest |v₂|: {np.abs(v).max():.1e} rad/s'),
                ('term₂', 'N·m', term, f'variation {variation / (t[-1] - t[0]):.0f} N·m/s'))):
            ax = drawing.panel(figure, grid[line, column], '',
                               '' if column else f'{name} [{unit}]', t)
            if not line:
                ax.set_title(switching, loc='left', fontsize=10.5, color=colour, weight='bold')
                ax.set_xlabel('')
            ax.plot(t, y, color=colour, **drawing.STEPS)
            ax.xaxis.set_major_locator(MaxNLocator(3, prune='both'))
            ax.tick_params(labelleft=not column, labelbottom=bool(line))
            drawing.label(ax, 0.03, 0.97, caption, va='top')
    for line in (0, 1):
        _same_ordinate(figure.axes[line::2], room=0.18)
    return figure


def save_study_figures(outcomes: Sequence[CaseOutcome], directory: Path) -> list[FigureFile]:
    """Write the figures that have cases as PNG of 64 colours; return them in their order."""
    figures = drawing.save(_all(outcomes), directory, ('png',))
    for figure in figures:
        with Image.open(figure.path) as image:
            image.quantize(64).save(figure.path, optimize=True)
    return figures


def _all(outcomes: Sequence[CaseOutcome]) -> Iterator[tuple[str, Figure, str]]:
    groups = {o.case.group for o in outcomes}
    laws = outcomes[0].variant in LAW_COLOURS
    basic = [o for o in outcomes if o.case.group == BASIC]
    if basic and not laws:
        yield 'chattering', chattering(basic[0].case), (
            'v and the chattering term of joint 2 while its friction changes sign. The axes of a '
            'row are the same.')
    if basic:
        yield 'basic', overview(basic, f'{BASIC}, joint 2'), _OVERVIEW
    for name, wanted, title, xlabel in (
            ('sample_period', (PERIOD,), 'Sample period', 'sample period h [ms]'),
            ('gain', (GAIN,), 'Gain, h = 1 ms', 'gain ka [N·m]'),
            ('velocity_noise', (NOISE, SHORT_NOISE), 'Velocity noise',
             'standard deviation σ [rad/s]')):
        present = [group for group in wanted if group in groups]
        if present and not (laws and name == 'gain'):  # Recommended settings have their own.
            yield name, sweep(outcomes, present, title, xlabel), (
                'RMS error and torque variation of joint 2 over the second half of each run; all '
                'other parameters have their defaults.')
    rest = [o for o in outcomes if o.case.group not in (BASIC, PERIOD, GAIN)]
    if rest:
        yield 'imperfections', overview(rest, 'One imperfection at a time, joint 2'), (
            _OVERVIEW)


def _styles(outcomes: Sequence[CaseOutcome]) -> dict[str, dict[str, Any]]:
    """Return the looks of the variants of outcomes."""
    variants = {o.variant for o in outcomes}
    return {name: style for name, style in STYLES.items() if name in variants}


def _legend(figure: Figure, outcomes: Sequence[CaseOutcome]) -> None:
    legend(figure, [Line2D([], [], label=name, **style)
                    for name, style in _styles(outcomes).items()])


def _same_ordinate(panels: Sequence[Axes], room: float = 0.0) -> None:
    """Give panels the same ordinate, with a part of it left free at the top."""
    low, high = np.array([ax.get_ylim() for ax in panels]).T
    for ax in panels:
        ax.set_ylim(low.min(), high.max() + room * (high.max() - low.min()))


@dataclasses.dataclass(frozen=True)
class StudyKind:
    """
    A study.

    Attributes
    ----------
    what, variants : str, tuple of str
        What is compared, and all of them.
    name, figures : str
        Of its files, without their endings, and of the directory of its figures.
    about, tables : callable
        What the tables show, and the tables, of outcomes.

    """

    what: str
    variants: Sequence[str]
    name: str
    figures: str
    about: Callable[[Sequence[CaseOutcome]], Markup]
    tables: Callable[[Sequence[CaseOutcome]], Iterator[Table]]

    @property
    def names(self) -> tuple[str, ...]:
        """Return what is written."""
        return (f'{self.name}.md', f'{self.name}.csv', self.figures)


OF_SWITCHINGS = StudyKind('switching', SWITCHINGS, 'study', 'figures', about, tables)
OF_LAWS = StudyKind('law', EVERY_LAW, 'laws', 'laws_figures', law_about, law_tables)


def kind_of(outcomes: Sequence[CaseOutcome]) -> StudyKind:
    """Return the study that outcomes are of."""
    return OF_LAWS if outcomes[0].variant in LAWS else OF_SWITCHINGS


def write_study(outcomes: Sequence[CaseOutcome], out: str | Path) -> None:
    """
    Write tables and figures.

    Parameters
    ----------
    outcomes : sequence of CaseOutcome
        What `run_cases` has returned.
    out : str or Path
        Directory for ``study.md``, ``study.csv``, ``figures``; of laws ``laws.md``, ``laws.csv``,
        ``laws_figures``.

    Raises
    ------
    CtcError
        If there is no outcome, or a file cannot be written.

    """
    kind = kind_of(outcomes)
    out = Path(out)
    shutil.rmtree(out / kind.figures, ignore_errors=True)
    text, table = (out / name for name in kind.names[:2])
    write_text(table, to_csv(outcomes, kind.what))
    write_text(text, to_markdown(kind, outcomes, save_study_figures(outcomes, out / kind.figures),
                                 out))


def to_markdown(kind: StudyKind, outcomes: Sequence[CaseOutcome],
                figures: Sequence[FigureFile] = (), out: Path = Path()) -> str:
    """Return all tables, and the figures below `out`."""
    lines = [f'# {_title(kind)}', '', markdown(kind.about(outcomes))]
    for table in kind.tables(outcomes):
        lines += ['', *([f'## {table.title}', ''] if table.title else []),
                  *([table.note, ''] if table.note else []),
                  *markdown_table(table.heads, table.rows)]
    if figures:
        lines += ['', '## Figures']
    for figure in figures:
        lines += ['', f'![{figure.title}.]({figure.path.relative_to(out).as_posix()})']
    return '\n'.join([*lines, ''])


def _title(kind: StudyKind) -> str:
    return f'Study of the {kind.what}s'


#: Where they are.
_PAGES = Path(__file__).resolve().parents[1] / 'docs' / 'study'


def main() -> None:
    """Run both studies, and write them into docs/study."""
    for variants in (SWITCHINGS, EVERY_LAW):
        compile_setups((setup_of(case, x) for case in CASES for x in variants), print)
        outcomes = list(run_cases(CASES, variants, os.cpu_count() or 1))
        write_study(outcomes, _PAGES)
        print(f'{len(outcomes)} runs. {engines(outcomes)}.')


if __name__ == '__main__':
    main()
