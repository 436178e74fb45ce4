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

"""Figures of all runs of a map: errors, kinds of failure, and what the error depends on."""

from __future__ import annotations

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.legends import legend_of
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.robustness.report.boundary import pooled
from ctc_chattering.robustness.report.data import KINDS, MapData, spaced
from ctc_chattering.robustness.report.lines import names_on, styles
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
import numpy as np

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
