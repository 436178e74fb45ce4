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

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from ctc_chattering.dynamics.arm import Arm
from ctc_chattering.dynamics.compiled_model import CompiledArm, CompiledModel
from ctc_chattering.numerics.compilable import function
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.machine_code import Call, Code
from ctc_chattering.numerics.records import in_lists, load, packed, store
from ctc_chattering.simulation.motion import Mechanism
from ctc_chattering.simulation.plant_step import PlantInput, PlantParameters, PlantState
from ctc_chattering.simulation.plant_step import stepped as plant_step
import numpy as np


class CompiledPlant(NamedTuple):
    """A plant as compiled code takes it."""

    #: As of `CompiledModel`; own friction, `PlantParameters`, `PlantState`: NumPy records.
    call: Any
    body: Any
    own: Any
    parameters: Any
    state: Any
    #: Torques in transit, shape (delay, n) [N·m].
    transit: Array


def no_inputs(n: int, count: int) -> Any:
    """Return `count` records of `PlantInput` with zeros."""
    zero = [0.0] * n
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
    transit : sequence of (n,)
        Torques in transit [N·m].

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
    torque : array, shape (n,)
        Of the drives now [N·m].

    """

    call: Call

    def __init__(self, arm: Arm, own: Any, parameters: PlantParameters, state: PlantState,
                 transit: Sequence[Vector]) -> None:
        n = len(state.motion.q)
        self._arm, self.given = CompiledArm(arm, n), no_inputs(n, 1)[0]
        self.records = CompiledPlant(
            *self._arm.model, packed(own), packed(parameters), packed(state),
            np.array(transit) if transit else np.zeros((1, n)))
        arguments = (self.records, self.given)
        code = Code(stepped, arguments, f'plant-{n}')
        self.codes = *self._arm.codes, code
        if self.compiled:
            self.call = Call(code, arguments)
        seen, given = self.records.state, self.given
        self._tau, self._noise = given['tau'], (given['position_noise'], given['velocity_noise'])
        self._shown = tuple(seen[name] for name in (
            'motion__q', 'motion__dq', 'shown__q', 'shown__dq'))
        self.torque = seen['driven__torque']

    @property
    def compiled(self) -> bool:
        """Whether there is machine code."""
        return all(code.compiled for code in self.codes)

    def go_on(self, tau: Vector, late: float, loss: float, jitter: float,
              noise: Iterable[Vector]) -> None:
        """Go on by a sample with what `PlantInput` has; no `noise` for none."""
        self._tau[:] = tau
        given = self.given
        given['late'], given['loss'], given['jitter'] = late, loss, jitter
        for row, values in zip(self._noise, noise):
            row[:] = values
        self.call()

    def shown(self) -> tuple[Vector, Vector, tuple[Vector, Vector], float, int]:
        """Return q, dq, both as measured, how long after the sample, and `lost_in_a_row`."""
        (q, dq, *measured), state = (row.tolist() for row in self._shown), self.records.state
        return (q, dq, (measured[0], measured[1]), float(state['offset']),
                int(state['lost_in_a_row']))

    def state(self) -> PlantState:
        """Return the present state."""
        state: PlantState = in_lists(load(self.records.state))
        return state


@function
def stepped(p: CompiledPlant, given: Any) -> int:
    """Go on by one control period, as a function that is called by its address."""
    advance(p, given)
    return 0


@function
def advance(p: CompiledPlant, given: Any) -> None:
    """Go on by one control period."""
    parameters = load(p.parameters)
    mechanism = Mechanism(CompiledModel(p.call, p.body), load(p.own), parameters.mechanics)
    store(p.state, plant_step(mechanism, parameters, load(p.state), p.transit, load(given)))
