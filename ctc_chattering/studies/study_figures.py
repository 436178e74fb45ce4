"""Figures of a study: the switchings over sample period, gain and imperfections."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import itertools
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator, NullLocator
import numpy as np

from ctc_chattering.analysis.figure_style import DOTS, drawing, label, panel, STEPS
from ctc_chattering.analysis.terms import terms
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.closed_loop import simulate
from ctc_chattering.studies.study import (
    BASIC,
    Case,
    GAIN,
    NOISE,
    Outcome,
    PERIOD,
    rows,
    SHORT_NOISE,
)

#: Colour, marker and dashes of each switching (after Okabe and Ito), distinct without
#: colour as well.
STYLES: dict[str, tuple[str, str, Any]] = dict(zip(SWITCHINGS, itertools.cycle((
    ('#D55E00', 's', '-'), ('#CC79A7', '^', (0, (5, 1.5))), ('#009E73', 'D', (0, (2.5, 1.2))),
    ('#0072B2', 'o', '-'), ('#E69F00', 'v', (0, (1, 1))), ('#56B4E9', 'P', '-.')))))
#: Attribute of an outcome, and its title and unit.
QUANTITIES = (('error', 'RMS error of joint 2', 'rad'),
              ('variation', 'torque variation of joint 2', 'N·m/s'))
#: The slice drawn of the time domain: friction of joint 2 changes its sign at 7.75 s [s].
SLICE = (7.70, 7.85)


def sweep(outcomes: Sequence[Outcome], groups: Sequence[str], title: str, xlabel: str) -> Figure:
    """Draw both quantities against the abscissa of the cases in `groups`, one panel row each."""
    figure, grid = drawing(title, len(groups), (1.0, 1.0), 3.1)
    _legend(figure, {o.switching for o in outcomes})
    for k, group in enumerate(groups):
        mine = [o for o in outcomes if o.case.group == group]
        for column, (key, name, unit) in enumerate(QUANTITIES):
            suffix = group.partition(', ')[2] or 'h = 1 ms'
            ax = panel(figure, grid[k, column],
                       f'{name}, {suffix}' if len(groups) > 1 else name, f'{name} [{unit}]')
            ax.set(xlabel=xlabel, xscale='log', yscale='log')
            for switching in STYLES:
                points = [(o.case.x, value[1]) for o in mine if o.switching == switching
                          and o.case.x is not None and (value := getattr(o, key)) is not None]
                colour, marker, dashes = STYLES[switching]
                ax.plot([x for x, _ in points], [y for _, y in points], color=colour,
                        marker=marker, linestyle=dashes, linewidth=1.5, markersize=5.5,
                        markeredgecolor='white', markeredgewidth=0.6)
            _ticks(ax, sorted({o.case.x for o in mine if o.case.x is not None}))
            _note_failures(ax, [o for o in mine if o.failure])
    _same_limits(figure)
    return figure


def overview(outcomes: Sequence[Outcome], title: str) -> Figure:
    """Draw both quantities of every case in `outcomes`, a line per case, a mark per switching."""
    table = rows(outcomes)
    figure, grid = drawing(title, 1, (1.0, 1.0), 0.29 * len(table) + 0.3, left=3.9)
    _legend(figure, {o.switching for o in outcomes})
    starts = [i for i, row in enumerate(table)
              if i and row[0].case.group != table[i - 1][0].case.group]
    for column, (key, name, unit) in enumerate(QUANTITIES):
        ax = panel(figure, grid[0, column], name, '')
        ax.set(xlabel=f'{name} [{unit}]', xscale='log', ylim=(len(table) - 0.4, -0.6))
        for y, row in enumerate(table):
            values = {o.switching: value[1] for o in row if (value := getattr(o, key))}
            if values:
                ax.plot([min(values.values()), max(values.values())], [y, y], color='#dddddd',
                        linewidth=5.0, zorder=1, solid_capstyle='round')
            for k, (switching, (colour, marker, _)) in enumerate(STYLES.items()):
                if switching in values:
                    ax.plot([values[switching]], [y + 0.2 * (k - 1.5)], color=colour,
                            marker=marker, markersize=5.0 if marker == 'D' else 6.0,
                            markeredgecolor='white', markeredgewidth=0.6, zorder=3)
            failed = [o.switching for o in row if o.failure]
            if failed:
                ax.text(0.995, y, 'diverged: ' + ', '.join(failed), ha='right', va='center',
                        fontsize=7.5, color='#444444', transform=ax.get_yaxis_transform())
        for start in starts:
            ax.axhline(start - 0.5, color='#999999', linewidth=0.6)
        ax.set_yticks(range(len(table)), ['' if column else _label(row[0].case)
                                          for row in table], parse_math=False)
        ax.tick_params(axis='y', length=0, labelsize=8)
    return figure


def chattering(case: Case, switchings: Sequence[str] = SWITCHINGS) -> Figure:
    """Draw v and the chattering term of joint 2 over `SLICE`, one column per switching."""
    setup = case.setup()
    ka = setup.controller.ka[1]
    figure, grid = drawing(
        f'Filtered error and chattering term of joint 2, ka = {ka:g} N·m, 1 kHz, clean', 2,
        (1.0,) * len(switchings), 2.2)
    grid = GridSpec(2, len(switchings), figure, left=0.07, right=0.985, bottom=0.09, top=0.86,
                    hspace=0.14, wspace=0.09)
    plant = setup.plant.changed({'duration': round(SLICE[1] + 0.01, 3)})
    axes: list[list[Axes]] = [[], []]
    for column, switching in enumerate(switchings):
        controller = setup.controller.changed({'switching': switching})
        run = simulate(plant, controller, setup.reference, setup.events)
        part = (run.t >= SLICE[0] - 1e-9) & (run.t <= SLICE[1] + 1e-9)
        t, v = run.t[part], run.v[part, 1]
        term = terms(run, [(0.0, controller)]).robust[part, 1]
        colour, variation = STYLES[switching][0], float(np.abs(np.diff(term)).sum())
        for line, (name, unit, y, caption) in enumerate((
                ('v₂', 'rad/s', v, f'largest |v₂|: {np.abs(v).max():.1e} rad/s'),
                ('term₂', 'N·m', term, f'variation {variation / (t[-1] - t[0]):.0f} N·m/s'))):
            ax = panel(figure, grid[line, column], '', '' if column else f'{name} [{unit}]', t)
            if not line:
                ax.set_title(switching, loc='left', fontsize=10.5, color=colour, weight='bold')
                ax.set_xlabel('')
            ax.plot(t, y, color=colour, **STEPS)
            ax.xaxis.set_major_locator(MaxNLocator(3, prune='both'))
            ax.tick_params(labelleft=not column, labelbottom=bool(line))
            label(ax, 0.03, 0.97, caption, va='top')
            axes[line].append(ax)
    for panels in axes:
        low, high = np.array([ax.get_ylim() for ax in panels]).T
        for ax in panels:
            ax.set_ylim(low.min(), high.max() + 0.18 * (high.max() - low.min()))
    return figure


def save_study_figures(outcomes: Sequence[Outcome], directory: Path) -> list[tuple[Path, str]]:
    """
    Write the figures of a study as PNG.

    Parameters
    ----------
    outcomes : sequence of Outcome
        Result of `study.run_cases`; a figure without any of its cases is left out.
    directory : Path
        Created if necessary.

    Returns
    -------
    list of (Path, str)
        Files with their captions, in the order in which to show them.

    Raises
    ------
    CtcError
        If a file cannot be written.

    """
    files = []
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for name, figure, caption in _all(outcomes):
            path = directory / f'{name}.png'
            figure.savefig(path, dpi=DOTS, metadata={'Software': None})
            files.append((path, caption))
    except OSError as error:
        raise CtcError(f'cannot write figures to {directory}: {error.strerror}') from None
    return files


def _all(outcomes: Sequence[Outcome]) -> Iterator[tuple[str, Figure, str]]:
    groups = list(dict.fromkeys(o.case.group for o in outcomes))
    clean = [o.case for o in outcomes if o.case.group == BASIC][:1]
    if clean:
        yield 'chattering', chattering(clean[0]), (
            'v and the chattering term of joint 2 while its friction changes sign. The axes of a '
            'row are the same.')
        yield 'basic', overview([o for o in outcomes if o.case.group == BASIC],
                                f'{BASIC}, joint 2'), f'{BASIC}, joint 2.'
    for name, wanted, title, xlabel in (
            ('sample_period', (PERIOD,), 'Sample period', 'sample period h [ms]'),
            ('gain', (GAIN,), 'Gain, h = 1 ms', 'gain ka [N·m]'),
            ('velocity_noise', (NOISE, SHORT_NOISE), 'Velocity noise',
             'standard deviation σ [rad/s]')):
        present = [group for group in wanted if group in groups]
        if present:
            yield name, sweep(outcomes, present, title, xlabel), f'{title}.'
    rest = [o for o in outcomes if o.case.group not in (BASIC, PERIOD, GAIN)]
    if rest:
        yield 'imperfections', overview(rest, 'One imperfection at a time, joint 2'), (
            'One imperfection at a time, joint 2.')


def _label(case: Case) -> str:
    return case.name if case.group == BASIC else f'{case.group}: {case.name}'


def _legend(figure: Figure, switchings: set[str]) -> None:
    shown = [name for name in STYLES if name in switchings]
    handles = [Line2D([], [], color=STYLES[name][0], marker=STYLES[name][1], label=name,
                      linestyle=STYLES[name][2], markeredgecolor='white') for name in shown]
    figure.legend(handles=handles, loc='upper right', ncol=len(shown), frameon=False, fontsize=9)


def _ticks(ax: Axes, xs: Sequence[float]) -> None:
    """Label the abscissae that were run, and no others."""
    ax.xaxis.set_major_locator(FixedLocator(list(xs)))
    ax.xaxis.set_major_formatter(FixedFormatter([f'{x:g}' for x in xs]))
    ax.xaxis.set_minor_locator(NullLocator())


def _note_failures(ax: Axes, failed: Sequence[Outcome]) -> None:
    if failed:
        label(ax, 0.01, 0.04, 'diverged: ' + ', '.join(
            f'{o.switching} at {o.case.x:g}' for o in failed))


def _same_limits(figure: Figure) -> None:
    """Give the panels of a column the same ordinate."""
    for column in (figure.axes[0::2], figure.axes[1::2]):
        low, high = np.array([ax.get_ylim() for ax in column]).T
        for ax in column:
            ax.set_ylim(low.min(), high.max())
