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

"""The simulated robot as machine code: its parameters, state and random numbers as records."""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import function
from ctc_chattering.compiled.machine_code import Call, Code
from ctc_chattering.compiled.records import load, packed, rows, store
from ctc_chattering.dynamics.arm import Arm
from ctc_chattering.dynamics.compiled_model import CompiledArm, CompiledModel
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.simulation.motion import Mechanism, Rigid
from ctc_chattering.simulation.plant_step import (
    PlantInput,
    PlantParameters,
    PlantState,
)
from ctc_chattering.simulation.plant_step import (
    stepped as plant_step,
)
import numpy as np


class Shown(NamedTuple):
    """What is known of a sample without its whole state; lists of n floats."""

    #: Position [rad] and velocity [rad/s], true and as measured.
    q: Vector
    dq: Vector
    measured: tuple[Vector, Vector]
    #: Torque of the drives [N·m].
    torque: Vector
    #: As of `PlantState`.
    offset: float
    lost_in_a_row: int


class CompiledPlant(NamedTuple):
    """A plant as compiled code takes it."""

    #: As of `CompiledModel`; own friction, `PlantParameters`, `PlantState`: NumPy records.
    call: Any
    body: Any
    own: Any
    parameters: Any
    state: Any
    #: Torques in transit, shape (delay, n), at least one row [N·m].
    transit: Array


def no_inputs(n: int, count: int) -> Any:
    """Return `count` records of `PlantInput` with zeros."""
    zero = np.zeros(n)
    return np.zeros(count, packed(PlantInput(zero, 0.0, 0.0, 0.0, zero, zero)).dtype)


class CompiledPlantStep:
    """
    The step of a plant between two changes of its parameters.

    Parameters
    ----------
    arm : Arm
        Model.
    own
        Own friction.
    parameters, state : PlantParameters, PlantState
        As they are now.
    transit : array, shape (delay, n)
        Torques in transit [N·m], at least one row.

    Attributes
    ----------
    codes : tuple of Code
        What must be compiled, for all plants with this friction and number of joints.
    records : CompiledPlant
        Parameters and state.
    given : record
        `PlantInput` of the next sample.
    call : Call
        Goes on by a sample; only if there is machine code.

    """

    call: Call

    def __init__(self, arm: Arm, own: Any, parameters: PlantParameters, state: PlantState,
                 transit: Array) -> None:
        n = len(state.motion.q)
        self._arm, self.given = CompiledArm(arm, n), no_inputs(n, 1)[0]
        self.records = CompiledPlant(
            *self._arm.model, packed(own), packed(parameters), packed(state),
            transit.copy())
        arguments = (self.records, self.given)
        code = Code(stepped, arguments, f'plant-{n}')
        self.codes = *self._arm.codes, code
        if self.compiled:
            self.call = Call(code, arguments)
        # Views that take a microsecond to make.
        self._tau, self._noise = self.given['tau'], [
            self.given[name] for name in ('position_noise', 'velocity_noise')]
        self._rows = [self.records.state[part][name] for part, name in (
            ('motion', 'q'), ('motion', 'dq'), ('shown', 'q'), ('shown', 'dq'),
            ('driven', 'torque'))]

    @property
    def compiled(self) -> bool:
        """Whether there is machine code."""
        return all(code.compiled for code in self.codes)

    @property
    def state(self) -> PlantState:
        """Return the present state."""
        state: PlantState = load(self.records.state)
        return state

    @property
    def transit(self) -> Array:
        """Return the torques in transit, shape (delay, n) [N·m]."""
        return self.records.transit

    def go_on(self, given: PlantInput) -> None:
        """Go on by a sample."""
        record = self.given
        self._tau[:] = given.tau
        record['late'], record['loss'], record['jitter'] = given.late, given.loss, given.jitter
        for row, x in zip(self._noise, (given.position_noise, given.velocity_noise)):
            row[:] = x
        self.call()

    def shown(self) -> Shown:
        """Return what is known of the present sample."""
        q, dq, measured_q, measured_dq, torque = [row.tolist() for row in self._rows]
        s = self.records.state
        return Shown(q, dq, (measured_q, measured_dq), torque, float(s['offset']),
                     int(s['lost_in_a_row']))


@function
def stepped(p: CompiledPlant, given: Any) -> int:
    """Go on by one control period, as a function that is called by its address."""
    advance(p, given)
    return 0


@function
def advance(p: CompiledPlant, given: Any) -> None:
    """Go on by one control period."""
    parameters = load(p.parameters)
    state = load(p.state)
    mechanism = Mechanism(
        CompiledModel(p.call, p.body), load(p.own), parameters.mechanics, Rigid(1.0))
    store(p.state, plant_step(
        mechanism, parameters, state, rows(p.transit, state.motion.q), load(given)))
