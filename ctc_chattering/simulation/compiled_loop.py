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

"""The closed loop sample by sample as machine code, for simulation that takes milliseconds."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import inf
from random import Random
from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import every, first, function, some
from ctc_chattering.compiled.machine_code import invoke, places, Program
from ctc_chattering.compiled.records import fill, load, numpy_record, rows, store, value
from ctc_chattering.control.compiled_step import CompiledStep
from ctc_chattering.control.irregular_sample import locate_sample
from ctc_chattering.dynamics.compiled_model import Arm
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_step import CompiledPlant, CompiledPlantStep, no_inputs
import numpy as np
import numpy.typing as npt

#: How a run ends, and the sample: at its end, without a finite torque, with a position error
#: beyond its limit (and its joint), with a state that is not finite.
FINISHED, NO_TORQUE, BEYOND, DIVERGED = range(4)
#: Rows of a sample.
Q, DQ, SENT, FILTERED = range(4)


class Control(NamedTuple):
    """The steps of controller and plant, which machine code calls by their addresses."""

    #: Addresses of the two functions, and of those of their arguments.
    call: Any
    #: `PlantInput` of the plant's step.
    given: Any
    #: As of `CompiledStep` and its records.
    measured: Array
    points: Array
    irregularity: Any
    result: Any
    #: Largest position error, shape (n,) [rad]; inf for any.
    error_limit: Array
    #: What is added to the measured positions: whole turns of continuous joints, shape (n,) [rad].
    lacking: Array


class CompiledLoop(Program):
    """
    A closed loop from its start to its end.

    Parameters
    ----------
    plant_step : CompiledPlantStep
        Of the plant, at its start.
    step : CompiledStep
        Of the controller, at its start.

    Attributes
    ----------
    step, plant_step
        As given.
    measured, error : array, shape (2, n) and (n,)
        q and dq [rad, rad/s], and the position error [rad], of the last sample.

    """

    def __init__(self, plant_step: CompiledPlantStep, step: CompiledStep) -> None:
        records = step.records
        self.measured, self.error, self.step = records.measured, records.result.e, step
        self.plant_step, self._error_limit = plant_step, np.zeros_like(self.error)
        self._lacking = np.zeros_like(self.error)
        n = len(self._error_limit)
        self._result = numpy_record(dict.fromkeys(('rows', 'last', 'joint', 'truth'), np.array(0)))
        calls = numpy_record(dict.fromkeys(
            ('control', 'control_places', 'plant', 'plant_places'), np.array(0)))
        kept = plant_step.records, Control(
            calls, plant_step.given, records.measured, step.points, records.irregularity,
            records.result, self._error_limit, self._lacking), self._result
        super().__init__((*step.codes, *plant_step.codes), run, (
            *kept, *_arrays(no_inputs(n, 1), np.zeros((3, n)))), f'loop-{n}')
        self.compiled &= step.compiled and plant_step.compiled
        if self.compiled:
            self._places = places(kept)
            for name, code in (('control', step.code), ('plant', plant_step.code)):
                calls[name] = code.address()
                calls[f'{name}_places'] = code.places.ctypes.data

    def fill(self, numbers: Sequence[tuple[Any, ...]], *of_steps: tuple[Arm, Array]) -> None:
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
        records = *self.plant_step.records[2:5], *self.step.records[:3]
        for fields, values in zip(records, numbers):
            fill(fields, values)
        steps: tuple[Any, ...] = self.plant_step, self.step
        for step, (arm, transit) in zip(steps, of_steps):
            step.arm.fill(arm)
            step.records.transit[:] = transit

    def run(self, plant: Plant, table: Array, error_limit: Array, truth: bool, lacking: Array
            ) -> tuple[int, int, int, Any, Array]:
        """
        Run it.

        Parameters
        ----------
        plant : Plant
            Whose parameters and state it has.
        table : array, shape (N + delay, 3, n)
            q_d, dq_d and ddq_d at each sample.
        error_limit : array, shape (n,)
            Largest position error [rad]; inf for any.
        truth : bool
            Record the true state in place of the one that the sensors show.
        lacking : array, shape (n,)
            What is added to the positions: whole turns of continuous joints [rad].

        Returns
        -------
        end, last, joint : int
            How the run ended, at which sample, with which joint.
        stamps : array of int, shape (N,)
            Of each sample that is not lost [ns].
        rows : array, shape (N, 4, n)
            Its q, dq, tau, v.

        """
        fill(self._result, (0, 0, 0, truth))
        self._error_limit[:], self._lacking[:] = error_limit, lacking
        count = plant.last + 1
        arrays = _arrays(inputs(plant, count), table.reshape(-1, plant.n))
        at = np.concatenate((self._places, places(arrays)))
        end, (found, last, joint, _) = invoke(self.code.address(), at.ctypes.data), self._result
        _, _, stamps, out = arrays
        return (end, int(last), int(joint), stamps[:found], out.reshape(count, 4, -1)[:found])


def _arrays(drawn: Any, points: Array) -> tuple[Any, ...]:
    """Return the last arguments of `run`."""
    count, n = len(drawn), points.shape[1]
    return drawn, points, np.zeros(count, np.int64), np.empty((4 * count, n))


def inputs(plant: Plant, count: int) -> Any:
    """Return `count` records of `PlantInput` with the random numbers that `plant` would draw."""
    made = no_inputs(plant.n, count)
    for name, random in plant.chances.items():
        made[name] = ([random.random() for _ in range(count)] if getattr(plant.config, name)
                      else 1.0)
    noisy = [(name, i) for name in ('position_noise', 'velocity_noise')
             for i, deviation in enumerate(getattr(plant.config, name)) if deviation > 0.0]
    numbers = normal_numbers(plant.sensor.random.getstate(), count * len(noisy))
    for (name, i), column in zip(noisy, numbers.reshape(count, -1).T):
        made[name][:, i] = column
    return made


@lru_cache(128)  # The runs of a map have the same seeds at every point.
def normal_numbers(state: Any, count: int) -> Array:
    """Return the next `count` numbers of ``gauss(0.0, 1.0)`` of a `Random` in this state."""
    random = Random()
    random.setstate(state)
    return np.array([random.gauss(0.0, 1.0) for _ in range(count)])


@function
def run(p: CompiledPlant, c: Control, result: Any, drawn: Any, points: Array,
        stamps: npt.NDArray[np.int64], out: Array) -> int:
    """
    Run the closed loop from the first sample to the last; return how it ended.

    Parameters
    ----------
    p, c
        Plant and controller.
    result : record
        To be filled: the number of rows, the last sample, the joint that is concerned.
    drawn : array of records, shape (N,)
        `PlantInput` of each sample but for the torque.
    points : array, shape (3 (N + delay), n)
        q_d, dq_d and ddq_d of one sample after the other.
    stamps, out : array, shape (N,) and (4 N, n)
        To be filled with stamp [ns], and with q, dq, tau, v, of each sample that is not lost.

    """
    s, tau = p.state, value(p.state.driven.received)
    measured, ahead = rows(c.measured, tau), rows(c.points, tau)
    table, kept, limit = rows(points, tau), rows(out, tau), rows(c.error_limit, tau)
    lacking = rows(c.lacking, tau)[0]
    last, period = p.parameters.last, p.parameters.mechanics.period_ns
    before, offset = -period, 0
    for k in range(last + 1):
        result.last = k
        if not s.lost_in_a_row:  # Else the plant takes the last torque again.
            measured[0], measured[1] = value(s.shown.q) + lacking, value(s.shown.dq)
            for j in range(len(c.points)):
                ahead[j] = table[3 * k + j]
            stamp = k * period + round(1e9 * s.offset)
            missed, offset = locate_sample(period, offset, stamp - before)
            for j in range(missed, -1, -1):
                c.irregularity.offset = offset / 1e9
                c.irregularity.reference_offset = (stamp - offset - (k + j) * period) / 1e9
                c.irregularity.is_measured = 1 - min(j, 1)
                c.irregularity.keeps_torque = min(j, 1)
                invoke(c.call.control, c.call.control_places)
            before, tau, v = stamp, value(c.result.tau), value(c.result.v)
            if not every(np.abs(tau) + np.abs(v) < inf):
                return NO_TORQUE
            beyond = ~(np.abs(value(c.result.e)) <= limit[0])
            if some(beyond):
                result.joint = first(beyond)
                return BEYOND
            i = 4 * result.rows
            kept[i + Q], kept[i + DQ] = measured[0], measured[1]
            if result.truth:
                kept[i + Q], kept[i + DQ] = value(s.motion.q) + lacking, value(s.motion.dq)
            kept[i + SENT], kept[i + FILTERED] = tau, v
            stamps[result.rows] = stamp
            result.rows += 1
        if k < last:
            store(c.given, load(drawn[k])._replace(tau=tau))
            invoke(c.call.plant, c.call.plant_places)
            if not every(np.abs(value(s.motion.q)) + np.abs(value(s.motion.dq)) < inf):
                return DIVERGED
    return FINISHED
