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
from ctc_chattering.identification.regression.torque import COMMAND, EFFORT
from ctc_chattering.identification.regression.weak_form import position_noise, TestFunction
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.stats import median_abs_deviation  # type: ignore[import-untyped]

#: Time on each side of the centre of a window [s].
_HALF = 0.015
#: Poses at which the inertia is looked up.
_POSES = 20


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
    noise : ndarray, shape (n,)
        Deviation of P that noise of the sensors makes [N·m]. Vibration is none.

    """

    perturbation: Array
    nearest: Indices
    noise: Array

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
        return cls(found, np.concatenate(nearest),
                   np.max([_noise(part, model, phi, timing.source) for part in parts], axis=0))


def _noise(part: Stretch, model: Model, phi: TestFunction, source: str) -> Array:
    """Return the deviation of P that noise of the sensors makes, shape (n,) [N·m]."""
    # As with velocities by differences: of white noise, h φ' twice differentiated.
    weights = np.convolve(phi.slope, (0.5, 0.0, -0.5)) / phi.period
    one = position_noise(part.q, phi.period) * float(np.linalg.norm(weights))
    still = np.zeros(part.q.shape[1])
    some = part.q[::max(1, len(part.q) // _POSES)]
    found: Array = np.max([np.square(model.evaluate(q, still)[0]) @ np.square(one)
                           for q in some], axis=0)
    if source == EFFORT and part.effort is not None:
        change = np.diff(np.nan_to_num(part.effort), 2, axis=0)
        torque = median_abs_deviation(change, axis=0, scale='normal') / np.sqrt(6.0)
        found = found + np.square(np.linalg.norm(phi.at) * torque)
    return np.asarray(np.sqrt(found))
