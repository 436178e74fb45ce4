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

"""Whether what was identified predicts a run that was not used for the fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses

from ctc_chattering.analysis.recording import Recording, stretches
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.regression.finding import Finding, Severity
from ctc_chattering.identification.regression.identify import Identification
from ctc_chattering.identification.regression.torque import has
from ctc_chattering.identification.report.perturbation import MeasuredPerturbation, perturbation
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Part of P above which a run that is not predicted says that the numbers are wrong.
_WRONG = 0.5


@dataclasses.dataclass(frozen=True)
class Validation:
    """
    Another run, predicted.

    Attributes
    ----------
    name : str
        Of its bag.
    run : MeasuredPerturbation
        P, measured and predicted.
    torque : ndarray, shape (J, n)
        Measured torque of each window [N·m].
    model : ndarray, shape (J, n)
        That of the model alone [N·m].

    """

    name: str
    run: MeasuredPerturbation
    torque: Array
    model: Array

    def findings(self, ka: Sequence[float | None]) -> Iterator[Finding]:
        """
        Yield what this run says against the numbers of a joint.

        Parameters
        ----------
        ka : sequence of float or None, shape (n,)
            Recommended [N·m]; None for a joint that is not usable.

        """
        whole, rest = self.run.misfit()
        good, peak = self.run.good(), self.run.peak
        moved = np.isfinite(self.run.predicted).sum(axis=0) > 0
        for i, most in enumerate(ka):
            if not moved[i]:
                yield Finding(Severity.NOTE, i, f'it hardly moves in {self.name}')
                continue
            if not good[i]:
                part = rest[i] / max(whole[i], 1e-12)
                yield Finding(
                    Severity.REFUSED if part > _WRONG else Severity.CARE, i,
                    f'{part:.0%} of P, {rest[i]:.3g} N*m RMS, are not predicted in {self.name}',
                    'record a motion like that one too, and give both bags')
            if most is not None and peak[i] > most:
                yield Finding(
                    Severity.REFUSED, i, f'|P| reaches {peak[i]:.3g} N*m in {self.name}, beyond '
                    f'ka = {most:.3g} N*m', 'record a motion like that one too')

    def verdicts(self, joints: Sequence[str], ka: Sequence[float]) -> list[tuple[bool, str]]:
        """Return for each joint whether prediction and ka hold, and why."""
        whole, rest = self.run.misfit()
        good, peak = self.run.good(), self.run.peak
        moved = np.isfinite(self.run.predicted).sum(axis=0) > 0
        found = []
        for i, name in enumerate(joints):
            if not moved[i]:
                found.append((False, f'{name}: hardly moves in this run'))
                continue
            held = peak[i] <= ka[i]
            found.append((bool(good[i] and held), (
                f'{name}: {rest[i]:.3g} N*m RMS of {whole[i]:.3g} N*m of friction and errors of '
                f'the model are not predicted ({rest[i] / max(whole[i], 1e-12):.2%}); |P| reaches '
                f'{peak[i]:.3g} N*m, ' + ('within' if held else 'beyond')
                + f' ka = {ka[i]:.3g} N*m')))
        return found


def validate(found: Identification, recording: Recording, model: Model) -> Validation:
    """
    Return how another run is predicted.

    Parameters
    ----------
    found : Identification
        Of other recordings.
    recording : Recording
        Checked.
    model : Model
        As `identify` has it.

    Raises
    ------
    CtcError
        If the run has other joints, another period, or no torque of the same source.

    """
    if recording.joints != found.joints:
        raise CtcError(f'{recording.name}: joints {list(recording.joints)}; those identified: '
                       f'{list(found.joints)}')
    period = found.clock.period
    if abs(recording.period - period) > 0.02 * period:
        raise CtcError(f'{recording.name}: a period of {recording.period:.4g} s; that of the '
                       f'identified run: {period:.4g} s')
    parts = [part for part in stretches(recording, period)
             if len(part.q) * period > 1.0 and has(part, found.timing.source) is not None]
    if not parts:
        raise CtcError(f'{recording.name}: no second without a gap that has a torque of the '
                       f'source {found.timing.source}')
    data, base = found.windows(parts, model)
    return Validation(recording.name, perturbation(found, data), base + data.residual, base)
