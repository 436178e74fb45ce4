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

"""Figures of runs, and of several compared; `CtcError` for a run without samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from pathlib import Path
from typing import Any

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.drawing import legend_of
from ctc_chattering.analysis.page import FigureFile
from ctc_chattering.analysis.result import colour, colours, name, names, Result
from ctc_chattering.analysis.signals import Series, SignalOrigin
from ctc_chattering.control.laws.registry import law_class
from ctc_chattering.errors import CtcError
from ctc_chattering.output_files import check_format, file_stem
from ctc_chattering.simulation.closed_loop import Array
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
import numpy as np


def error_sums(result: Result) -> list[tuple[str, Array]]:
    """Return the 1-norm of the position error of the joints of each unit: unit, shape (N,)."""
    units, error = np.array(result.position_units), np.abs(result.run.q_d - result.run.q)
    return [(unit, error[:, units == unit].sum(axis=1))
            for unit in dict.fromkeys(result.position_units)]


def error_comparison(results: Sequence[Result]) -> Figure:
    """Draw the 1-norm of the error of all runs, a panel per experiment and unit."""
    groups: dict[tuple[str, str], list[tuple[int, Array]]] = {}
    for i, result in enumerate(results):
        for unit, error in error_sums(result):
            groups.setdefault((result.experiment, unit), []).append((i, error))
    columns = drawing.column_count(len(groups))
    figure, grid = drawing.sheet('Position error of the runs compared', -(-len(groups) // columns),
                                 (1.0,) * columns, 2.9)
    every = np.concatenate([error for group in groups.values() for _, error in group])
    called, painted = names(results), colours(results)
    for k, ((experiment, unit), group) in enumerate(groups.items()):
        ax = drawing.panel(figure, grid[k // columns, k % columns], experiment,
                           f'Σ |eᵢ| [{unit}]', *(results[i].run.t for i, _ in group))
        for i, error in group:
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


#: Figures of the paper by experiment and law: (tracking, torques).
PAPER_FIGURES = {
    ('friction', 'compensation'): (2, 4), ('friction', 'chattering'): (3, 5),
    ('disturbance', 'compensation'): (6, 8), ('disturbance', 'chattering'): (7, 9)}
#: Length of the enlarged slices of positions and torques [s].
SLICE, SHORT_SLICE = 1.0, 0.2
#: Figures of a run.
_PER_RUN = 3
_THIN: dict[str, Any] = {'linewidth': 0.6, 'alpha': 0.85}
#: Of samples between which the signal may be anything.
_DOTS: dict[str, Any] = {'linestyle': 'none', 'marker': '.', 'markersize': 3.0}


def tracking(result: Result, run_name: str = '') -> Figure:
    """Draw q against q_d for each joint, and the 1-norm of the error."""
    run, n = result.run, _joints(result)
    sums = error_sums(result)
    sheet = _RunFigure(result, f'Tracking – {run_name or name(result)}{_paper(result, 0)}',
                       n + len(sums), (3.0, 1.35), 1.45, SLICE)
    for column, enlarged in enumerate((False, True)):
        for i, (joint, unit) in enumerate(zip(result.joint_names, result.position_units)):
            ax = sheet.panel((i, column), joint, f'q, q_d [{unit}]', enlarged)
            sheet.line(ax, run.t, run.q[:, i], label='q')
            sheet.line(ax, run.t, run.q_d[:, i], label='q_d', color=drawing.REFERENCE,
                       linewidth=1.1, linestyle=(0, (4, 2.5)))
        for i, (unit, error) in enumerate(sums, n):
            ax = sheet.panel(
                (i, column), 'position error Σ |eᵢ|', f'Σ |eᵢ| [{unit}]', enlarged)
            sheet.line(ax, run.t, error)
            if column:
                ax.set_ylim(bottom=0.0)
            else:
                drawing.log_axis(ax, error)
    legend_of(sheet.figure.axes[0])
    return sheet.figure


def torques(result: Result, run_name: str = '') -> Figure:
    """Draw the torque of each joint over the whole run and over a slice."""
    n, torque = _joints(result), result.torque
    sheet = _RunFigure(result, f'Torques – {run_name or name(result)}{_paper(result, 1)}', n,
                       (3.0, 1.35), 2.1 if n < 4 else 1.5, SHORT_SLICE)
    for i, (joint, unit, tau) in enumerate(zip(
            result.joint_names, result.torque_units, torque.values.T)):
        ylabel = f'{"τ" if unit == "N·m" else "force"} [{unit}]'
        ax = sheet.panel((i, 0), joint, ylabel)
        sheet.line(ax, torque.t, tau, **_THIN)
        drawing.steady_axis(ax, torque.t, tau)
        ax = sheet.panel((i, 1), joint, ylabel, enlarged=True)
        sheet.line(ax, torque.t, tau, **drawing.STEPS)
    return sheet.figure


def internals(result: Result, run_name: str = '') -> Figure:
    """Draw V, and for each joint the filtered error v and the robust term z of the law."""
    terms, n = result.terms, _joints(result)
    symbol = _robust_term(result)
    sheet = _RunFigure(result, f'V, filtered error and robust term – {run_name or name(result)}',
                       n + 1, (1.5, 1.5, 1.2), 1.6, SHORT_SLICE)
    ax = sheet.panel((0, slice(None)), 'Lyapunov function V = ½ vᵀ M(q) v', 'V [J]')
    sheet.line(ax, terms.t, terms.lyapunov, linewidth=0.9)
    drawing.log_axis(ax, terms.lyapunov)
    is_sparse = Series(terms.t, terms.v, terms.origin).step > 1.5 * result.config.control_period
    for i, (joint, position, torque, v, term) in enumerate(zip(
            result.joint_names, result.position_units, result.torque_units, terms.v.T,
            terms.robust.T)):
        ax = sheet.panel((i + 1, 0), f'{joint}: v', f'v [{position}/s]')
        sheet.line(ax, terms.t, v, **_THIN)
        drawing.steady_axis(ax, terms.t, v)
        reach = 1.25 * float(np.nanmax(np.abs(term), initial=0.0)) or 1.0
        for column, style in ((1, {**_THIN, 'linewidth': 0.35}),
                              (2, _DOTS if is_sparse else drawing.STEPS)):
            ax = sheet.panel((i + 1, column), f'{joint}: {symbol or "robust term"}',
                             f'z [{torque}]', column == 2)
            sheet.line(ax, terms.t, term, **style)
            ax.set_ylim(-reach, reach)
            if len(term) and not term.any():
                drawing.label(ax, 0.5, 0.62, 'zero' if symbol else 'zero: not part of this law',
                              ha='center')
            elif column == 1 and result.saturation and result.saturation[i].cause:
                drawing.note(ax, result.saturation[i].cause)
    return sheet.figure


def _robust_term(result: Result) -> str:
    """Return the robust term in symbols; empty for laws without."""
    symbols = {law_class(config.law).symbol for _, config in result.configs} - {''}
    return symbols.pop() if len(symbols) == 1 else 'robust term z' if symbols else ''


def save_figures(results: Sequence[Result], directory: str | Path, extra: str = 'svg'
                 ) -> list[FigureFile]:
    """
    Write every figure of `results` as SVG and return them in the order in which to show them.

    Two or more results are also compared.

    Parameters
    ----------
    results : sequence of Result
        Runs to draw.
    directory : str or Path
        Directory of the files, created if necessary.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.

    Returns
    -------
    list of FigureFile
        Each with ``path``, ``title`` and ``caption``.

    Raises
    ------
    CtcError
        If a run has no samples, and nothing is written, or a file cannot be written.

    """
    check_format(extra)
    for result in results:
        _joints(result)
    files = drawing.save(_figures(results), Path(directory), ('svg', extra))
    of_runs = [name for name in names(results) for _ in range(_PER_RUN)]
    first = len(files) - len(of_runs)
    return [*files[:first], *(
        dataclasses.replace(file, group=name) for file, name in zip(files[first:], of_runs))]


def _figures(results: Sequence[Result]) -> Iterator[tuple[str, Figure, str]]:
    """Yield file name, figure and caption."""
    if len(results) > 1:
        complete = any(r.metrics()['max_error_norm1_rad'] is not None for r in results)
        yield 'comparison_error', error_comparison(results), (
            'Sum of the absolute joint errors over time on a logarithmic axis, one panel per '
            'experiment.' + (' Grey: the time that is evaluated.' if complete else ''))
    for result, run_name in zip(results, names(results)):
        slug = file_stem(result.slug + run_name.removeprefix(result.label))
        where = 'enlarged ' + ('about the last change.' if result.marks else 'at the end.')
        if result.missing.any():
            where += f' {int(result.missing.sum())} samples are missing; longer gaps are hatched.'
        yield f'{slug}_tracking', tracking(result, run_name), (
            'Joint positions (solid) against the reference (dashed), and the sum of the '
            f'absolute errors, on a logarithmic axis. Right: {where}')
        yield f'{slug}_torques', torques(result, run_name), (
            f'Torques sent to the joints{_times_of_torques(result)}. Right: {where}')
        yield f'{slug}_internals', internals(result, run_name), (
            'Not in the paper: the Lyapunov function V of its proof, the filtered error v, and '
            f'the robust term z of the law{_times_of_terms(result)}. Right: {where}')


def _times_of_torques(result: Result) -> str:
    """Return at which times torques stand, where these are not those of the states."""
    return ', each when the recorder received it' if result.torque.received else ''


def _times_of_terms(result: Result) -> str:
    """Return at which times terms stand, where these are not those of the states."""
    terms = result.terms
    if terms.origin is SignalOrigin.COMPUTED:
        return ''
    if terms.origin is SignalOrigin.UNKNOWN:
        return ', none of which is known'
    every = 1e3 * Series(terms.t, terms.v, terms.origin).step
    return f', as the controller published them, every {every:.3g} ms'


class _RunFigure:
    """A figure of one run, with an enlarged slice at its end, or at a change of law."""

    def __init__(self, result: Result, title: str, rows: int, widths: Sequence[float],
                 height: float, length: float) -> None:
        self.result, t = result, result.run.t
        self.figure, self._grid = drawing.sheet(title, rows, widths, height)
        length = min(length * (2.5 if result.marks else 1.0), float(t[-1] - t[0]) / 3.0)
        change = result.marks[-1][0] if result.marks else np.inf
        start = min(t[-1] - length, change - 0.2 * length)
        #: First and last sample of the slice [s].
        self._slice = _part(t, start, start + length)
        self._slices: list[Axes] = []

    def panel(self, cell: tuple[int, int | slice], title: str, ylabel: str,
              enlarged: bool = False) -> Axes:
        """Return axes for the whole run or for the slice, with marks and gaps."""
        t = self._slice if enlarged else self.result.run.t
        if enlarged:
            title = f'enlarged: {t[0]:.4g}–{t[-1]:.4g} s'
        ax = drawing.panel(self.figure, self._grid[cell], title, ylabel, t)
        if enlarged:
            self._slices.append(ax)
            ax.xaxis.set_major_locator(MaxNLocator(4))
        else:
            ax.axvspan(self._slice[0], self._slice[-1], color='#eeeeee', lw=0, zorder=0)
        for time, change in self.result.marks:
            drawing.mark(ax, time, '' if enlarged or cell[0] else change)
        drawing.shade_gaps(ax, t, self.result.config.control_period)
        return ax

    def line(self, ax: Axes, t: Array, y: Array, **style: Any) -> None:
        """Draw samples, of the slice if the axes are of it, or say that there are none."""
        if ax in self._slices and len(t):
            part = slice(*np.searchsorted(t, (self._slice[0] - 1e-9, self._slice[-1] + 1e-9)))
            t, y = t[part], y[part]
        if not np.isfinite(y).any():
            drawing.label(ax, 0.5, 0.45, 'not known', ha='center')
            return
        step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
        drawing.line(ax, t, y, max(step, self.result.config.control_period),
                     **{'color': colour(self.result), **style})


def _part(t: Array, begin: float, end: float) -> Array:
    """Return the times from `begin` to `end`, one of them at least."""
    first, last = np.searchsorted(t, (begin - 1e-9, end + 1e-9))
    return t[first:max(last, first + 1)]


def _joints(result: Result) -> int:
    if not len(result.run.t):
        raise CtcError(f'{result.label}: the run has no samples, so there is nothing to draw')
    return int(result.run.q.shape[1])


def _paper(result: Result, which: int) -> str:
    """Return the suffix of a title with the number of the paper's figure."""
    numbers = PAPER_FIGURES.get((result.experiment, result.law))
    config = result.config
    same = (not result.marks and config.model == 'two_link' and set(config.ka) == {10.0}
            and config.switching_in_force in ('', 'sign'))
    return f' (figure {numbers[which]} of the paper)' if numbers and same else ''
