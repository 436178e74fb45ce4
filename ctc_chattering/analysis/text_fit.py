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

"""Texts of a figure, shortened until they have room."""

from __future__ import annotations

from typing import Any

from ctc_chattering.analysis.legends import TITLE
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

#: Smallest letters [point], and fewest of them.
_SMALL, _FEW = 8.0, 8
#: That the label of an axis may be longer than it, and from title to edge [inch].
_LONGER, _EDGE = 0.1, 0.3
#: Between the texts above a panel [pixel].
_BETWEEN = 20.0


def fit(figure: Figure) -> Figure:
    """Shorten title, texts above panels and labels of axes that have no room; return `figure`."""
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
    for text in figure.texts:
        if text.get_label() == TITLE:
            _shorten(text, (figure.get_figwidth() - _EDGE) * figure.dpi, renderer)
    for ax in figure.axes:
        room = ax.get_window_extent(renderer)
        more = _LONGER * figure.dpi
        _shorten(ax.xaxis.label, room.width + more, renderer)
        _shorten(ax.yaxis.label, room.height + more, renderer)
        _fit_titles(ax, room.width, renderer)
    return figure


def _shorten(text: Text, room: float, renderer: Any) -> None:
    """Make letters smaller, then leave out those in the middle, until a text has room [pixel]."""
    while text.get_text() and (length := _length(text, renderer)) > room:
        whole, size = text.get_text(), float(text.get_fontsize())
        if size > _SMALL:
            text.set_fontsize(max(_SMALL, size - 1.0))
        elif len(whole) > _FEW:
            most = max(_FEW, min(len(whole) - 1, int(len(whole) * room / length)))
            text.set_text(f'{whole[:most - most // 2 - 1]}…{whole[-(most // 2):]}')
        else:
            break


def _length(text: Text, renderer: Any) -> float:
    """Return the length of a text along its line [pixel]."""
    box = text.get_window_extent(renderer)
    return float(max(box.width, box.height))


def _fit_titles(ax: Axes, room: float, renderer: Any) -> None:
    """Shorten the two texts above a panel until they do not overlap."""
    both = [ax._left_title, ax._right_title]  # type: ignore[attr-defined]
    titles = [title for title in both if title.get_text()]
    while titles and sum(x.get_window_extent(renderer).width for x in titles) > (
            room - _BETWEEN * (len(titles) - 1)):
        longest = max(titles, key=lambda x: len(x.get_text()))
        if longest.get_fontsize() > _SMALL:
            longest.set_fontsize(longest.get_fontsize() - 0.5)
        elif len(longest.get_text()) > _FEW:
            longest.set_text(longest.get_text().rstrip('…')[:-1] + '…')
        else:
            break
