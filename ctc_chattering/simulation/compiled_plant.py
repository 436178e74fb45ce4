"""The simulated robot as machine code: its parameters, state and random numbers as records."""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.dynamics.compiled_model import CompiledArm, CompiledModel
from ctc_chattering.numerics.compilable import function
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.records import load, packed, store
from ctc_chattering.simulation.motion import Mechanism
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_step import PlantInput, PlantParameters, PlantState
from ctc_chattering.simulation.plant_step import stepped as plant_step
from ctc_chattering.simulation.random_numbers import normal_numbers
from ctc_chattering.simulation.sensor import Measured
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


def compiled_plant(plant: Plant, arm: CompiledArm) -> CompiledPlant:
    """Return a plant that has not moved yet, with its model."""
    config = plant.config
    return CompiledPlant(
        *arm.model, packed(plant.own), packed(PlantParameters(
            plant.mechanics, plant.drives, plant.sensor.encoders, config.sample_loss,
            plant.last)),
        packed(PlantState(0, plant.driven, plant.motion, Measured(*plant.measured), 0)),
        np.zeros((max(config.input_delay, 1), plant.n)))


def inputs(plant: Plant, count: int) -> Any:
    """Return `count` records of `PlantInput` with the random numbers that `plant` would draw."""
    n, config = plant.n, plant.config
    zero = [0.0] * n
    made: Any = np.zeros(count, packed(PlantInput(zero, 0.0, 0.0, zero, zero)).dtype)
    for name, random, asked in (('late', plant.lateness, config.late_samples),
                                ('loss', plant.loss, config.sample_loss)):
        made[name] = [random.random() for _ in range(count)] if asked else 1.0
    noisy = np.array([*config.position_noise, *config.velocity_noise]) > 0.0
    noise = np.zeros((count, 2 * n))
    noise[:, noisy] = normal_numbers(
        plant.sensor.random, count * noisy.sum()).reshape(count, -1)
    made['position_noise'], made['velocity_noise'] = noise[:, :n], noise[:, n:]
    return made


@function
def advance(p: CompiledPlant, given: Any) -> None:
    """Go on by one control period."""
    parameters = load(p.parameters)
    mechanism = Mechanism(CompiledModel(p.call, p.body), load(p.own), parameters.mechanics)
    store(p.state, plant_step(mechanism, parameters, load(p.state), p.transit, load(given)))
