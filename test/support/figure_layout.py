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

"""Overlaps in a figure, of its legend, its title, and its panels with all their labels."""

from __future__ import annotations

from itertools import combinations
from typing import Any

from ctc_chattering.analysis.drawing import fit
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

#: That boxes may overlap, and reach beyond the figure [pixel].
_SLACK = 1.0


def overlaps(figure: Figure) -> list[str]:
    """Return what is over something else, or beyond the edge, in a figure as it is saved."""
    canvas = FigureCanvasAgg(figure)
    fit(figure)
    renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
    boxes: list[tuple[str, Any]] = [
        (f'panel {k} {ax.get_title("left")}', ax.get_tightbbox(renderer, bbox_extra_artists=[
            *ax.texts, ax.xaxis, ax.yaxis, ax._left_title, ax._right_title]))  # type: ignore
        for k, ax in enumerate(figure.axes)]
    legends = [x for x in (*figure.legends, *(ax.get_legend() for ax in figure.axes)) if x]
    boxes += [('legend', legend.get_window_extent(renderer)) for legend in legends]
    boxes += [(f'text {x.get_text()}', x.get_window_extent(renderer)) for x in figure.texts]
    found = [f'{a} / {b}' for (a, one), (b, other) in combinations(boxes, 2)
             if min(one.x1, other.x1) - max(one.x0, other.x0) > _SLACK
             and min(one.y1, other.y1) - max(one.y0, other.y0) > _SLACK]
    width, height = figure.get_size_inches() * figure.dpi
    return found + [f'{name} beyond the edge' for name, box in boxes if (
        box.x0 < -_SLACK or box.y0 < -_SLACK or box.x1 > width + _SLACK
        or box.y1 > height + _SLACK)]
