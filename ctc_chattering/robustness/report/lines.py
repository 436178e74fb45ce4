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

"""Figures of a map with one axis: error and failure probability of all variants as lines."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
import textwrap
from typing import Any

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.legends import legend_of
from ctc_chattering.analysis.run_names import LAW_COLOURS, MIXED, shaded
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.robustness.report.axis import GridAxis
from ctc_chattering.robustness.report.boundary import LEVEL, wilson
from ctc_chattering.robustness.report.data import MapData
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
import numpy as np

_MARKED: dict[str, Any] = {'linewidth': 1.4, 'markersize': 4.5, 'markeredgecolor': 'white',
                           'markeredgewidth': 0.5}


def styles(data: MapData) -> list[dict[str, Any]]:
    """Return the law's colour, marker and dashes of each variant, distinct without colour, too."""
    return [{'color': colour, 'marker': marker, 'linestyle': dashes} for colour, marker, dashes in
            zip(shaded([LAW_COLOURS.get(law, MIXED) for law in data.laws]), cycle('so^Dv<P>X'),
                cycle(['-', (0, (5, 1.5)), (0, (2.5, 1.2)), '-.', (0, (1, 1))]))]


def lines(data: MapData) -> Figure:
    """Draw median error and failure probability over the only axis."""
    (axis,) = data.axes
    figure, grid = drawing.sheet(f'Error and failures over {axis.name}', 2, (1.0,), 3.0)
    above = drawing.panel(figure, grid[0, 0], 'median of the RMS error', 'RMS error [rad]')
    below = drawing.panel(figure, grid[1, 0],
                          'failure probability, with intervals of 95 % (Wilson)',
                          'share of runs that fail')
    drawing.log_axis(above, data.median[np.isfinite(data.median)])
    for v, style in enumerate(styles(data)):
        aside = 0.06 * (axis.edges[1] - axis.edges[0]) * (v - 0.5 * (len(data.variants) - 1))
        _median(above, axis, data.median[v], aside, label=data.variants[v], **style)
        low, high = wilson(data.failed[v], data.runs[v])
        p = data.probability[v]
        below.errorbar(axis.positions + aside, p, elinewidth=0.8, capsize=2.0, yerr=[
            np.fmax(p - low, 0.0), np.fmax(high - p, 0.0)], **_MARKED, **style)
    below.axhline(LEVEL, color=drawing.REFERENCE, linewidth=0.8, linestyle=(0, (4, 2.5)))
    below.yaxis.set_major_formatter(PercentFormatter(1.0))
    below.set_ylim(-0.04, 1.04)
    for ax in (above, below):
        _ruled(ax, axis, 10)
    legend_of(above)
    return figure


def bands(data: MapData) -> Figure:
    """Draw the spread of the error of each variant over the only axis, a panel each."""
    (axis,) = data.axes
    columns = min(len(data.variants), 3)
    rows = -(-len(data.variants) // columns)
    figure, grid = drawing.sheet(f'Spread of the error over {axis.name}', rows,
                                 (1.0,) * columns, 2.2)
    for v, style in enumerate(styles(data)):
        ax = drawing.panel(figure, grid[v // columns, v % columns], data.variants[v],
                           'RMS error [rad]')
        drawing.log_axis(ax, data.quantiles[np.isfinite(data.quantiles)])
        top = ax.get_ylim()[1]
        low, _, high = np.minimum(data.quantiles[:, v], top)
        ax.fill_between(axis.positions, low, high, color=style['color'], alpha=0.22,
                        linewidth=0.0)
        for other in range(len(data.variants)):
            if other != v:
                ax.plot(axis.positions, np.where(np.isinf(data.median[other]), np.nan,
                                                 data.median[other]), color='#b5b5b5',
                        linewidth=0.7, zorder=1)
        _median(ax, axis, data.median[v], **style)
        _ruled(ax, axis, 5)
    return figure


def _median(ax: Axes, axis: GridAxis, values: Array, aside: float = 0.0, **style: Any) -> None:
    """Draw a line, and a cross at the top, this far aside, where the median is infinite."""
    gone = np.isinf(values)
    ax.plot(axis.positions, np.where(gone, np.nan, values), **_MARKED, **style)
    ax.plot(axis.positions[gone] + aside, np.ones(int(gone.sum())), 'x', color=style['color'],
            markersize=6.0, transform=ax.get_xaxis_transform(), clip_on=False)


def _ruled(ax: Axes, axis: GridAxis, most: int) -> None:
    ax.set(xlabel=axis.label, xlim=axis.edges[[0, -1]])
    ax.set_xticks(*axis.ticks(most))


def names_on(ax: Axes, names: Sequence[str]) -> None:
    """Let rows of the axes have names, from the top."""
    ax.set_yticks(range(len(names)), [textwrap.fill(name, 40) for name in names])
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.tick_params(axis='y', length=0)
