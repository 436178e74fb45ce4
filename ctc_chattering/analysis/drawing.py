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
Style of all figures, from sheets to files.

Each command's figures are made in three steps. `sheet` makes a figure, and `panel` makes axes in
its cells. `line` and others draw. `legend` comes last, and `save` writes the files.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import io
from pathlib import Path
import re
from textwrap import fill
from typing import Any

from ctc_chattering.analysis.page import FigureFile
from ctc_chattering.analysis.tables import cut
from ctc_chattering.numerics.time_grid import missing
from ctc_chattering.output_files import file_stem, write_bytes
from ctc_chattering.simulation.closed_loop import Array
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.text import Text
from matplotlib.ticker import LogFormatter
import numpy as np
import numpy.typing as npt

#: Colour of the reference and of marks.
REFERENCE = '#222222'
#: Samples missing at a stretch from which on a line is broken and the gap is shaded.
SHOWN_GAP = 5
#: Columns of pixels of a figure: more samples than they show are not drawn.
COLUMNS = 1600
#: Style of a signal that keeps its value from a sample to the next.
STEPS: dict[str, Any] = {'linewidth': 0.9, 'drawstyle': 'steps-post'}
#: Width of a letter of 9 points [inch].
_LETTER = 0.078
#: Colour of what is written into panels.
_TEXT = '#444444'
#: Metadata with a date or version are left out, so that equal runs give equal files.
_METADATA = {'svg': {'Date': None}, 'pdf': {'CreationDate': None}, 'png': {'Software': None}}
#: Control codes, in a name for example, which no SVG may have.
_NOT_XML = re.compile(rb'[\x00-\x08\x0b\x0c\x0e-\x1f]')


def sheet(
    title: str, rows: int, widths: Sequence[float], height: float, left: float = 0.85
) -> tuple[Figure, GridSpec]:
    """
    Return a figure with cells for panels.

    Panels have one height, and `left` is the space for labels beside them [inch].

    Its first text is the title: Matplotlib 3.6, of Ubuntu 24.04, has no `Figure.get_suptitle`.
    """
    title = fill(title, 85)
    # All lengths are in inches.
    whole_width, right, bottom, gap, side = 11.0, 0.25, 0.55, 0.75, 0.85
    top = 0.78 + 0.22 * title.count('\n')
    whole_height = top + bottom + rows * height + (rows - 1) * gap
    figure = Figure(figsize=(whole_width, whole_height), facecolor='white')
    FigureCanvasAgg(figure)
    figure.suptitle(
        title,
        x=0.15 / whole_width,
        y=1.0 - 0.16 / whole_height,
        ha='left',
        va='top',
        fontsize=13,
        weight='bold',
        parse_math=False,
    )
    width = (whole_width - left - right) / len(widths)
    return figure, figure.add_gridspec(
        rows,
        len(widths),
        width_ratios=list(widths),
        left=left / whole_width,
        right=1.0 - right / whole_width,
        bottom=bottom / whole_height,
        top=1.0 - top / whole_height,
        hspace=gap / height,
        wspace=side / (width - side),
    )


def column_count(panels: int) -> int:
    """Return the number of columns that leaves few cells empty."""
    if panels <= 4:
        return (1, 1, 2, 3, 2)[panels]
    return min((3, 4), key=lambda columns: -panels % columns)


def panel(figure: Figure, cell: Any, title: str, ylabel: str, *times: Array) -> Axes:
    """
    Return axes in a cell of a sheet.

    They show all the times [s], if there are any.
    """
    ax = figure.add_subplot(cell)
    ax.set_title(title, loc='left', fontsize=10, color='#333333', pad=4, parse_math=False)
    ax.grid(True, color='#dddddd', linewidth=0.6)
    ax.spines[['top', 'right']].set_visible(False)
    ax.tick_params(labelsize=9, which='both')
    ax.set(xlabel='t [s]', ylabel=ylabel)
    if times:
        first, last = min(t[0] for t in times), max(t[-1] for t in times)
        ax.set_xlim(first, last if last > first else first + 1e-3)
    return ax


