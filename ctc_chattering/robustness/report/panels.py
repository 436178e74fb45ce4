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

"""Sheets of small maps, a panel a variant, with one colour bar and one legend."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
import textwrap
from typing import Any

from ctc_chattering.analysis import drawing
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.robustness.report.axis import GridAxis
from ctc_chattering.robustness.report.boundary import LEVEL, share, wilson
from ctc_chattering.robustness.report.data import MapData, spaced
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
import numpy as np
import numpy.typing as npt

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
