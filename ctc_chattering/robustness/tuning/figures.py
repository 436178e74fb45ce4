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

"""Figures of a search for gains: the front, the gains along it, and errors over what is drawn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.legends import legend_of
from ctc_chattering.robustness.tuning.report import part_of_runs
from ctc_chattering.robustness.tuning.runs import Candidate, Tuning
from ctc_chattering.robustness.tuning.search import CONSTRAINTS, DIVERGED
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
import numpy as np

#: Colours: the front on the draws of the search, on fresh draws, and the recommended point.
_DRAWN, _FRESH, _KNEE = '#0072B2', '#D55E00', '#CC3311'
_OTHERS = ('#222222', '#7B5EA7', '#007A5A')
#: Colour and mark of a trial that violates a constraint.
_VIOLATING = {'torque': ('#B8860B', 'x'), 'torque rate': ('#888888', '+')}
#: What numbers are, where they are not the parameters of the same name.
_MEANING = {'pole': ', p of kp = p² [rad/s]', 'damping': ', d of kv = 2 d p',
            'ka': ", times the file's", 'ki': ', times kp kv',
            'adaptation_gain': ', times the friction'}
#: Panels beside each other.
_COLUMNS = 3
#: Room around what is drawn, as a factor.
_ROOM = 1.4


def front_figure(tuning: Tuning) -> Figure:
    """Draw error over torque variation: trials, the front, the validation, and others."""
    figure, grid = drawing.sheet('Error and torque variation', 1, (1.0,), 5.2)
    ax = drawing.panel(figure, grid[0, 0], part_of_runs(tuning.percentile), 'RMS error [rad]')
    ax.set(xlabel='torque variation [N·m/s]', xscale='log', yscale='log')
    _trials(ax, tuning)
    for candidate in tuning.points:
        ax.plot(*zip(_place(candidate, False), _place(candidate, True)), color='#bbbbbb',
                linewidth=0.8, zorder=2)
    for fresh, form, colour, name in (
            (False, 'o-', _DRAWN, 'front, draws of the search'),
            (True, 'o', _FRESH, 'the same on fresh draws')):
        places = [_place(x, fresh) for x in tuning.points]
        if places:
            ax.plot(*zip(*places), form, color=colour, label=name, linewidth=1.3, markersize=6,
                    markerfacecolor='white' if fresh else colour, zorder=3)
    _marks(ax, tuning)
    _fit(ax, [_place(x, fresh) for x in (*tuning.points, *tuning.others) for fresh in (0, 1)])
    legend_of(ax)
    return figure


def _trials(ax: Axes, tuning: Tuning) -> None:
    """Draw the trials that are not on the front."""
    scores = [x.score for x in tuning.trials]
    rest = [x for k, x in enumerate(scores) if x.allowed and k not in tuning.front]
    if rest:
        ax.plot([x.variation for x in rest], [x.error for x in rest], '.', color='#88aacc',
                markersize=5, label=f'other trials within the limits ({len(rest)})')
    for name, (colour, marker) in _VIOLATING.items():
        mine = [x for x in scores if x.violating[name] and not x.violating[DIVERGED]
                and name == next(y for y in CONSTRAINTS if x.violating[y])]
        if mine:
            ax.plot([x.variation for x in mine], [x.error for x in mine], marker, color=colour,
                    markersize=5, label=f'beyond the limit of the {name} ({len(mine)})')
    gone = sum(bool(x.violating[DIVERGED]) for x in scores)
    if gone:
        drawing.note(ax, f'{gone} trials with a run that diverges are not shown')


def _marks(ax: Axes, tuning: Tuning) -> None:
    """Draw the recommended point and the others, on fresh draws."""
    gone: list[dict[str, Any]] = []
    if tuning.best is not None:
        ax.plot(*_place(tuning.best, True), '*', color=_KNEE, markersize=17,
                markeredgecolor='white', zorder=5, label='recommended point')
    for candidate, colour, marker in zip(tuning.others, _OTHERS, 'sDP'):
        broken = ', '.join(x for x in CONSTRAINTS if candidate.fresh.violating[x])
        look: dict[str, Any] = {
            'marker': marker, 'color': colour, 'markersize': 9, 'linestyle': '', 'zorder': 4,
            'markerfacecolor': 'none', 'markeredgewidth': 1.8,
            'label': candidate.name + (f' (violates: {broken})' if broken else '')}
        if np.isfinite(_place(candidate, True)).all():
            ax.plot(*_place(candidate, True), **look)
        else:
            gone.append(look)
    drawing.beyond(ax, 'without a finite error', gone)
    for k, candidate in enumerate(tuning.points):
        if k in (0, len(tuning.points) - 1) or candidate is tuning.best:
            ax.annotate(candidate.name, _place(candidate, False), xytext=(5, 4),
                        textcoords='offset points', fontsize=9, color=_DRAWN, zorder=6)


def _place(candidate: Candidate, fresh: object) -> tuple[float, float]:
    """Return torque variation and error of a candidate."""
    score = candidate.fresh if fresh else candidate.drawn
    return score.variation, score.error


def _fit(ax: Axes, places: Sequence[tuple[float, float]]) -> None:
    """Fit the axes to places; trials far from them are not shown."""
    for axis, values in zip('xy', zip(*places)):
        finite = [x for x in values if 0.0 < x < np.inf]
        if finite:
            ax.set(**{f'{axis}lim': (min(finite) / _ROOM, max(finite) * _ROOM)})
    _ticks(ax.xaxis, ax.yaxis)


def _ticks(*axes: Axis) -> None:
    """Put plain numbers at 1, 2 and 5 times powers of ten."""
    for axis in axes:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda x, _: f'{x:g}'))
        axis.set_minor_locator(NullLocator())


def gains_figure(tuning: Tuning) -> Figure:
    """Draw each number that is searched along the front, with its range."""
    names = list(tuning.spec.ranges)
    columns = min(_COLUMNS, len(names))
    figure, grid = drawing.sheet('Numbers along the front', -(-len(names) // columns),
                                 (1.0,) * columns, 2.2)
    x = [point.drawn.variation for point in tuning.points]
    for k, name in enumerate(names):
        ax = drawing.panel(figure, grid[k // columns, k % columns], name + _MEANING.get(name, ''),
                           '')
        limits = tuning.spec.ranges[name]
        y = [tuning.trials[i].numbers[name] for i in tuning.front]
        ax.plot(x, y, 'o', color=_DRAWN, markersize=5)
        if tuning.best in tuning.points:
            best = tuning.points.index(tuning.best)
            ax.plot(x[best], y[best], '*', color=_KNEE, markersize=14,
                    markeredgecolor='white')
        ax.set(xlabel='torque variation [N·m/s]', xscale='log', yscale='log',
               ylim=(limits.low / 1.2, limits.high * 1.2))
        _ticks(ax.xaxis, ax.yaxis)
        for end in limits[:2]:
            ax.axhline(end, color='#999999', linewidth=0.8, linestyle='--')
    return figure


def draws_figure(tuning: Tuning) -> Figure:
    """Draw the error of every fresh draw over each uncertain quantity."""
    spec, fresh = tuning.spec, tuning.fresh
    columns = min(_COLUMNS, len(spec.uncertain))
    figure, grid = drawing.sheet('Error over what is uncertain, fresh draws',
                                 -(-len(spec.uncertain) // columns), (1.0,) * columns, 2.4)
    shown = [(tuning.others[0], _OTHERS[0], 's', 3.0)]
    if tuning.best is not None:
        shown.append((tuning.best, _KNEE, 'o', 4.0))
    for k, quantity in enumerate(spec.uncertain):
        unit = f' [{quantity.unit}]' if quantity.unit else ' [factor]' if quantity.factor else ''
        ax = drawing.panel(figure, grid[k // columns, k % columns], quantity.name,
                           '' if k % columns else 'RMS error [rad]')
        ax.set(xlabel=f'{quantity.name}{unit}', yscale='log')
        if quantity.distribution == 'log_uniform':
            ax.set_xscale('log')
            _ticks(ax.xaxis)
        elif quantity.distribution == 'choice':
            ax.set_xticks(quantity.numbers)
        for candidate, colour, marker, size in shown:
            ax.plot([row[k] for row in fresh.values], [x.error for x in candidate.fresh.runs],
                    marker, color=colour, markersize=size, alpha=0.7,
                    label='gains of the file' if colour in _OTHERS else
                    'recommended point')
    legend_of(figure.axes[0])
    return figure


def save_tune_figures(tuning: Tuning, directory: Path, extra: str = 'svg'
                      ) -> list[drawing.FigureFile]:
    """
    Write the figures of a search as SVG and `extra`; return them in the order to show them.

    Raises
    ------
    CtcError
        If a file cannot be written.

    """
    return drawing.save(_all(tuning), directory, ('svg', extra))


def _all(tuning: Tuning) -> Iterator[tuple[str, Figure, str]]:
    yield 'front', front_figure(tuning), (
        'A dot a trial; the front has those that no other beats in both. The numbers are those '
        'of the table. Star, square, diamond and cross are on fresh draws. Where fresh draws lie '
        'above or to the right of the front, the search has fitted its own draws.')
    if tuning.points:
        yield 'numbers', gains_figure(tuning), (
            'What was searched, at each point of the front. Star: recommended, if it is '
            'on the front. Dashed: ends of the range that is searched. At an end the range may be '
            'too narrow.')
    if tuning.spec.uncertain:
        yield 'draws', draws_figure(tuning), (
            'A dot a draw: which uncertain quantity makes the error.')
