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
The control step, which answers one sample by a law.

`Controller` calls it once a sample, as plain Python (`PlainStep`) or machine code
(`compiled_step.py`). It is a pure function of records. One sample is, in this order:

1. the state at the sample, if it was measured later or not at all (`irregular_sample.py`);
2. the law's answer, for the state in which the torque arrives (`delay.py`);
3. the offset of a hand-over (`handover.py`), and the limits of torque and rate;
4. filter (3) and law a period later, under the torque that is applied.

The limits take the saturation error from the torque. In the closed loop (8) it acts like a
perturbation. Anti-windup keeps it out of the filter.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import function, record
from ctc_chattering.control.delay import exchange_torque
from ctc_chattering.control.handover import handover_offset
from ctc_chattering.control.irregular_sample import SampleIrregularity, state_at_sample
from ctc_chattering.control.sample import (
    Applied,
    Context,
    ControlMemory,
    evaluate_state,
    LastSample,
    Memories,
    Models,
)
from ctc_chattering.control.settings import ControlSettings
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class ControlOutput(NamedTuple):
    """
    Result of a sample, as `control.controller.Sample`.

    Its fields are arrays of shape (n,).
    """

    tau: Array
    e: Array
    de: Array
    v: Array
    nominal: Array
    compensation: Array
    robust: Array
    saturation_error: Array


@function
def step(context: Context, law: Any, law_memory: Any, last: LastSample,
         irregularity: SampleIrregularity, q: Array, dq: Array) -> tuple[ControlOutput, Memories]:
    """
    Return result and memories of a sample.

    Parameters
    ----------
    context : Context
        Of the sample. The torque in transit that is applied now gives way to this sample's.
    law, law_memory
        Law in force, and its memory after the last sample.
    last : LastSample
        That sample.
    irregularity : SampleIrregularity
        Of this sample.
    q, dq : array, shape (n,)
        Measured position [rad] and velocity [rad/s].

    """
    settings, memory = context.settings, context.memory
    if irregularity.offset != 0.0 or irregularity.is_measured == 0.0:
        q, dq = state_at_sample(law, law_memory, last, context, irregularity, q, dq)
    law_memory, measured = law.corrected(law_memory, q, dq, memory.held)
    now = evaluate_state(settings, context.models.now, measured.q, measured.dq,
                         context.reference_at(0), memory.xi)
    law_memory = law.updated(law_memory, now)
    terms, law_memory = law.answer(law_memory, now, context)

    torque = terms.nominal - terms.compensation - terms.robust
    sent = Applied(torque, settings.zero, settings.zero, terms.clipping_error)
    offset, samples_left = memory.handover_offset, memory.handover_samples_left
    modified = context.torque_is_modified()
    if modified:
        smooth = torque
        if samples_left > 0.0:
            offset = handover_offset(settings, memory, torque)
            smooth = torque + samples_left / settings.handover_samples * offset
        samples_left = max(samples_left - 1.0, -settings.delay)
        tau = settings.limit(smooth, memory.held)
        sent = Applied(tau, smooth - tau, torque - tau, terms.clipping_error)
    if irregularity.keeps_torque != 0.0:
        sent = Applied(memory.held, settings.zero, settings.zero, settings.zero)

    applied, transit_index = sent, memory.transit_index
    if settings.delay > 0.0:
        applied = exchange_torque(context.transit, context.transit_row(0), sent)
        transit_index = (transit_index + 1.0) % settings.delay
    xi = settings.filter.next_state(memory.xi, now.de, now.u)
    if modified:
        applied = applied._replace(excess=settings.anti_windup * applied.excess)
        xi = xi + settings.filter.correction(now.M, applied.excess)
    law_memory = law.advanced(law_memory, now, applied)
    return (
        ControlOutput(sent.tau, now.e, now.de, now.v, terms.nominal, terms.compensation,
                      terms.robust, sent.saturation_error),
        Memories(ControlMemory(xi, sent.tau, offset, samples_left, transit_index), law_memory,
                 LastSample(now.q, now.dq, applied.tau)))


class PlainStep:
    """
    The step of a controller in plain Python.

    It lasts until the next change of settings.

    Parameters
    ----------
    settings, law, memories
        Of the step.
    transit : array, shape (4 d, n)
        Torques in transit, not copied.
    model : Model
        M, C and G.

    Attributes
    ----------
    memories : Memories
        May be set.

    """

    compiled = False

    def __init__(self, settings: ControlSettings, law: Any, memories: Memories, transit: Array,
                 model: Model) -> None:
        self.memories, self._law = memories, law
        self._fixed = settings, Models(model, model, model), transit

    @property
    def law_memory(self) -> Any:
        """Return the memory of the law after the last sample."""
        return self.memories.law

    def use_model(self, model: Model) -> None:
        """Take another model, as of the next sample."""
        settings, _, transit = self._fixed
        self._fixed = settings, Models(model, model, model), transit

    def step(self, rows: Array, irregularity: SampleIrregularity) -> list[list[float]]:
        """
        Return the `ControlOutput` of a sample, shape (8, n).

        Parameters
        ----------
        rows : array, shape (5 + 3 d, n)
            Measured q and dq, and the points of the reference.
        irregularity : SampleIrregularity
            Of the sample.

        """
        control, law_memory, last = self.memories
        context = Context(*self._fixed, control, rows[2:], irregularity.reference_offset)
        output, self.memories = step(
            context, self._law, law_memory, last, irregularity, rows[0], rows[1])
        return list(map(np.ndarray.tolist, output))
