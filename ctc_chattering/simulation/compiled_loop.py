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

from copy import copy
from functools import lru_cache
from math import isfinite
from random import Random
from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import function
from ctc_chattering.compiled.machine_code import Call, Code, invoke
from ctc_chattering.compiled.records import numpy_record
from ctc_chattering.control.step import CompiledStep, E, periods, TAU, V
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_step import CompiledPlant, CompiledPlantStep, no_inputs
import numpy as np

#: How a run ends, and the sample: at its end, without a finite torque, with a position error
#: beyond its limit (and its joint), with a state that is not finite.
FINISHED, NO_TORQUE, BEYOND, DIVERGED = range(4)
#: Rows of a sample.
STAMP, Q, DQ, SENT, FILTERED = range(5)


class Control(NamedTuple):
    """The steps of controller and plant, which machine code calls by their addresses."""

    #: Addresses of the two functions, and of those of their arguments.
    call: Any
    #: `PlantInput` of the plant's step.
    given: Any
    #: As of `CompiledStep`.
    measured: Array
    points: Array
    arrival: Any
    made: Array
    #: Largest position error, shape (n,) [rad]; inf for any.
    error_limit: Array


class CompiledLoop:
    """
    A closed loop from its start to its end.

    Parameters
    ----------
    plant : Plant
        Which has not moved yet.
    plant_step : CompiledPlantStep
        Of the plant, at its start.
    step : CompiledStep
        Of the controller, at its start.
    truth : bool
        Record the true state in place of the one that the sensors show.

    Attributes
    ----------
    code : Code
        Of the loop, the same for all laws.
    codes : tuple of Code
        All that must be compiled.
    measured, error : array, shape (2, n) and (n,)
        q and dq [rad, rad/s], and the position error [rad], of the last sample.

    """

    def __init__(self, plant: Plant, plant_step: CompiledPlantStep, step: CompiledStep,
                 truth: bool) -> None:
        self.measured, self.error, self._step = step.measured, step.made[E], step
        self._plant, self._plant_step, n = plant, plant_step, plant.n
        zero = np.array(0)
        self._call = numpy_record(dict.fromkeys(
            ('control', 'control_places', 'plant', 'plant_places'), zero))
        self._result = numpy_record(
            {'rows': zero, 'last': zero, 'joint': zero, 'truth': np.array(int(truth))})
        self.code = Code(run, self._arguments(
            np.zeros(n), no_inputs(n, 1), np.zeros((3, n)), np.zeros((1, 5, n))), f'loop-{n}')
        self.codes = *step.codes, *plant_step.codes, self.code

    def _arguments(self, error_limit: Array, inputs: Any, points: Array, rows: Array
                   ) -> tuple[Any, ...]:
        step, plant_step = self._step, self._plant_step
        control = Control(self._call, plant_step.given, step.measured, step.points, step.arrival,
                          step.made, error_limit)
        return plant_step.records, control, inputs, points, rows, self._result

    @property
    def compiled(self) -> bool:
        """Whether it can run."""
        return all(code.compiled for code in self.codes)

    @property
    def commanded(self) -> Array:
        """Return what the drives were asked for last, shape (n,) [N·m]."""
        torque: Array = self._plant_step.records.state['driven']['commanded']
        return torque

    def run(self, table: Array, error_limit: Array) -> tuple[int, int, int, Array]:
        """
        Run it.

        Parameters
        ----------
        table : array, shape (N + delay, 3, n)
            q_d, dq_d and ddq_d at each sample.
        error_limit : array, shape (n,)
            Largest position error [rad]; inf for any.

        Returns
        -------
        end, last, joint : int
            How the run ended, at which sample, with which joint.
        rows : array, shape (N, 5, n)
            Stamp [ns], q, dq, tau, v of each sample that is not lost.

        """
        for name, step in (('control', self._step), ('plant', self._plant_step)):
            self._call[name] = step.call.function
            self._call[f'{name}_places'] = step.call.places.ctypes.data
        drawn = inputs(self._plant, self._plant.last + 1)
        out = np.empty((len(drawn), 5, self._plant.n))
        end = Call(self.code, self._arguments(
            error_limit, drawn, table.reshape(-1, self._plant.n), out))()
        return end, int(self._result.last), int(self._result.joint), out[:self._result.rows]


