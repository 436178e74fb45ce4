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

"""Figures of a comparison: errors of all joints, and error against torque variation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.legends import legend
from ctc_chattering.analysis.run_names import LAW_COLOURS
from ctc_chattering.studies.comparison import Outcome, RECOMMENDED, Variant
from ctc_chattering.studies.comparison_tables import groups, heading
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
import numpy as np

#: Panels of a figure beside each other.
_COLUMNS = 3


def label(variant: Variant) -> str:
    """Return law, switching and settings for a figure."""
    return ', '.join(filter(None, (variant.switching or variant.law, variant.settings)))


def styles(variants: Sequence[Variant]) -> dict[Variant, dict[str, Any]]:
    """Return colour of the law and mark of each variant; hollow, so that no mark hides others."""
    markers = cycle('osD^v<>pPXhd8')
    return {x: {'color': LAW_COLOURS[x.law], 'markerfacecolor': 'none', 'linestyle': '',
                'marker': '*' if x.settings == RECOMMENDED else next(markers),
                'markersize': 15 if x.settings == RECOMMENDED else 8, 'markeredgewidth': 1.8}
            for x in dict.fromkeys(variants)}


def errors(group: Sequence[Outcome]) -> Figure:
    """Draw RMS error and torque variation under one condition: a row a variant, a dot a joint."""
    figure, grid = drawing.sheet(
        f'{heading(group[0])}: error and torque variation (number: joint)', 1, (1.0, 1.0),
        drawing.dots_height(len(group[0].joints)) * len(group) + 0.3, left=2.9)
    for column, (quantity, unit, values) in enumerate((
            ('RMS error', 'rad', [x.score.rms for x in group]),
            ('torque variation', 'N·m/s', [x.score.variation for x in group]))):
        ax = drawing.panel(figure, grid[0, column], f'{quantity}, 5 s to 10 s', '')
        ax.set(xlabel=f'{quantity} [{unit}]', xscale='log', ylim=(len(group) - 0.4, -0.6))
        for y, (outcome, row) in enumerate(zip(group, values)):
            drawing.numbered_dots(ax, y, row, LAW_COLOURS[outcome.task.variant.law])
            if outcome.score.failure:
                ax.text(0.5, y, 'diverged', ha='center', va='center', fontsize=9,
                        color='#444444', transform=ax.get_yaxis_transform())
        drawing.decades(ax, 'x', [x for row in values for x in row])
        names = [label(x.task.variant) for x in group]
        ax.set_yticks(range(len(group)), [''] * len(names) if column else names)
    return figure


def trade_off(outcomes: Sequence[Outcome], title: str) -> Figure:
    """Draw error against torque variation, means of the joints, a panel for each condition."""
    parts = groups(outcomes)
    look = styles([x.task.variant for x in outcomes])
    columns = min(_COLUMNS, len(parts))
    rows = -(-len(parts) // columns)
    figure, grid = drawing.sheet(title, rows, (1.0,) * columns, 3.6)
    for k, group in enumerate(parts):
        ax = drawing.panel(figure, grid[k // columns, k % columns],
                           heading(group[0]).rpartition(', ')[2], 'RMS error [rad]')
        ax.set(xlabel='torque variation [N·m/s]', xscale='log', yscale='log')
        for x in group:
            if not x.score.failure:
                ax.plot([_mean(x.score.variation)], [_mean(x.score.rms)],
                        **look[x.task.variant])
        drawing.beyond(ax, 'diverged', [look[x.task.variant] for x in group if x.score.failure])
        for axis, key in (('x', 'variation'), ('y', 'rms')):
            drawing.decades(ax, axis, [_mean(getattr(x.score, key)) for x in group
                                       if not x.score.failure])
    legend(figure, [Line2D([], [], label=label(x), **style) for x, style in look.items()])
    return figure


def _mean(values: Sequence[float]) -> float:
    """Return the geometric mean."""
    return float(np.exp(np.mean(np.log(np.maximum(values, 1e-300)))))


def save_comparison_figures(outcomes: Sequence[Outcome], directory: Path, extra: str = 'svg'
                            ) -> list[drawing.FigureFile]:
    """
    Write the figures of a comparison as SVG; return them in the order in which to show them.

    Parameters
    ----------
    outcomes : sequence of Outcome
        Result of `compare`.
    directory : Path
        Created if necessary.
    extra : str
        A second format: ``pdf`` or ``png``.

    Raises
    ------
    CtcError
        If a file cannot be written.

    """
    return drawing.save(_all(outcomes), directory, ('svg', extra))


def _all(outcomes: Sequence[Outcome]) -> Iterator[tuple[str, Figure, str]]:
    robots: dict[tuple[str, str], list[Outcome]] = {}
    for x in outcomes:
        robots.setdefault((x.experiment, x.backend), []).append(x)
    for (experiment, backend), mine in robots.items():
        yield f'{experiment}_{backend}', trade_off(
            mine, f'{experiment}, plant {backend}: error and torque variation'), (
            'Geometric means over the joints, 5 s to 10 s, a panel for each condition; lower left '
            'is better.')
        for group in groups(mine):
            condition = group[0].task.condition
            yield '_'.join((experiment, backend, *([condition.name] if condition else []))), (
                errors(group)), (
                    f'A row a law; {condition.title if condition else "as in the file"}.')
