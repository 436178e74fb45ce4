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

"""The figure of an identification: friction against velocity."""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.analysis.drawing import panel, sheet
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import friction_at
from ctc_chattering.identification.verdict import Verdict
from matplotlib.figure import Figure
import numpy as np

_MEASURED, _FIT, _BAND = '#8aa6c1', '#b34a00', '#f3c9a8'
#: Points of a fitted curve.
_POINTS = 200


def friction_figure(found: Identification, verdicts: Sequence[Verdict]) -> tuple[str, Figure, str]:
    """Return friction against velocity; without a fit for a joint that is not usable."""
    data, fit = found.data, found.selected.fit
    figure, grid = sheet('Friction against velocity', (len(verdicts) + 1) // 2, (1.0, 1.0), 2.0)
    for i, verdict in enumerate(verdicts):
        title = verdict.joint if verdict.usable else f'{verdict.joint}: {verdict.word}'
        axes = panel(figure, grid[i // 2, i % 2], title, 'torque [N·m]')
        used = data.way[:, i] != 0.0
        mine = [k for k, term in enumerate(fit.terms) if term.joint == i]
        speed = data.velocity[used, i]
        # Less errors of the model, and friction of the load.
        rest = fit.residual[used, i] + fit.columns(i)[used][:, mine] @ fit.value[mine]
        axes.plot(speed, rest, '.', markersize=2.0, color=_MEASURED, rasterized=len(speed) > 5000)
        axes.set_xlabel('velocity [rad/s]')
        for sign in (1.0, -1.0) if verdict.usable else ():
            mine_speed = speed[np.sign(speed) == sign]
            if len(mine_speed):
                v = sign * np.linspace(np.abs(mine_speed).min(), np.abs(mine_speed).max(), _POINTS)
                value, half = (x[:, i] for x in friction_at(
                    found, np.repeat(v[:, None], len(verdicts), axis=1), 0.0))
                left = found.unexplained[i] if found.unexplained else None
                half = half + (left.off if left else 0.0)
                axes.fill_between(v, value - half, value + half, color=_BAND, linewidth=0)
                axes.plot(v, value, color=_FIT, linewidth=1.2)
    return 'friction', figure, ('Dots: torque less the corrected model, in windows of 0.1 s in '
                                'which the joint slides one way. Line: the fit with its interval '
                                'of 95 %; a joint that is not usable has none.')
