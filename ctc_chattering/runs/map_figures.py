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
Figures of a map.

They show errors, and failures with their boundary and its interval. `map_page` calls `figures`.
One axis gives lines, two or three give panels of coloured cells, and more give no figure.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.drawing import legend, legend_of
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.runs.law_figures import law_styles
from ctc_chattering.runs.map_data import (
    Counts,
    failure_share,
    GridAxis,
    MapData,
    PASSING_SHARE,
    spaced_indices,
    wilson_interval,
)
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import PercentFormatter
import numpy as np

#: Values of the third axis that have a panel.
MAX_THIRD_VALUES = 6
_LINES: dict[str, Any] = {
    'linewidth': 1.4, 'markersize': 4.5, 'markeredgecolor': 'white', 'markeredgewidth': 0.5}
#: Style of a cell without a number, and its text in the legend.
_HATCHED: dict[str, Any] = {'facecolor': '#e4e4e4', 'edgecolor': '#8c8c8c', 'hatch': '////'}
NO_NUMBER = 'half of the runs or more diverged or were refused, or no run'
#: Lines of the boundary and of its interval, by their text in the legend.
BOUNDARY_LINES: dict[str, dict[str, Any]] = {
    'half of the runs fail': {'linestyle': '-', 'linewidth': 1.8},
    'beyond, more than half fail (95 %)': {'linestyle': '--', 'linewidth': 1.1},
    'within, less than half fail (95 %)': {'linestyle': ':', 'linewidth': 1.4}}
_BOUNDARY_COLOUR = '#111111'


def _set_ticks(ax: Axes, direction: str, grid: GridAxis, limit: int) -> None:
    """Space the values of a grid evenly, with up to `limit` ticks."""
    ticks = spaced_indices(len(grid.values), limit)
    ax.set(**{f'{direction}label': grid.label,
              f'{direction}lim': (-0.5, len(grid.values) - 0.5), f'{direction}ticks': ticks,
              f'{direction}ticklabels': [f'{grid.values[k]:.4g}' for k in ticks]})


def draw_lines(data: MapData) -> Figure:
    """Draw quantiles of the error, and failures, over the axis."""
    (axis,) = data.axes
    figure, grid = drawing.sheet(f'Error and failures over {axis.name}', 2, (1.0,), 3.0)
    errors = drawing.panel(figure, grid[0, 0], 'median of the RMS error, and 5 % to 95 % of it',
                           'RMS error [rad]')
    failures = drawing.panel(figure, grid[1, 0],
                             'failure probability, with intervals of 95 % (Wilson)',
                             'share of runs that fail')
    drawing.log_axis(errors, data.quantiles[np.isfinite(data.quantiles)])
    x = np.arange(len(axis.values))
    top = errors.get_ylim()[1]
    for v, style in enumerate(law_styles(data.laws)):
        shifted = x + 0.06 * (v - 0.5 * (len(data.variants) - 1))
        low, median, high = data.quantiles[:, v]
        diverged = np.isinf(median)
        errors.fill_between(x, np.minimum(low, top), np.minimum(high, top), color=style['color'],
                            alpha=0.12, linewidth=0.0)
        errors.plot(x, np.where(diverged, np.nan, median), label=data.variants[v], **_LINES,
                    **style)
        errors.plot(shifted[diverged], np.ones(int(diverged.sum())), 'x', color=style['color'],
                    markersize=6.0, transform=errors.get_xaxis_transform(), clip_on=False)
        p = data.probability[v]
        low, high = wilson_interval(data.failed[v], data.runs[v])
        failures.errorbar(shifted, p, elinewidth=0.8, capsize=2.0, yerr=[
            np.fmax(p - low, 0.0), np.fmax(high - p, 0.0)], **_LINES, **style)
    failures.axhline(
        PASSING_SHARE, color=drawing.REFERENCE, linewidth=0.8, linestyle=(0, (4, 2.5)))
    failures.yaxis.set_major_formatter(PercentFormatter(1.0))
    failures.set_ylim(-0.04, 1.04)
    for ax in (errors, failures):
        _set_ticks(ax, 'x', axis, 12)
    legend_of(errors)
    return figure


