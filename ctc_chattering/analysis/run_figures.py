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
    name_runs,
    NamedRun,
    run_colour,
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
    ('friction', 'compensation'): (2, 4),
    ('friction', 'chattering'): (3, 5),
    ('disturbance', 'compensation'): (6, 8),
    ('disturbance', 'chattering'): (7, 9),
}
#: Colour of the time that is evaluated, or enlarged.
_SHADE = '#eeeeee'
_THIN: dict[str, Any] = {'linewidth': 0.6, 'alpha': 0.85}


def error_sums(result: Result) -> dict[str, Array]:
    """
    Return the 1-norm of the position error by unit.

    Each has the shape (N,).
    """
    units, error = np.array(result.position_units), np.abs(result.e)
    return {
        unit: error[:, units == unit].sum(axis=1) for unit in dict.fromkeys(result.position_units)
    }


def error_comparison(results: Sequence[Result]) -> Figure:
    """
    Draw the 1-norm of the error of all runs.

    There is a panel per experiment and unit.
    """
    groups: dict[tuple[str, str], list[tuple[NamedRun, Array]]] = {}
    for run in name_runs(results):
        for unit, error in error_sums(run.result).items():
            groups.setdefault((run.result.experiment, unit), []).append((run, error))
    columns = drawing.column_count(len(groups))
    figure, grid = drawing.sheet(
        'Position error of the runs compared', -(-len(groups) // columns), (1.0,) * columns, 2.9
    )
    all_errors = np.concatenate([error for group in groups.values() for _, error in group])
    for k, ((experiment, unit), group) in enumerate(groups.items()):
        ax = drawing.panel(
            figure,
            grid[k // columns, k % columns],
            experiment,
            f'Σ |eᵢ| [{unit}]',
            *(run.result.t for run, _ in group),
        )
        for run, error in group:
            _draw_error(ax, run, error)
        drawing.log_axis(ax, all_errors)
    legend_of(*figure.axes)
    return figure


def _draw_error(ax: Axes, run: NamedRun, error: Array) -> None:
    """
    Draw the error of a run.

    Changes, gaps and the time that is evaluated are marked.
    """
    result, t, period = run.result, run.result.t, run.result.config.control_period
    drawing.line(ax, t, error, period, linewidth=1.0, label=run.name.short, color=run.colour)
    for time, change in result.marks:
        drawing.mark(ax, time, change)
    drawing.shade_gaps(ax, t, period)
    if result.metrics()['rms_error_rad'] is not None:
        begin, end = result.window
        ax.axvspan(begin, min(end, t[-1]), color=_SHADE, lw=0, zorder=-1)


def tracking(result: Result, name: RunName | None = None) -> Figure:
    """Draw q, q_d and the 1-norm of the error."""
    sums = error_sums(result)
    sheet = _RunFigure(
        result,
        'Tracking',
        name,
        len(result.joint_names) + len(sums),
        (3.0, 1.35),
        1.45,
        1.0,
        paper_index=0,
    )
    for i, (joint, unit) in enumerate(zip(result.joint_names, result.position_units)):
        for ax in sheet.pair(i, joint, f'q, q_d [{unit}]'):
            sheet.line(ax, result.t, result.q[:, i], label='q')
            sheet.line(
                ax,
                result.t,
                result.q_d[:, i],
                label='q_d',
                color=drawing.REFERENCE,
                linewidth=1.1,
                linestyle=(0, (4, 2.5)),
            )
    for i, (unit, error) in enumerate(sums.items(), len(result.joint_names)):
        whole, enlarged = sheet.pair(i, 'position error Σ |eᵢ|', f'Σ |eᵢ| [{unit}]')
        sheet.line(whole, result.t, error)
        drawing.log_axis(whole, error)
        sheet.line(enlarged, result.t, error)
        enlarged.set_ylim(bottom=0.0)
    legend_of(sheet.figure.axes[0])
    return sheet.figure


def torques(result: Result, name: RunName | None = None) -> Figure:
    """Draw the torque of each joint."""
    torque, n = result.torque, len(result.joint_names)
    sheet = _RunFigure(
        result, 'Torques', name, n, (3.0, 1.35), 2.1 if n < 4 else 1.5, 0.2, paper_index=1
    )
    for i, (joint, unit) in enumerate(zip(result.joint_names, result.torque_units)):
        tau = torque.values[:, i]
        whole, enlarged = sheet.pair(
            i, joint, f'τ [{unit}]' if unit == 'N·m' else f'force [{unit}]'
        )
        sheet.line(whole, torque.t, tau, **_THIN)
        drawing.steady_axis(whole, torque.t, tau)
        sheet.line(enlarged, torque.t, tau, **drawing.STEPS)
    return sheet.figure


def internals(result: Result, name: RunName | None = None) -> Figure:
    """
    Draw V, and for each joint v and z.

    v is the filtered error, and z the robust term of the law.
    """
    terms = result.terms
    sheet = _RunFigure(
        result,
        'V, filtered error and robust term',
        name,
        len(result.joint_names) + 1,
        (1.5, 1.5, 1.2),
        1.6,
        0.2,
    )
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
    whole, enlarged = axes = sheet.pair(
        i + 1,
        f'{result.joint_names[i]}: {symbol or "robust term"}',
        f'z [{result.torque_units[i]}]',
    )
    sheet.line(whole, terms.t, z, linewidth=0.35, alpha=0.85)
    is_sparse = Series(terms.t, z, terms.origin).step > 1.5 * result.config.control_period
    # Between sparse samples, the signal may be anything.
    dots: dict[str, Any] = {'linestyle': 'none', 'marker': '.', 'markersize': 3.0}
    sheet.line(enlarged, terms.t, z, **dots if is_sparse else drawing.STEPS)
    end = 1.25 * float(np.nanmax(np.abs(z), initial=0.0)) or 1.0
    is_zero = len(z) > 0 and not z.any()
    for ax in axes:
        ax.set_ylim(-end, end)
        if is_zero:
            text = 'zero' if symbol else 'zero: not part of this law'
            drawing.label(ax, 0.5, 0.62, text, ha='center')
    if not is_zero and result.saturation and result.saturation[i].cause:
        drawing.note(whole, result.saturation[i].cause)


def _robust_symbol(result: Result) -> str:
    """
    Return the symbol of the robust term.

    It is '' for laws without such a term.
    """
    symbols = {law_class(config.law).symbol for _, config in result.configs} - {''}
    return symbols.pop() if len(symbols) == 1 else 'robust term z' if symbols else ''


def save_figures(
    results: Sequence[Result], directory: str | Path, extra: str = 'svg'
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
        _check_samples(result)
    files: list[FigureFile] = []
    used: set[str] = set()
    if len(results) > 1:
        caption = (
            'Sum of the absolute joint errors over time, on a logarithmic axis, with one '
            'panel per experiment.'
        )
        if any(x.metrics()['max_error_norm1_rad'] is not None for x in results):
            caption += ' Errors are evaluated over the time in grey.'
        comparison = ('comparison_error', error_comparison(results), caption)
        files += drawing.save([comparison], Path(directory), ('svg', extra), used)
    for result, name in zip(results, run_names(results)):
        of_run = drawing.save(_figures(result, name), Path(directory), ('svg', extra), used)
        files += [dataclasses.replace(file, group=str(name)) for file in of_run]
    return files


def _figures(result: Result, name: RunName) -> Iterator[tuple[str, Figure, str]]:
    """Yield name, figure and caption of a run's figures."""
    stem = file_stem(result.slug + name.details)
    right = f'Right: enlarged {"around the last change" if result.marks else "at the end"}.'
    if result.missing.any():
        right += f' {int(result.missing.sum())} samples are missing. Longer gaps are hatched.'
    yield (
        f'{stem}_tracking',
        tracking(result, name),
        (
            'Joint positions (solid) against the reference (dashed), and the sum of the '
            f'absolute errors, on a logarithmic axis. {right}'
        ),
    )
    received = ', each when the recorder received it' if result.torque.received else ''
    yield (
        f'{stem}_torques',
        torques(result, name),
        (f'Torques sent to the joints{received}. {right}'),
    )
    yield (
        f'{stem}_internals',
        internals(result, name),
        (
            'Signals that the paper does not show: the Lyapunov function V of its proof, the '
            f'filtered error v, and the robust term z of the law{_times_of_terms(result)}. {right}'
        ),
    )


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
    subject : str
        Beginning of the figure's title.
    name : RunName, optional
        Name of the run in the title.
    rows, widths, height
        As of `drawing.sheet`.
    length : float
        Length of the slice [s]. It is longer around a change of law.
    paper_index : int, optional
        Index into `PAPER_FIGURES` of the figure that the paper also has.

    """

    def __init__(
        self,
        result: Result,
        subject: str,
        name: RunName | None,
        rows: int,
        widths: Sequence[float],
        height: float,
        length: float,
        paper_index: int | None = None,
    ) -> None:
        _check_samples(result)
        self.result, t = result, result.t
        title = f'{subject} – {name or run_name(result)}{_paper_figure(result, paper_index)}'
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

    def pair(self, row: int, title: str, ylabel: str) -> tuple[Axes, Axes]:
        """Return axes for the whole run, and the last ones for the slice."""
        last = self._grid.ncols - 1
        return (
            self.panel((row, last - 1), title, ylabel),
            self.panel((row, last), title, ylabel, enlarged=True),
        )

    def panel(
        self, cell: tuple[int, int | slice], title: str, ylabel: str, enlarged: bool = False
    ) -> Axes:
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
        drawing.line(
            ax,
            t,
            y,
            max(step, self.result.config.control_period),
            **{'color': run_colour(self.result), **style},
        )


def _check_samples(result: Result) -> None:
    """Raise `CtcError` for a run without samples."""
    if not len(result.t):
        raise CtcError(f'{result.label}: the run has no samples, so there is nothing to draw')


def _paper_figure(result: Result, index: int | None) -> str:
    """Return the paper's figure as suffix of a title."""
    numbers = PAPER_FIGURES.get((result.experiment, result.law))
    config = result.config
    if (
        numbers is None
        or index is None
        or result.marks
        or config.model != 'two_link'
        or set(config.ka) != {10.0}
        or config.switching_in_force not in ('', 'sign')
    ):
        return ''
    return f' (figure {numbers[index]} of the paper)'
