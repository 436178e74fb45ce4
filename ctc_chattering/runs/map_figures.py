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
from typing import Any

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.drawing import legend, legend_of
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.runs.map_data import Counts, GridAxis, LEVEL, MapData, share, spaced, wilson
from ctc_chattering.runs.run_figures import law_styles
from matplotlib import colormaps
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
#: Where there is no number, and what the legend says of it.
_HATCHED: dict[str, Any] = {'facecolor': '#e4e4e4', 'edgecolor': '#8c8c8c', 'hatch': '////'}
NO_NUMBER = 'half of the runs or more diverged or were refused, or no run'
#: Lines of the boundary, and of its uncertainty.
LINES: dict[str, dict[str, Any]] = {
    'half of the runs fail': {'linestyle': '-', 'linewidth': 1.8},
    'beyond, more than half fail (95 %)': {'linestyle': '--', 'linewidth': 1.1},
    'within, less than half fail (95 %)': {'linestyle': ':', 'linewidth': 1.4}}
_BLACK = '#111111'
#: Colours of shares, of which the boundary is distinct.
_SHARES = ListedColormap(colormaps['Oranges'](np.linspace(0.0, 0.6, 256)))


def _ruled(ax: Axes, axis: str, grid: GridAxis, most: int) -> None:
    """Let an axis have the values of a grid, evenly spaced, at most so many with a text."""
    shown = spaced(len(grid.values), most)
    ax.set(**{f'{axis}label': grid.label, f'{axis}lim': (-0.5, len(grid.values) - 0.5),
              f'{axis}ticks': shown,
              f'{axis}ticklabels': [f'{grid.values[k]:.4g}' for k in shown]})


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


