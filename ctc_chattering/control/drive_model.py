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
The drives as the controller knows them: a lag of first order with a limited rate.

While a command c is held, the torque τ of a drive with the lag T and the rate limit R follows::

    dτ/dt = (c - τ) / T, within ±R                                                        (DM1)

It moves at the rate R until |c - τ| = R T, then exponentially. What a period h of that does to a
mass has a closed form; with x = τ - c, s the time since the command, r the end of the first part::

    x(h),     1/h ∫ x ds,     2/h² ∫ (h - s) x ds

the last two being the means that the velocity and the position at the end of the period see.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.numerics.compilable import every, record
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import LARGEST
import numpy as np

#: In the place of a lag of 0 [s]: shorter than any period.
_NO_LAG = 1e-12


@record
class Response(NamedTuple):
    """Torque of the drives over a period, each of shape (n,) [N·m]."""

    #: At the end.
    end: Array
    #: Mean, which changes the velocity.
    mean: Array
    #: Mean weighted by the time that is left, which changes the position.
    weighted: Array


@record
class DriveModel(NamedTuple):
    """Drives with a known lag and rate limit, as `drive_model` makes them; arrays (n,)."""

    #: h [s].
    period: float
    #: T, at least 1e-12 s; R [N·m/s], inf for none; the same with 0 for none; exp(-h / T).
    lag: Array
    rate: Array
    slope: Array
    decay: Array
    #: R (T + h): a command farther than this from the torque moves it no faster [N·m].
    reach: Array
    #: R T: up to this difference the torque is within the rate [N·m]; and what is left of it at
    #: the end, in the mean and in the weighted mean of the period, `decay` being the first.
    linear: Array
    mean: Array
    weighted: Array
    #: Whether there is neither lag nor limit, 1.0 or 0.0.
    prompt: float

    def response(self, torque: Array, command: Array) -> Response:
        """Return what `torque` does over a period in which `command` is held, both (n,) [N·m]."""
        if self.prompt != 0.0:
            return Response(command, command, command)
        h, T, x0 = self.period, self.lag, torque - command
        if every(np.abs(x0) <= self.linear):
            return Response(command + self.decay * x0, command + self.mean * x0,
                            command + self.weighted * x0)
        r = np.minimum(np.maximum(np.abs(x0) / self.rate - T, 0.0), h)
        slope, rest = -np.sign(x0) * self.slope, h - r
        x1 = x0 + slope * r
        decay = np.exp(-rest / T)
        ramp, tail = r * (x0 + 0.5 * slope * r), T * x1 * (1.0 - decay)
        weighted = h * ramp - r * r * (0.5 * x0 + slope * r / 3.0) + T * (x1 * rest - tail)
        return Response(command + x1 * decay, command + (ramp + tail) / h,
                        command + 2.0 / (h * h) * weighted)

    def command(self, now: Array, after: Array) -> Array:
        """
        Return the command by which the drives give a wanted torque, shape (n,) [N·m].

        Where the torque of a drive with a lag differs from what is wanted, that decays with T::

            c = (after - E now) / (1 - E),     E = exp(-h / T)

        which for small h is wanted + T d(wanted)/dt. A drive without a lag gets `now`.

        Parameters
        ----------
        now, after : array, shape (n,)
            Wanted at the start and at the end of the period [N·m].

        """
        E = self.decay
        return np.where(self.lag > _NO_LAG, (after - E * now) / (1.0 - E), now)


def drive_model(lag: Array, rate: Array, period: float) -> DriveModel:
    """
    Return drives.

    Parameters
    ----------
    lag : array, shape (n,)
        T [s]; 0 for none.
    rate : array, shape (n,)
        R [N·m/s]; inf for none.
    period : float
        h [s].

    """
    floor, decay = np.maximum(lag, _NO_LAG), np.exp(-period / np.maximum(lag, _NO_LAG))
    mean = floor * (1.0 - decay) / period
    return DriveModel(period, floor, rate, np.where(rate < np.inf, rate, 0.0), decay,
                      np.minimum(rate * (lag + period), LARGEST), rate * floor, mean,
                      2.0 * floor / period * (1.0 - mean),
                      float(not lag.any() and not np.isfinite(rate).any()))
