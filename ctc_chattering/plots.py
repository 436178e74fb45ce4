"""Figures of finished runs; every function raises `CtcError` for a run without samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from pathlib import Path
import re
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.ticker import MaxNLocator
import numpy as np

from ctc_chattering.core.simulation import Array
from ctc_chattering.errors import CtcError
from ctc_chattering.result import Result

#: Figures of the paper by experiment and law: (tracking, torques).
PAPER_FIGURES = {
    ('friction', 'compensation'): (2, 4), ('friction', 'chattering'): (3, 5),
    ('disturbance', 'compensation'): (6, 8), ('disturbance', 'chattering'): (7, 9)}
#: Colour of each law, of a run under both, and of the reference (after Okabe and Ito).
LAW_COLOURS = {'compensation': '#D55E00', 'chattering': '#0072B2'}
MIXED, REFERENCE = '#007A5A', '#222222'
#: Length of the slices that are drawn larger: of positions, of torques [s].
SLICE, SHORT_SLICE = 1.0, 0.2
_WIDTH, _LEFT, _RIGHT, _TOP, _BOTTOM, _GAP, DOTS = 11.0, 0.85, 0.25, 0.72, 0.5, 0.68, 130  # inch
_NOTE: dict[str, Any] = {'fontsize': 8, 'color': '#444444', 'zorder': 5, 'bbox': {
    'facecolor': 'white', 'edgecolor': 'none', 'alpha': 0.85, 'pad': 1.5}}
_THIN: dict[str, Any] = {'linewidth': 0.6, 'alpha': 0.85}
STEPS: dict[str, Any] = {'linewidth': 0.9, 'drawstyle': 'steps-post'}
_WHOLE = slice(None)


@dataclasses.dataclass(frozen=True)
class FigureFile:
    """A figure on disk: the PNG, what it shows, and how to read it."""

    path: Path
    title: str
    caption: str


def tracking(result: Result) -> Figure:
    """Draw q against q_d for each joint, and the 1-norm of the error."""
    run, n, error = result.run, _joints(result), _norm1(result)
    sheet = _Sheet(result, f'Tracking – {result.label}{_paper(result, 0)}', n + 1, (3.0, 1.35),
                   1.45, SLICE)
    for column, part in enumerate((_WHOLE, sheet.window)):
        for i, name in enumerate(result.joint_names):
            ax = sheet.panel((i, column), name, 'q, q_d [rad]', part)
            sheet.line(ax, run.q[:, i], part, label='q')
            sheet.line(ax, run.q_d[:, i], part, label='q_d', color=REFERENCE, linewidth=1.1,
                       linestyle=(0, (4, 2.5)))
        ax = sheet.panel((n, column), f'position error {_norm1_name(n)}',
                         f'{_norm1_name(n)} [rad]', part)
        sheet.line(ax, error, part)
        if column:
            ax.set_ylim(bottom=0.0)
        else:
            _log_axis(ax, error)
    sheet.figure.axes[0].legend(loc='lower right', bbox_to_anchor=(1.0, 0.97), ncol=2,
                                frameon=False, fontsize=9.5)
    return sheet.figure


def torques(result: Result) -> Figure:
    """Draw the torque of each joint, the whole run and a slice."""
    tau, n = result.run.tau, _joints(result)
    sheet = _Sheet(result, f'Torques – {result.label}{_paper(result, 1)}', n, (3.0, 1.35),
                   2.1 if n < 4 else 1.5, SHORT_SLICE)
    for i, name in enumerate(result.joint_names):
        ax = sheet.panel((i, 0), name, 'τ [N·m]', _WHOLE)
        sheet.line(ax, tau[:, i], _WHOLE, **_THIN)
        _steady_axis(ax, result.run.t, tau[:, i], 'N·m')
        ax = sheet.panel((i, 1), name, 'τ [N·m]', sheet.window)
        sheet.line(ax, tau[:, i], sheet.window, **STEPS)
    return sheet.figure


def internals(result: Result) -> Figure:
    """Draw V, and for each joint the filtered error v and the chattering term Ka sgn(v)."""
    terms, n = result.terms, _joints(result)
    sheet = _Sheet(result, f'V, filtered error and chattering term – {result.label}', n + 1,
                   (1.6, 1.6, 1.0), 1.6, SHORT_SLICE)
    ax = sheet.panel((0, _WHOLE), 'Lyapunov function V = ½ vᵀ M(q) v', 'V [J]', _WHOLE)
    sheet.line(ax, terms.lyapunov, _WHOLE, linewidth=0.9)
    _log_axis(ax, terms.lyapunov)
    for i, name in enumerate(result.joint_names):
        ax = sheet.panel((i + 1, 0), f'{name}: filtered error v', 'v [rad/s]', _WHOLE)
        sheet.line(ax, terms.v[:, i], _WHOLE, **_THIN)
        _steady_axis(ax, result.run.t, terms.v[:, i], 'rad/s')
        term = terms.chattering[:, i]
        reach = 1.25 * float(np.abs(term).max()) or 1.0
        for column, part in ((1, _WHOLE), (2, sheet.window)):
            ax = sheet.panel((i + 1, column), f'{name}: chattering term', 'Ka sgn(v) [N·m]', part)
            sheet.line(ax, term, part, **(STEPS if column == 2 else {**_THIN, 'linewidth': 0.35}))
            ax.set_ylim(-reach, reach)
            if not term.any():
                label(ax, 0.5, 0.62, 'zero: not part of this law', ha='center')
    return sheet.figure


def error_comparison(results: Sequence[Result]) -> Figure:
    """Draw the 1-norm of the error of all runs, one panel per experiment, the laws together."""
    groups: dict[str, list[Result]] = {}
    for result in results:
        _joints(result)
        groups.setdefault(result.experiment, []).append(result)
    columns = min(3, len(groups))
    figure, grid = drawing('Position error of the laws compared', -(-len(groups) // columns),
                           (1.0,) * columns, 2.9)
    error = np.concatenate([_norm1(result) for result in results])
    for k, (experiment, group) in enumerate(groups.items()):
        low, high = group[0].metrics()['window_s']
        ax = panel(figure, grid[k // columns, k % columns], experiment,
                   f'{_norm1_name(_joints(group[0]))} [rad]', *(r.run.t for r in group))
        repeated: dict[str, int] = {}
        for result in group:
            colour, largest = _colour(result), result.metrics()['max_error_norm1_rad']
            repeated[colour] = dashes = repeated.get(colour, -1) + 1
            label = _name(result, group).removeprefix(f'{experiment}: ')
            _line(ax, result.run.t, _norm1(result), color=colour, linewidth=1.0,
                  linestyle=('-', '--', ':', '-.')[dashes % 4],
                  label=label if largest is None else f'{label}: at most {largest:.2g} rad')
            _mark_changes(ax, result, labelled=True)
            if largest is not None:
                ax.axvspan(low, min(high, result.run.t[-1]), color='#eeeeee', lw=0, zorder=0)
        ax.legend(fontsize=8, loc='upper right', borderaxespad=0.1, framealpha=0.9,
                  edgecolor='none', handlelength=1.2)
        _log_axis(ax, error, room=12.0)
    return figure


def score_comparison(results: Sequence[Result]) -> Figure:
    """Draw RMS errors and torque variations of all runs, a numbered dot per joint."""
    scores = [result.metrics() for result in results]
    figure, grid = drawing('Tracking error and what it costs', 1, (1.0, 1.0),
                           0.42 * len(results) + 0.3, left=2.9)
    for column, (key, name, unit) in enumerate((
            ('rms_error_rad', 'RMS error', 'rad'),
            ('torque_variation_nm_per_s', 'torque variation', 'N·m/s'))):
        low, high = scores[0]['window_s']
        ax = panel(figure, grid[0, column], f'{name}, {low:g} s to {high:g} s (number: joint)', '')
        ax.set(xlabel=f'{name} [{unit}]', xscale='log', ylim=(len(results) - 0.4, -0.6))
        every = [x for score in scores for x in score[key] or () if 0.0 < x < np.inf]
        if every:  # whole decades
            ax.set_xlim(10.0 ** np.floor(np.log10(min(every) / 1.2)),
                        10.0 ** np.ceil(np.log10(max(every) * 1.2)))
        for y, (result, score) in enumerate(zip(results, scores)):
            dots = [(x, i) for i, x in enumerate(score[key] or (), 1) if x in every]
            ax.plot([x for x, _ in dots], [y] * len(dots), 'o', color=_colour(result),
                    markersize=13, markeredgecolor='white')
            for x, i in dots:
                ax.text(x, y, str(i), color='white', fontsize=8, weight='bold', ha='center',
                        va='center_baseline')
            if score[key] is None:
                ax.text(0.5, y, 'no sample in this time', ha='center', va='center',
                        transform=ax.get_yaxis_transform(), **_NOTE)
        ax.set_yticks(range(len(results)), ['' if column else _name(result, results)
                                            for result in results], parse_math=False)
    return figure


def save_figures(results: Sequence[Result], directory: Path) -> list[FigureFile]:
    """
    Write every figure of `results` as PNG and return them in the order in which to show them.

    Two results or more are compared as well. The directory is made if need be. Nothing is
    written if a run has no samples; `CtcError` also if a file cannot be written.
    """
    for result in results:
        _joints(result)
    files = []
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for name, figure, caption in _all(results):
            path = directory / f'{name}.png'
            figure.savefig(path, dpi=DOTS, metadata={'Software': None},
                           pil_kwargs={'compress_level': 3})
            files.append(FigureFile(path, figure.get_suptitle(), caption))
    except OSError as error:
        raise CtcError(f'cannot write figures to {directory}: {error.strerror}') from None
    return files


def _all(results: Sequence[Result]) -> Iterator[tuple[str, Figure, str]]:
    """Yield file name, figure and caption, each figure made when it is due."""
    if len(results) > 1:
        yield 'comparison_error', error_comparison(results), (
            'Sum of the absolute joint errors over time on a logarithmic axis, one panel per '
            'experiment. The legend gives the largest value within the shaded time.')
        yield 'comparison_scores', score_comparison(results), (
            'Left: RMS error of each joint. Right: how far each torque travels in a second.')
    used: set[str] = set()
    for result in results:
        name = re.sub(r'[^\w.-]+', '_', _name(result, results, result.slug)).strip('_.') or 'run'
        slug = name if name not in used else f'{name}_{len(used) + 1}'
        used.add(slug)
        where = 'enlarged ' + ('about the last change.' if result.marks else 'at the end.')
        yield f'{slug}_tracking', tracking(result), (
            'Joint positions (solid) against the reference (dashed), and the sum of the '
            f'absolute errors, on a logarithmic axis. Right: {where}')
        yield f'{slug}_torques', torques(result), f'Torques sent to the joints. Right: {where}'
        yield f'{slug}_internals', internals(result), (
            'Beyond the paper: the Lyapunov function V of its proof, the filtered error v that '
            f'is to reach zero, and the chattering term. Right: {where}')


class _Sheet:
    """A figure of one run; `window` is the slice to enlarge: at the end or a change of law."""

    def __init__(self, result: Result, title: str, rows: int, widths: Sequence[float],
                 height: float, length: float) -> None:
        self.result, t = result, result.run.t
        self.figure, self._grid = drawing(title, rows, widths, height)
        length = min(length * (2.5 if result.marks else 1.0), float(t[-1] - t[0]) / 3.0)
        change = result.marks[-1][0] if result.marks else np.inf
        start = min(t[-1] - length, change - 0.2 * length)
        first, last = np.searchsorted(t, (start - 1e-9, start + length + 1e-9))
        self.window = slice(int(first), max(int(last), int(first) + 1))

    def panel(self, cell: tuple[int, int | slice], title: str, ylabel: str, part: slice) -> Axes:
        """Add axes over the samples `part`, with the marks that belong there."""
        t, window = self.result.run.t[part], self.result.run.t[self.window]
        if part == _WHOLE:
            ax = panel(self.figure, self._grid[cell], title, ylabel, t)
            ax.axvspan(window[0], window[-1], color='#eeeeee', lw=0, zorder=0)
        else:
            title = f'enlarged: {t[0]:.4g} s to {t[-1]:.4g} s'
            ax = panel(self.figure, self._grid[cell], title, ylabel, t)
            ax.xaxis.set_major_locator(MaxNLocator(4))
        _mark_changes(ax, self.result, labelled=part == _WHOLE and not cell[0])
        return ax

    def line(self, ax: Axes, y: Array, part: slice, **style: Any) -> None:
        """Draw the samples `part` of `y`."""
        _line(ax, self.result.run.t[part], y[part], **{'color': _colour(self.result), **style})


def drawing(title: str, rows: int, widths: Sequence[float], height: float,
            left: float = _LEFT) -> tuple[Figure, GridSpec]:
    whole = _TOP + _BOTTOM + rows * height + (rows - 1) * _GAP
    figure = Figure(figsize=(_WIDTH, whole), facecolor='white')
    FigureCanvasAgg(figure)
    figure.suptitle(title, x=0.15 / _WIDTH, y=1.0 - 0.16 / whole, ha='left', va='top',
                    fontsize=13, weight='bold', parse_math=False)
    width = (_WIDTH - left - _RIGHT) / len(widths)
    return figure, figure.add_gridspec(
        rows, len(widths), width_ratios=list(widths), left=left / _WIDTH,
        right=1.0 - _RIGHT / _WIDTH, bottom=_BOTTOM / whole, top=1.0 - _TOP / whole,
        hspace=_GAP / height, wspace=0.7 / (width - 0.7))


def panel(figure: Figure, cell: Any, title: str, ylabel: str, *times: Array) -> Axes:
    ax = figure.add_subplot(cell)
    ax.set_title(title, loc='left', fontsize=9.5, color='#333333', pad=4, parse_math=False)
    ax.grid(True, color='#dddddd', linewidth=0.6)
    ax.spines[['top', 'right']].set_visible(False)
    ax.tick_params(labelsize=8.5)
    ax.set(xlabel='t [s]', ylabel=ylabel)
    if times:
        first, last = min(t[0] for t in times), max(t[-1] for t in times)
        ax.set_xlim(first, last if last > first else first + 1e-3)
    return ax


def _line(ax: Axes, t: Array, y: Array, **style: Any) -> None:
    """Draw a line, with dots if it is too short to be seen."""
    ax.plot(t, y, **{'linewidth': 1.3, 'marker': '.' if len(t) < 4 else None, **style})


def label(ax: Axes, x: float, y: float, text: str, **style: Any) -> None:
    ax.text(x, y, text, transform=ax.transAxes, **style, **_NOTE)


def _mark_changes(ax: Axes, result: Result, labelled: bool) -> None:
    for time, name in result.marks:
        ax.axvline(time, color=REFERENCE, linewidth=1.0, linestyle=(0, (1, 1.5)))
        if labelled:
            ax.text(time, 0.12, f'  → {name}', transform=ax.get_xaxis_transform(), **_NOTE)


def _log_axis(ax: Axes, y: Array, room: float = 1.6) -> None:
    """Make the axis of y logarithmic if it can be, without room for rare dips towards zero."""
    positive = y[np.isfinite(y) & (y > 0.0)]
    if len(positive):
        low = float(np.percentile(positive, 1.0)) / 5.0
        ax.set_ylim(max(float(positive.min()) / 1.6, low), float(positive.max()) * room)
        ax.set_yscale('log')
        if positive.min() < low:
            label(ax, 0.006, 0.04, 'axis cut below')


def _steady_axis(ax: Axes, t: Array, y: Array, unit: str) -> None:
    """Let the axis of y show the run past its start, and say so if that cuts the start."""
    finite = np.isfinite(y)
    late = y[finite & (t >= t[0] + min(1.0, (t[-1] - t[0]) / 3.0))]
    if not len(late):
        return
    low, high = np.percentile(late, (1.0, 99.0))
    late = late[(late >= 2.0 * low - high) & (late <= 2.0 * high - low)]
    low, high = late.min(), late.max()
    least, most = y[finite].min(), y[finite].max()
    span = high - low if high - low > 1e-9 * abs(high) else abs(high) or 1.0
    if least < low - span or most > high + span:
        k = int(np.nanargmax(np.where(finite, np.abs(y), -1.0)))
        text = f'axis cut: {y[k]:.4g} {unit} at t = {t[k]:.3g} s'
        label(ax, 0.995, 0.97, text, ha='right', va='top')
    else:
        low, high = min(low, least), max(high, most)
    ax.set_ylim(low - 0.1 * span, high + 0.22 * span)


def _joints(result: Result) -> int:
    if not len(result.run.t):
        raise CtcError(f'{result.label}: the run has no samples, so there is nothing to draw')
    return int(result.run.q.shape[1])


def _norm1(result: Result) -> Array:
    return np.asarray(np.abs(result.run.q_d - result.run.q).sum(axis=1))


def _norm1_name(n: int) -> str:
    return ('|e₁|', '|e₁| + |e₂|')[n - 1] if n < 3 else 'Σ |eᵢ|'


def _colour(result: Result) -> str:
    return MIXED if result.changes else LAW_COLOURS.get(result.law, REFERENCE)


def _paper(result: Result, which: int) -> str:
    """Return the suffix of a title that names the paper's figure; `which` as in the table."""
    numbers = PAPER_FIGURES.get((result.experiment, result.law))
    config = result.configs[-1][1]
    same = not result.marks and config.switching == 'sign' and config.model == 'two_link'
    return f' (figure {numbers[which]} of the paper)' if numbers and same else ''


def _name(result: Result, results: Sequence[Result], name: str = '') -> str:
    """Return the label or `name`, with the switching if `results` differ in it."""
    several = len({r.switching for r in results if r.law == result.law}) > 1
    return (name or result.label) + (f' ({result.switching})' if several else '')
