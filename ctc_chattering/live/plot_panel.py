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

"""The plots of the page: error, v, V, and the torque of a joint with its parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ctc_chattering.live.history import envelope
from ctc_chattering.live.samples import COLOURS, PARTS, Samples
import numpy as np

#: The dashes distinguish lines without colour.
DASHES = ((), (9, 4), (2, 3), (9, 3, 2, 3), (5, 5), (14, 4), (1, 5))
#: The same in the legend, whose marks have colours only.
_SIGNS = ('—', '– –', '···', '—·', '- -', '— —', '· ·')
#: Stretches of a plot, of which each shows its least and greatest value.
_BUCKETS = 150
#: Least V of which the logarithm is drawn [J].
_LEAST = 1e-12
_HEIGHT = 165


class PlotPanel:
    """
    Plots of one run, or of two for comparison: the second one's lines are thinner and dashed.

    Parameters
    ----------
    gui : GuiApi
        Of the page, in the container to fill.
    names : sequence of str
        The joints.
    runs : sequence of str
        Names of the runs; one empty name for a single run.

    """

    def __init__(self, gui: Any, names: Sequence[str], runs: Sequence[str] = ('',)) -> None:
        self._gui, self._n, self._runs = gui, len(names), len(runs)
        suffixes = [f', {run}' if run else '' for run in runs]
        joints = [name + suffix for suffix in suffixes for name in names]
        self._folder = gui.add_folder(None)
        with self._folder:
            self._plots = [
                self._add('error [rad]', joints), self._add('v [rad/s]', joints),
                self._add('log₁₀ of V [J]', [f'V{suffix}' for suffix in suffixes]),
                self._add('torque [N·m]', [
                    f'{part}{suffix}' for suffix in suffixes for part in ('torque', *PARTS)])]
            self._joint = gui.add_dropdown('torque of', tuple(names))

    def _add(self, title: str, labels: Sequence[str]) -> Any:
        styles = [{
            'label': f'{label} {_SIGNS[i % len(_SIGNS)]}', 'width': 1.6,
            'stroke': COLOURS[i % len(labels) % len(COLOURS)],
            'dash': DASHES[i % len(DASHES)], 'points': {'show': False}}
            for i, label in enumerate(labels)]
        grey = {'stroke': '#808080', 'grid': {'stroke': '#80808040', 'width': 1},
                'ticks': {'stroke': '#80808040', 'width': 1}}
        return self._gui.add_uplot(
            (np.arange(2.0), *(np.zeros(2) for _ in labels)),
            ({'label': 't [s]'}, *styles), title=title, height=_HEIGHT,
            scales={'x': {'time': False}}, axes=(grey, {**grey, 'size': 60}),
            legend={'show': True, 'live': False}, padding=(12, 12, 0, 0))

    def show(self, runs: Sequence[Samples]) -> None:
        """Draw the samples of every run; the others at the times of the first."""
        first = runs[0]
        if len(first.t) < 2:
            return
        aligned = [first, *(run.at(first.t) for run in runs[1:])]
        for plot, rows in zip(self._plots, (
                np.hstack([x.e for x in aligned]), np.hstack([x.v for x in aligned]),
                np.log10(np.maximum(np.stack([x.lyapunov for x in aligned], axis=1), _LEAST)),
                np.hstack([x.torques[:, :, self.joint] for x in aligned]))):
            t, values = envelope(first.t, rows, _BUCKETS)
            plot.data = (t, *values.T)

    @property
    def joint(self) -> int:
        """Index of the joint whose torque is drawn."""
        return int(self._joint.options.index(self._joint.value))

    def remove(self) -> None:
        """Take them from the page."""
        self._folder.remove()