def draw_cells(data: MapData, title: str, values: Array, bar: str, variants: Sequence[int],
               with_boundary: bool = False, **style: Any) -> Figure:
    """
    Draw numbers as colours.

    Each variant and value of the third axis has a panel.

    Parameters
    ----------
    data : MapData
        Map of two or three axes. The first is the abscissa, the second the ordinate.
    title, bar : str
        Title of the figure, and label of the colours.
    values : array, shape (V, *shape)
        The numbers. A cell without one is hatched.
    variants : sequence of int
        Indices of those that are drawn.
    with_boundary : bool
        Whether the boundary of failures is drawn.
    style : object
        Arguments of `Axes.pcolormesh`.

    """
    x, y, *third = data.axes
    shape: Any = (len(data.variants), len(x.values), len(y.values), -1)
    numbers = np.reshape(values, shape)
    runs = np.reshape(data.runs, shape)
    failed = np.reshape(data.failed, shape)
    shown = spaced_indices(numbers.shape[-1], MAX_THIRD_VALUES)
    panels = [(v, k) for v in variants for k in shown]
    columns = len(shown) if third else min(len(panels), 4)
    rows = -(-len(panels) // columns)
    figure, grid = drawing.sheet(f'{title} over {x.name} and {y.name}', rows, (1.0,) * columns,
                                 min(max(5.0 / columns, 1.3), 3.0))
    for panel, (v, k) in enumerate(panels):
        name = '\n'.join((data.variants[v], *(axis.value_text(k) for axis in third)))
        ax = drawing.panel(figure, grid[panel // columns, panel % columns], name, '')
        ax.grid(False)
        ax.patch.set(**_HATCHED, linewidth=0.0)
        ax.spines[['top', 'right']].set_visible(True)
        _set_ticks(ax, 'x', x, max(2, 14 // columns))
        _set_ticks(ax, 'y', y, 6)
        if third and panel + columns < len(panels):
            ax.set_xlabel('')  # The second line of the title below takes its place.
        drawn = ax.pcolormesh(np.arange(len(x.values)), np.arange(len(y.values)),
                              np.ma.masked_invalid(numbers[v, ..., k].T), rasterized=True, **style)
        if with_boundary:
            _draw_boundary(ax, failed[v, ..., k].T, runs[v, ..., k].T)
    bar_axes = figure.colorbar(
        drawn, ax=figure.axes, fraction=0.11, pad=0.02, aspect=20 * rows).ax
    bar_axes.set_ylabel(bar, fontsize=10)
    bar_axes.tick_params(labelsize=9)
    handles: list[Any] = []
    if with_boundary:
        handles += [Line2D([], [], color=_BOUNDARY_COLOUR, label=name, **line)
                    for name, line in BOUNDARY_LINES.items()]
    if not np.isfinite(numbers[list(variants)]).all():
        handles.append(Patch(**_HATCHED, label=NO_NUMBER))
    legend(figure, handles)
    return figure


def _draw_boundary(ax: Axes, failed: Counts, runs: Counts) -> None:
    """Draw where half of the runs fail, with interval."""
    x, y = ([-0.5, *range(n), n - 0.5] for n in reversed(runs.shape))
    shares = failure_share(failed, runs), *wilson_interval(failed, runs)
    for values, style in zip(shares, BOUNDARY_LINES.values()):
        # Padded, lines reach the ends of the cells.
        z = np.pad(np.where(runs > 0, values, np.nan), 1, mode='edge')
        if (z < PASSING_SHARE).any() and (z >= PASSING_SHARE).any():
            ax.contour(x, y, np.ma.masked_invalid(z), [PASSING_SHARE - 1e-9],
                       colors=_BOUNDARY_COLOUR, linestyles=style['linestyle'],
                       linewidths=style['linewidth'])


def draw_errors(data: MapData) -> Figure:
    """Draw the median error on a logarithmic scale."""
    positive = data.median[np.isfinite(data.median) & (data.median > 0.0)]
    low, high = (positive.min(), positive.max()) if len(positive) else (1e-3, 1.0)
    return draw_cells(
        data, 'RMS error', np.maximum(data.median, low), 'median of the RMS error [rad]',
        range(len(data.variants)), norm=LogNorm(low, max(high, 1.3 * low)), cmap='viridis')


def draw_failures(data: MapData) -> Figure:
    """Draw the share of failures with its boundary."""
    # Colours on which the boundary is distinct.
    colours = ListedColormap(colormaps['Oranges'](np.linspace(0.0, 0.6, 256)))
    return draw_cells(
        data, 'Failure probability', data.probability, 'share of runs that fail',
        range(len(data.variants)), with_boundary=True, cmap=colours, norm=Normalize(0.0, 1.0))


def draw_gain(data: MapData, base: int) -> Figure:
    """Draw the gain in median error over the base [decades]."""
    name = data.variants[base]
    compared = [v for v in range(len(data.variants)) if v != base]
    with np.errstate(divide='ignore', invalid='ignore'):
        gain = np.log10(data.median[base]) - np.log10(data.median)
    finite = np.abs(gain[compared][np.isfinite(gain[compared])])
    largest = finite.max(initial=0.1)
    return draw_cells(
        data, f'Gain against {name}', np.clip(gain, -largest, largest),
        f'decades less error than {name}', compared, norm=Normalize(-largest, largest),
        cmap='RdBu')


def figures(data: MapData) -> Iterator[tuple[str, Figure, str]]:
    """Yield name, figure and caption, for one to three axes."""
    if len(data.axes) == 1:
        yield 'lines', draw_lines(data), (
            'The upper panel shows the error of the worst joint: its median, × where half of the '
            'runs or more diverged, and 5 % to 95 %. The lower panel shows the share of runs that '
            'fail, with intervals. The marks of different laws are shifted sideways.')
    if len(data.axes) not in (2, 3):
        return
    omitted = ''
    if len(data.axes) == 3 and len(data.axes[2].values) > MAX_THIRD_VALUES:
        axis = data.axes[2]
        omitted = f' {MAX_THIRD_VALUES} of {len(axis.values)} values of {axis.name} are shown.'
    yield 'error', draw_errors(data), (
        'Median of the RMS error of the worst joint. All panels have the same colours. A median '
        f'hides single runs, which show among the failures.{omitted}')
    yield 'failure', draw_failures(data), (
        f'Share of failures among {data.runs.max()} runs at each point. Half of the runs fail on '
        'the solid line. The 95 % interval (Wilson) of a single point ends at the dashed and '
        f'dotted lines. Between them the runs do not decide.{omitted}')
    if data.base is not None and len(data.variants) > 1:
        yield 'gain', draw_gain(data, data.base), (
            'log₁₀ of the ratio of median errors at the same point. In blue the law has the '
            'smaller error, and 1 is ten times smaller. The strongest blue or red also shows '
            f'where only one of both diverged. Where both did, the cell is hatched.{omitted}')
