"""The simulated robot as machine code: its parameters, state and random numbers as records."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from typing import Any, NamedTuple, TYPE_CHECKING

from ctc_chattering.dynamics.arm import Arm
from ctc_chattering.dynamics.compiled_model import CompiledArm, CompiledModel
from ctc_chattering.numerics.compilable import function
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.machine_code import Call, Code
from ctc_chattering.numerics.records import in_lists, load, packed, store
from ctc_chattering.simulation.motion import Mechanism
from ctc_chattering.simulation.plant_step import PlantInput, PlantParameters, PlantState
from ctc_chattering.simulation.plant_step import stepped as plant_step
from ctc_chattering.simulation.random_numbers import normal_numbers
from ctc_chattering.simulation.sensor import Measured
import numpy as np

if TYPE_CHECKING:
    from ctc_chattering.simulation.plant import Plant


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


def compiled_plant(plant: Plant, arm: CompiledArm) -> CompiledPlant:
    """Return a plant as it is now, with its model."""
    config = plant.config
    return CompiledPlant(
        *arm.model, packed(plant.own), packed(PlantParameters(
            plant.mechanics, plant.drives, plant.sensor.encoders, config.sample_loss,
            plant.last)),
        packed(PlantState(plant.k, plant.driven, plant.motion, Measured(*plant.measured),
                          plant.lost_in_a_row)),
        np.array(plant.transit) if plant.transit else np.zeros((1, plant.n)))


def inputs(plant: Plant, count: int) -> Any:
    """Return `count` records of `PlantInput` with the random numbers that `plant` would draw."""
    n, config = plant.n, plant.config
    made = _no_inputs(n, count)
    for name, random, asked in (('late', plant.lateness, config.late_samples),
                                ('loss', plant.loss, config.sample_loss)):
        draw = copy(random).random  # The run may turn out to be plain Python.
        made[name] = [draw() for _ in range(count)] if asked else 1.0
    noisy = np.array([*config.position_noise, *config.velocity_noise]) > 0.0
    noise = np.zeros((count, 2 * n))
    noise[:, noisy] = normal_numbers(
        plant.sensor.random, count * noisy.sum()).reshape(count, -1)
    made['position_noise'], made['velocity_noise'] = noise[:, :n], noise[:, n:]
    return made


def _no_inputs(n: int, count: int) -> Any:
    zero = [0.0] * n
    return np.zeros(count, packed(PlantInput(zero, 0.0, 0.0, zero, zero)).dtype)


class CompiledPlantStep:
    """
    The step of a plant between two changes of its parameters.

    Parameters
    ----------
    plant : Plant
        As it is now.
    arm : Arm
        Its model.

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

    def __init__(self, plant: Plant, arm: Arm) -> None:
        self._arm = CompiledArm(arm, plant.n)
        self.records = compiled_plant(plant, self._arm)
        self.given = _no_inputs(plant.n, 1)[0]
        arguments = (self.records, self.given)
        code = Code(stepped, arguments, f'plant-{plant.n}')
        self.codes = *self._arm.codes, code
        if self.compiled:
            self.call = Call(code, arguments)
        state, given = self.records.state, self.given
        self._tau, self._noise = given['tau'], (given['position_noise'], given['velocity_noise'])
        self._shown = tuple(state[name] for name in (
            'motion__q', 'motion__dq', 'shown__q', 'shown__dq'))
        self.torque = state['driven__torque']

    @property
    def compiled(self) -> bool:
        """Whether there is machine code."""
        return all(code.compiled for code in self.codes)

    def go_on(self, tau: Vector, late: float, loss: float, noise: Iterable[Vector]) -> None:
        """Go on by a sample with what `PlantInput` has; no `noise` for none."""
        self._tau[:] = tau
        self.given['late'], self.given['loss'] = late, loss
        for row, values in zip(self._noise, noise):
            row[:] = values
        self.call()

    def shown(self) -> tuple[Vector, Vector, tuple[Vector, Vector], int]:
        """Return q, dq, both as measured, and how many measurements have been lost in a row."""
        q, dq, *measured = (row.tolist() for row in self._shown)
        return q, dq, (measured[0], measured[1]), int(self.records.state['lost_in_a_row'])

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
