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

"""The simulated robot from sample to sample: drives, motion, sensors, and what is lost."""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import function, record
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.drive import Driven, driven, Drives
from ctc_chattering.simulation.motion import acting, Mechanics, Mechanism, Motion
from ctc_chattering.simulation.sensor import Encoders, Measured, measured, off_the_grid

#: Most samples in a row that are lost: the controller takes a gap of three periods for no outage.
_MOST_LOST = 2


@record
class PlantParameters(NamedTuple):
    """Parameters of a robot with rigid joints."""

    mechanics: Mechanics
    drives: Drives
    encoders: Encoders
    #: Probability that a measurement is lost, how far it is off the grid at the most [s], and the
    #: last sample of the run.
    sample_loss: float
    sample_jitter: float
    last: int


@record
class PlantState(NamedTuple):
    """State of a robot at sample `k`."""

    k: int
    driven: Driven
    motion: Motion
    shown: Measured
    #: How long after the sample that was measured [s].
    offset: float
    #: Measurements that are lost with this one; 0 if it is sent.
    lost_in_a_row: int


@record
class PlantInput(NamedTuple):
    """What a robot receives at a sample; vectors of shape (n,)."""

    #: Torque [N·m].
    tau: Array
    #: Numbers in [0, 1) that decide whether it is late, the next measurement lost, and when that
    #: is made.
    late: float
    loss: float
    jitter: float
    #: Noise of the next measurement, of the deviation 1.
    position_noise: Array
    velocity_noise: Array


@function
def lost_in_a_row(probability: float, chance: float, before: int, k: int, last: int) -> int:
    """
    Return how many measurements have been lost in a row with that of sample `k`; 0 if it is sent.

    Parameters
    ----------
    probability : float
        Of losing one.
    chance : float
        Number in [0, 1): below the probability, this one is lost.
    before, k, last : int
        What was returned for the sample before; the sample; the last one, which is sent.

    """
    return before + 1 if chance < probability and before < _MOST_LOST and k != last else 0


@function
def offset_of(jitter: float, chance: float) -> float:
    """Return whole nanoseconds within ±`jitter` [s], for a number in [0, 1)."""
    return round(1e9 * jitter * (2.0 * chance - 1.0)) / 1e9


@function
def stepped(mechanism: Mechanism, p: PlantParameters, state: PlantState, transit: Any,
            given: PlantInput) -> PlantState:
    """Return the state a sample later; `transit` as of `driven`."""
    k, joints, drives = state.k, mechanism.joints, driven(
        p.drives, state.driven, transit, state.k, given.tau, given.late)
    motion = mechanism.integrate(
        acting(p.mechanics, joints.on_motors(drives.commanded), joints.on_motors(drives.gap), k),
        state.motion)
    q, dq, offset, h = joints.seen(motion.q), joints.seen(motion.dq), 0.0, p.encoders.period
    if p.sample_jitter > 0.0:
        offset = offset_of(p.sample_jitter, given.jitter)
        q, dq = off_the_grid(q, dq, joints.seen(state.motion.dq), offset, h)
    shown = measured(p.encoders, state.shown, q, dq, h + offset - state.offset,
                     given.position_noise, given.velocity_noise)
    return PlantState(k + 1, drives, motion, shown, offset, lost_in_a_row(
        p.sample_loss, given.loss, state.lost_in_a_row, k + 1, p.last))
