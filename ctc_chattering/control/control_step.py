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
The control step: a law at one sample, for any model.

It is a pure function of records, so that it runs as plain Python and compiled
(`numerics.compilable`); `Controller` is what users call. Vectors are arrays of shape (n,),
matrices of shape (n, n).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.control.delay_prediction import ROWS
from ctc_chattering.control.evaluation import (
    Context,
    ControlMemory,
    evaluated,
    losing,
    State,
)
from ctc_chattering.control.laws.base import Applied, Terms
from ctc_chattering.numerics.compilable import function, record
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class Step(NamedTuple):
    """What one control step computed."""

    #: The sample as the law takes it.
    now: State
    #: Of the torque, and the torque as it will be applied.
    parts: Terms
    sent: Applied
    memory: ControlMemory
    #: Of the law.
    law_memory: Any


def control_memory(held: Array, delay: int) -> ControlMemory:
    """Return the memory at the start, with the torque that is still held, shape (n,) [N·m]."""
    zero = np.zeros_like(held)
    return ControlMemory(zero, held, zero, float(-delay), 0.0, 0.0)


def in_transit(n: int, delay: int) -> Array:
    """Return no torques in transit, shape (4 delay, n)."""
    return np.zeros((ROWS * delay, n))


@function
def step(context: Context, law: Any, memory: ControlMemory, law_memory: Any, q: Array, dq: Array,
         points: Array) -> Step:
    """
    Return the torque of a sample, and what is remembered a period later.

    Parameters
    ----------
    context, law
        What is the same at all samples, and the law in force. The torque in transit that is
        applied now gives way to that of this sample.
    memory, law_memory
        After the last sample.
    q, dq : array, shape (n,)
        Measured position [rad] and velocity [rad/s].
    points : array, shape (3 (1 + d), n)
        q_d [rad], dq_d [rad/s] and ddq_d [rad/s²] of this sample and of those of the delay.

    """
    settings = context.settings
    limiter = settings.limiter
    law_memory, q, dq = law.corrected(law_memory, q, dq, memory.held)
    now = evaluated(settings, context.models.now, q, dq, points, 0, memory.xi)
    law_memory = law.updated(law_memory, now)
    terms, law_memory = law.answer(law_memory, now, context, memory, points)
    own = terms.nominal - terms.compensation - terms.robust
    tau, sent = own, Applied(own, settings.zero, settings.zero, terms.clipping_error)
    fading, difference, turn = memory.fading, memory.difference, memory.turn
    lossy = losing(settings, memory)
    if lossy:
        wanted = own
        if fading > 0.0:
            if memory.fresh != 0.0:
                difference = memory.held - own
            wanted = own + fading / settings.fading * difference
        fading = max(fading - 1.0, -settings.delay)
        tau = limiter.limit(wanted, memory.held)
        sent = Applied(tau, wanted - tau, own - tau, terms.clipping_error)
    applied = sent
    if settings.delay > 0.0:
        applied = exchanged(context.transit, ROWS * int(turn), sent)
        turn = (turn + 1.0) % settings.delay
    correction, xi = settings.zero, settings.filter.next_state(memory.xi, now.de, now.u)
    if lossy:
        correction = limiter.correction(now.M, applied.excess)
        xi = xi + correction
    law_memory = law.advanced(law_memory, now, applied, correction)
    return Step(now, terms, sent, ControlMemory(xi, tau, difference, fading, 0.0, turn),
                law_memory)


@function
def exchanged(transit: Array, row: int, sent: Applied) -> Applied:
    """Return the torque in transit from a row on, and put another one in its place."""
    applied = Applied(1.0 * transit[row], 1.0 * transit[row + 1], 1.0 * transit[row + 2],
                      1.0 * transit[row + 3])
    transit[row] = sent.tau
    transit[row + 1] = sent.saturation_error
    transit[row + 2] = sent.excess
    transit[row + 3] = sent.clipping_error
    return applied
