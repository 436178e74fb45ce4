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
from math import cos, isfinite, log, sin
from random import Random
from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import function
from ctc_chattering.compiled.machine_code import Call, Code, invoke
from ctc_chattering.compiled.records import numpy_record
from ctc_chattering.control.step import CompiledStep, E, periods, TAU, V
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.compiled_plant import CompiledPlant, CompiledPlantStep, no_inputs
from ctc_chattering.simulation.plant import Plant
import numpy as np

#: How a run ends, and the sample: at its end, without a finite torque, with a position error
#: beyond its limit (and its joint), with a state that is not finite.
FINISHED, NO_TORQUE, BEYOND, DIVERGED = range(4)
#: Rows of a sample.
STAMP, Q, DQ, SENT, FILTERED = range(5)


class Control(NamedTuple):
    """The control step and that of the plant, which machine code calls by their addresses."""

    #: Addresses of the functions and of their arguments' places; of the reference with the length
    #: of a row, and of the plant's input; where among the places the addresses of these two are.
    step: Any
    #: Places of the arguments of both.
    places: Array
    plant_places: Array
    #: As of `CompiledStep`.
    measured: Array
    arrival: Array
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
    commanded : array, shape (n,)
        What the drives were asked for last [N·m].

    """

    def __init__(self, plant: Plant, plant_step: CompiledPlantStep, step: CompiledStep,
                 truth: bool) -> None:
        self.measured, self.error, self._step = step.measured, step.made[E], step
        self._plant, self._plant_step, n = plant, plant_step, plant.n
        zero = np.array(0)
        addresses = ('function', 'places', 'points', 'stride', 'points_place', 'plant',
                     'plant_places', 'given', 'given_place')
        self._called = numpy_record(dict.fromkeys(addresses, zero))
        self._result = numpy_record(
            {'rows': zero, 'last': zero, 'joint': zero, 'truth': np.array(int(truth))})
        places = np.zeros(1, np.int64)
        self.code = Code(run, self._arguments(
            np.zeros(n), no_inputs(n, 1), np.zeros((1, 5, n)), places, places), f'loop-{n}')
        self.codes = *step.codes, *plant_step.codes, self.code

    def _arguments(self, error_limit: Array, given: Any, rows: Array, places: Any,
                   plant_places: Any) -> tuple[Any, ...]:
        step = Control(self._called, places, plant_places, self._step.measured,
                       self._step.arrival, self._step.made, error_limit)
        return self._plant_step.records, step, given, rows, self._result

    @property
    def compiled(self) -> bool:
        """Whether it can run."""
        return all(code.compiled for code in self.codes)

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
        call, plant, called = self._step.call, self._plant_step.call, self._called
        given = inputs(self._plant, self._plant.last + 1)
        out = np.empty((len(given), 5, self._plant.n))
        called.function, called.places = call.function, call.places.ctypes.data
        called.plant, called.plant_places = plant.function, plant.places.ctypes.data
        called.given, called.given_place = given.ctypes.data, plant.place_of(1)
        called.points, called.stride = table.ctypes.data, table.strides[0]
        called.points_place = call.place_of(1)
        end = Call(self.code, self._arguments(
            error_limit, given, out, call.places, plant.places))()
        self.commanded = self._plant_step.records.state.driven__commanded
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
        plant.sensor.random, count * noisy.sum()).reshape(count, -1)
    made['position_noise'], made['velocity_noise'] = noise[:, :n], noise[:, n:]
    return made


@function
def run(p: CompiledPlant, c: Control, given: Any, out: Array, result: Any) -> int:
    """
    Run the closed loop from the first sample to the last; return how it ended.

    Parameters
    ----------
    p, c
        Plant and controller.
    given : array of records, shape (N,)
        Of `PlantInput`, their torque to be filled.
    out : array, shape (N, 5, n)
        Rows to be filled with stamp, q, dq, tau, v of each sample that is not lost.
    result : record
        To be filled: the number of rows, the last sample, the joint that is concerned.

    """
    s, n = p.state, out.shape[2]
    last, period = p.parameters.last, p.parameters.mechanics__period_ns
    before, offset = -period, 0
    for k in range(last + 1):
        result.last = k
        tau = given[k].tau
        if s.lost_in_a_row:
            for i in range(n):
                tau[i] = given[k - 1].tau[i]
        else:
            for i in range(n):
                c.measured[0, i], c.measured[1, i] = s.shown__q[i], s.shown__dq[i]
            c.places[c.step.points_place] = c.step.points + k * c.step.stride
            stamp = k * period + round(1e9 * s.offset)
            missed, offset = periods(period, offset, stamp - before)
            for j in range(missed, -1, -1):
                c.arrival[0] = offset / 1e9
                c.arrival[1] = (stamp - offset - (k + j) * period) / 1e9
                c.arrival[2], c.arrival[3] = 1 - min(j, 1), min(j, 1)
                invoke(c.step.function, c.step.places)
            before = stamp
            row, total = out[result.rows], 0.0
            for i in range(n):
                row[STAMP, i], tau[i] = stamp, c.made[TAU, i]
                row[Q, i], row[DQ, i] = s.shown__q[i], s.shown__dq[i]
                if result.truth:
                    row[Q, i], row[DQ, i] = s.motion__q[i], s.motion__dq[i]
                row[SENT, i], row[FILTERED, i] = tau[i], c.made[V, i]
                total += tau[i] + c.made[V, i]
            if not isfinite(total):
                return NO_TORQUE
            for i in range(n):
                if not abs(c.made[E, i]) <= c.error_limit[i]:
                    result.joint = i
                    return BEYOND
            result.rows += 1
        if k < last:
            c.plant_places[c.step.given_place] = c.step.given + k * given.itemsize
            invoke(c.step.plant, c.step.plant_places)
            total = 0.0
            for i in range(n):
                total += s.motion__q[i] + s.motion__dq[i]
            if not isfinite(total):
                return DIVERGED
    return FINISHED


def normal_numbers(random: Random, count: int) -> Array:
    """Return the next `count` numbers of ``random.gauss(0.0, 1.0)``; `random` stays as it is."""
    return _normal_numbers(random.getstate(), count)


@lru_cache(64)  # The runs of a map have the same seeds at every point.
def _normal_numbers(state: Any, count: int) -> Array:
    if not count:
        return np.zeros(0)
    _, (*key, position), kept = state
    bits = np.random.MT19937()
    bits.state = {'bit_generator': 'MT19937',
                  'state': {'key': np.array(key, np.uint32), 'pos': position}}
    x = np.random.Generator(bits).random((count + 1) // 2 * 2).reshape(-1, 2)
    # Box and Muller, with functions of `math`: those of NumPy differ in the last bit.
    angle, rest = (2.0 * np.pi * x[:, 0]).tolist(), (1.0 - x[:, 1]).tolist()
    cosine, sine, logarithm = (np.fromiter(map(function, values), float) for function, values in (
        (cos, angle), (sin, angle), (log, rest)))
    radius = np.sqrt(-2.0 * logarithm)
    made = np.stack((cosine * radius, sine * radius), 1).ravel()
    return made[:count] if kept is None else np.concatenate(([kept], made))[:count]
