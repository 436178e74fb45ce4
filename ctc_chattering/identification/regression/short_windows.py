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

"""P over windows so short that the impacts of backlash and of elastic joints show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ctc_chattering.analysis.recording import Stretch
from ctc_chattering.analysis.time_stamps import Indices
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.regression.delay_and_lag import Profile, Timing
from ctc_chattering.identification.regression.rows import Rows
from ctc_chattering.identification.regression.torque import COMMAND
from ctc_chattering.identification.regression.weak_form import TestFunction
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.stats import median_abs_deviation  # type: ignore[import-untyped]

#: Time on each side of the centre of a window [s].
_HALF = 0.015
#: Windows that share no samples are so many apart.
_APART = 5


class ShortWindows(NamedTuple):
    """
    P in short windows; K of them, n joints.

    Attributes
    ----------
    perturbation : ndarray, shape (K, n)
        Torque less the model's, whether joints slide or not [N·m]. Where the delay is not sure,
        the larger one of that with and without it.
    nearest : ndarray of int, shape (K,)
        The window of the regression that is nearest.

    """

    perturbation: Array
    nearest: Indices

    @classmethod
    def of(cls, parts: Sequence[Stretch], rows: Sequence[Rows], model: Model, timing: Timing
           ) -> ShortWindows:
        """Return those of stretches, with the rows of the regression there."""
        period = parts[0].period
        phi = TestFunction(period, period * sum(len(x.q) for x in parts), _HALF)
        short = [Rows.of(part, model, phi) for part in parts]
        profile = Profile(parts, short, timing.source, phi)
        found = profile.windows(timing).residual
        if timing.source == COMMAND and timing.unsure:
            at_once = profile.data.residual
            found = np.where(np.abs(at_once) > np.abs(found), at_once, found)
        nearest, before = [], 0
        for row, other in zip(rows, short):
            middle = 0.5 * (row.centres[1:] + row.centres[:-1])
            nearest.append(before + np.searchsorted(middle, other.centres))
            before += len(row.t)
        return cls(found, np.concatenate(nearest))

    @property
    def noise(self) -> Array:
        """Return the deviation of P that noise makes, shape (n,) [N·m]."""
        if len(self.perturbation) <= _APART:
            return np.zeros(self.perturbation.shape[1])
        change = self.perturbation[_APART:] - self.perturbation[:-_APART]
        found: Array = median_abs_deviation(change, axis=0, scale='normal') / np.sqrt(2.0)
        return found
