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

"""Figures of an identification."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ctc_chattering.analysis.drawing import FigureFile, panel, REFERENCE, save, sheet
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.least_squares import BENT, TermKind
from ctc_chattering.identification.perturbation import friction_at, MeasuredPerturbation
from ctc_chattering.identification.results import IdentificationResults
from ctc_chattering.identification.verdict import Verdict
from ctc_chattering.numerics.linear_algebra import Array
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

_MEASURED, _FIT, _BAND = '#8aa6c1', '#b34a00', '#f3c9a8'
#: Points of a fitted curve.
_POINTS = 200
_Named = tuple[str, Figure, str]


def save_identification_figures(results: IdentificationResults, directory: Path,
                                extra: str = 'svg') -> list[FigureFile]:
    """Write all figures as SVG, and as `extra`, into `directory`, and return them."""
    found, run, verdicts = results.found, results.run, results.verdicts
    ka = np.asarray(results.recommended.values['ka'][0], float)
    figures = [_friction(found, verdicts), _perturbation(run, ka, verdicts)]
    return save(figures, directory, ('svg', extra))


def _panels(verdicts: Sequence[Verdict], title: str, ylabel: str) -> tuple[Figure, list[Axes]]:
    """Return a figure, and axes in it for each joint, two in a row."""
    figure, grid = sheet(title, (len(verdicts) + 1) // 2, (1.0, 1.0), 2.0)
    return figure, [panel(figure, grid[i // 2, i % 2], _title(verdict), ylabel)
                    for i, verdict in enumerate(verdicts)]


def _title(verdict: Verdict) -> str:
    """Return the name of a joint, and whether it is not usable."""
    return verdict.joint if verdict.usable else f'{verdict.joint}: {verdict.word}'


def _friction(found: Identification, verdicts: Sequence[Verdict]) -> _Named:
    """Return friction against velocity; without a fit for a joint that is not usable."""
    data, fit = found.data, found.selected.fit
    figure, panels = _panels(verdicts, 'Friction against velocity', 'torque [N·m]')
    for i, axes in enumerate(panels):
        used = data.way[:, i] != 0.0
        mine = [k for k, term in enumerate(fit.terms)
                if term.joint == i and term.kind not in (TermKind.SCALE, *BENT)]
        speed = data.velocity[used, i]
        # Less errors of the model, and friction of the load.
        rest = fit.residual[used, i] + fit.design[used, i][:, mine] @ fit.value[mine]
        axes.plot(speed, rest, '.', markersize=2.0, color=_MEASURED, rasterized=len(speed) > 5000)
        axes.set_xlabel('velocity [rad/s]')
        for sign in (1.0, -1.0) if verdicts[i].usable else ():
            mine_speed = speed[np.sign(speed) == sign]
            if len(mine_speed):
                v = sign * np.linspace(np.abs(mine_speed).min(), np.abs(mine_speed).max(), _POINTS)
                value, half = (x[:, i] for x in friction_at(
                    found, np.repeat(v[:, None], len(panels), axis=1), 0.0))
                left = found.unexplained[i] if found.unexplained else None
                half = half + (left.off if left else 0.0)
                axes.fill_between(v, value - half, value + half, color=_BAND, linewidth=0)
                axes.plot(v, value, color=_FIT, linewidth=1.2)
    return 'friction', figure, ('Dots: torque less the corrected model, in windows of 0.1 s in '
                                'which the joint slides one way. Line: the fit with its interval '
                                'of 95 %; a joint that is not usable has none.')


def _perturbation(run: MeasuredPerturbation, ka: Array, verdicts: Sequence[Verdict]) -> _Named:
    """Return P over time, with ±ka where there is one."""
    figure, panels = _panels(verdicts, 'Perturbation P and the recommended ka', 'P [N·m]')
    for i, axes in enumerate(panels):
        axes.plot(run.t, run.measured[:, i], color=_MEASURED, linewidth=0.8)
        for sign in (1.0, -1.0) if verdicts[i].usable else ():
            axes.plot(run.t, sign * run.envelope[:, i], color=_FIT, linewidth=0.5, alpha=0.6)
            axes.axhline(sign * ka[i], color=REFERENCE, linewidth=1.0, linestyle='--')
    return 'perturbation', figure, ('P: torque less the model. Thin lines: the most that what was '
                                    'identified allows at each time. Dashed: ±ka. A joint that '
                                    'is not usable has neither.')
