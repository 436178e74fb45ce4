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
Figures of runs: tracking, torques, terms, and errors compared.

`save_figures` writes them for `ctc plot`, `ctc reproduce` and the public API. A run without
samples raises `CtcError`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from pathlib import Path
from typing import Any

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.drawing import legend_of
from ctc_chattering.analysis.page import FigureFile
from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.run_names import (
    run_colour,
    run_colours,
    run_name,
    run_names,
    RunName,
)
from ctc_chattering.analysis.signals import Series, SignalOrigin
from ctc_chattering.control.laws.registry import law_class
from ctc_chattering.errors import CtcError
from ctc_chattering.output_files import check_format, file_stem
from ctc_chattering.simulation.closed_loop import Array
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
import numpy as np

#: Figures of the paper by experiment and law: (tracking, torques).
PAPER_FIGURES = {
    ('friction', 'compensation'): (2, 4), ('friction', 'chattering'): (3, 5),
    ('disturbance', 'compensation'): (6, 8), ('disturbance', 'chattering'): (7, 9)}
#: Length of an enlarged slice of positions [s].
SLICE = 1.0
#: Length of an enlarged slice of torques [s].
SHORT_SLICE = 0.2
#: Colour of the time that is evaluated, or enlarged.
_SHADE = '#eeeeee'
_THIN: dict[str, Any] = {'linewidth': 0.6, 'alpha': 0.85}
#: Of samples between which the signal may be anything.
_DOTS: dict[str, Any] = {'linestyle': 'none', 'marker': '.', 'markersize': 3.0}


def error_sums(result: Result) -> dict[str, Array]:
    """
    Return the 1-norm of the position error by unit.

    Each has the shape (N,).
    """
    units, error = np.array(result.position_units), np.abs(result.e)
    return {unit: error[:, units == unit].sum(axis=1)
            for unit in dict.fromkeys(result.position_units)}


