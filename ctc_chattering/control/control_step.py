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
The control step: a law at one sample, for any model, and at the instants of the states.

The samples of a law are a period h apart, whatever the stamps say. For each period without a
state the law goes on with the state that it predicts, under the torque that acted. A state that
was measured a time δ after a sample is taken back to it along the predicted motion::

    q - δ (dq + ½ δ a),     dq - δ a,     a = (dq - dq of the sample before) / h         (LS1)

Where clocks differ the samples follow the stamps, so that |δ| stays below 0.45 h.

It is a pure function of records, so that it runs as plain Python and compiled
(`numerics.compilable`); `Controller` is what users call. Vectors are arrays of shape (n,),
matrices of shape (n, n).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.control.delay_prediction import ROWS
from ctc_chattering.control.evaluation import (
    Arrival,
    Context,
    ControlMemory,
    ControlSettings,
    evaluated,
    Evaluates,
    LastSample,
    losing,
    Models,
    State,
)
from ctc_chattering.control.laws.base import Applied, Terms
from ctc_chattering.numerics.compilable import function, record
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: More periods without a state are no gap of states: the law goes on as if there were none.
MOST_MISSED = 50


@record
class Step(NamedTuple):
    """What one control step computed."""

    #: The sample as the law takes it.
    now: State
    #: Of the torque, and the torque as it will be applied.
    parts: Terms
    sent: Applied
    #: The torque that acts from now on.
    applied: Applied
    memory: ControlMemory
    #: Of the law.
    law_memory: Any


#: What is remembered: by the control step, by the law, and of the last sample.
Memories = tuple[ControlMemory, Any, LastSample]


class PlainStep:
    """
    The control step of a controller between two changes of its settings, in plain Python.

    Parameters
    ----------
    settings, law, memories
        As of `step_at`.
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
                 model: Evaluates) -> None:
        self.memories, self._law = memories, law
        self._context = Context(settings, Models(model, model, model), transit, np.zeros(
            (3 + 3 * int(settings.delay), len(settings.zero))))

    def step(self, rows: Array, arrival: Arrival) -> list[list[float]]:
        """
        Go on by a sample, and return the rows of `Sample`, shape (8, n).

        Parameters
        ----------
        rows : array, shape (5 + 3 d, n)
            Measured q and dq, and the points of `step_at`.
        arrival : Arrival
            Of the state.

        """
        memory, of_law, last = self.memories
        made, last = step_at(self._context, self._law, memory, of_law, last, arrival, rows[0],
                             rows[1], rows[2:])
        self.memories = made.memory, made.law_memory, last
        now, terms, sent = made.now, made.parts, made.sent
        return [x.tolist() for x in (sent.tau, now.e, now.de, now.v, terms.nominal,
                                     terms.compensation, terms.robust, sent.saturation_error)]


def control_memory(held: Array, delay: int) -> ControlMemory:
    """Return the memory at the start, with the torque that is still held, shape (n,) [N·m]."""
    zero = np.zeros_like(held)
    return ControlMemory(zero, held, zero, float(-delay), 0.0, 0.0)


def in_transit(n: int, delay: int) -> Array:
    """Return no torques in transit, shape (4 delay, n)."""
    return np.zeros((ROWS * delay, n))


def first_sample(n: int) -> LastSample:
    """Return that there was no sample of n joints."""
    zero = np.zeros(n)
    return LastSample(zero, zero, zero)


@function
def periods(h: int, offset: int, elapsed: int) -> tuple[int, int]:
    """
    Return the periods without a state before one, and how long after its sample it was measured.

    Parameters
    ----------
    h, offset : int
        Period, and what was returned for the state before; 0 for the first [ns].
    elapsed : int
        Since that state [ns].

    """
    since = offset + elapsed
    count = max((since + h // 2) // h, 1)
    if since <= 0 or count > MOST_MISSED + 1:
        return 0, 0
    largest = h * 9 // 20
    return count - 1, min(max(since - count * h, -largest), largest)


@function
def step_at(context: Context, law: Any, memory: ControlMemory, law_memory: Any, last: LastSample,
            arrival: Arrival, q: Array, dq: Array, points: Array) -> tuple[Step, LastSample]:
    """
    Return `step` for a state that was not measured at the sample, or has not come, by (LS1).

    Parameters
    ----------
    context, law, memory, law_memory, q, dq, points
        As of `step`, but for the instants of state and reference.
    last : LastSample
        The sample before.
    arrival : Arrival
        Of the state.

    """
    offset, s = arrival.offset, arrival.after_points
    reference = points
    if s != 0.0:
        reference = context.reference
        for i in range(0, 3 + 3 * int(context.settings.delay), 3):
            reference[i] = points[i] + s * (points[i + 1] + 0.5 * s * points[i + 2])
            reference[i + 1] = points[i + 1] + s * points[i + 2]
            reference[i + 2] = 1.0 * points[i + 2]
    if offset != 0.0 or arrival.measured == 0.0:
        next_q, next_dq = law.predicted_state(law_memory, last, context, memory, reference)
        a = (next_dq - last.dq) / context.settings.period
        if arrival.measured == 0.0:
            q, dq = next_q, next_dq
        else:
            q, dq = q - offset * (next_dq + 0.5 * offset * a), dq - offset * a
    made = step(context, law, memory, law_memory, q, dq, reference, arrival.kept != 0.0)
    return made, LastSample(made.now.q, made.now.dq, made.applied.tau)


@function
def step(context: Context, law: Any, memory: ControlMemory, law_memory: Any, q: Array, dq: Array,
         points: Array, kept: bool = False) -> Step:
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
    kept : bool
        Whether the torque sent last stays in force.

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
    if kept:
        tau = memory.held
        sent = Applied(tau, settings.zero, settings.zero, settings.zero)
    applied = sent
    if settings.delay > 0.0:
        applied = exchanged(context.transit, ROWS * int(turn), sent)
        turn = (turn + 1.0) % settings.delay
    correction, xi = settings.zero, settings.filter.next_state(memory.xi, now.de, now.u)
    if lossy:
        correction = limiter.correction(now.M, applied.excess)
        xi = xi + correction
    law_memory = law.advanced(law_memory, now, applied, correction)
    return Step(now, terms, sent, applied,
                memory._replace(xi=xi, held=tau, difference=difference, fading=fading, fresh=0.0,
                                turn=turn), law_memory)


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
