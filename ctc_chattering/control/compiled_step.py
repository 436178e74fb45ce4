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

"""The control step as machine code: `control.control_step.step` on records in memory."""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.control.control_step import Memories, step_at
from ctc_chattering.control.evaluation import (
    Arrival,
    Context,
    ControlSettings,
    Models,
    REGULAR,
)
from ctc_chattering.dynamics.arm import Arm
from ctc_chattering.dynamics.compiled_model import CompiledArm, CompiledModel, EvaluatedModel
from ctc_chattering.numerics.compilable import function
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.machine_code import Call, Code
from ctc_chattering.numerics.records import load, packed, rows, store
import numpy as np

#: Rows of what a step computes, those of `control.controller.Sample` in this order.
TAU, E, DE, V, NOMINAL, COMPENSATION, ROBUST, SATURATION_ERROR = range(8)


class ControlRecords(NamedTuple):
    """A controller, each part a NumPy record of what it is named after, or an array."""

    settings: Any
    law: Any
    memory: Any
    law_memory: Any
    last: Any
    #: Of the model: as of `CompiledModel`.
    call: Any
    body: Any
    #: Where M, C and G of the sample are kept, of the arrival of its torque, and a period later.
    now: Any
    arriving: Any
    after: Any
    #: Torques in transit, shape (4 d, n), and room for a reference, (3 (1 + d), n).
    transit: Array
    reference: Array
    #: `Arrival` of the state, shape (4,).
    arrival: Array
    #: Position [rad] and velocity [rad/s], shape (2, n), and what is computed of it, (8, n).
    measured: Array
    made: Array


class CompiledStep:
    """
    The control step of a controller between two changes of its settings, as `PlainStep`.

    Parameters
    ----------
    settings, law, memories, transit
        As of `PlainStep`.
    arm : Arm
        Model.

    Attributes
    ----------
    codes : tuple of Code
        What must be compiled, for all controllers with this law and number of joints.
    measured, points : array, shape (2, n) and (3 (1 + d), n)
        Of `control_step.step_at`.
    arrival : array, shape (4,)
        As `Arrival` is; that of a regular state until it is set.
    made : array, shape (8, n)
        What it computes.
    call : Call
        Goes on by a sample; only if there is machine code.

    """

    call: Call

    def __init__(self, settings: ControlSettings, law: Any, memories: Memories, transit: Array,
                 arm: Arm) -> None:
        n = len(settings.zero)
        self.measured, self.made = np.zeros((2, n)), np.zeros((8, n))
        self.points = np.zeros((3 + 3 * int(settings.delay), n))
        self.arrival, self._arrival = np.array(REGULAR), REGULAR
        self._arm = CompiledArm(arm, n)
        self._records = ControlRecords(
            packed(settings), packed(law), *map(packed, memories),  # type: ignore[call-arg]
            *self._arm.model, *(self._arm.place() for _ in range(3)), transit,
            np.zeros_like(self.points), self.arrival, self.measured, self.made)
        arguments = (self._records, self.points)
        code = Code(stepped, arguments, f'control-{type(law).__name__}-{n}'.lower())
        self.codes = *self._arm.codes, code
        if self.compiled:
            self.call = Call(code, arguments)

    @property
    def compiled(self) -> bool:
        """Whether there is machine code."""
        return all(code.compiled for code in self.codes)

    @property
    def memories(self) -> Memories:
        """Return what is remembered; it may be set."""
        p = self._records
        return load(p.memory), load(p.law_memory), load(p.last)

    @memories.setter
    def memories(self, memories: Memories) -> None:
        p = self._records
        for fields, record in zip((p.memory, p.law_memory, p.last), memories):
            store(fields, record)

    def step(self, rows: Array, arrival: Arrival) -> list[list[float]]:
        """Go on by a sample, and return the rows of `Sample`, shape (8, n)."""
        self.measured[:], self.points[:] = rows[:2], rows[2:]
        if arrival is not self._arrival:
            self.arrival[:] = self._arrival = arrival
        self.call()
        made: list[list[float]] = self.made.tolist()
        return made


@function
def stepped(p: ControlRecords, points: Array) -> int:
    """
    Go on by a sample, and set `p.made`.

    Parameters
    ----------
    p : ControlRecords
        After the last sample, with what is measured.
    points : array, shape (3 (1 + d), n)
        The reference at this sample and those of the delay; there may be more.

    """
    memory = load(p.memory)
    like = memory.xi
    measured = rows(p.measured, like)
    model = CompiledModel(p.call, p.body)
    models = Models(EvaluatedModel(model, p.now), EvaluatedModel(model, p.arriving),
                    EvaluatedModel(model, p.after))
    came = p.arrival
    step, last = step_at(
        Context(load(p.settings), models, rows(p.transit, like), rows(p.reference, like)),
        load(p.law), memory, load(p.law_memory), load(p.last),
        Arrival(came[0], came[1], came[2], came[3]), measured[0], measured[1],
        rows(points, like))
    store(p.last, last)
    store(p.memory, step.memory)
    store(p.law_memory, step.law_memory)
    made, terms = rows(p.made, like), step.parts
    made[TAU], made[E], made[DE], made[V] = step.sent.tau, step.now.e, step.now.de, step.now.v
    made[NOMINAL], made[COMPENSATION] = terms.nominal, terms.compensation
    made[ROBUST], made[SATURATION_ERROR] = terms.robust, step.sent.saturation_error
    return 0
