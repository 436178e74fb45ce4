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
The simulated robot from one sample to the next.

`advance_plant` says what happens: drives, motion, sensors, lost samples. `plant.py` calls it as
plain Python, or a `CompiledPlantStep` that runs it as machine code. Everything random comes in
with `PlantInput`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import function, record
from ctc_chattering.compiled.machine_code import Program
from ctc_chattering.compiled.records import load, packed, rows, store, views
from ctc_chattering.dynamics.compiled_model import ArmNumbers, CompiledArm, CompiledModel
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.coordinates import RigidJoints
from ctc_chattering.simulation.drive import advance_drives, Driven
from ctc_chattering.simulation.motion import load_period, Mechanics, Mechanism, Motion
from ctc_chattering.simulation.sensor import Encoders, Measured, measured, off_the_grid
import numpy as np

#: Most consecutive lost samples: the controller takes a gap of three periods for no outage.
_MAX_LOST = 2


@record
class PlantParameters(NamedTuple):
    """Parameters of the robot, from a `PlantConfig`."""

    mechanics: Mechanics
    encoders: Encoders
    #: Probability that a measurement is lost.
    sample_loss: float
    #: Largest time from a sample to its measurement [s].
    sample_jitter: float
    #: Last sample of the run.
    last: int


@record
class PlantState(NamedTuple):
    """State of the robot at sample `k`."""

    k: int
    driven: Driven
    motion: Motion
    shown: Measured
    #: Time from the sample to its measurement [s].
    offset: float
    #: Consecutive measurements that are lost, up to this one, 0 if it is sent.
    lost_in_a_row: int


@record
class PlantInput(NamedTuple):
    """Torque and random numbers for a sample."""

    #: Torque, shape (n,) [N·m].
    tau: Array
    #: Numbers in [0, 1), each for the parameter of its name: is this torque late, is the next
    #: measurement lost, and when is it made.
    late_samples: float
    sample_loss: float
    sample_jitter: float
    #: Standard normal numbers, shape (n,), for the noise of the next measurement.
    position_noise: Array
    velocity_noise: Array


@function
def advance_plant(mechanism: Mechanism, p: PlantParameters, state: PlantState, transit: Any,
                  received: PlantInput) -> PlantState:
    """
    Return the state a sample later.

    Parameters
    ----------
    mechanism : Mechanism
        Model with what acts on it.
    p : PlantParameters
        Parameters in force.
    state : PlantState
        State at the sample.
    transit : array, shape (delay, n)
        Torques in transit [N·m]. `advance_drives` replaces the one that arrives.
    received : PlantInput
        Torque and random numbers.

    """
    k = state.k
    joints = mechanism.joints
    h = p.encoders.period
    drives = advance_drives(
        p.mechanics.drives, state.driven, transit, k, received.tau, received.late_samples)
    load = load_period(mechanism, drives.commanded, drives.gap, k)
    motion = mechanism.integrate(load, state.motion)
    q = joints.seen(motion.q)
    dq = joints.seen(motion.dq)
    offset = 0.0
    if p.sample_jitter > 0.0:
        shift = p.sample_jitter * (2.0 * received.sample_jitter - 1.0)
        offset = round(1e9 * shift) / 1e9  # Whole nanoseconds.
        q, dq = off_the_grid(q, dq, joints.seen(state.motion.dq), offset, h)
    shown = measured(p.encoders, state.shown, q, dq, h + offset - state.offset,
                     received.position_noise, received.velocity_noise)
    may_be_lost = state.lost_in_a_row < _MAX_LOST and k + 1 != p.last  # The last one never is.
    lost = received.sample_loss < p.sample_loss and may_be_lost
    return PlantState(
        k + 1, drives, motion, shown, offset, state.lost_in_a_row + 1 if lost else 0)


class CompiledPlant(NamedTuple):
    """A plant in the memory of machine code."""

    model: CompiledModel
    #: NumPy records: friction of the user, `PlantParameters` and `PlantState`.
    own_friction: Any
    parameters: Any
    state: Any
    #: Torques in transit, shape (delay, n), at least one row [N·m].
    transit: Array


def no_inputs(n: int, count: int) -> Any:
    """Return `count` records of `PlantInput` with zeros."""
    zero = np.zeros(n)
    return np.zeros(count, packed(PlantInput(zero, 0.0, 0.0, 0.0, zero, zero)).dtype)


class CompiledPlantStep(Program):
    """
    The step of a plant as machine code.

    Another one takes its place when parameters change.

    Parameters
    ----------
    arm : ArmNumbers
        Model.
    own_friction : record
        Friction of `friction_model`.
    parameters, state : PlantParameters, PlantState
        Those at present.
    transit : array, shape (delay, n)
        Torques in transit [N·m], at least one row.

    Attributes
    ----------
    arm : CompiledArm
        The model.
    records : CompiledPlant
        Parameters and state.
    state : PlantState
        Present state, views of the records.
    transit : array, shape (delay, n)
        Torques in transit [N·m].
    received : record
        `PlantInput` of the next sample. At first it has no noise and no faults.

    """

    def __init__(self, arm: ArmNumbers, own_friction: Any, parameters: PlantParameters,
                 state: PlantState, transit: Array) -> None:
        n = len(state.motion.q)
        self.arm = CompiledArm(arm, n)
        self.received = no_inputs(n, 1)[0]
        self.set_input(PlantInput(np.zeros(n), 1.0, 1.0, 1.0, np.zeros(n), np.zeros(n)))
        self._torque = self.received['tau']
        self.transit = transit.copy()
        self.records = CompiledPlant(self.arm.model, packed(own_friction), packed(parameters),
                                     packed(state), self.transit)
        self.state: PlantState = views(self.records.state)
        super().__init__(
            self.arm.codes, advance_records, (self.records, self.received), f'plant-{n}')

    def set_input(self, received: PlantInput) -> None:
        """Use noise and faults of an input from now on."""
        store(self.received, received)

    def advance(self, torque: Array) -> None:
        """Go on by a sample with a torque, shape (n,) [N·m]."""
        self._torque[:] = torque
        self.call()


@function
def advance_records(p: CompiledPlant, received: Any) -> int:
    """Apply `advance_plant` to records in memory."""
    parameters = load(p.parameters)
    state = load(p.state)
    mechanism = Mechanism(
        p.model, load(p.own_friction), parameters.mechanics, RigidJoints(True))
    transit = rows(p.transit, state.motion.q)
    store(p.state, advance_plant(mechanism, parameters, state, transit, load(received)))
    return 0
