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

"""Figures of maps: errors, failures with the boundary and its interval, what they depend on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any, NamedTuple

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.drawing import legend, legend_of
from ctc_chattering.analysis.tables import short, Table, two_lines
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.runs.figures import bars, law_styles, names_on, room_for, Series
from ctc_chattering.runs.map_data import (
    Counts,
    GridAxis,
    KINDS,
    LEVEL,
    MapData,
    pooled,
    share,
    slices,
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
import numpy.typing as npt

#: Most panels beside each other, values of the third axis, and figures of a kind, for
#: combinations of values of the axes after the third.
_COLUMNS, THIRD, MOST = 4, 6, 4
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
#: Colours of `KINDS`.
KIND_COLOURS = ('#1b1b1b', '#D55E00', '#E69F00', '#009E73', '#56B4E9', '#7B5EA7', '#b5b5b5')
#: Most steps of a distribution that are drawn.
_STEPS = 1000
#: Resamples of the intervals of Sobol indices, and the ends of these.
_RESAMPLES, _ENDS = 500, (2.5, 97.5)


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


def maps(data: MapData, what: str, rest: tuple[int, ...], values: Array, bar: str, hatched: str,
         variants: Sequence[int] = (), limits: bool = False, ticks: str | None = None,
         handles: Sequence[Any] = (), **style: Any) -> Figure:
    """
    Draw numbers as colours: a panel for each variant and value of the third axis.

    Parameters
    ----------
    data : MapData
        Of two axes or more: the first is the abscissa, the second the ordinate.
    what, bar, hatched : str
        What it is, for the title; label of the colours; what a hatched cell, without a number, is.
    rest : tuple of int
        Indices of the axes after the third.
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
    figure, grid = drawing.sheet(
        ', '.join([f'{what} over {x.name} and {y.name}', *(
            axis.at(k) for axis, k in zip(data.axes[3:], rest))]), rows, (1.0,) * columns,
        min(max(5.0 / columns, 1.3), 3.0))
    found: dict[str, Any] = {}
    for place, (v, k) in zip(product(range(rows), range(columns)), places):
        at: Any = (v, slice(None), slice(None), *(() if k is None else (k, *rest)))
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


def error_map(data: MapData, rest: tuple[int, ...] = ()) -> Figure:
    """Draw the median error, colours on a logarithmic scale that all panels share."""
    median = data.median
    positive = median[np.isfinite(median) & (median > 0.0)]
    low, high = np.quantile(positive, (0.01, 0.99), method='inverted_cdf') if len(positive) else (
        1e-3, 1.0)  # Without rare extremes.
    low, high = (low, high) if high >= 1.3 * low else (low / 1.2, high * 1.2)
    return maps(data, 'RMS error', rest, np.maximum(median, low), 'median of the RMS error [rad]',
                'half of the runs or more diverged', norm=LogNorm(low, high), cmap='viridis')


def failure_map(data: MapData, rest: tuple[int, ...] = ()) -> Figure:
    """Draw the share of failures with its boundary, and the interval of this."""
    return maps(data, 'Failure probability', rest, data.probability, 'share of runs that fail',
                '', limits=True, ticks='{x:.0%}', cmap='Oranges', norm=Normalize(0.0, 1.0))


