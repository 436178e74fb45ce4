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
Parts of the figures of many runs.

`compare_page`, `map_figures` and `tune_page` draw with them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import cycle
from typing import Any

from ctc_chattering.analysis import drawing
from ctc_chattering.analysis.run_names import LAW_COLOURS, SEVERAL_LAWS_COLOUR, shaded
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
import numpy as np

#: Torque variation [N·m/s] and error [rad] of a mark, and its look.
Mark = tuple[float, float, dict[str, Any]]


def law_styles(laws: Sequence[str]) -> list[dict[str, Any]]:
    """
    Return colour, marker and dashes of laws.

    They are also distinct without colour.
    """
    colours = shaded([LAW_COLOURS.get(law, SEVERAL_LAWS_COLOUR) for law in laws])
    dashes: list[Any] = ['-', (0, (5, 1.5)), (0, (2.5, 1.2)), '-.', (0, (1, 1))]
    return [{'color': colour, 'marker': marker, 'linestyle': dash}
            for colour, marker, dash in zip(colours, cycle('so^Dv<P>X'), cycle(dashes))]


def draw_panels(title: str, names: Sequence[str], ylabel: str, height: float, **options: Any
                ) -> tuple[Figure, list[Axes]]:
    """
    Return a figure with a panel for each name.

    The first panel of a row has the label.
    """
    columns = drawing.column_count(len(names))
    figure, grid = drawing.sheet(title, -(-len(names) // columns), (1.0,) * columns, height,
                                 **options)
    axes = []
    for k, name in enumerate(names):
        row, column = divmod(k, columns)
        axes.append(drawing.panel(figure, grid[row, column], name, '' if column else ylabel))
    return figure, axes


def scale_log_axis(ax: Axes, axis: str, values: Iterable[float]) -> None:
    """Make an axis logarithmic, with plain numbers as ticks."""
    positive = [x for x in values if 0.0 < x < np.inf] or [1.0]
    low, high = min(positive) / 1.4, max(positive) * 1.4
    ax.set(**{f'{axis}scale': 'log', f'{axis}lim': (low, high)})
    subs = (1.0, 2.0, 5.0) if high < 300.0 * low else (1.0,)  # On a long axis decades only.
    scaled_axis = getattr(ax, f'{axis}axis')
    scaled_axis.set_major_locator(LogLocator(subs=subs))
    scaled_axis.set_major_formatter(FuncFormatter(lambda x, _: f'{x:g}'))
    scaled_axis.set_minor_locator(NullLocator())


def draw_trade_off(ax: Axes, marks: Sequence[Mark], infinite_label: str,
                   further: Iterable[tuple[float, float]] = ()) -> None:
    """
    Draw marks of error over torque variation.

    Infinite ones are in a labelled row at the top. The axes also fit `further` points.
    """
    points = list(further)
    infinite = []
    for x, y, look in marks:
        if np.isfinite((x, y)).all():
            ax.plot([x], [y], **look)
            points.append((x, y))
        else:
            infinite.append(look)
    drawing.beyond(ax, infinite_label, infinite)
    ax.set(xlabel='torque variation [N·m/s]')
    for axis, values in zip('xy', zip(*points)):
        scale_log_axis(ax, axis, values)
