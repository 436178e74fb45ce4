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

"""Figures of a map: maps over two axes, lines over one, distributions, Sobol indices."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from itertools import cycle
from pathlib import Path
import textwrap
from typing import Any, NamedTuple

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.drawing import legend, legend_of
from ctc_chattering.analysis.run_names import LAW_COLOURS, MIXED, shaded
from ctc_chattering.analysis.tables import short, Table, two_lines
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.runs.map_data import (
    GridAxis,
    KINDS,
    LEVEL,
    MapData,
    pooled,
    round_decades,
    share,
    slices,
    spaced,
    wilson,
)
import matplotlib
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import PercentFormatter
import numpy as np
import numpy.typing as npt

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
        _ruled_axis(ax, axis, 10)
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
        _ruled_axis(ax, axis, 5)
    return figure


def _median(ax: Axes, axis: GridAxis, values: Array, aside: float = 0.0, **style: Any) -> None:
    """Draw a line, and a cross at the top, this far aside, where the median is infinite."""
    gone = np.isinf(values)
    ax.plot(axis.positions, np.where(gone, np.nan, values), **_MARKED, **style)
    ax.plot(axis.positions[gone] + aside, np.ones(int(gone.sum())), 'x', color=style['color'],
            markersize=6.0, transform=ax.get_xaxis_transform(), clip_on=False)


def _ruled_axis(ax: Axes, axis: GridAxis, most: int) -> None:
    ax.set(xlabel=axis.label, xlim=axis.edges[[0, -1]])
    ax.set_xticks(*axis.ticks(most))


def names_on(ax: Axes, names: Sequence[str]) -> None:
    """Let rows of the axes have names, from the top."""
    ax.set_yticks(range(len(names)), [textwrap.fill(name, 40) for name in names])
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.tick_params(axis='y', length=0)


#: Of a sheet and its panels [inch].
_WIDTH, _LEFT, _RIGHT, _TOP, _BOTTOM = 11.0, 0.8, 1.15, 0.5, 0.55
_SIDE, _GAP, _TITLE, _HEADER, _WIDEST, _TALLEST = 0.16, 0.14, 0.24, 0.3, 4.4, 3.0
#: Which cells.
Mask = npt.NDArray[np.bool_]
#: Most panels beside each other, and values of the third axis.
_COLUMNS, THIRD = 5, 6
#: Where there is no number: hatched, and plain colours of further reasons.
DIVERGED: dict[str, Any] = {'facecolor': '#e4e4e4', 'edgecolor': '#8c8c8c', 'hatch': '////'}
REFUSED, NO_RUN = '#9a9a9a', '#ffffff'
#: Lines of the boundary, and of its uncertainty.
LINES: dict[str, dict[str, Any]] = {
    'half of the runs fail': {'linestyle': '-', 'linewidth': 1.8},
    'beyond, more than half fail (95 %)': {'linestyle': '--', 'linewidth': 1.1},
    'within, less than half fail (95 %)': {'linestyle': ':', 'linewidth': 1.4}}


@dataclasses.dataclass(frozen=True)
class MapPanel:
    """A panel: its axes, the variant, and indices of the axes after the second."""

    ax: Axes
    variant: int
    index: tuple[int, ...]

    def cells(self, values: Any) -> Any:
        """Return what the panel shows of values of shape (V, *shape), shape (ny, nx)."""
        mine = values[self.variant]
        return mine.reshape(*mine.shape[:2], -1)[
            ..., np.ravel_multi_index(self.index, mine.shape[2:]) if self.index else 0].T


@dataclasses.dataclass(frozen=True)
class Sheet:
    """A figure with its panels; `bar` is the place of the colour bar."""

    figure: Figure
    places: tuple[MapPanel, ...]
    bar: tuple[float, float, float, float]

    def colour_bar(self, mappable: ScalarMappable, label: str, **style: Any) -> Axes:
        """Draw the colour bar, and return its axes."""
        ax = self.figure.add_axes(self.bar)
        self.figure.colorbar(mappable, cax=ax, **style)
        ax.set_ylabel(label, fontsize=10)
        ax.tick_params(labelsize=9)
        return ax


def sheet(data: MapData, title: str, variants: Sequence[int], rest: tuple[int, ...]) -> Sheet:
    """
    Return a sheet with a panel for each variant and value of the third axis.

    Parameters
    ----------
    data : MapData
        Of two axes or more: the first is the abscissa, the second the ordinate.
    title : str
        Of the figure.
    variants : sequence of int
        Their indices.
    rest : tuple of int
        Indices of the axes after the third.

    """
    table, columns, heads = _arranged(data, variants, rest)
    rows, header = len(table), _HEADER if heads else 0.0
    width = min((_WIDTH - _LEFT - header - _RIGHT - (columns - 1) * _SIDE) / columns, _WIDEST)
    height = min(0.8 * width, _TALLEST) if rows < 4 else max(min(0.6 * width, 1.9), 1.25)
    gap = _GAP + (0.0 if heads else _TITLE)
    above = _TOP + _TITLE
    inner = rows * height + (rows - 1) * gap
    whole = above + inner + _BOTTOM
    figure, _ = drawing.sheet(title, 1, (1.0,), whole - 1.33)
    left = _LEFT + header
    right = left + columns * width + (columns - 1) * _SIDE
    grid = figure.add_gridspec(
        rows, columns, left=left / _WIDTH, right=right / _WIDTH, top=1.0 - above / whole,
        bottom=_BOTTOM / whole, wspace=_SIDE / width, hspace=gap / height)
    places = []
    for row, line in enumerate(table):
        for column, (variant, index, name) in enumerate(line):
            ax = drawing.panel(figure, grid[row, column],
                               name if not heads or not row else '', '')
            last = row + 1 == rows or column >= len(table[row + 1])
            _ruled(ax, data.axes[0], data.axes[1], width, height, not column, last)
            if heads and not column:
                text = textwrap.fill(heads[row], max(8, int(height / 0.085)), max_lines=2,
                                     placeholder='…')
                middle = above + row * (height + gap) + 0.5 * height
                figure.text(0.12 / _WIDTH, 1.0 - middle / whole, text, rotation=90, va='center',
                            fontsize=10, color='#333333')
            places.append(MapPanel(ax, variant, index))
    tall = min(inner, 4.0)
    return Sheet(figure, tuple(places), (
        (right + 0.2) / _WIDTH, 1.0 - (above + tall) / whole, 0.16 / _WIDTH, tall / whole))


def _arranged(data: MapData, variants: Sequence[int], rest: tuple[int, ...]
              ) -> tuple[list[list[tuple[int, tuple[int, ...], str]]], int, list[str]]:
    """
    Return rows of panels (variant, index, title), number of columns, and titles of the rows.

    Without a third axis the variants fill rows; with it, rows are its values and columns the
    variants, or the other way if there are more variants than fit.
    """
    if len(data.shape) == 2:
        n = len(variants)
        columns = min(n, 3 if n % 3 == 0 or n == 5 else 4)
        panels = [(v, rest, data.variants[v]) for v in variants]
        return [panels[k:k + columns] for k in range(0, n, columns)], columns, []
    axis = data.axes[2]
    third = [(k, axis.at(k)) for k in spaced(len(axis.values), THIRD)]
    if len(data.variants) <= _COLUMNS or len(third) > _COLUMNS:
        return ([[(v, (k, *rest), data.variants[v]) for v in variants] for k, _ in third],
                len(variants), [name for _, name in third])
    return ([[(v, (k, *rest), name) for k, name in third] for v in variants], len(third),
            [data.variants[v] for v in variants])


def _ruled(ax: Axes, x: GridAxis, y: GridAxis, width: float, height: float, first: bool, last: bool
           ) -> None:
    """Set limits, ticks and labels; texts in the first column and the last row only."""
    ax.grid(False)
    ax.set(xlabel=x.label if last else '', ylabel=y.label if first else '',
           xlim=x.edges[[0, -1]], ylim=y.edges[[0, -1]])
    places, texts = x.ticks(max(2, int(width / 0.42)))
    ax.set_xticks(places, texts if last else [''] * len(texts))
    places, texts = y.ticks(max(2, int(height / 0.25)))
    ax.set_yticks(places, texts if first else [''] * len(texts))
    ax.tick_params(labelsize=8.5, length=2.5)
    ax.spines[['top', 'right']].set_visible(True)


def mesh(place: MapPanel, data: MapData, values: Array, **style: Any) -> ScalarMappable:
    """Draw the cells; the background shows where `values`, shape (ny, nx), are not finite."""
    x, y = (axis.edges for axis in data.axes[:2])
    place.ax.patch.set(**DIVERGED, linewidth=0.0)
    drawn = place.ax.pcolormesh(x, y, np.ma.masked_invalid(values), rasterized=True, **style)
    for colour, cells in zip((REFUSED, NO_RUN), _plain(place, data)):
        if cells.any():
            place.ax.pcolormesh(x, y, np.ma.masked_where(~cells, cells), rasterized=True,
                                cmap=ListedColormap([colour]))
    return drawn


def states(places: Sequence[MapPanel], data: MapData, hatched: Sequence[Mask], text: str
           ) -> list[Patch]:
    """Return what a legend says of cells without a number; `text` is for the hatched ones."""
    plain = [_plain(place, data) for place in places]
    found = [any((cells & ~x & ~y).any() for cells, (x, y) in zip(hatched, plain)),
             any(x.any() for x, _ in plain), any(y.any() for _, y in plain)]
    return [Patch(**style, label=name) for there, style, name in zip(
        found, (DIVERGED, {'facecolor': REFUSED}, {'facecolor': NO_RUN, 'edgecolor': '#999999'}),
        (text, 'refused', 'no run')) if there]


def _plain(place: MapPanel, data: MapData) -> tuple[Mask, Mask]:
    """Return where all runs were refused, and where there is none."""
    runs = place.cells(data.runs)
    return (place.cells(data.refused) == runs) & (runs > 0), runs == 0


def boundary(place: MapPanel, data: MapData) -> list[Line2D]:
    """Draw where half of the runs fail, and its interval; return what a legend says of it."""
    failed, runs = place.cells(data.failed), place.cells(data.runs)
    x, y = ([axis.edges[0], *axis.positions, axis.edges[-1]] for axis in data.axes[:2])
    handles = []
    for values, (name, style) in zip((share(failed, runs), *wilson(failed, runs)),
                                     LINES.items()):
        # As far as the ends of the cells.
        z = np.pad(np.where(runs > 0, values, np.nan), 1, mode='edge')
        known = z[np.isfinite(z)]
        if len(known) and known.min() < LEVEL <= known.max():
            lines = place.ax.contour(
                x, y, np.ma.masked_invalid(z), [LEVEL - 1e-9], colors='#111111',
                linestyles=style['linestyle'], linewidths=style['linewidth'])
            lines.set(path_effects=[patheffects.withStroke(
                linewidth=style['linewidth'] + 1.6, foreground='white')])
            handles.append(Line2D([], [], color='#111111', label=name, **style))
    return handles


#: Colours of `KINDS`.
KIND_COLOURS = ('#1b1b1b', '#D55E00', '#E69F00', '#009E73', '#56B4E9', '#7B5EA7', '#b5b5b5')
#: Most steps of a distribution that are drawn.
_STEPS = 1000


def distributions(data: MapData) -> Figure:
    """Draw the share of runs with an error up to a value."""
    figure, grid = drawing.sheet('Distribution of the error', 1, (1.0,), 3.6)
    ax = drawing.panel(figure, grid[0, 0], '', 'share of runs with this error or less')
    error = data.rows['error'].to_numpy()
    known = error[np.isfinite(error) & (error > 0.0)]
    if len(known):
        ax.set(xscale='log', xlim=(known.min() / 1.3, known.max() * 1.3))
    end = ax.get_xlim()[1]
    for v, style in enumerate(styles(data)):
        mine = np.sort(data.of(v)['error'])
        steps = np.array(spaced(len(mine), _STEPS))
        reached = (steps + 1.0) / len(mine)
        known = mine[steps] < np.inf
        ax.step([*mine[steps][known], end], [*reached[known], reached[known].max(initial=0.0)],
                where='post', color=style['color'], linestyle=style['linestyle'], linewidth=1.6,
                label=data.variants[v])
    ax.set(xlabel='RMS error [rad]', ylim=(-0.02, 1.02))
    ax.yaxis.set_major_formatter(PercentFormatter(1.0))
    legend_of(ax)
    return figure


def shares(data: MapData) -> Figure:
    """Draw the share of each kind of failure, with the interval of all."""
    n = len(data.variants)
    left = min(4.0, 0.5 + 0.075 * max(map(len, data.variants)))
    figure, grid = drawing.sheet('Failures by kind', 1, (1.0,), 0.36 * n + 0.4, left=left)
    ax = drawing.panel(figure, grid[0, 0], '', '')
    runs = np.array([len(data.of(v)) for v in range(n)])
    ax.set_axisbelow(True)
    ax.grid(False, axis='y')
    before = np.zeros(n)
    for kind, colour, count in zip(KINDS, KIND_COLOURS, data.kinds):
        if count.any():
            ax.barh(range(n), count / runs, left=before, height=0.66, color=colour, label=kind)
            before += count / runs
    low, high = np.array([pooled(*data.of_draws(v)) for v in range(n)]).T
    ax.errorbar(before, range(n), xerr=np.maximum([before - low, high - before], 0.0),
                fmt='none', ecolor='#777777', elinewidth=1.4, capsize=4.0)
    ax.set(xlabel='share of runs that fail', xlim=(0.0, 1.0))
    ax.xaxis.set_major_formatter(PercentFormatter(1.0))
    names_on(ax, data.variants)
    if before.any():
        legend_of(ax)
    return figure


def correlations(data: MapData) -> Figure:
    """Draw Spearman's rank correlation of the error with each axis and uncertain parameter."""
    names, n = data.columns, len(data.variants)
    columns = min(n, 3)
    left = min(3.4, 0.4 + 0.075 * max(map(len, names)))
    figure, grid = drawing.sheet('What the error depends on', -(-n // columns), (1.0,) * columns,
                                 0.26 * len(names) + 0.3, left=left)
    for v, found in enumerate(rank_correlations(data)):
        ax = drawing.panel(figure, grid[v // columns, v % columns], data.variants[v], '')
        if not data.axes:
            half = 1.96 / np.sqrt(max(int(data.runs[v]) - 1, 1))
            ax.axvspan(-half, half, color='#eeeeee', linewidth=0.0, zorder=0)
        ax.barh(range(len(names)), np.nan_to_num(found), height=0.6, color=np.where(
            found > 0.0, '#D55E00', '#0072B2').tolist(), zorder=2)
        ax.grid(False, axis='y')
        ax.axvline(0.0, color=drawing.REFERENCE, linewidth=0.8)
        ax.set(xlabel='rank correlation', xlim=(-1.0, 1.0))
        names_on(ax, names if not v % columns else [''] * len(names))
    return figure


def rank_correlations(data: MapData) -> Array:
    """
    Return Spearman's rank correlations, shape (V, axes and uncertain parameters).

    A run without an error counts as the largest; nan where one of both never changes.
    """
    ranks = [data.of(v)[[*data.columns, 'error']].rank() for v in range(len(data.variants))]
    return np.array([x.corr()['error'][data.columns] for x in ranks])


#: Resamples of the intervals, and the ends of these.
_RESAMPLES, _ENDS = 500, (2.5, 97.5)


class SobolIndices(NamedTuple):
    """Of each of m quantities: index of first order and total one; with ends, shape (2, m)."""

    first: Array
    total: Array
    first_ends: Array
    total_ends: Array


def sobol_indices(values: Array, m: int) -> SobolIndices:
    """
    Return the indices of what a run gives, for draws of `sampling: saltelli`.

    Estimators of SciPy (Saltelli et al., *Variance based sensitivity analysis of model output*,
    Computer Physics Communications 181, 2010); intervals of 95 % are percentiles of a bootstrap.

    Parameters
    ----------
    values : array, shape ((m + 2) n,)
        Of each draw, in their order.
    m : int
        Number of uncertain quantities.

    """
    from scipy import stats  # type: ignore[import-untyped]
    parts = np.asarray(values, float).reshape(m + 2, 1, -1)
    n, rng = parts.shape[-1], np.random.default_rng(0)

    def of(which: npt.NDArray[np.int_]) -> Array:
        A, B, *AB = parts[..., which]
        found = stats.sobol_indices(func={'f_A': A, 'f_B': B, 'f_AB': np.array(AB)}, n=n)
        return np.stack([found.first_order.reshape(m), found.total_order.reshape(m)])

    with np.errstate(divide='ignore', invalid='ignore'):
        first, total = of(np.arange(n))
        ends = np.nanpercentile([of(rng.integers(0, n, n)) for _ in range(_RESAMPLES)], _ENDS,
                                axis=0)
    return SobolIndices(first, total, ends[:, 0], ends[:, 1])


def sensitivities(data: MapData) -> Iterator[tuple[str, str, SobolIndices]]:
    """
    Yield law, result and indices of the results that vary.

    Of the error its logarithm, if all runs have one; of failures whether a run fails.
    """
    for v, name in enumerate(data.variants):
        rows = data.of(v).sort_values('repeat')
        error = rows['error'].to_numpy()
        results = {'fails': (rows['failure'] != '').to_numpy(float)}
        if np.isfinite(error).all() and (error > 0.0).all():
            results = {'log error': np.log10(error), **results}
        for result, values in results.items():
            if np.ptp(values) > 0.0:
                yield name, result, sobol_indices(values, len(data.uncertain))


def sobol_table(data: MapData) -> Table:
    """Return the table of a page: a row for each law and result, two columns a quantity."""
    rows = []
    for name, result, found in sensitivities(data):
        cells = []
        for k in range(len(data.uncertain)):
            for value, ends in ((found.first, found.first_ends), (found.total, found.total_ends)):
                cells.append(two_lines(f'{value[k]:.2f}', ' to '.join(
                    f'{x:.2f}' for x in ends[:, k])))
        rows.append([name, result, *cells])
    heads = [f'{name}{what}' for name in data.uncertain for what in ('', ', total')]
    return Table('Sobol indices', ['law', 'of', *heads], rows, names=2, note=(
        'Part of the variance of log₁₀ of the RMS error, and of whether a run fails, that is due '
        'to a quantity alone, and in total with all that it does together with others; below, '
        'intervals of 95 % (bootstrap). The error is left out where a run has none.'))


def sobol_figure(data: MapData) -> Figure:
    """Draw the indices of each law and result."""
    found = list(sensitivities(data))
    columns, names = min(len(found), 3), data.uncertain
    left = min(3.4, 0.4 + 0.075 * max(map(len, names)))
    figure, grid = drawing.sheet('What the result depends on', -(-len(found) // columns),
                                 (1.0,) * columns, 0.36 * len(names) + 0.4, left=left)
    place = np.arange(len(names))
    for k, (name, result, x) in enumerate(found):
        ax = drawing.panel(figure, grid[k // columns, k % columns], f'{name}: {result}', '')
        for shift, colour, label, value, ends in (
                (-0.18, '#0072B2', 'alone', x.first, x.first_ends),
                (0.18, '#9ecae1', 'total', x.total, x.total_ends)):
            ax.barh(place + shift, value, height=0.34, color=colour, label=label)
            ax.hlines(place + shift, *ends, color='#555555', linewidth=1.2)
        ax.set(xlabel='part of the variance', xlim=(0.0, 1.05))
        ax.grid(False, axis='y')
        names_on(ax, names if not k % columns else [''] * len(names))
    legend_of(figure.axes[0])
    return figure


#: Most figures of a kind, for combinations of values of the axes after the third.
MOST = 4
#: Where a gain has no number: the base or this law diverged.
_BETTER, _WORSE = '#08203d', '#4a0410'


def error_map(data: MapData, rest: tuple[int, ...] = ()) -> Figure:
    """Draw the median error, colours on a logarithmic scale that all panels share."""
    found = sheet(data, _title(data, 'RMS error', rest), range(len(data.variants)), rest)
    shown = [place.cells(data.median) for place in found.places]
    low, high, extend = _limits(np.concatenate([x.ravel() for x in shown]))
    for place, values in zip(found.places, shown):
        drawn = mesh(place, data, np.maximum(values, low), norm=LogNorm(low, high),
                     cmap='viridis')
    if any(np.isfinite(x).any() for x in shown):
        bar = found.colour_bar(drawn, 'median of the RMS error [rad]', extend=extend)
        ticks = round_decades(low, high, 8)
        bar.set_yticks(ticks, [short(x) for x in ticks])
        bar.set_yticks([], minor=True)
    legend(found.figure, states(found.places, data, [np.isinf(x) for x in shown],
                                'half of the runs or more diverged'))
    return found.figure


def failure_map(data: MapData, rest: tuple[int, ...] = ()) -> Figure:
    """Draw the share of failures with its boundary, and the interval of this."""
    found = sheet(data, _title(data, 'Failure probability', rest), range(len(data.variants)),
                  rest)
    handles = {}
    for place in found.places:
        drawn = mesh(place, data, place.cells(data.probability), cmap='Oranges',
                     norm=Normalize(0.0, 1.0))
        handles.update({handle.get_label(): handle for handle in boundary(place, data)})
    found.colour_bar(drawn, 'share of runs that fail', ticks=[0.0, 0.25, 0.5, 0.75, 1.0],
                     format='{x:.0%}')
    legend(found.figure, [*(handles[name] for name in LINES if name in handles),
                          *states(found.places, data, [], '')])
    return found.figure


def gain_map(data: MapData, rest: tuple[int, ...] = ()) -> Figure:
    """Draw by how many decades the median error is less than that of the base."""
    base = data.base
    assert base is not None
    found = sheet(data, _title(data, f'Gain against {data.variants[base]}', rest),
                  [v for v in range(len(data.variants)) if v != base], rest)
    with np.errstate(divide='ignore', invalid='ignore'):
        gain = np.log10(data.median[base]) - np.log10(data.median)
    shown = [place.cells(gain) for place in found.places]
    finite = np.abs(np.concatenate([x[np.isfinite(x)] for x in shown]))
    most = max(float(np.quantile(finite, 0.99, method='inverted_cdf')), 0.1) if len(
        finite) else 1.0
    cmap = matplotlib.colormaps['RdBu'].with_extremes(under=_WORSE, over=_BETTER)
    for place, values in zip(found.places, shown):
        beyond = np.where(np.isinf(values), np.sign(values) * 1e3 * most,
                          np.clip(values, -most, most))
        drawn = mesh(place, data, beyond, cmap=cmap, norm=Normalize(-most, most))
    name = data.variants[base]
    found.colour_bar(drawn, f'decades less error than {name}')
    legend(found.figure, [*_one_diverged(shown, name), *states(
        found.places, data, [np.isnan(x) for x in shown], 'both diverged')])
    return found.figure


def _one_diverged(shown: Sequence[Array], base: str) -> list[Patch]:
    return [Patch(facecolor=colour, label=text) for extreme, colour, text in (
        (np.inf, _BETTER, f'only {base} diverged'), (-np.inf, _WORSE, 'only this law diverged'))
        if any((values == extreme).any() for values in shown)]


def _title(data: MapData, what: str, rest: tuple[int, ...]) -> str:
    where = [axis.at(k) for axis, k in zip(data.axes[3:], rest)]
    return ', '.join([f'{what} over {data.axes[0].name} and {data.axes[1].name}', *where])


def _limits(values: Array) -> tuple[float, float, str]:
    """Return limits of a logarithmic scale, without rare extremes, and what they cut."""
    positive = values[np.isfinite(values) & (values > 0.0)]
    if not len(positive):
        return 1e-3, 1.0, 'neither'
    low, high = np.quantile(positive, (0.01, 0.99), method='inverted_cdf')
    below, above = positive.min() < low, positive.max() > high
    if high < 1.3 * low:
        low, high = low / 1.2, high * 1.2
    return float(low), float(high), ('both' if below and above else 'min' if below else
                                     'max' if above else 'neither')


def save_map_figures(data: MapData, directory: Path, extra: str = 'svg'
                     ) -> list[drawing.FigureFile]:
    """
    Write the figures of a map as SVG; return them in the order in which to show them.

    Equal data give equal files.

    Parameters
    ----------
    data : MapData
        Of the map.
    directory : Path
        Created if necessary.
    extra : str
        A second format: ``pdf`` or ``png``.

    Raises
    ------
    CtcError
        If a file cannot be written.

    """
    with matplotlib.rc_context({'svg.hashsalt': 'map'}):
        return drawing.save(figures(data), directory, ('svg', extra))


def figures(data: MapData) -> Iterator[tuple[str, Figure, str]]:
    """Yield file name, figure and caption."""
    if len(data.axes) > 1:
        yield from _maps(data)
    elif data.axes:
        yield 'lines', lines(data), (
            'Above: median of the error of the worst joint; × where half of the runs or more '
            'diverged. Below: share of runs that fail, with the interval of each value by itself; '
            'the marks of a value are moved aside of each other.')
        yield 'bands', bands(data), (
            'Line: median. Band: 5 % to 95 % of the runs, up to the top where more than 5 % of '
            'them diverged. Grey: medians of the others.')
    else:
        yield 'errors', distributions(data), (
            'Share of the runs with this error or less; a curve that ends below 1 lacks the runs '
            'that diverged. Further left is better.')
    yield 'failures', shares(data), (
        'Share of all runs that fail, by the first kind that applies, and the interval of 95 % of '
        'their sum' + (' for other draws, which all points share.' if data.axes else ' (Wilson).'))
    if data.saltelli and any(True for _ in sensitivities(data)):
        yield 'sobol', sobol_figure(data), (
            'Sobol indices: part of the variance that is due to a quantity alone, and with all '
            'that it does together with others. Lines: intervals of 95 %.')
    elif (len(data.columns) > 1 or data.uncertain) and data.rows['error'].nunique() > 1:
        yield 'dependence', correlations(data), _correlation_caption(data)


def _maps(data: MapData) -> Iterator[tuple[str, Figure, str]]:
    chosen, count = slices(data, MOST)
    left_out = ''
    if len(data.axes) > 2 and len(data.axes[2].values) > THIRD:
        left_out = f' Of {data.axes[2].name}, {THIRD} of {len(data.axes[2].values)} values.'
    if len(chosen) < count:
        left_out += f' Figures for {len(chosen)} of {count} combinations of the further axes.'
    for rest in chosen:
        name = ''.join(f'_{axis.name}_{k}' for axis, k in zip(data.axes[3:], rest))
        yield f'error{name}', error_map(data, rest), (
            f'Median of the RMS error of the worst joint, of {_runs(data)}; all panels have the '
            'same colours. A median hides single runs; they show among the failures.'
            f'{left_out}')
        yield f'failure{name}', failure_map(data, rest), _failure_caption(data) + left_out
        if data.base is not None and len(data.variants) > 1:
            yield f'gain{name}', gain_map(data, rest), (
                f'log₁₀ of the median error under {data.variants[data.base]} over that under the '
                'law, at the same point. Blue: the law has the smaller error; 1 is ten times '
                f'smaller.{left_out}')


def _failure_caption(data: MapData) -> str:
    text = (f'Share of failures among {_runs(data)}. Solid: a half. Beyond the dashed line the '
            'interval of 95 % (Wilson) of a point by itself is above a half, within the dotted '
            'one below; between them the runs do not decide.')
    return text + (' With so few runs no point is decided.' if data.repeats < 4 else '')


def _runs(data: MapData) -> str:
    return 'one run at each point' if data.repeats == 1 else f'{data.repeats} runs at each point'


def _correlation_caption(data: MapData) -> str:
    text = ('Rank correlation (Spearman) of the error with each parameter over all runs; a run '
            'that diverged has the largest error. Right: the error grows with the parameter.')
    return text + ('' if data.axes else (
        ' Grey: 95 % of the values that independent quantities would have.'))
