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

From one law to another the torque makes no step. The new law begins from the perturbation that
the old one estimates; if it acts on v and the old one did not, with v = 0. What its first torque
then still differs from the last one sent is added to it, and fades: after j samples there remains
1 - j / J of it, with J h = `FADE`. Anti-windup keeps it out of the filter (3), as what the limits
take from a torque. Between the two laws of the paper the chattering term comes and goes at once
instead.

The step is a pure function of records, so that it runs as plain Python and compiled
(`compiled.compilable`): `PlainStep` and `CompiledStep`. `Controller` is what
users call. Vectors are arrays of shape (n,), matrices of shape (n, n).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import function, record
from ctc_chattering.compiled.machine_code import Program
from ctc_chattering.compiled.records import load, packed, rows, store
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
    REGULAR,
    ROWS,
    State,
)
from ctc_chattering.control.laws.base import Applied, Law, Terms
from ctc_chattering.dynamics.compiled_model import Arm, CompiledArm, CompiledModel, EvaluatedModel
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: More periods without a state are no gap of states: the law goes on as if there were none.
MOST_MISSED = 50


@record
class Memories(NamedTuple):
    """What is remembered: by the control step, by the law, and of the last sample."""

    control: ControlMemory
    law: Any
    last: LastSample


@record
class Step(NamedTuple):
    """What one control step computed."""

    #: The sample as the law takes it.
    now: State
    #: Of the torque, and the torque as it will be applied.
    parts: Terms
    sent: Applied
    memories: Memories


class PlainStep:
    """
    The control step of a controller between two changes of its settings, in plain Python.

    Parameters
    ----------
    settings, law, memories
        As of `step`.
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
            Measured q and dq, and the points of `step`.
        arrival : Arrival
            Of the state.

        """
        made = step(self._context, self._law, self.memories, arrival, rows[0], rows[1], rows[2:])
        self.memories = made.memories
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
def step(context: Context, law: Any, memories: Memories, arrival: Arrival, q: Array, dq: Array,
         points: Array) -> Step:
    """
    Return the torque of a sample, and what is remembered a period later.

    Parameters
    ----------
    context, law
        What is the same at all samples, and the law in force. The torque in transit that is
        applied now gives way to that of this sample.
    memories : Memories
        After the last sample.
    arrival : Arrival
        Of the state. One that was not measured at the sample, or has not come, is replaced by
        (LS1).
    q, dq : array, shape (n,)
        Measured position [rad] and velocity [rad/s].
    points : array, shape (3 (1 + d), n)
        q_d [rad], dq_d [rad/s] and ddq_d [rad/s²] at the instants of the reference, of this
        sample and of those of the delay.

    """
    memory, law_memory, last = memories.control, memories.law, memories.last
    offset, s, reference = arrival.offset, arrival.after_points, points
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
    settings = context.settings
    limiter = settings.limiter
    law_memory, q, dq = law.corrected(law_memory, q, dq, memory.held)
    now = evaluated(settings, context.models.now, q, dq, reference, 0, memory.xi)
    law_memory = law.updated(law_memory, now)
    terms, law_memory = law.answer(law_memory, now, context, memory, reference)
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
    if arrival.kept != 0.0:
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
    memory = memory._replace(xi=xi, held=tau, difference=difference, fading=fading, fresh=0.0,
                             turn=turn)
    return Step(now, terms, sent, Memories(
        memory, law_memory, LastSample(now.q, now.dq, applied.tau)))


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


def taken_over(settings: ControlSettings, before: tuple[Law, Any], law: Law, memories: Memories,
               model: Evaluates, rows: Array) -> Memories:
    """
    Return the memories with which a law goes on after another one.

    Parameters
    ----------
    settings : ControlSettings
        Of the control step.
    before : tuple
        The old law and its memory.
    law : Law
        The new one.
    memories : Memories
        After the last sample; that of the law is the new one's, from before.
    model : Model
        M, C and G.
    rows : array, shape (5, n)
        Measured q, dq and desired q, dq, ddq of the sample to come.

    """
    (old, known), control = before, memories.control
    if law.acts_on_v and not old.acts_on_v:
        control = control._replace(xi=settings.filter.b * (rows[3] - rows[1]))
    now = evaluated(settings, model, rows[0], rows[1], rows[2:], 0, control.xi)
    if not (old.of_the_paper and law.of_the_paper):
        control = control._replace(fading=settings.fading, fresh=1.0)
    estimate = old.estimate(known, now) if old.estimates else None
    return memories._replace(
        control=control, law=law.initialized(memories.law, now, estimate))


#: Rows of what a step computes, those of `control.controller.Sample` in this order.
TAU, E, DE, V, NOMINAL, COMPENSATION, ROBUST, SATURATION_ERROR = range(8)


class ControlRecords(NamedTuple):
    """A controller, each part a NumPy record of what it is named after, or an array."""

    settings: Any
    law: Any
    memories: Any
    #: Of the state, `Arrival`.
    arrival: Any
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
    #: Position [rad] and velocity [rad/s], shape (2, n), and what is computed of it, (8, n).
    measured: Array
    made: Array


class CompiledStep(Program):
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
    measured, points : array, shape (2, n) and (3 (1 + d), n)
        Of `step`.
    arrival : NumPy record
        As `Arrival` is; that of a regular state until it is set.
    made : array, shape (8, n)
        What it computes.

    """

    def __init__(self, settings: ControlSettings, law: Any, memories: Memories, transit: Array,
                 arm: Arm) -> None:
        n = len(settings.zero)
        self.measured, self.made = np.zeros((2, n)), np.zeros((8, n))
        self.points = np.zeros((3 + 3 * int(settings.delay), n))
        self.arrival, self._arrival = packed(REGULAR), REGULAR
        self._arm = CompiledArm(arm, n)
        self._records = ControlRecords(
            packed(settings), packed(law), packed(memories), self.arrival, *self._arm.model,
            *(self._arm.place() for _ in range(3)),  # type: ignore[call-arg]
            transit, np.zeros_like(self.points), self.measured, self.made)
        super().__init__(self._arm.codes, stepped, (self._records, self.points),
                         f'control-{type(law).__name__}-{n}'.lower())

    @property
    def memories(self) -> Memories:
        """Return what is remembered; it may be set."""
        memories: Memories = load(self._records.memories)
        return memories

    @memories.setter
    def memories(self, memories: Memories) -> None:
        store(self._records.memories, memories)

    def step(self, rows: Array, arrival: Arrival) -> list[list[float]]:
        """Go on by a sample, and return the rows of `Sample`, shape (8, n)."""
        self.measured[:], self.points[:] = rows[:2], rows[2:]
        if arrival is not self._arrival:
            self._arrival = arrival
            store(self.arrival, arrival)
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
    memories = load(p.memories)
    like = memories.control.xi
    measured = rows(p.measured, like)
    model = CompiledModel(p.call, p.body)
    models = Models(EvaluatedModel(model, p.now), EvaluatedModel(model, p.arriving),
                    EvaluatedModel(model, p.after))
    context = Context(load(p.settings), models, rows(p.transit, like), rows(p.reference, like))
    found = step(context, load(p.law), memories, load(p.arrival), measured[0], measured[1],
                 rows(points, like))
    store(p.memories, found.memories)
    made, now, terms, sent = rows(p.made, like), found.now, found.parts, found.sent
    made[TAU], made[E], made[DE], made[V] = sent.tau, now.e, now.de, now.v
    made[NOMINAL], made[COMPENSATION] = terms.nominal, terms.compensation
    made[ROBUST], made[SATURATION_ERROR] = terms.robust, sent.saturation_error
    return 0
