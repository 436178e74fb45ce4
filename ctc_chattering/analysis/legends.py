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

"""Legends of figures: in a strip of their own, where nothing else is."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

#: Label of a figure's title: Matplotlib 3.6, of Ubuntu 24.04, has no `Figure.get_suptitle`.
TITLE = 'title'
#: From the edges of the figure to the title and to the legend below it, and below that [inch].
_SIDE, _TITLE, _ABOVE, _BELOW = 0.15, 0.16, 0.45, 0.06
#: Characters of a line.
_LINE = 90


def title_of(figure: Figure) -> str:
    """Return the title of a figure that `drawing.sheet` made."""
    return next((x.get_text() for x in figure.texts if x.get_label() == TITLE), '')


def legend(figure: Figure, handles: Sequence[Any]) -> None:
    """
    Draw a legend between title and panels; the figure grows by its height. Call it last.

    Parameters
    ----------
    figure : Figure
        As `drawing.sheet` returns it, with its panels.
    handles : sequence of Artist or Container
        Those with labels; none for no legend.

    """
    if not handles:
        return
    width, height = figure.get_size_inches()
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
    names = [fill(str(x.get_label()), _LINE) for x in handles]
    for columns in range(len(handles), 0, -1):
        found = figure.legend(list(handles), names, loc='upper left', ncol=columns, frameon=False,
                              fontsize=9, borderaxespad=0.0, borderpad=0.0, handlelength=1.8,
                              columnspacing=1.6)
        for text in found.get_texts():
            text.set_parse_math(False)
        box = found.get_window_extent(renderer)
        if columns == 1 or box.width <= (width - 2.0 * _SIDE) * figure.dpi:
            break
        found.remove()
    room = box.height / figure.dpi + _BELOW
    part = height / (height + room)
    figure.set_size_inches(width, height + room)
    for ax in figure.axes:
        place = ax.get_position()
        ax.set_position((place.x0, place.y0 * part, place.width, place.height * part))
    for text in figure.texts:
        text.set_y(1.0 - _TITLE / (height + room) if text.get_label() == TITLE else
                   text.get_position()[1] * part)
    found.set_bbox_to_anchor((_SIDE / width, 1.0 - _ABOVE / (height + room)))


def legend_of(*panels: Axes) -> None:
    """Draw the legend of what is named in panels of one figure, each name and colour once."""
    handles: list[Any] = []
    names: set[str] = set()
    for ax in panels:
        for handle, name in zip(*ax.get_legend_handles_labels()):
            if name not in names:
                names.add(name)
                handles.append(handle)
    legend(panels[0].figure, handles)  # type: ignore[arg-type]
