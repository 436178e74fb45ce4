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
Figures of an identification: predicted torque, and friction over velocity.

`identified_robot` saves them for the page of `ctc identify`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ctc_chattering.analysis.drawing import legend_of, panel, sheet
from ctc_chattering.identification.friction_terms import TermKind
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import friction_at
from ctc_chattering.identification.verdict import Verdict
from matplotlib.figure import Figure
import numpy as np

RECORDED_COLOUR = '#8aa6c1'
MODEL_COLOUR = '#7F7F7F'
FRICTION_COLOUR = '#2e7d32'
IDENTIFIED_COLOUR = '#b34a00'
#: Terms of friction that a curve over velocity has.
VELOCITY_TERMS = (TermKind.COULOMB, TermKind.OFFSET, TermKind.VISCOUS, TermKind.STRIBECK)


class NamedFigure(NamedTuple):
    """A figure with the name of its file and its caption."""

    name: str
    figure: Figure
    caption: str


def torque_figure(identified: Identification, verdicts: Sequence[Verdict]) -> NamedFigure:
    """Return the torque over time, recorded and predicted."""
    prediction = identified.prediction
    figure, grid = sheet('Torque of held-out time', len(verdicts), (1.0,), 1.6)
    for joint, verdict in enumerate(verdicts):
        axes = panel(figure, grid[joint, 0], f'{verdict.joint}: {verdict.word}', 'torque [N·m]')
        for values, colour, label in (
            (prediction.measured, RECORDED_COLOUR, 'recorded'),
            (prediction.model, MODEL_COLOUR, 'model as given'),
            (prediction.with_friction, FRICTION_COLOUR, 'model with friction'),
            (prediction.identified, IDENTIFIED_COLOUR, 'identified'),
        ):
            axes.plot(
                prediction.t,
                values[:, joint],
                color=colour,
                label=label,
                linewidth=1.8 if label == 'recorded' else 0.9,
            )
    axes.set_xlabel('t [s]')
    legend_of(*figure.axes)
    return NamedFigure(
        'torque',
        figure,
        'The other blocks of time predict the torque of each block. The joint rests in gaps.',
    )


def friction_figure(identified: Identification, verdicts: Sequence[Verdict]) -> NamedFigure:
    """
    Return friction over velocity.

    A joint that is not usable has no curve.
    """
    fit = identified.fit
    figure, grid = sheet('Friction over velocity', (len(verdicts) + 1) // 2, (1.0, 1.0), 2.0)
    for joint, verdict in enumerate(verdicts):
        axes = panel(
            figure, grid[joint // 2, joint % 2], f'{verdict.joint}: {verdict.word}', 'torque [N·m]'
        )
        used = fit.data.used[:, joint]
        speed = fit.data.windows.velocity[used, joint]
        beyond = fit.data.beyond_model[used, joint] - fit.torque(joint)[used]
        points = beyond + fit.torque(joint, VELOCITY_TERMS)[used]
        axes.plot(
            speed,
            points,
            '.',
            markersize=2.5,
            color=RECORDED_COLOUR,
            zorder=3,
            rasterized=len(speed) > 5000,
        )  # Many dots are pixels.
        axes.set_xlabel('velocity [rad/s]')
        for sign in (1.0, -1.0) if verdict.usable else ():
            shown = np.abs(speed[np.sign(speed) == sign])
            if len(shown):
                v = sign * np.linspace(shown.min(), shown.max(), 200)
                friction = identified.friction[joint]
                low, middle, high = (
                    friction_at(friction, v, 0.0, halves) for halves in (-1.0, 0.0, 1.0)
                )
                axes.fill_between(v, low, high, color=IDENTIFIED_COLOUR, alpha=0.25, linewidth=0)
                axes.plot(v, middle, color=IDENTIFIED_COLOUR, linewidth=1.2)
    return NamedFigure(
        'friction',
        figure,
        'Dots are the recorded torque without that of the identified bodies, in windows of time. '
        'The line is the friction with its interval of 95 %. A joint that is not usable has none.',
    )