def maps(data: MapData, title: str, values: Array, bar: str, variants: Sequence[int],
         limits: bool = False, **style: Any) -> Figure:
    """
    Draw numbers as colours: a panel for each variant and value of the third axis.

    Parameters
    ----------
    data : MapData
        Of two axes or three: the first is the abscissa, the second the ordinate.
    title, bar : str
        What it is; label of the colours.
    values : array, shape (V, *shape)
        The numbers; a cell without one is hatched.
    variants : sequence of int
        Indices of those that are drawn.
    limits : bool
        Whether the boundary is drawn, too.
    style : object
        Of `Axes.pcolormesh`.

    """
    x, y, *more = data.axes
    shape: Any = (len(data.variants), len(x.values), len(y.values), -1)
    numbers, runs, failed = (np.reshape(x, shape) for x in (values, data.runs, data.failed))
    panels = [(v, k) for v in variants for k in spaced(numbers.shape[-1], THIRD)]
    columns = min(numbers.shape[-1], THIRD) if more else min(len(panels), _COLUMNS)
    rows = -(-len(panels) // columns)
    figure, grid = drawing.sheet(f'{title} over {x.name} and {y.name}', rows, (1.0,) * columns,
                                 min(max(5.0 / columns, 1.3), 3.0))
    for place, (v, k) in enumerate(panels):
        name = '\n'.join((data.variants[v], *(axis.at(k) for axis in more)))
        ax = drawing.panel(figure, grid[place // columns, place % columns], name, '')
        ax.grid(False)
        ax.patch.set(**_HATCHED, linewidth=0.0)
        ax.spines[['top', 'right']].set_visible(True)
        _ruled(ax, 'x', x, max(2, 14 // columns))
        _ruled(ax, 'y', y, 6)
        if more and place + columns < len(panels):
            ax.set_xlabel('')  # In place of a second line of the title below.
        drawn = ax.pcolormesh(np.arange(len(x.values)), np.arange(len(y.values)),
                              np.ma.masked_invalid(numbers[v, ..., k].T), rasterized=True, **style)
        if limits:
            _boundary(ax, failed[v, ..., k].T, runs[v, ..., k].T)
    bar_axes = figure.colorbar(
        drawn, ax=figure.axes, fraction=0.11, pad=0.02, aspect=20 * rows).ax
    bar_axes.set_ylabel(bar, fontsize=10)
    bar_axes.tick_params(labelsize=9)
    handles: list[Any] = [Line2D([], [], color=_BLACK, label=name, **line)
                          for name, line in LINES.items() if limits]
    if not np.isfinite(numbers[list(variants)]).all():
        handles.append(Patch(**_HATCHED, label=NO_NUMBER))
    legend(figure, handles)
    return figure


def _boundary(ax: Axes, failed: Counts, runs: Counts) -> None:
    """Draw where half of the runs fail, and its interval."""
    x, y = ([-0.5, *range(n), n - 0.5] for n in reversed(runs.shape))
    for values, style in zip((share(failed, runs), *wilson(failed, runs)), LINES.values()):
        # As far as the ends of the cells.
        z = np.pad(np.where(runs > 0, values, np.nan), 1, mode='edge')
        if (z < LEVEL).any() and (z >= LEVEL).any():
            ax.contour(x, y, np.ma.masked_invalid(z), [LEVEL - 1e-9], colors=_BLACK,
                       linestyles=style['linestyle'], linewidths=style['linewidth'])


def error_map(data: MapData) -> Figure:
    """Draw the median error, colours on a logarithmic scale that all panels share."""
    positive = data.median[np.isfinite(data.median) & (data.median > 0.0)]
    low, high = (positive.min(), positive.max()) if len(positive) else (1e-3, 1.0)
    return maps(data, 'RMS error', np.maximum(data.median, low), 'median of the RMS error [rad]',
                range(len(data.variants)), norm=LogNorm(low, max(high, 1.3 * low)),
                cmap='viridis')


def failure_map(data: MapData) -> Figure:
    """Draw the share of failures with its boundary, and the interval of this."""
    return maps(data, 'Failure probability', data.probability, 'share of runs that fail',
                range(len(data.variants)), True, cmap=_SHARES, norm=Normalize(0.0, 1.0))


def gain_map(data: MapData, base: int) -> Figure:
    """Draw by how many decades the median error is less than that of the base."""
    name, others = data.variants[base], [v for v in range(len(data.variants)) if v != base]
    with np.errstate(divide='ignore', invalid='ignore'):
        gain = np.log10(data.median[base]) - np.log10(data.median)
    finite = np.abs(gain[others][np.isfinite(gain[others])])
    most = finite.max(initial=0.1)
    return maps(data, f'Gain against {name}', np.clip(gain, -most, most),
                f'decades less error than {name}', others, norm=Normalize(-most, most),
                cmap='RdBu')


def figures(data: MapData) -> Iterator[tuple[str, Figure, str]]:
    """Yield file name, figure and caption; none without axes, and for more than three."""
    if len(data.axes) == 1:
        yield 'lines', lines(data), (
            'Above: error of the worst joint: median, × where half of the runs or more diverged, '
            'and 5 % to 95 %. Below: share of runs that fail, with intervals. Marks are aside.')
    elif 1 < len(data.axes) <= _MOST_AXES:
        left_out = ''
        if len(data.axes) > 2 and len(data.axes[2].values) > THIRD:
            left_out = f' Of {data.axes[2].name}, {THIRD} of {len(data.axes[2].values)} values.'
        yield 'error', error_map(data), (
            'Median of the RMS error of the worst joint; all panels have the same colours. A '
            f'median hides single runs; they show among the failures.{left_out}')
        yield 'failure', failure_map(data), (
            f'Share of failures among {data.runs.max()} runs at each point. Solid: a half; dashed '
            'and dotted: the 95 % interval (Wilson) of a point by itself ends there, between '
            f'them the runs do not decide.{left_out}')
        if data.base is not None and len(data.variants) > 1:
            yield 'gain', gain_map(data, data.base), (
                'log₁₀ of the ratio of median errors at the same point. Blue: the law has the '
                'smaller one; 1 is ten times smaller. The strongest blue or red also where only '
                f'one of both diverged; hatched where both did.{left_out}')