def legend(figure: Figure, handles: Sequence[Any]) -> None:
    """
    Draw a legend between title and panels.

    The figure grows by its height. Call it last.

    Parameters
    ----------
    figure : Figure
        Figure of `sheet`, with its panels.
    handles : sequence of Artist or Container
        Those with labels; none for no legend.

    """
    if not handles:
        return
    width, height = figure.get_size_inches()
    names = [fill(str(x.get_label()), 90) for x in handles]
    longest = max(len(line) for name in names for line in name.splitlines())
    # A legend's sample, with the gaps beside it, takes 0.55 inch.
    columns = int(width / (_LETTER * longest + 0.55))
    columns = max(1, min(len(names), columns))
    row_count = -(-len(names) // columns)
    # Matplotlib fills one column after the other. A line is 0.19 inch high.
    lines = sum(
        1 + max(name.count('\n') for name in names[k::row_count]) for k in range(row_count)
    )
    added = 0.19 * lines + 0.06
    scale = height / (height + added)
    figure.set_size_inches(width, height + added)
    for ax in figure.axes:
        box = ax.get_position()
        ax.set_position((box.x0, box.y0 * scale, box.width, box.height * scale))
    title, *notes = figure.texts
    title.set_y(1.0 - 0.16 / (height + added))
    for text in notes:
        text.set_y(text.get_position()[1] * scale)
    top = 0.23 + 0.22 * len(title.get_text().splitlines())
    drawn = figure.legend(
        list(handles),
        names,
        loc='upper left',
        ncol=columns,
        frameon=False,
        fontsize=9,
        bbox_to_anchor=(0.15 / width, 1.0 - top / (height + added)),
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=1.8,
        columnspacing=1.6,
    )
    for text in drawn.get_texts():
        text.set_parse_math(False)


def legend_of(*panels: Axes) -> None:
    """
    Draw one legend for several panels of a figure.

    Each name is in it once.
    """
    handles: dict[str, Any] = {}
    for ax in panels:
        for handle, name in zip(*ax.get_legend_handles_labels()):
            handles.setdefault(name, handle)
    legend(panels[0].figure, list(handles.values()))  # type: ignore[arg-type]


def save(
    figures: Iterable[tuple[str, Figure, str]],
    directory: Path,
    kinds: Sequence[str],
    used: set[str] | None = None,
) -> list[FigureFile]:
    """
    Write figures as files.

    A dollar sign in a name stays a dollar sign.

    Parameters
    ----------
    figures : iterable of (str, Figure, str)
        Name that `file_stem` makes a file name of, figure and caption.
    directory : Path
        Created if necessary.
    kinds : sequence of str
        ``svg``, ``pdf`` or ``png``; the files returned are those of the first.
    used : set of str, optional
        File names that are taken. Those of the figures are added.

    Raises
    ------
    CtcError
        If a file cannot be written.

    """
    files: list[FigureFile] = []
    used = set() if used is None else used
    for name, figure, caption in figures:
        stem = file_stem(name, used)
        _disable_math(fit(figure))
        paths = [directory / f'{stem}.{kind}' for kind in dict.fromkeys(kinds)]
        for path in paths:
            write_bytes(path, _content(figure, path.suffix[1:]))
        width, height = 96.0 * figure.get_size_inches()
        files.append(
            FigureFile(
                paths[0],
                figure.texts[0].get_text(),
                caption,
                tuple(paths[1:]),
                (round(width), round(height)),
            )
        )
    return files


def _content(figure: Figure, kind: str) -> bytes:
    """Return the content of a figure's file."""
    data = io.BytesIO()
    # Without a salt, the names of parts of an SVG would be random.
    with rc_context({'svg.hashsalt': 'ctc_chattering'}):
        figure.savefig(data, format=kind, dpi=130, metadata=_METADATA[kind])
    return _NOT_XML.sub(b'', data.getvalue()) if kind == 'svg' else data.getvalue()


def fit(figure: Figure) -> Figure:
    """Cut titles and labels that are longer than their panels."""
    for ax in figure.axes:
        width, height = figure.get_size_inches() * ax.get_position().size / _LETTER
        left, right = ax._left_title, ax._right_title  # type: ignore[attr-defined]
        right_width = max(int(0.5 * width), int(width) - 2 - len(left.get_text()))
        right_width = min(len(right.get_text()), right_width)
        limits = {
            ax.xaxis.label: width,
            ax.yaxis.label: height,
            right: right_width,
            left: width - right_width - 2,
        }
        for text, limit in limits.items():
            lines = text.get_text().split('\n')
            text.set_text('\n'.join(cut(line, max(int(limit), 8)) for line in lines))
    return figure


def _disable_math(figure: Figure) -> None:
    """
    Let no text be a formula.

    Powers of ten along logarithmic axes remain.
    """
    formulas = {
        text
        for ax in figure.axes
        for axis in (ax.xaxis, ax.yaxis)
        if isinstance(axis.get_major_formatter(), LogFormatter)
        for text in axis.get_ticklabels(which='both')
    }
    for text in figure.findobj(Text):
        if text not in formulas:
            text.set_parse_math(False)


def line(ax: Axes, t: Array, y: Array, period: float, **style: Any) -> None:
    """
    Draw a line that is broken where samples are missing.

    A line of few samples has dots.

    If there are more samples than `COLUMNS` can show, only the least and greatest of each column
    are drawn.

    Parameters
    ----------
    ax : Axes
        Axes to draw in.
    t, y : ndarray, shape (N,)
        Samples.
    period : float
        Sample period [s].
    style : dict
        Arguments of matplotlib.

    """
    gaps = _gaps(t, period)
    shown = np.union1d(envelope(y), np.concatenate((gaps, gaps + 1)))
    after = np.searchsorted(shown, gaps) + 1
    t, y = t[shown], y[shown]
    ax.plot(
        np.insert(t, after, t[after - 1]),
        np.insert(y, after, np.nan),
        **{'linewidth': 1.3, 'marker': '.' if len(t) < 4 else None, **style},
    )


def envelope(y: Array) -> npt.NDArray[np.intp]:
    """
    Return the indices of the samples to draw.

    They are all, or the first, the last and the extremes of each column of pixels.

    Where some samples of a column are not finite, one of them is kept, so that a line is broken.
    """
    if len(y) <= 4 * COLUMNS:
        return np.arange(len(y))
    width = -(-len(y) // COLUMNS)
    columns = np.append(y, np.full(-len(y) % width, y[-1])).reshape(-1, width)
    is_finite = np.isfinite(columns)
    picked = [
        np.where(is_finite, columns, np.inf).argmin(axis=1),
        np.where(is_finite, columns, -np.inf).argmax(axis=1),
        is_finite.argmin(axis=1),
    ]
    starts = width * np.arange(len(columns))
    indices = np.concatenate([[0], *(starts + x for x in picked), [len(y) - 1]])
    return np.unique(np.minimum(indices, len(y) - 1))


def shade_gaps(ax: Axes, t: Array, period: float) -> None:
    """
    Hatch gaps of `SHOWN_GAP` samples or more.

    The arguments are those of `line`.
    """
    gaps = _gaps(t, period)
    if len(gaps):
        ax.broken_barh(
            list(zip(t[gaps], t[gaps + 1] - t[gaps])),
            (0.0, 1.0),
            facecolor='none',
            edgecolor='#999999',
            hatch='////',
            linewidth=0,
            zorder=0,
            transform=ax.get_xaxis_transform(),
        )


def _gaps(t: Array, period: float) -> Any:
    """Return the indices of the samples before long gaps."""
    return np.flatnonzero(missing(t, period) >= SHOWN_GAP)


def note(ax: Axes, text: str) -> None:
    """Write `text` above the axes, on the right."""
    notes = filter(None, (ax.get_title('right'), text))
    ax.set_title(
        '; '.join(notes), loc='right', fontsize=9, color='#666666', pad=4, parse_math=False
    )


def label(ax: Axes, x: float, y: float, text: str, **style: Any) -> None:
    """Write `text` into the axes."""
    ax.text(x, y, text, transform=ax.transAxes, fontsize=9, color=_TEXT, zorder=5, **style)


def mark(ax: Axes, time: float, name: str = '') -> None:
    """Draw a vertical line at `time`, with its name."""
    ax.axvline(time, color=REFERENCE, linewidth=1.0, linestyle=(0, (1, 1.5)))
    if name:
        ax.annotate(
            f'→ {name}',
            (time, 1.0),
            xycoords=ax.get_xaxis_transform(),
            xytext=(3, -1),
            textcoords='offset points',
            va='top',
            fontsize=9,
            color=_TEXT,
            annotation_clip=True,
        )


def log_axis(ax: Axes, y: Array) -> None:
    """
    Make the axis of y logarithmic.

    It leaves out rare dips towards zero. Without a positive value it stays as it is.
    """
    positive = y[np.isfinite(y) & (y > 0.0)]
    if len(positive):
        least = float(positive.min())
        low = float(np.percentile(positive, 1.0)) / 5.0
        ax.set_ylim(max(least / 1.6, low), float(positive.max()) * 1.6)
        ax.set_yscale('log')
        if least < low:
            note(ax, 'axis cut below')


def steady_axis(ax: Axes, t: Array, y: Array) -> None:
    """
    Fit the axis of y to the run after its start.

    A note says so if that cuts the start.
    """
    is_finite = np.isfinite(y)
    if not is_finite.any():
        return
    begin = t[0] + min(1.0, (t[-1] - t[0]) / 3.0)
    t, y = t[is_finite], y[is_finite]
    late = y[t >= begin]
    if not len(late):
        return
    low, high = late.min(), late.max()
    span = max(high - low, 1e-9 * abs(high)) or 1.0
    k = int(np.abs(y).argmax())
    if not low - span <= y[k] <= high + span:
        note(ax, f'axis cut: {y[k]:.4g} at {t[k]:.3g} s')
        ax.set_ylim(low - 0.1 * span, high + 0.1 * span)


def beyond(ax: Axes, text: str, looks: Sequence[dict[str, Any]]) -> None:
    """
    Draw marks that lie outside the axes in a row.

    The row is at the top, on the right.
    """
    if looks:
        for k, look in enumerate(looks, 1):
            ax.plot([1.0 - 0.045 * k], [0.95], transform=ax.transAxes, **{**look, 'zorder': 6})
        label(ax, 0.98 - 0.045 * len(looks), 0.95, f'{text}:', ha='right', va='center')
