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

"""Legends above the panels, which keep their sizes, and texts that are shortened to fit."""

from __future__ import annotations

from ctc_chattering.analysis.drawing import fit, legend_of, panel, sheet
from figure_layout import overlaps
from matplotlib.figure import Figure
import numpy as np
import pytest


def drawn(names: list[str]) -> Figure:
    figure, grid = sheet('Title', 2, (2.0, 1.0), 1.5)
    for k in range(4):
        ax = panel(figure, grid[k // 2, k % 2], f'panel {k}', 'y [rad]')
        for name in names:
            ax.plot([0.0, 1.0], [0.0, 1.0], label=name)
    return figure


@pytest.mark.parametrize('names', [
    [], ['one'], [f'a law with the settings {k}' for k in range(20)], ['long ' * 60, '$x_{']])
def test_panels_keep_their_size_and_nothing_is_over_the_legend(names: list[str]) -> None:
    figure = drawn(names)

    def sizes() -> list[list[float]]:
        return [(ax.get_position().bounds[2:] * figure.get_size_inches()).tolist()
                for ax in figure.axes]
    before, height = sizes(), figure.get_size_inches()[1]
    legend_of(*figure.axes)
    assert np.allclose(sizes(), before)
    assert (figure.get_size_inches()[1] > height) == bool(names)
    assert len(figure.legends) == bool(names)
    assert not overlaps(figure)
    assert [len(x.get_texts()) for x in figure.legends] == [len(names)] * bool(names)


@pytest.mark.parametrize('long', [1, 30])
def test_what_has_room_stays_and_what_has_none_is_shortened(long: int) -> None:
    figure, grid = sheet('Title ' * long, 2, (1.0, 1.0), 1.5)
    ax = panel(figure, grid[0, 0], 'panel ' * long, 'y, ' * long + 'last [N·m]')
    shown = *figure.texts, ax.yaxis.label
    before = [(x.get_text(), x.get_fontsize()) for x in shown]
    assert fit(figure) is figure
    assert (before == [(x.get_text(), x.get_fontsize()) for x in shown]) == (long == 1)
    assert ax.get_ylabel().endswith('[N·m]')
    assert not overlaps(figure)
