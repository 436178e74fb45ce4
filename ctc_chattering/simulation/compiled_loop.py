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
The closed loop as one piece of machine code.

`run_closed_loop` runs a `CompiledLoop` where plant and controller can be machine code, and its own
loop in plain Python elsewhere. `run_loop` is that loop once more, over records in memory. It calls
the steps of plant and controller by their addresses, so that these are compiled once for all
loops. A run then takes milliseconds, and may be advanced in segments.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import inf
from random import Random
from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import every, first, function, record, some
from ctc_chattering.compiled.machine_code import argument_addresses, Callee, invoke, Program
from ctc_chattering.compiled.records import fill, load, packed, rows, store, value
from ctc_chattering.control.compiled_step import CompiledStep
from ctc_chattering.control.irregular_sample import locate_sample
from ctc_chattering.dynamics.compiled_model import ArmNumbers
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_step import CompiledPlant, CompiledPlantStep, no_inputs
import numpy as np
import numpy.typing as npt

# Ends of a segment, as `run_loop` returns them.
#: Before the sample that was asked for.
FINISHED = 0
#: Without a finite torque.
NO_TORQUE = 1
#: With a position error beyond its limit.
BEYOND_LIMIT = 2
#: With a state that is not finite.
DIVERGED = 3


class Samples(NamedTuple):
    """The N samples of a run that are not lost."""

    #: Time of measurement [ns], shape (N,).
    stamps: npt.NDArray[np.int64]
    #: Position [rad], velocity [rad/s], torque sent [N·m] and v [rad/s], each of shape (N, n).
    q: Array
    dq: Array
    tau: Array
    v: Array
    #: Position error that the law computed, shape (N, n) [rad].
    e: Array

    def head(self, count: int) -> Samples:
        """Return the first `count` samples."""
        return Samples._make(column[:count] for column in self)


def empty_samples(count: int, n: int) -> Samples:
    """Return memory for `count` samples of `n` joints."""
    return Samples(np.zeros(count, np.int64), *np.empty((5, count, n)))


@record
class LoopStatus(NamedTuple):
    """Progress of a run."""

    #: Number of samples that are not lost.
    recorded: int
    #: The next sample, or the one at which the run failed.
    k: int
    #: The sample before which the segment ends.
    until: int
    #: Stamp of the last state that was not lost, and its time after its sample [ns].
    previous: int
    offset: int
    #: Joint with the error of `BEYOND_LIMIT`.
    joint: int
    #: True to record the true state in place of the measured one.
    truth: bool


class LoopRecords(NamedTuple):
    """Records of the loop, beside those of the plant."""

    #: NumPy records: `Callee` of the steps of controller and plant.
    controller: Any
    plant: Any
    #: `PlantInput` of the plant's step.
    received: Any
    #: As of `CompiledStep` and its records.
    measured: Array
    points: Array
    irregularity: Any
    result: Any
    #: Largest position error, inf for any, shape (n,) [rad].
    error_limit: Array
    #: Whole turns that are added to the measured positions, shape (n,) [rad].
    turns: Array
    #: `LoopStatus`.
    status: Any


class CompiledLoop(Program):
    """
    A closed loop, from `fill` over `start` to the last `advance`.

    Parameters
    ----------
    plant_step : CompiledPlantStep
        Of the plant, at its start.
    step : CompiledStep
        Of the controller, at its start.

    Attributes
    ----------
    step, plant_step
        The same.
    measured, error : array, shape (2, n) and (n,)
        q and dq [rad, rad/s], and the position error [rad], of the last sample.

    """

    def __init__(self, plant_step: CompiledPlantStep, step: CompiledStep) -> None:
        self.step = step
        self.plant_step = plant_step
        control = step.records
        self.measured = control.measured
        self.error = control.result.e
        n = len(self.error)
        callees = packed(Callee(0, 0)), packed(Callee(0, 0))
        self._records = LoopRecords(
            *callees, plant_step.received, control.measured, step.points, control.irregularity,
            control.result, np.zeros(n), np.zeros(n), packed(LoopStatus(0, 0, 0, 0, 0, 0, False)))
        # The machine code is the same for any number of samples.
        super().__init__((*step.codes, *plant_step.codes), run_loop, (
            plant_step.records, self._records, no_inputs(n, 1), np.zeros((3, n)),
            empty_samples(1, n)), f'loop-{n}')
        self.compiled &= step.compiled and plant_step.compiled
        if self.compiled:
            for callee, code in zip(callees, (step.code, plant_step.code)):
                callee.function = code.address()
                callee.arguments = code.addresses.ctypes.data

    def fill(self, numbers: Sequence[tuple[Any, ...]], *of_steps: tuple[ArmNumbers, Array]
             ) -> None:
        """
        Begin with a plant and a controller of these layouts.

        Parameters
        ----------
        numbers : sequence
            Values, as of `described`, of own friction, parameters and state of the plant, and of
            settings, law and memories of the controller.
        *of_steps
            Model and torques in transit of the plant, then of the controller.

        """
        records = *self.plant_step.records[1:4], *self.step.records[:3]
        for fields, values in zip(records, numbers):
            fill(fields, values)
        steps: tuple[Any, ...] = self.plant_step, self.step
        for step, (arm, transit) in zip(steps, of_steps):
            step.arm.fill(arm)
            step.records.transit[:] = transit

    def start(self, plant: Plant, table: Array, samples: Samples, error_limit: Array, turns: Array,
              truth: bool) -> tuple[Any, ...]:
        """
        Return the arguments of `advance` for a run at its start.

        They are its memory, and must live until its end.

        Parameters
        ----------
        plant : Plant
            Whose parameters and state it has.
        table : array, shape (N + delay, 3, n)
            q_d, dq_d and ddq_d at each sample. It is read where `advance` needs it.
        samples : Samples
            Memory for N samples, to be filled.
        error_limit : array, shape (n,)
            Largest position error, inf for any [rad].
        turns : array, shape (n,)
            Whole turns that are added to the positions of continuous joints [rad].
        truth : bool
            Record the true state in place of the one that the sensors show.

        """
        fill(self._records.status, (0, 0, 0, -plant.period_ns, 0, 0, truth, 0))
        self._records.error_limit[:] = error_limit
        self._records.turns[:] = turns
        drawn = inputs(plant, plant.last + 1)
        points = table.reshape(-1, plant.n)
        return self.plant_step.records, self._records, drawn, points, samples

    def advance(self, arguments: tuple[Any, ...], until: int) -> int:
        """Run all samples before `until`, and return the segment's end."""
        self._records.status.until = until
        addresses = argument_addresses(arguments)
        return invoke(self.code.address(), addresses.ctypes.data)

    @property
    def status(self) -> LoopStatus:
        """Return the progress of the last run."""
        status: LoopStatus = load(self._records.status)
        return status


