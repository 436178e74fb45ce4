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

"""Parts of the figures of many runs: looks of laws, panels, error over variation."""

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

#: A place in a figure, torque variation [N·m/s] and error [rad], and what its mark looks like.
Mark = tuple[float, float, dict[str, Any]]
#: Room around what is drawn, as a factor, and ratio of ends from which on only decades have ticks.
_ROOM, _DECADES = 1.4, 300.0


def law_styles(laws: Sequence[str]) -> list[dict[str, Any]]:
    """Return colour of the law, marker and dashes of variants, distinct without colour, too."""
    colours = shaded([LAW_COLOURS.get(law, SEVERAL_LAWS_COLOUR) for law in laws])
    return [{'color': colour, 'marker': marker, 'linestyle': dashes} for colour, marker, dashes in
            zip(colours, cycle('so^Dv<P>X'),
                cycle(['-', (0, (5, 1.5)), (0, (2.5, 1.2)), '-.', (0, (1, 1))]))]


def panels(title: str, names: Sequence[str], ylabel: str, height: float, **more: Any
           ) -> tuple[Figure, list[Axes]]:
    """Return a figure and its panels, one for each name; the first of a row has a label."""
    columns = drawing.column_count(len(names))
    figure, grid = drawing.sheet(title, -(-len(names) // columns), (1.0,) * columns, height,
                                 **more)
    return figure, [drawing.panel(figure, grid[k // columns, k % columns], name,
                                  '' if k % columns else ylabel) for k, name in enumerate(names)]


def log_axis(ax: Axes, axis: str, values: Iterable[float]) -> None:
    """Make an axis logarithmic, around the positive values, with plain numbers as ticks."""
    positive = [x for x in values if 0.0 < x < np.inf] or [1.0]
    low, high = min(positive) / _ROOM, max(positive) * _ROOM
    ax.set(**{f'{axis}scale': 'log', f'{axis}lim': (low, high)})
    mine = getattr(ax, f'{axis}axis')
    mine.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < _DECADES * low else (1.0,)))
    mine.set_major_formatter(FuncFormatter(lambda x, _: f'{x:g}'))
    mine.set_minor_locator(NullLocator())


def trade_off(ax: Axes, marks: Sequence[Mark], gone: str,
              further: Iterable[tuple[float, float]] = ()) -> None:
    """Draw marks; those without a place in a row at the top, called `gone`; fit to `further`."""
    there = [x for x in marks if np.isfinite(x[:2]).all()]
    for x, y, look in there:
        ax.plot([x], [y], **look)
    drawing.beyond(ax, gone, [look for x, y, look in marks if not np.isfinite((x, y)).all()])
    ax.set(xlabel='torque variation [N·m/s]')
    for axis, values in zip('xy', zip(*(x[:2] for x in there), *further)):
        log_axis(ax, axis, values)
