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
Simulate the drives, from the torque that is sent to the one that acts.

A torque may come late. It is delayed by `input_delay` samples, quantised and saturated. This is
the command c, held over a period. The drive's torque τ follows it with a lag and a rate limit, by
(DM1) of `dynamics/drive_response.py`. `plant_step.advance_plant` calls it at every sample.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import function, record, some
from ctc_chattering.dynamics.drive_response import response
from ctc_chattering.numerics.box_qp import clip
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.sensor import quantised


@record
class Drives(NamedTuple):
    """Drives of n joints, in arrays of shape (n,), with names of `PlantConfig`."""

    #: Control period h [s].
    period: float
    #: Delay of the command [samples].
    input_delay: int
    #: Probability of a late torque.
    late_samples: float
    #: Step of the command, 0 for none [N·m].
    torque_resolution: Array
    #: Largest command, inf for none [N·m].
    torque_saturation: Array
    #: Time constant T [s].
    actuator_lag: Array
    #: Rate limit R, inf for none [N·m/s].
    torque_rate_limit: Array
    #: True if no joint has a lag or a rate limit.
    ideal: bool


@record
class Driven(NamedTuple):
    """Torques of the drives over a period, shape (n,) [N·m]."""

    #: Torque sent for it, also if it was late.
    sent: Array
    #: Command c.
    commanded: Array
    #: c - τ at its start, 0 if all drives are ideal.
    gap: Array
    #: τ at its end.
    torque: Array


@function
def advance_drives(drives: Drives, previous: Driven, transit: Array, k: int, tau: Array,
                   chance: float) -> Driven:
    """
    Return the torques over the period after sample `k`.

    Parameters
    ----------
    drives : Drives
        Drives with their delay.
    previous : Driven
        Torques of the period before.
    transit : array, shape (delay, n)
        Torques in transit [N·m]. The one that arrives is replaced in place: by `tau`, or by the
        torque sent before if `tau` is late.
    k : int
        Index of the sample.
    tau : array, shape (n,)
        Torque sent at the sample [N·m].
    chance : float
        Uniform random number in [0, 1). The torque is late if it is below `late_samples`.

    """
    command = tau
    if chance < drives.late_samples:
        command = previous.sent
    if drives.input_delay > 0:
        i = k % drives.input_delay
        arriving = 1.0 * transit[i]  # A copy.
        transit[i] = command
        command = arriving
    if some(drives.torque_resolution):
        command = quantised(command, drives.torque_resolution)
    command = clip(command, -drives.torque_saturation, drives.torque_saturation)
    if drives.ideal:
        return Driven(tau, command, previous.gap, command)
    gap = command - previous.torque
    error = response(gap, drives.actuator_lag, drives.torque_rate_limit, drives.period)[0]
    return Driven(tau, command, gap, command + error)