def inputs(plant: Plant, count: int) -> Any:
    """Return `count` records of `PlantInput` with the random numbers that `plant` would draw."""
    n, config = plant.n, plant.config
    made = no_inputs(n, count)
    for name, random, asked in (('late', plant.lateness, config.late_samples),
                                ('loss', plant.loss, config.sample_loss),
                                ('jitter', plant.jitter, config.sample_jitter)):
        draw = copy(random).random  # The plant stays at its start.
        made[name] = [draw() for _ in range(count)] if asked else 1.0
    noisy = np.array([*config.position_noise, *config.velocity_noise]) > 0.0
    noise = np.zeros((count, 2 * n))
    noise[:, noisy] = normal_numbers(
        plant.sensor.random.getstate(), count * int(noisy.sum())).reshape(count, -1)
    made['position_noise'], made['velocity_noise'] = noise[:, :n], noise[:, n:]
    return made


@lru_cache(64)  # The runs of a map have the same seeds at every point.
def normal_numbers(state: Any, count: int) -> Array:
    """Return the next `count` numbers of ``gauss(0.0, 1.0)`` of a `Random` in this state."""
    random = Random()
    random.setstate(state)
    return np.array([random.gauss(0.0, 1.0) for _ in range(count)])


@function
def run(p: CompiledPlant, c: Control, drawn: Any, points: Array, out: Array, result: Any) -> int:
    """
    Run the closed loop from the first sample to the last; return how it ended.

    Parameters
    ----------
    p, c
        Plant and controller.
    drawn : array of records, shape (N,)
        `PlantInput` of each sample but for the torque.
    points : array, shape (3 (N + delay), n)
        q_d, dq_d and ddq_d of one sample after the other.
    out : array, shape (N, 5, n)
        Rows to be filled with stamp, q, dq, tau, v of each sample that is not lost.
    result : record
        To be filled: the number of rows, the last sample, the joint that is concerned.

    """
    s, given, n = p.state, c.given, out.shape[2]
    last, period = p.parameters.last, p.parameters.mechanics.period_ns
    before, offset = -period, 0
    for k in range(last + 1):
        result.last = k
        if not s.lost_in_a_row:  # Else the plant takes the last torque again.
            for i in range(n):
                c.measured[0, i], c.measured[1, i] = s.shown.q[i], s.shown.dq[i]
                for j in range(len(c.points)):
                    c.points[j, i] = points[3 * k + j, i]
            stamp = k * period + round(1e9 * s.offset)
            missed, offset = periods(period, offset, stamp - before)
            for j in range(missed, -1, -1):
                c.arrival.offset = offset / 1e9
                c.arrival.after_points = (stamp - offset - (k + j) * period) / 1e9
                c.arrival.measured, c.arrival.kept = 1 - min(j, 1), min(j, 1)
                invoke(c.call.control, c.call.control_places)
            before = stamp
            row, total = out[result.rows], 0.0
            for i in range(n):
                given.tau[i] = c.made[TAU, i]
                row[STAMP, i], row[SENT, i], row[FILTERED, i] = stamp, given.tau[i], c.made[V, i]
                row[Q, i], row[DQ, i] = s.shown.q[i], s.shown.dq[i]
                if result.truth:
                    row[Q, i], row[DQ, i] = s.motion.q[i], s.motion.dq[i]
                total += row[SENT, i] + row[FILTERED, i]
            if not isfinite(total):
                return NO_TORQUE
            for i in range(n):
                if not abs(c.made[E, i]) <= c.error_limit[i]:
                    result.joint = i
                    return BEYOND
            result.rows += 1
        if k < last:
            given.late, given.loss, given.jitter = drawn[k].late, drawn[k].loss, drawn[k].jitter
            total = 0.0
            for i in range(n):
                given.position_noise[i] = drawn[k].position_noise[i]
                given.velocity_noise[i] = drawn[k].velocity_noise[i]
            invoke(c.call.plant, c.call.plant_places)
            for i in range(n):
                total += s.motion.q[i] + s.motion.dq[i]
            if not isfinite(total):
                return DIVERGED
    return FINISHED