def gain_map(data: MapData, base: int, rest: tuple[int, ...] = ()) -> Figure:
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
    return maps(data, f'Gain against {name}', rest, beyond, f'decades less error than {name}',
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


def shares(data: MapData) -> Figure:
    """Draw the share of each kind of failure, with the interval of all."""
    n = len(data.variants)
    figure, grid = drawing.sheet('Failures by kind', 1, (1.0,), 0.36 * n + 0.4,
                                 left=room_for(data.variants))
    ax = drawing.panel(figure, grid[0, 0], '', '')
    ax.set_axisbelow(True)
    before = np.zeros(n)
    for kind, colour, count in zip(KINDS, KIND_COLOURS, data.kinds):
        if count.any():
            ax.barh(range(n), count / data.made, left=before, height=0.66, color=colour,
                    label=kind)
            before += count / data.made
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
    figure = bars(
        'What the error depends on', 'rank correlation', -1.0, data.columns,
        [(name, [Series('', np.where(found > 0.0, '#D55E00', '#0072B2').tolist(),
                        np.nan_to_num(found))])
         for name, found in zip(data.variants, rank_correlations(data))])
    for ax, runs in zip(figure.axes, data.made if not data.axes else ()):
        half = 1.96 / np.sqrt(max(int(runs) - 1, 1))
        ax.axvspan(-half, half, color='#eeeeee', linewidth=0.0, zorder=0)
    return figure


def rank_correlations(data: MapData) -> Array:
    """
    Return Spearman's rank correlations, shape (V, axes and uncertain parameters).

    A run without an error counts as the largest; nan where one of both never changes.
    """
    ranks = [data.of(v)[[*data.columns, 'error']].rank() for v in range(len(data.variants))]
    return np.array([x.corr()['error'][data.columns] for x in ranks])


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


def sensitivities(data: MapData) -> list[tuple[str, str, SobolIndices]]:
    """
    Return law, result and indices of the results that vary, with draws for such indices.

    Of the error its logarithm, if all runs have one; of failures whether a run fails.
    """
    found = []
    for v, name in enumerate(data.variants if data.saltelli else ()):
        rows = data.of(v).sort_values('repeat')
        error = rows['error'].to_numpy()
        results = {'fails': (rows['failure'] != '').to_numpy(float)}
        if np.isfinite(error).all() and (error > 0.0).all():
            results = {'log error': np.log10(error), **results}
        found += [(name, result, sobol_indices(values, len(data.uncertain)))
                  for result, values in results.items() if np.ptp(values) > 0.0]
    return found


def sobol_table(data: MapData) -> Table:
    """Return the table of a page: a row for each law and result, two columns a quantity."""
    rows = [[name, result, *(
        two_lines(f'{value[k]:.2f}', ' to '.join(f'{x:.2f}' for x in ends[:, k]))
        for k in range(len(data.uncertain))
        for value, ends in ((found.first, found.first_ends), (found.total, found.total_ends)))]
        for name, result, found in sensitivities(data)]
    heads = [f'{name}{what}' for name in data.uncertain for what in ('', ', total')]
    return Table('Sobol indices', ['law', 'of', *heads], rows, names=2, note=(
        'Part of the variance of log₁₀ of the RMS error, and of whether a run fails, that is due '
        'to a quantity alone, and in total with all that it does together with others; below, '
        'intervals of 95 % (bootstrap). The error is left out where a run has none.'))


def sobol_figure(data: MapData) -> Figure:
    """Draw the indices of each law and result."""
    figure = bars('What the result depends on', 'part of the variance', 0.0, data.uncertain, [
        (f'{name}: {result}', [Series('alone', '#0072B2', x.first, x.first_ends),
                               Series('total', '#9ecae1', x.total, x.total_ends)])
        for name, result, x in sensitivities(data)])
    legend_of(figure.axes[0])
    return figure


def figures(data: MapData) -> Iterator[tuple[str, Figure, str]]:
    """Yield file name, figure and caption."""
    if len(data.axes) > 1:
        yield from _maps(data)
    elif data.axes:
        yield 'lines', lines(data), (
            'Above: error of the worst joint, line: median, × where half of the runs or more '
            'diverged, band: 5 % to 95 %. Below: share of runs that fail, with the interval of '
            'each value by itself; the marks of a value are moved aside of each other.')
    else:
        yield 'errors', distributions(data), (
            'Share of the runs with this error or less; a curve that ends below 1 lacks the runs '
            'that diverged. Further left is better.')
    yield 'failures', shares(data), (
        'Share of all runs that fail, by the first kind that applies, and the interval of 95 % of '
        'their sum' + (' for other draws, which all points share.' if data.axes else ' (Wilson).'))
    if sensitivities(data):
        yield 'sobol', sobol_figure(data), (
            'Sobol indices: part of the variance that is due to a quantity alone, and with all '
            'that it does together with others. Lines: intervals of 95 %.')
    elif (len(data.columns) > 1 or data.uncertain) and data.rows['error'].nunique() > 1:
        yield 'dependence', correlations(data), (
            'Rank correlation (Spearman) of the error with each parameter over all runs; a run '
            'that diverged has the largest error. Right: the error grows with the parameter.'
            + ('' if data.axes else
               ' Grey: 95 % of the values that independent quantities would have.'))


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
            'Median of the RMS error of the worst joint; all panels have the same colours. A '
            f'median hides single runs; they show among the failures.{left_out}')
        yield f'failure{name}', failure_map(data, rest), (
            f'Share of failures among {data.runs.max()} runs at each point. Solid: a half. Beyond '
            'the dashed line the interval of 95 % (Wilson) of a point by itself is above a half, '
            'within the dotted one below; between them, and with less than 4 runs everywhere, '
            f'the runs do not decide.{left_out}')
        if data.base is not None and len(data.variants) > 1:
            yield f'gain{name}', gain_map(data, data.base, rest), (
                f'log₁₀ of the median error under {data.variants[data.base]} over that under the '
                'law, at the same point. Blue: the law has the smaller error; 1 is ten times '
                f'smaller.{left_out}')
