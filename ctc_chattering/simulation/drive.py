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
The drives between the torque that is sent and the one that acts.

A torque may come late, is in transit for some samples, is quantised and saturated: that is the
command c, held over a period. The torque τ of a drive follows it, with the lag T and the rate
limit R::

    dτ/dt = (c - τ) / T, within ±R                                                        (DR1)

It rises at the rate R until |c - τ| = R T, then exponentially; without a lag it rises to c.
Both parts have a closed form, so that no integrator is needed and T may be shorter than its step.
"""

from __future__ import annotations

from math import copysign, exp
from typing import NamedTuple

from ctc_chattering.numerics.compilable import along, each, exchanged, function, record, uniform
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.simulation.sensor import quantised


@record
class Drives(NamedTuple):
    """The drives of all joints; vectors of shape (n,), truth values 1.0 and 0.0."""

    #: h [s]; samples in transit; probability of a late one.
    period: float
    delay: int
    late_samples: float
    #: Step of the command, 0 for none, and its largest, inf for none [N·m].
    resolution: Vector
    saturation: Vector
    #: T [s] and R [N·m/s].
    lag: Vector
    rate: Vector
    #: Whether any joint has a resolution, a limit, and whether none has a lag or a rate limit.
    coarse: float
    limited: float
    ideal: float


@record
class Driven(NamedTuple):
    """What the drives do over a period; vectors of shape (n,) [N·m]."""

    #: Torque that was sent for it.
    received: Vector
    #: c.
    commanded: Vector
    #: c - τ at its start.
    gap: Vector
    #: τ at its end.
    torque: Vector


@function
def response(gap: float, lag: float, rate: float, s: float) -> tuple[float, float]:
    """
    Return τ - c [N·m] of (DR1) at `s`, and its integral from 0 to `s` [N·m·s].

    Parameters
    ----------
    gap : float
        c - τ at 0 [N·m].
    lag, rate : float
        T [s], 0 for none; R [N·m/s], inf for none.
    s : float
        Time since the command came [s].

    """
    s = max(s, 0.0)  # Rounding apart, it is never less.
    ramp, slope = max(abs(gap) / rate - lag, 0.0), copysign(rate, gap)
    if s < ramp:
        return slope * s - gap, s * (0.5 * slope * s - gap)
    rest, area = -gap, 0.0
    if ramp:
        rest, area = slope * ramp - gap, ramp * (0.5 * slope * ramp - gap)
    now = rest * exp((ramp - s) / lag) if lag else 0.0
    return now, area + lag * (rest - now)


@function
def plus_error(x: float, gap: float, lag: float, rate: float, s: float) -> float:
    """Return x + τ - c at `s` [s] after the command."""
    return x + response(gap, lag, rate, s)[0]


@function
def plus_mean_error(x: float, gap: float, lag: float, rate: float, s: float) -> float:
    """Return x plus the mean of τ - c until `s` [s] after the command."""
    return x + response(gap, lag, rate, s)[1] / s


@function
def plus_middle_error(x: float, gap: float, lag: float, rate: float, s: float, half: float
                      ) -> float:
    """
    Return x + τ - c for the middle of a step from `s` - `half` to `s` + `half` [s].

    With it, Simpson's rule has the exact integral over the step, whatever the lag.
    """
    start, before = response(gap, lag, rate, s - half)
    end, after = response(gap, lag, rate, s + half)
    return x + (0.75 * (after - before) / half - 0.25 * (start + end))


@function
def within(x: float, limit: float) -> float:
    """Return x within ±`limit`."""
    return min(max(x, -limit), limit)


@function
def driven(drives: Drives, before: Driven, transit: list[Vector], k: int, tau: Vector,
           chance: float) -> Driven:
    """
    Return what the drives do over the period after sample `k`.

    Parameters
    ----------
    drives, before : Drives, Driven
        Parameters, and the period before.
    transit : sequence of `delay` vectors
        Torques in transit; `tau` takes the place of the one that arrives.
    k : int
        Sample.
    tau : sequence of float, shape (n,)
        Torque sent at it [N·m].
    chance : float
        Number in [0, 1): below `late_samples`, this torque is late.

    """
    command = tau
    if chance < drives.late_samples:
        command = before.received
    if drives.delay > 0:
        command = exchanged(transit, k % drives.delay, command)
    if drives.coarse:
        command = each(quantised, command, drives.resolution)
    if drives.limited:
        command = each(within, command, drives.saturation)
    if drives.ideal:
        return Driven(tau, command, before.gap, command)
    gap = along(command, -1.0, before.torque)
    return Driven(tau, command, gap, each(
        plus_error, command, gap, drives.lag, drives.rate, uniform(drives.period)))
