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

"""Figures that compare several runs."""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.legends import legend_of
from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.run_names import colours, names
from ctc_chattering.simulation.closed_loop import Array
from matplotlib.figure import Figure
import numpy as np


def error_sums(result: Result) -> list[tuple[str, str, Array]]:
    """Return the 1-norm of the position error of the joints of each unit: name, unit, (N,)."""
    units, found = result.position_units, []
    error = np.abs(result.run.q_d - result.run.q)
    for unit in dict.fromkeys(units):
        mine = [i for i, own in enumerate(units) if own == unit]
        if len(mine) > 2 and len(mine) == len(units):
            name = 'Σ |eᵢ|'
        elif len(mine) > 2:
            name = 'Σ |eᵢ| of joints in ' + unit
        else:
            name = ' + '.join(f'|e{chr(0x2081 + i) if i < 9 else i + 1}|' for i in mine)
        found.append((name, unit, error[:, mine].sum(axis=1)))
    return found


def error_comparison(results: Sequence[Result]) -> Figure:
    """Draw the 1-norm of the error of all runs, a panel per experiment and unit."""
    groups: dict[tuple[str, str], list[tuple[int, str, Array]]] = {}
    for i, result in enumerate(results):
        for name, unit, error in error_sums(result):
            groups.setdefault((result.experiment, unit), []).append((i, name, error))
    columns = min(3, len(groups))
    figure, grid = drawing.sheet('Position error of the runs compared', -(-len(groups) // columns),
                                 (1.0,) * columns, 2.9)
    every = np.concatenate([error for group in groups.values() for _, _, error in group])
    called, painted = names(results), colours(results)
    for k, ((experiment, unit), group) in enumerate(groups.items()):
        ax = drawing.panel(figure, grid[k // columns, k % columns], experiment,
                           f'{group[0][1]} [{unit}]', *(results[i].run.t for i, _, _ in group))
        for i, _, error in group:
            result, score = results[i], results[i].metrics()
            t, period = result.run.t, result.config.control_period
            drawing.line(ax, t, error, period, color=painted[i], linewidth=1.0,
                         label=called[i].removeprefix(f'{experiment}: '))
            for time, change in result.marks:
                drawing.mark(ax, time, change)
            drawing.shade_gaps(ax, t, period)
            if score['rms_error_rad'] is not None:
                low, high = score['window_s']
                ax.axvspan(low, min(high, t[-1]), color='#eeeeee', lw=0, zorder=-1)
        drawing.log_axis(ax, every)
    legend_of(*figure.axes)
    return figure


def score_comparison(results: Sequence[Result]) -> Figure:
    """Draw RMS errors and torque variations of all runs, a numbered dot per joint."""
    scores = [result.metrics() for result in results]
    low, high = scores[0]['window_s']
    called, painted = names(results), colours(results)
    joints = max(len(result.joint_names) for result in results)
    left = min(4.6, 0.5 + 0.078 * max(map(len, called)))
    figure, grid = drawing.sheet('Tracking error and torque variation', 1, (1.0, 1.0),
                                 drawing.dots_height(joints) * len(results) + 0.3, left=left)
    for column, (key, quantity, units, suffix) in enumerate((
            ('rms_error_rad', 'RMS error', 'position_units', ''),
            ('torque_variation_nm_per_s', 'torque variation', 'torque_units', '/s'))):
        evaluated = any(score[key] for score in scores)
        ax = drawing.panel(figure, grid[0, column],
                           f'{quantity}{f", {low:g} s to {high:g} s" if evaluated else ""} '
                           '(number: joint)', '')
        unit = ' or '.join(sorted({unit + suffix for score in scores for unit in score[units]}))
        ax.set(xlabel=f'{quantity} [{unit}]', xscale='log', ylim=(len(results) - 0.4, -0.6))
        every = [x for score in scores for x in score[key] or () if 0.0 < x < np.inf]
        drawing.decades(ax, 'x', every)
        for y, score in enumerate(scores):
            drawing.numbered_dots(ax, y, score[key] or (), painted[y])
            if score[key] is None:
                ax.text(0.5, y, f'no sample from {low:g} s to {high:g} s', ha='center',
                        va='center', transform=ax.get_yaxis_transform(), fontsize=9,
                        color='#444444')
        ax.set_yticks(range(len(results)), [''] * len(called) if column else called)
    return figure