def inputs(plant: Plant, count: int) -> Any:
    """Return `PlantInput`s with the numbers that `plant` would draw."""
    drawn = no_inputs(plant.n, count)
    for name, random in plant.draws.items():
        drawn[name] = ([random.random() for _ in range(count)] if getattr(plant.config, name)
                       else 1.0)
    noisy = [(name, i) for name in ('position_noise', 'velocity_noise')
             for i, deviation in enumerate(getattr(plant.config, name)) if deviation > 0.0]
    numbers = normal_numbers(plant.noise.getstate(), count * len(noisy))
    for (name, i), column in zip(noisy, numbers.reshape(count, -1).T):
        drawn[name][:, i] = column
    return drawn


@lru_cache(128)  # The runs of a map have the same seeds at every point.
def normal_numbers(state: Any, count: int) -> Array:
    """Return the next ``gauss(0.0, 1.0)`` of a `Random` in this state."""
    random = Random()
    random.setstate(state)
    return np.array([random.gauss(0.0, 1.0) for _ in range(count)])


@function
def run_loop(p: CompiledPlant, c: LoopRecords, drawn: Any, points: Array, samples: Samples
             ) -> int:
    """
    Run samples of the closed loop, and return the segment's end.

    Parameters
    ----------
    p, c
        Memory of the plant, and of the loop.
    drawn : array of records, shape (N,)
        `PlantInput` of each sample but for the torque.
    points : array, shape (3 (N + delay), n)
        q_d, dq_d and ddq_d of one sample after the other.
    samples : Samples
        To be filled.

    """
    state = p.state
    status = c.status
    tau = value(c.result.tau)  # The first sample is never lost, and computes another one.
    measured = rows(c.measured, tau)
    table = rows(points, tau)
    ahead = rows(c.points, tau)
    limit = rows(c.error_limit, tau)[0]
    turns = rows(c.turns, tau)[0]
    q_column = rows(samples.q, tau)
    dq_column = rows(samples.dq, tau)
    tau_column = rows(samples.tau, tau)
    v_column = rows(samples.v, tau)
    e_column = rows(samples.e, tau)
    period = p.parameters.mechanics.period_ns
    for k in range(status.k, status.until):
        status.k = k
        if not state.lost_in_a_row:  # Else the plant takes the last torque again.
            measured[0] = value(state.shown.q) + turns
            measured[1] = value(state.shown.dq)
            for j in range(len(c.points)):
                ahead[j] = table[3 * k + j]
            stamp = k * period + round(1e9 * state.offset)
            missed, offset = locate_sample(period, status.offset, stamp - status.previous)
            for j in range(missed, -1, -1):
                c.irregularity.offset = offset / 1e9
                c.irregularity.reference_offset = (stamp - offset - (k + j) * period) / 1e9
                c.irregularity.is_measured = 1 - min(j, 1)
                c.irregularity.keeps_torque = min(j, 1)
                invoke(c.controller.function, c.controller.arguments)
            status.previous = stamp
            status.offset = offset
            tau = value(c.result.tau)
            v = value(c.result.v)
            if not every(np.abs(tau) + np.abs(v) < inf):
                return NO_TORQUE
            beyond = ~(np.abs(value(c.result.e)) <= limit)
            if some(beyond):
                status.joint = first(beyond)
                return BEYOND_LIMIT
            i = status.recorded
            samples.stamps[i] = stamp
            q_column[i] = measured[0]
            dq_column[i] = measured[1]
            if status.truth:
                q_column[i] = value(state.motion.q) + turns
                dq_column[i] = value(state.motion.dq)
            tau_column[i] = tau
            v_column[i] = v
            e_column[i] = value(c.result.e)
            status.recorded += 1
        if k < p.parameters.last:
            store(c.received, load(drawn[k])._replace(tau=tau))
            invoke(c.plant.function, c.plant.arguments)
            if not every(np.abs(value(state.motion.q)) + np.abs(value(state.motion.dq)) < inf):
                return DIVERGED
    status.k = status.until
    return FINISHED
