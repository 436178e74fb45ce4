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
Response of drives with a lag and a limited rate.

The simulated plant, the observers of the laws and the identification compute drives with this
module. They are between the torque that is commanded and the one that acts. A command c is held
over a period h. The torque τ of a drive follows it, with the lag T and the rate limit R::

    dτ/dt = (c - τ) / T, within ±R                                                        (DM1)

It moves at the rate R until |c - τ| = R T, then exponentially. Without a lag it rises to c. Both
phases have a closed form. So no integrator is needed, and T may be shorter than its step.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import every, function, record
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import LARGEST
import numpy as np

#: Lag in the place of 0 in quotients [s].
_TINY_LAG_S = 1e-300
#: Rate in the place of none in products with a time of 0 [N·m/s].
_UNLIMITED_RATE = 1e300
#: Lag in the place of 0 in `DriveModel`, shorter than any period [s].
_NO_LAG_S = 1e-15


@record
class DrivePhases(NamedTuple):
    """
    The two phases of (DM1) within a time s, each of shape (n,).

    Attributes
    ----------
    ramp : ndarray
        Time r at the limited rate [s].
    slope : ndarray
        Rate during this time, with its sign [N·m/s].
    error : ndarray
        τ - c at its end [N·m].
    decay : ndarray
        Factor on this error in the remaining time s - r.

    """

    ramp: Array
    slope: Array
    error: Array
    decay: Array


@function
def drive_phases(gap: Array, lag: Array, rate: Array, s: float) -> DrivePhases:
    """
    Return the phases until `s`.

    Parameters
    ----------
    gap : array, shape (n,)
        c - τ at 0 [N·m].
    lag, rate : array, shape (n,)
        T [s], 0 for none; R [N·m/s], inf for none.
    s : float
        Time since the command came [s].

    """
    duration = np.abs(gap) / rate - lag
    limited = np.maximum(duration, 0.0)
    slope = np.sign(gap) * np.minimum(rate, _UNLIMITED_RATE)
    ramp = np.minimum(limited, s)
    if lag.min() > 0.0:
        decay = np.exp((ramp - s) / lag)
    else:
        decay = np.where(lag > 0.0, np.exp((ramp - s) / np.maximum(lag, _TINY_LAG_S)),
                         np.where(limited > s, 1.0, 0.0))
    return DrivePhases(ramp, slope, slope * ramp - gap, decay)


@function
def response(gap: Array, lag: Array, rate: Array, s: float) -> tuple[Array, Array]:
    """
    Return τ - c [N·m] at `s`, and its integral until then [N·m·s].

    Parameters are those of `drive_phases`.
    """
    phases = drive_phases(gap, lag, rate, max(s, 0.0))  # Rounding apart, s is never less.
    ramp = phases.ramp
    error = phases.error
    end = error * phases.decay
    area = ramp * (0.5 * phases.slope * ramp - gap)
    tail = lag * (error - end)
    return end, area + tail


@function
def middle_error(
    gap: Array, lag: Array, rate: Array, s: float, half: float
) -> Array:
    """
    Return τ - c for the middle of a step, shape (n,) [N·m].

    The step is from `s` - `half` to `s` + `half` [s]. With it, Simpson's rule has the exact
    integral over the step, whatever the lag.
    """
    start, area_before = response(gap, lag, rate, s - half)
    end, area_after = response(gap, lag, rate, s + half)
    mean = 0.75 * (area_after - area_before) / half
    return mean - 0.25 * (start + end)


@record
class DriveTorque(NamedTuple):
    """
    Torque of drives over a period, each of shape (n,) [N·m].

    Attributes
    ----------
    end : ndarray
        At the end.
    mean : ndarray
        Mean, which changes the velocity.
    weighted : ndarray
        Mean weighted by the time that is left, which changes the position.

    """

    end: Array
    mean: Array
    weighted: Array


@record
class DriveModel(NamedTuple):
    """
    Drives over one fixed period, each of shape (n,).

    Attributes
    ----------
    period : float
        h [s].
    lag, rate : ndarray
        T, at least `_NO_LAG_S` [s]; R, inf for none [N·m/s].
    decay : ndarray
        exp(-h / T).
    reach : ndarray
        R (T + h): a command farther than this from the torque moves it no faster [N·m].
    linear_gap : ndarray
        R T: up to this gap the torque is within the rate [N·m].
    mean, weighted : ndarray
        Fraction of a linear gap that is left in the means of `DriveTorque`.

    """

    period: float
    lag: Array
    rate: Array
    decay: Array
    reach: Array
    linear_gap: Array
    mean: Array
    weighted: Array

    def follow(self, torque: Array, command: Array) -> DriveTorque:
        """Return the torque that follows a held `command`, each of shape (n,) [N·m]."""
        h = self.period
        T = self.lag
        x0 = torque - command
        if every(np.abs(x0) <= self.linear_gap):
            return DriveTorque(command + self.decay * x0, command + self.mean * x0,
                               command + self.weighted * x0)
        phases = drive_phases(command - torque, T, self.rate, h)
        r = phases.ramp
        slope = phases.slope
        x1 = phases.error
        area = r * (x0 + 0.5 * slope * r)
        tail = T * x1 * (1.0 - phases.decay)
        ramp_moment = r * r * (0.5 * x0 + slope * r / 3.0)
        tail_moment = T * (x1 * (h - r) - tail)
        weighted = h * area - ramp_moment + tail_moment
        return DriveTorque(command + x1 * phases.decay, command + (area + tail) / h,
                           command + 2.0 / (h * h) * weighted)

    def command_for(self, now: Array, after: Array) -> Array:
        """
        Return the command with which the drives give a desired torque, shape (n,) [N·m].

        Where the torque of a drive with a lag differs from the desired one, that decays with T::

            c = (after - E now) / (1 - E),     E = exp(-h / T)

        For small h that is the desired torque plus T times its slope. A drive without a lag gets
        `now`.

        Parameters
        ----------
        now, after : array, shape (n,)
            Desired at the start and at the end of the period [N·m].

        """
        E = self.decay
        return np.where(self.lag > _NO_LAG_S, (after - E * now) / (1.0 - E), now)


def discretize_drives(lag: Array, rate: Array, period: float) -> DriveModel:
    """
    Return the model of drives over a period.

    Parameters
    ----------
    lag, rate : array, shape (n,)
        T [s], 0 for none; R [N·m/s], inf for none.
    period : float
        h [s].

    """
    T = np.maximum(lag, _NO_LAG_S)
    decay = np.exp(-period / T)
    mean = T * (1.0 - decay) / period
    return DriveModel(
        period=period, lag=T, rate=rate, decay=decay,
        reach=np.minimum(rate * (lag + period), LARGEST), linear_gap=rate * T, mean=mean,
        weighted=2.0 * T / period * (1.0 - mean))
