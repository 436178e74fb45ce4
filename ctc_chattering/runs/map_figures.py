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

"""Figures of maps: errors, and failures with the boundary and its interval."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.drawing import legend, legend_of
from ctc_chattering.analysis.tables import short
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.runs.figures import law_styles
from ctc_chattering.runs.map_data import (
    Counts,
    GridAxis,
    LEVEL,
    MapData,
    share,
    spaced,
    wilson,
)
import matplotlib
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import PercentFormatter
import numpy as np

#: Most panels beside each other, values of the third axis, and axes of a map that is drawn.
_COLUMNS, THIRD, _MOST_AXES = 4, 6, 3
_MARKED: dict[str, Any] = {'linewidth': 1.4, 'markersize': 4.5, 'markeredgecolor': 'white',
                           'markeredgewidth': 0.5}
#: Where there is no number: hatched, and plain colours of further reasons.
DIVERGED: dict[str, Any] = {'facecolor': '#e4e4e4', 'edgecolor': '#8c8c8c', 'hatch': '////'}
REFUSED, NO_RUN = '#9a9a9a', '#ffffff'
#: Where a gain has no number: the base or this law diverged.
_BETTER, _WORSE = '#08203d', '#4a0410'
#: Lines of the boundary, and of its uncertainty.
LINES: dict[str, dict[str, Any]] = {
    'half of the runs fail': {'linestyle': '-', 'linewidth': 1.8},
    'beyond, more than half fail (95 %)': {'linestyle': '--', 'linewidth': 1.1},
    'within, less than half fail (95 %)': {'linestyle': ':', 'linewidth': 1.4}}
#: Most steps of a distribution that are drawn.
_STEPS = 1000


def _ruled(ax: Axes, axis: str, grid: GridAxis, most: int) -> None:
    """Let an axis have the values of a grid, evenly spaced, at most so many with a text."""
    shown = spaced(len(grid.values), most)
    ax.set(**{f'{axis}label': grid.label, f'{axis}lim': (-0.5, len(grid.values) - 0.5),
              f'{axis}ticks': shown, f'{axis}ticklabels': [short(grid.values[k]) for k in shown]})


def lines(data: MapData) -> Figure:
    """Draw error, median and 5 % to 95 %, and failure probability over the only axis."""
    (axis,) = data.axes
    figure, grid = drawing.sheet(f'Error and failures over {axis.name}', 2, (1.0,), 3.0)
    above = drawing.panel(figure, grid[0, 0], 'median of the RMS error, and 5 % to 95 % of it',
                          'RMS error [rad]')
    below = drawing.panel(figure, grid[1, 0],
                          'failure probability, with intervals of 95 % (Wilson)',
                          'share of runs that fail')
    drawing.log_axis(above, data.quantiles[np.isfinite(data.quantiles)])
    x, top = np.arange(len(axis.values)), above.get_ylim()[1]
    for v, style in enumerate(law_styles(data.laws)):
        aside = 0.06 * (v - 0.5 * (len(data.variants) - 1))
        low, median, high = data.quantiles[:, v]
        gone = np.isinf(median)
        above.fill_between(x, np.minimum(low, top), np.minimum(high, top), color=style['color'],
                           alpha=0.12, linewidth=0.0)
        above.plot(x, np.where(gone, np.nan, median), label=data.variants[v], **_MARKED, **style)
        above.plot(x[gone] + aside, np.ones(int(gone.sum())), 'x', color=style['color'],
                   markersize=6.0, transform=above.get_xaxis_transform(), clip_on=False)
        p = data.probability[v]
        low, high = wilson(data.failed[v], data.runs[v])
        below.errorbar(x + aside, p, elinewidth=0.8, capsize=2.0, yerr=[
            np.fmax(p - low, 0.0), np.fmax(high - p, 0.0)], **_MARKED, **style)
    below.axhline(LEVEL, color=drawing.REFERENCE, linewidth=0.8, linestyle=(0, (4, 2.5)))
    below.yaxis.set_major_formatter(PercentFormatter(1.0))
    below.set_ylim(-0.04, 1.04)
    for ax in (above, below):
        _ruled(ax, 'x', axis, 12)
    legend_of(above)
    return figure


def maps(data: MapData, what: str, values: Array, bar: str, hatched: str,
         variants: Sequence[int] = (), limits: bool = False, ticks: str | None = None,
         handles: Sequence[Any] = (), **style: Any) -> Figure:
    """
    Draw numbers as colours: a panel for each variant and value of the third axis.

    Parameters
    ----------
    data : MapData
        Of two axes or three: the first is the abscissa, the second the ordinate.
    what, bar, hatched : str
        What it is, for the title; label of the colours; what a hatched cell, without a number, is.
    values : array, shape (V, *shape)
        The numbers.
    variants : sequence of int
        Their indices; all by default.
    limits : bool
        Whether the boundary is drawn, too.
    ticks : str, optional
        Format of the numbers beside the colours.
    handles : sequence of Artist
        What the legend has besides.
    style : object
        Of `Axes.pcolormesh`.

    """
    x, y = data.axes[:2]
    third = data.axes[2] if len(data.axes) > 2 else None
    places = [(v, k) for v in variants or range(len(data.variants)) for k in (
        (None,) if third is None else spaced(len(third.values), THIRD))]
    columns = min(len(places), _COLUMNS) if third is None else min(len(third.values), THIRD)
    rows = -(-len(places) // columns)
    figure, grid = drawing.sheet(f'{what} over {x.name} and {y.name}', rows, (1.0,) * columns,
                                 min(max(5.0 / columns, 1.3), 3.0))
    found: dict[str, Any] = {}
    for place, (v, k) in zip(product(range(rows), range(columns)), places):
        at: Any = (v, slice(None), slice(None), *(() if k is None else (k,)))
        shown, runs, failed, refused = (
            part[at].T for part in (values, data.runs, data.failed, data.refused))
        ax = drawing.panel(figure, grid[place], data.variants[v] if third is None or k is None else
                           f'{data.variants[v]}\n{third.at(k)}', '')
        ax.grid(False)
        ax.patch.set(**DIVERGED, linewidth=0.0)
        ax.spines[['top', 'right']].set_visible(True)
        _ruled(ax, 'x', x, max(2, 14 // columns))
        _ruled(ax, 'y', y, 6)
        if third is not None and place[0] + 1 < rows:
            ax.set_xlabel('')  # In place of a second line of the title below.
        cells = np.arange(len(x.values)), np.arange(len(y.values))
        drawn = ax.pcolormesh(*cells, np.ma.masked_invalid(shown), rasterized=True, **style)
        plain = {'refused': (REFUSED, (refused == runs) & (runs > 0)),
                 'no run': (NO_RUN, runs == 0)}
        for name, (colour, mask) in plain.items():
            if mask.any():
                ax.pcolormesh(*cells, np.ma.masked_where(~mask, mask), rasterized=True,
                              cmap=ListedColormap([colour]))
                found[name] = Patch(facecolor=colour, edgecolor='#999999', label=name)
        if (~np.isfinite(shown) & ~plain['refused'][1] & ~plain['no run'][1]).any():
            found[hatched] = Patch(**DIVERGED, label=hatched)
        found |= boundary(ax, failed, runs) if limits else {}
    bar_axes = figure.colorbar(drawn, ax=figure.axes, fraction=0.11, pad=0.02,
                               aspect=20 * rows, format=ticks).ax
    bar_axes.set_ylabel(bar, fontsize=10)
    bar_axes.tick_params(labelsize=9)
    legend(figure, [*handles, *(found[name] for name in (*LINES, hatched, 'refused', 'no run')
                                if name in found)])
    return figure


def boundary(ax: Axes, failed: Counts, runs: Counts) -> dict[str, Line2D]:
    """Draw where half of the runs fail, and its interval; return what a legend says of it."""
    x, y = ([-0.5, *range(n), n - 0.5] for n in reversed(runs.shape))
    handles = {}
    for values, (name, style) in zip((share(failed, runs), *wilson(failed, runs)),
                                     LINES.items()):
        # As far as the ends of the cells.
        z = np.pad(np.where(runs > 0, values, np.nan), 1, mode='edge')
        known = z[np.isfinite(z)]
        if len(known) and known.min() < LEVEL <= known.max():
            lines = ax.contour(
                x, y, np.ma.masked_invalid(z), [LEVEL - 1e-9], colors='#111111',
                linestyles=style['linestyle'], linewidths=style['linewidth'])
            lines.set(path_effects=[patheffects.withStroke(
                linewidth=style['linewidth'] + 1.6, foreground='white')])
            handles[name] = Line2D([], [], color='#111111', label=name, **style)
    return handles


def error_map(data: MapData) -> Figure:
    """Draw the median error, colours on a logarithmic scale that all panels share."""
    median = data.median
    positive = median[np.isfinite(median) & (median > 0.0)]
    low, high = np.quantile(positive, (0.01, 0.99), method='inverted_cdf') if len(positive) else (
        1e-3, 1.0)  # Without rare extremes.
    low, high = (low, high) if high >= 1.3 * low else (low / 1.2, high * 1.2)
    return maps(data, 'RMS error', np.maximum(median, low), 'median of the RMS error [rad]',
                'half of the runs or more diverged', norm=LogNorm(low, high), cmap='viridis')


def failure_map(data: MapData) -> Figure:
    """Draw the share of failures with its boundary, and the interval of this."""
    return maps(data, 'Failure probability', data.probability, 'share of runs that fail',
                '', limits=True, ticks='{x:.0%}', cmap='Oranges', norm=Normalize(0.0, 1.0))


def gain_map(data: MapData, base: int) -> Figure:
    """Draw by how many decades the median error is less than that of the base."""
    name, others = data.variants[base], [v for v in range(len(data.variants)) if v != base]
    with np.errstate(divide='ignore', invalid='ignore'):
        gain = np.log10(data.median[base]) - np.log10(data.median)
    finite = np.abs(gain[others][np.isfinite(gain[others])])
    most = max(float(np.quantile(finite, 0.99, method='inverted_cdf')), 0.1) if len(
        finite) else 1.0
    beyond = np.where(np.isinf(gain), np.sign(gain) * 1e3 * most, np.clip(gain, -most, most))
    one = [Patch(facecolor=colour, label=text) for extreme, colour, text in (
        (np.inf, _BETTER, f'only {name} diverged'), (-np.inf, _WORSE, 'only this law diverged'))
        if (gain[others] == extreme).any()]
    return maps(data, f'Gain against {name}', beyond, f'decades less error than {name}',
                'both diverged', others, handles=one, norm=Normalize(-most, most),
                cmap=matplotlib.colormaps['RdBu'].with_extremes(under=_WORSE, over=_BETTER))


def distributions(data: MapData) -> Figure:
    """Draw the share of runs with an error up to a value."""
    figure, grid = drawing.sheet('Distribution of the error', 1, (1.0,), 3.6)
    ax = drawing.panel(figure, grid[0, 0], '', 'share of runs with this error or less')
    error = data.rows['error'].to_numpy()
    known = error[np.isfinite(error) & (error > 0.0)]
    if len(known):
        ax.set(xscale='log', xlim=(known.min() / 1.3, known.max() * 1.3))
    end = ax.get_xlim()[1]
    for v, style in enumerate(law_styles(data.laws)):
        mine = np.sort(data.of(v)['error'])
        steps = np.array(spaced(len(mine), _STEPS))
        steps = steps[mine[steps] < np.inf]
        reached = (steps + 1.0) / len(mine)
        ax.step([*mine[steps], end], [*reached, reached.max(initial=0.0)], where='post',
                color=style['color'], linestyle=style['linestyle'], linewidth=1.6,
                label=data.variants[v])
    ax.set(xlabel='RMS error [rad]', ylim=(-0.02, 1.02))
    ax.yaxis.set_major_formatter(PercentFormatter(1.0))
    legend_of(ax)
    return figure


def figures(data: MapData) -> Iterator[tuple[str, Figure, str]]:
    """Yield file name, figure and caption; none for more than three axes."""
    if not data.axes:
        yield 'errors', distributions(data), (
            'Share of the runs with this error or less; a curve that ends below 1 lacks the runs '
            'that diverged. Further left is better.')
    elif len(data.axes) == 1:
        yield 'lines', lines(data), (
            'Above: error of the worst joint, line: median, × where half of the runs or more '
            'diverged, band: 5 % to 95 %. Below: share of runs that fail, with the interval of '
            'each value by itself; the marks of a value are moved aside of each other.')
    elif len(data.axes) <= _MOST_AXES:
        left_out = ''
        if len(data.axes) > 2 and len(data.axes[2].values) > THIRD:
            left_out = f' Of {data.axes[2].name}, {THIRD} of {len(data.axes[2].values)} values.'
        yield 'error', error_map(data), (
            'Median of the RMS error of the worst joint; all panels have the same colours. A '
            f'median hides single runs; they show among the failures.{left_out}')
        yield 'failure', failure_map(data), (
            f'Share of failures among {data.runs.max()} runs at each point. Solid: a half. Beyond '
            'the dashed line the interval of 95 % (Wilson) of a point by itself is above a half, '
            'within the dotted one below; between them, and with less than 4 runs everywhere, '
            f'the runs do not decide.{left_out}')
        if data.base is not None and len(data.variants) > 1:
            yield 'gain', gain_map(data, data.base), (
                f'log₁₀ of the median error under {data.variants[data.base]} over that under the '
                'law, at the same point. Blue: the law has the smaller error; 1 is ten times '
                f'smaller.{left_out}')
