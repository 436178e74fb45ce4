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
The control step as machine code.

`Controller` uses `CompiledStep` in the place of `PlainStep` where it has been compiled. Its
records are in memory, and its functions work on them. The compiled closed loop and the C export
take both.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import function
from ctc_chattering.compiled.machine_code import Program
from ctc_chattering.compiled.records import load, packed, rows, store
from ctc_chattering.control.irregular_sample import REGULAR, SampleIrregularity
from ctc_chattering.control.sample import Context, Memories, Models
from ctc_chattering.control.settings import ControlSettings
from ctc_chattering.control.step import ControlOutput, step
from ctc_chattering.dynamics.compiled_model import (
    ArmNumbers,
    CompiledArm,
    CompiledModel,
    EvaluatedModel,
)
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class ControlRecords(NamedTuple):
    """
    A controller in memory.

    NumPy records have the classes in parentheses.

    Attributes
    ----------
    settings, law, memories, irregularity
        (`ControlSettings`, `Law`, `Memories`, `SampleIrregularity`)
    call, body
        Model, as of `CompiledModel`.
    now, arriving, after
        Terms of the model in each state of `Models` (`KeptTerms`).
    transit : ndarray, shape (4 d, n)
        Torques in transit.
    measured : ndarray, shape (2, n)
        Position [rad] and velocity [rad/s].
    result
        Result of the sample (`ControlOutput`).

    """

    settings: Any
    law: Any
    memories: Any
    irregularity: Any
    call: Any
    body: Any
    now: Any
    arriving: Any
    after: Any
    transit: Array
    measured: Array
    result: Any


class CompiledStep(Program):
    """
    The step of a controller as machine code.

    It lasts until the next change of settings.

    Parameters
    ----------
    settings, law, memories, transit
        As of `PlainStep`.
    arm : ArmNumbers
        Model.

    Attributes
    ----------
    rows : array, shape (5 + 3 d, n)
        Measured position [rad] and velocity [rad/s], and the points of the reference.
    points : array, shape (3 (1 + d), n)
        View of these points.
    arm : CompiledArm
        Of the model.
    records : ControlRecords
        Arguments and results of the machine code.

    """

    def __init__(self, settings: ControlSettings, law: Any, memories: Memories, transit: Array,
                 arm: ArmNumbers) -> None:
        n = len(settings.zero)
        self.rows = np.zeros((5 + 3 * int(settings.delay), n))
        self.points = self.rows[2:]
        self.arm, self._irregularity = CompiledArm(arm, n), REGULAR
        result = packed(ControlOutput(*(settings.zero,) * 8))
        self._output_rows = np.frombuffer(result, float, 8 * n).reshape(8, n)
        self.records = ControlRecords(
            packed(settings), packed(law), packed(memories), packed(REGULAR), *self.arm.model,
            *(self.arm.add_terms() for _ in range(3)),  # type: ignore[call-arg]
            transit, self.rows[:2], result)
        super().__init__(self.arm.codes, run_step, (self.records, self.points),
                         f'control-{type(law).__name__}-{n}'.lower())

    @property
    def memories(self) -> Memories:
        """Return the memories after the last sample."""
        memories: Memories = load(self.records.memories)
        return memories

    @memories.setter
    def memories(self, memories: Memories) -> None:
        store(self.records.memories, memories)

    @property
    def law_memory(self) -> Any:
        """Return the memory of the law after the last sample."""
        return load(self.records.memories['law'])

    def step(self, rows: Array, irregularity: SampleIrregularity) -> list[list[float]]:
        """Go on by a sample, and return its `ControlOutput`, shape (8, n)."""
        self.rows[:] = rows
        if irregularity is not self._irregularity:
            self._irregularity = irregularity
            store(self.records.irregularity, irregularity)
        self.call()
        output: list[list[float]] = self._output_rows.tolist()
        return output


@function
def run_step(p: ControlRecords, points: Array) -> int:
    """
    Go on by a sample, and set `p.result`.

    Parameters
    ----------
    p : ControlRecords
        After the last sample, with the measured state.
    points : array, shape (3 (1 + d), n)
        The reference at this sample and those of the delay, and more.

    """
    memories, settings, irregularity = load(p.memories), load(p.settings), load(p.irregularity)
    like = memories.control.xi
    measured = rows(p.measured, like)
    model = CompiledModel(p.call, p.body)
    models = Models(EvaluatedModel(model, p.now), EvaluatedModel(model, p.arriving),
                    EvaluatedModel(model, p.after))
    context = Context(settings, models, rows(p.transit, like), memories.control,
                      rows(points, like), irregularity.reference_offset)
    output, memories_after = step(context, load(p.law), memories.law, memories.last,
                                  irregularity, measured[0], measured[1])
    store(p.memories, memories_after)
    store(p.result, output)
    return 0


@function
def apply_gains(p: ControlRecords, ka: Array) -> int:
    """
    Have law and memory follow other gains.

    `Controller.configure` does this with the same law.

    Parameters
    ----------
    p : ControlRecords
        With Kp and Kv in the settings.
    ka : array, shape (n,)
        Ka [N·m].

    """
    settings = load(p.settings)
    law = load(p.law).with_gains(settings.kp, settings.kv, rows(ka, settings.zero)[0])
    store(p.law, law)
    store(p.memories.law, law.reconfigured(load(p.memories.law)))
    return 0