def error_comparison(results: Sequence[Result]) -> Figure:
    """
    Draw the 1-norm of the error of all runs.

    There is a panel per experiment and unit.
    """
    groups: dict[tuple[str, str], list[tuple[int, Array]]] = {}
    for i, result in enumerate(results):
        for unit, error in error_sums(result).items():
            groups.setdefault((result.experiment, unit), []).append((i, error))
    columns = drawing.column_count(len(groups))
    figure, grid = drawing.sheet('Position error of the runs compared', -(-len(groups) // columns),
                                 (1.0,) * columns, 2.9)
    all_errors = np.concatenate([error for group in groups.values() for _, error in group])
    names, colours = run_names(results), run_colours(results)
    for k, ((experiment, unit), group) in enumerate(groups.items()):
        ax = drawing.panel(figure, grid[k // columns, k % columns], experiment,
                           f'Σ |eᵢ| [{unit}]', *(results[i].t for i, _ in group))
        for i, error in group:
            _draw_error(ax, results[i], error, label=names[i].short, color=colours[i])
        drawing.log_axis(ax, all_errors)
    legend_of(*figure.axes)
    return figure


def _draw_error(ax: Axes, result: Result, error: Array, **style: Any) -> None:
    """
    Draw the error of a run.

    Changes, gaps and the time that is evaluated are marked.
    """
    t, period = result.t, result.config.control_period
    drawing.line(ax, t, error, period, linewidth=1.0, **style)
    for time, change in result.marks:
        drawing.mark(ax, time, change)
    drawing.shade_gaps(ax, t, period)
    if result.metrics()['rms_error_rad'] is not None:
        begin, end = result.window
        ax.axvspan(begin, min(end, t[-1]), color=_SHADE, lw=0, zorder=-1)


def tracking(result: Result, name: RunName | None = None) -> Figure:
    """Draw q, q_d and the 1-norm of the error."""
    run, n, sums = result.run, _joint_count(result), error_sums(result)
    sheet = _RunFigure(result, f'Tracking – {name or run_name(result)}{_paper_figure(result, 0)}',
                       n + len(sums), (3.0, 1.35), 1.45, SLICE)
    for column, enlarged in enumerate((False, True)):
        for i, (joint, unit) in enumerate(zip(result.joint_names, result.position_units)):
            ax = sheet.panel((i, column), joint, f'q, q_d [{unit}]', enlarged)
            sheet.line(ax, run.t, run.q[:, i], label='q')
            sheet.line(ax, run.t, run.q_d[:, i], label='q_d', color=drawing.REFERENCE,
                       linewidth=1.1, linestyle=(0, (4, 2.5)))
        for i, (unit, error) in enumerate(sums.items(), n):
            ax = sheet.panel(
                (i, column), 'position error Σ |eᵢ|', f'Σ |eᵢ| [{unit}]', enlarged)
            sheet.line(ax, run.t, error)
            if enlarged:
                ax.set_ylim(bottom=0.0)
            else:
                drawing.log_axis(ax, error)
    legend_of(sheet.figure.axes[0])
    return sheet.figure


def torques(result: Result, name: RunName | None = None) -> Figure:
    """Draw the torque of each joint."""
    n, torque = _joint_count(result), result.torque
    sheet = _RunFigure(result, f'Torques – {name or run_name(result)}{_paper_figure(result, 1)}',
                       n, (3.0, 1.35), 2.1 if n < 4 else 1.5, SHORT_SLICE)
    for i, (joint, unit, tau) in enumerate(zip(
            result.joint_names, result.torque_units, torque.values.T)):
        ylabel = f'τ [{unit}]' if unit == 'N·m' else f'force [{unit}]'
        ax = sheet.panel((i, 0), joint, ylabel)
        sheet.line(ax, torque.t, tau, **_THIN)
        drawing.steady_axis(ax, torque.t, tau)
        ax = sheet.panel((i, 1), joint, ylabel, enlarged=True)
        sheet.line(ax, torque.t, tau, **drawing.STEPS)
    return sheet.figure


def internals(result: Result, name: RunName | None = None) -> Figure:
    """
    Draw V, and for each joint v and z.

    v is the filtered error, and z the robust term of the law.
    """
    terms, n = result.terms, _joint_count(result)
    sheet = _RunFigure(
        result, f'V, filtered error and robust term – {name or run_name(result)}', n + 1,
        (1.5, 1.5, 1.2), 1.6, SHORT_SLICE)
    ax = sheet.panel((0, slice(None)), 'Lyapunov function V = ½ vᵀ M(q) v', 'V [J]')
    sheet.line(ax, terms.t, terms.lyapunov, linewidth=0.9)
    drawing.log_axis(ax, terms.lyapunov)
    for i, (joint, unit) in enumerate(zip(result.joint_names, result.position_units)):
        ax = sheet.panel((i + 1, 0), f'{joint}: v', f'v [{unit}/s]')
        sheet.line(ax, terms.t, terms.v[:, i], **_THIN)
        drawing.steady_axis(ax, terms.t, terms.v[:, i])
        _draw_robust_term(sheet, i)
    return sheet.figure


def _draw_robust_term(sheet: _RunFigure, i: int) -> None:
    """Draw the robust term of a joint."""
    result, terms = sheet.result, sheet.result.terms
    symbol, z = _robust_symbol(result), terms.robust[:, i]
    is_sparse = Series(terms.t, z, terms.origin).step > 1.5 * result.config.control_period
    end = 1.25 * float(np.nanmax(np.abs(z), initial=0.0)) or 1.0
    for column, style in ((1, {**_THIN, 'linewidth': 0.35}),
                          (2, _DOTS if is_sparse else drawing.STEPS)):
        ax = sheet.panel((i + 1, column), f'{result.joint_names[i]}: {symbol or "robust term"}',
                         f'z [{result.torque_units[i]}]', enlarged=column == 2)
        sheet.line(ax, terms.t, z, **style)
        ax.set_ylim(-end, end)
        if len(z) and not z.any():
            text = 'zero' if symbol else 'zero: not part of this law'
            drawing.label(ax, 0.5, 0.62, text, ha='center')
        elif column == 1 and result.saturation and result.saturation[i].cause:
            drawing.note(ax, result.saturation[i].cause)


def _robust_symbol(result: Result) -> str:
    """
    Return the symbol of the robust term.

    It is '' for laws without such a term.
    """
    symbols = {law_class(config.law).symbol for _, config in result.configs} - {''}
    return symbols.pop() if len(symbols) == 1 else 'robust term z' if symbols else ''


def save_figures(results: Sequence[Result], directory: str | Path, extra: str = 'svg'
                 ) -> list[FigureFile]:
    """
    Write every figure of `results` as SVG.

    The figures are returned in the order in which to show them.

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
        _joint_count(result)
    kinds = ('svg', extra)
    files: list[FigureFile] = []
    used: set[str] = set()
    if len(results) > 1:
        files += drawing.save([_comparison(results)], Path(directory), kinds, used)
    for result, name in zip(results, run_names(results)):
        files += [dataclasses.replace(file, group=str(name)) for file in drawing.save(
            _figures(result, name), Path(directory), kinds, used)]
    return files


def _comparison(results: Sequence[Result]) -> tuple[str, Figure, str]:
    """Return name, figure and caption of a comparison."""
    caption = ('Sum of the absolute joint errors over time, on a logarithmic axis, with one panel '
               'per experiment.')
    if any(x.metrics()['max_error_norm1_rad'] is not None for x in results):
        caption += ' Errors are evaluated over the time in grey.'
    return 'comparison_error', error_comparison(results), caption


def _figures(result: Result, name: RunName) -> Iterator[tuple[str, Figure, str]]:
    """Yield name, figure and caption of a run's figures."""
    stem = file_stem(result.slug + name.details)
    right = f'Right: enlarged {"around the last change" if result.marks else "at the end"}.'
    if result.missing.any():
        right += f' {int(result.missing.sum())} samples are missing. Longer gaps are hatched.'
    yield f'{stem}_tracking', tracking(result, name), (
        'Joint positions (solid) against the reference (dashed), and the sum of the '
        f'absolute errors, on a logarithmic axis. {right}')
    received = ', each when the recorder received it' if result.torque.received else ''
    yield f'{stem}_torques', torques(result, name), (
        f'Torques sent to the joints{received}. {right}')
    yield f'{stem}_internals', internals(result, name), (
        'Signals that the paper does not show: the Lyapunov function V of its proof, the filtered '
        f'error v, and the robust term z of the law{_times_of_terms(result)}. {right}')


def _times_of_terms(result: Result) -> str:
    """
    Return the times of the terms for a caption.

    It is '' if they are those of the states.
    """
    terms = result.terms
    if terms.origin is SignalOrigin.COMPUTED:
        return ''
    if terms.origin is SignalOrigin.UNKNOWN:
        return ', none of which is known'
    step = Series(terms.t, terms.v, terms.origin).step
    return f', as the controller published them, every {1e3 * step:.3g} ms'


class _RunFigure:
    """
    Figure of one run, with an enlarged slice.

    The slice is at the end, or at the last change of law.

    Parameters
    ----------
    result : Result
        Run with samples.
    title : str
        Title of the figure.
    rows, widths, height
        As of `drawing.sheet`.
    length : float
        Length of the slice [s]. It is longer around a change of law.

    """

    def __init__(self, result: Result, title: str, rows: int, widths: Sequence[float],
                 height: float, length: float) -> None:
        self.result, t = result, result.t
        self.figure, self._grid = drawing.sheet(title, rows, widths, height)
        if result.marks:
            length *= 2.5
        length = min(length, float(t[-1] - t[0]) / 3.0)
        change = result.marks[-1][0] if result.marks else np.inf
        begin = min(t[-1] - length, change - 0.2 * length)
        first, end = np.searchsorted(t, (begin - 1e-9, begin + length + 1e-9))
        #: Times of the slice [s].
        self._slice = t[first:max(end, first + 1)]
        self._slices: list[Axes] = []

    def panel(self, cell: tuple[int, int | slice], title: str, ylabel: str,
              enlarged: bool = False) -> Axes:
        """
        Return axes with marks and gaps.

        They are for the whole run, or `enlarged` for the slice.
        """
        t = self._slice if enlarged else self.result.t
        if enlarged:
            title = f'enlarged: {t[0]:.4g}–{t[-1]:.4g} s'
        ax = drawing.panel(self.figure, self._grid[cell], title, ylabel, t)
        if enlarged:
            self._slices.append(ax)
            ax.xaxis.set_major_locator(MaxNLocator(4))
        else:
            ax.axvspan(self._slice[0], self._slice[-1], color=_SHADE, lw=0, zorder=0)
        for time, change in self.result.marks:
            drawing.mark(ax, time, '' if enlarged or cell[0] else change)
        drawing.shade_gaps(ax, t, self.result.config.control_period)
        return ax

    def line(self, ax: Axes, t: Array, y: Array, **style: Any) -> None:
        """
        Draw the samples that the axes show.

        A text says so if none is known.
        """
        if ax in self._slices:
            begin, end = self._slice[[0, -1]]
            shown = (t >= begin - 1e-9) & (t <= end + 1e-9)
            t, y = t[shown], y[shown]
        if not np.isfinite(y).any():
            drawing.label(ax, 0.5, 0.45, 'not known', ha='center')
            return
        step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
        drawing.line(ax, t, y, max(step, self.result.config.control_period),
                     **{'color': run_colour(self.result), **style})


def _joint_count(result: Result) -> int:
    """Return the number of joints, or raise without samples."""
    if not len(result.t):
        raise CtcError(f'{result.label}: the run has no samples, so there is nothing to draw')
    return len(result.joint_names)


def _paper_figure(result: Result, index: int) -> str:
    """Return the paper's figure as suffix of a title."""
    numbers = PAPER_FIGURES.get((result.experiment, result.law))
    config = result.config
    if (numbers is None or result.marks or config.model != 'two_link'
            or set(config.ka) != {10.0} or config.switching_in_force not in ('', 'sign')):
        return ''
    return f' (figure {numbers[index]} of the paper)'
