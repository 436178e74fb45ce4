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

A torque may come late, is in transit for some samples, is quantised and saturated. That is the
command c, held over a period. The torque of a drive follows it by (DM1) of
`dynamics/drive_response.py`.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import function, record, some
from ctc_chattering.dynamics.drive_response import response
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.sensor import quantised
import numpy as np


@record
class Drives(NamedTuple):
    """Drives, with parameters of `PlantConfig` by name, shape (n,)."""

    #: h [s].
    period: float
    #: Samples in transit.
    input_delay: int
    #: Probability of a late torque.
    late_samples: float
    #: Step of the command, 0 for none [N·m].
    torque_resolution: Array
    #: Largest command, inf for none [N·m].
    torque_saturation: Array
    #: T [s] and R [N·m/s].
    actuator_lag: Array
    torque_rate_limit: Array
    #: True if no joint has a lag or a rate limit.
    ideal: bool


@record
class Driven(NamedTuple):
    """Torques of the drives over a period, shape (n,) [N·m]."""

    #: Torque that was sent for it.
    received: Array
    #: c.
    commanded: Array
    #: c - τ at its start.
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
        Parameters.
    previous : Driven
        The period before.
    transit : array, shape (delay, n)
        Torques in transit. `tau` takes the place of the one that arrives.
    k : int
        Sample.
    tau : array, shape (n,)
        Torque sent at it [N·m].
    chance : float
        Number in [0, 1): below `late_samples`, this torque is late.

    """
    command = tau
    if chance < drives.late_samples:
        command = previous.received
    if drives.input_delay > 0:
        i = k % drives.input_delay
        arriving = 1.0 * transit[i]
        transit[i] = command
        command = arriving
    if some(drives.torque_resolution):
        command = quantised(command, drives.torque_resolution)
    command = np.minimum(np.maximum(command, -drives.torque_saturation), drives.torque_saturation)
    if drives.ideal:
        return Driven(tau, command, previous.gap, command)
    gap = command - previous.torque
    error = response(gap, drives.actuator_lag, drives.torque_rate_limit, drives.period)[0]
    return Driven(tau, command, gap, command + error)
