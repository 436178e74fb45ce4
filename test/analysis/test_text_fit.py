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

from __future__ import annotations

from ctc_chattering.analysis.drawing import fit, panel, sheet
from figure_layout import overlaps
from matplotlib.figure import Figure
from matplotlib.text import Text
import pytest


def texts(figure: Figure) -> list[Text]:
    return [*figure.texts, *(x for ax in figure.axes for x in (
        ax.xaxis.label, ax.yaxis.label, ax.title))]


@pytest.mark.parametrize('long', [1, 30])
def test_what_has_room_stays_and_what_has_none_is_shortened(long: int) -> None:
    figure, grid = sheet('Title ' * long, 2, (1.0, 1.0), 1.5)
    for k in range(4):
        ax = panel(figure, grid[k // 2, k % 2], 'panel ' * long, 'y, ' * long + 'last [N·m]')
        ax.set_xlabel('x, ' * long + 'last [rad]')
    before = [(x.get_text(), x.get_fontsize()) for x in texts(figure)]
    assert fit(figure) is figure
    after = [(x.get_text(), x.get_fontsize()) for x in texts(figure)]
    assert (before == after) == (long == 1)
    assert all(ax.get_ylabel().endswith('[N·m]') and ax.get_xlabel().endswith('[rad]')
               for ax in figure.axes)
    assert not overlaps(figure)
