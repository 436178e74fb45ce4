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

Filter
------
The filter (3), with b > 0, λ > 0 and a state ξ that needs no acceleration. In continuous time
``v = -b de + ξ`` with ``dξ/dt = -λ ξ + b [(λ I - Kv) de - Kp e]``, ξ(0) = 0.
Sampled, with the bracket held over each period h, this has the exact solution::

    ξ[k+1] = exp(-λ h) ξ[k] + (1 - exp(-λ h)) / λ · b [λ de - u],     u = Kv de + Kp e

Limits
------
Of the torque and of its rate, with the anti-windup of the filter (3). The saturation error, what
the limits take from the torque, acts in the closed loop (8) like a perturbation: over one period
it changes v by -b h M⁻¹ times itself. Added to ξ with the opposite sign, it leaves v as it would
be without limits.

Delay
-----
Under a known input delay the law is evaluated at the state predicted for when its torque is
applied. The prediction runs model, reference and filter ahead under the torques in transit.
Filter and observer themselves advance with what is measured and applied.
"""

from __future__ import annotations

from math import exp, expm1, inf
from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import dot, function, record, solve, some
from ctc_chattering.compiled.machine_code import Program
from ctc_chattering.compiled.records import load, packed, rows, store
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.dynamics.compiled_model import Arm, CompiledArm, CompiledModel, EvaluatedModel
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.time_grid import period_ns, seconds
from ctc_chattering.parameters import matrix
import numpy as np

#: Time over which the difference of two laws fades [s].
FADE = 0.2
#: Rows of a torque in transit.
ROWS = 4


@record
class ErrorFilter(NamedTuple):
    """Coefficients of the filter (3), made by `error_filter`."""

    #: λ [1/s] and b.
    pole: float
    b: float
    #: exp(-λ h), c = b (1 - exp(-λ h)) / λ, b h and b h - c.
    decay: float
    gain: float
    scale: float
    rest: float

    def output(self, de: Array, xi: Array) -> Array:
        """Return v, shape (n,) [rad/s], at the velocity error `de` and the state ξ."""
        return xi - self.b * de

    def next_state(self, xi: Array, de: Array, u: Array) -> Array:
        """
        Return ξ, shape (n,), one period later.

        Parameters
        ----------
        xi : array, shape (n,)
            ξ [rad/s].
        de : array, shape (n,)
            Velocity error [rad/s].
        u : array, shape (n,)
            Kv de + Kp e [rad/s²].

        """
        return self.decay * xi + self.gain * (self.pole * de - u)

    def nominal_response(self, v: Array, u: Array) -> Array:
        """
        Return y: what v would be a period later if dde + Kv de + Kp e were 0, shape (n,) [rad/s].

        It is exp(-λ h) v + (b h - c) u, with c the gain of the filter's input; the second part is
        of the order of h². Arguments as `next_state` has them.
        """
        return self.decay * v + self.rest * u

    def correction(self, mass: Array, excess: Array) -> Array:
        """Return what anti-windup adds to ξ for `excess` of `Applied`, shape (n,) [rad/s]."""
        return self.scale * solve(mass, excess) if some(excess) else excess


def error_filter(pole: float, b: float, period: float) -> ErrorFilter:
    """Return the filter with λ [1/s], b and the sample period [s]."""
    gain = -b * expm1(-pole * period) / pole
    return ErrorFilter(pole, b, exp(-pole * period), gain, b * period, b * period - gain)


@record
class ControlSettings(NamedTuple):
    """What is common to all laws; made by `control_settings`."""

    #: h [s], the input delay in samples, and `FADE` in samples.
    period: float
    delay: float
    fading: float
    #: Kp [1/s²] and Kv [1/s], shape (n, n).
    kp: Array
    kv: Array
    filter: ErrorFilter  # noqa: A003
    #: Largest torque, and largest change of it in a period, shape (n,) [N·m]; inf for unlimited.
    effort: Array
    change: Array
    #: Whether there are limits, and whether the filter does not wind up at them; 1.0 or 0.0.
    limited: float
    anti_windup: float
    #: n zeros.
    zero: Array

    def limit(self, unsaturated: Array, held: Array) -> Array:
        """Return the torque to send after the torque `held`, shape (n,) [N·m]."""
        near = np.minimum(np.maximum(unsaturated, held - self.change), held + self.change)
        return np.minimum(np.maximum(near, -self.effort), self.effort)


@record
class Models(NamedTuple):
    """
    One model for the states that are evaluated side by side.

    Compiled code keeps M and C of each in a place of its own.
    """

    #: Of the sample, of the arrival of its torque, and of a period later; each a `Model`, or what
    #: compiled code has in its place.
    now: Any
    arriving: Any
    after: Any


@record
class State(NamedTuple):
    """
    A state and a reference, with what all laws need of them; arrays of shape (n,), or (n, n).

    Attributes
    ----------
    q, dq : ndarray
        Position [rad] and velocity [rad/s].
    dq_d, ddq_d : ndarray
        Desired velocity [rad/s] and acceleration [rad/s²].
    e, de : ndarray
        Errors [rad, rad/s].
    u : ndarray
        Kv de + Kp e [rad/s²].
    v : ndarray
        Filtered error [rad/s].
    M, C : ndarray, shape (n, n)
        Mass matrix [kg·m²] and Coriolis matrix [kg·m²/s] of the model.
    G, bias : ndarray
        Gravity, and C dq + G [N·m].
    N : ndarray
        M (ddq_d + u) + C dq + G [N·m].
    zero : ndarray
        n zeros, for terms that a law does not have.

    """

    q: Array
    dq: Array
    dq_d: Array
    ddq_d: Array
    e: Array
    de: Array
    u: Array
    v: Array
    M: Array
    C: Array
    G: Array
    bias: Array
    N: Array
    zero: Array


@record
class ControlMemory(NamedTuple):
    """What the control step remembers, besides the memory of the law and torques in transit."""

    #: ξ of the filter [rad/s], shape (n,).
    xi: Array
    #: Torque sent last, shape (n,) [N·m].
    held: Array
    #: Of a law that took over (`taken_over`): what its torque differed from the one sent, shape
    #: (n,) [N·m]; for how many samples it is still added, -d once none of it is in transit.
    difference: Array
    fading: float
    #: Which of the torques in transit is applied next.
    turn: float


@record
class Context(NamedTuple):
    """What surrounds the state of a sample."""

    settings: ControlSettings
    models: Models
    #: Torques in transit: `Applied` in four rows each, shape (4 d, n).
    transit: Array
    memory: ControlMemory
    #: q_d [rad], dq_d [rad/s] and ddq_d [rad/s²] of this sample and of those of the delay, shape
    #: (3 (1 + d), n).
    points: Array

    def row(self, j: int) -> int:
        """Return the first row of the torque in transit that is applied j periods from now."""
        return ROWS * ((int(self.memory.turn) + j) % int(self.settings.delay))

    def in_transit(self, j: int) -> Array:
        """Return that torque, shape (n,) [N·m]."""
        torque: Array = self.transit[self.row(j)]
        return torque


@record
class LastSample(NamedTuple):
    """The sample before, from which a state is predicted; arrays of shape (n,)."""

    #: Position [rad] and velocity [rad/s] as the law took them.
    q: Array
    dq: Array
    #: Torque that acts from then on [N·m].
    applied: Array


@record
class Arrival(NamedTuple):
    """What is irregular about the state of a sample; truth values are 1.0 and 0.0."""

    #: How long after the sample it was measured, δ [s].
    offset: float
    #: How long after the instants of the reference that is given the sample is [s].
    after_points: float
    #: Whether it has come; else the state that is predicted takes its place.
    measured: float
    #: Whether the torque sent last has been kept.
    kept: float


#: A state that was measured at its sample.
REGULAR = Arrival(0.0, 0.0, 1.0, 0.0)


@function
def losing(settings: ControlSettings, memory: ControlMemory) -> bool:
    """Return whether a torque that is applied may be another one than that of its law."""
    return settings.limited != 0.0 or memory.fading > -settings.delay


def control_settings(config: ControllerConfig, effort_limits: Vector) -> ControlSettings:
    """Return the settings of a configuration, with the effort limits of its model [N·m]."""
    n, h = len(config.joint_names), seconds(period_ns(config.control_period))
    effort = np.array(config.largest_torque(effort_limits))
    change = h * np.array(config.effort_rate_limit)
    limited = float(min(effort.min(), change.min()) < inf)
    return ControlSettings(
        h, float(config.input_delay), float(max(round(FADE / h), 1)),
        np.array(matrix(config.kp, n)), np.array(matrix(config.kv, n)),
        error_filter(config.lambda_, config.b, h), effort, change, limited,
        float(config.anti_windup), np.zeros(n))


@function
def evaluated(settings: ControlSettings, model: Any, q: Array, dq: Array, points: Array, i: int,
              xi: Array) -> State:
    """Return the state for row i of the reference, and the state ξ of the filter."""
    q_d, dq_d, ddq_d = points[i], points[i + 1], points[i + 2]
    e, de = q_d - q, dq_d - dq
    u = dot(settings.kv, de) + dot(settings.kp, e)
    v = settings.filter.output(de, xi)                               # (3)
    M, C, G = model.evaluate(q, dq)
    bias = dot(C, dq) + G
    N = dot(M, ddq_d + u) + bias                                     # inverse dynamics
    return State(q, dq, dq_d, ddq_d, e, de, u, v, M, C, G, bias, N, settings.zero)


@function
def arriving(law: Any, law_memory: Any, now: State, context: Context) -> State:
    """
    Return the state in which the torque of this sample is applied; `now` without a delay.

    Parameters
    ----------
    law, law_memory
        Law in force, and its memory: of what acts until the torque arrives.
    now : State
        Measured.
    context : Context
        Of the sample.

    """
    settings, at, xi, model = context.settings, now, context.memory.xi, context.models.arriving
    if settings.delay == 0.0:
        return now
    perturbation = law.acting(law_memory, now)
    lossy = losing(settings, context.memory)
    for j in range(int(settings.delay)):
        row = context.row(j)
        xi = settings.filter.next_state(xi, at.de, at.u)
        if lossy:
            excess = settings.anti_windup * context.transit[row + 2]
            xi = xi + settings.filter.correction(at.M, excess)
        q, dq = predict(model, at, context.transit[row] - perturbation, settings.period)
        at = evaluated(settings, model, q, dq, context.points, 3 * j + 3, xi)
    return at


@function
def predict(model: Model, at: State, u: Array, h: float) -> tuple[Array, Array]:
    """
    Return q and dq after one period under a held torque, by the midpoint rule.

    Parameters
    ----------
    model : Model
        As the controller knows it.
    at : State
        Now.
    u : array, shape (n,)
        Torque less the perturbation [N·m].
    h : float
        Period [s].

    """
    middle = at.dq + 0.5 * h * solve(at.M, u - at.bias)
    return at.q + h * middle, at.dq + h * model.forward(at.q + 0.5 * h * at.dq, middle, u)


@record
class Terms(NamedTuple):
    """
    What a torque is made of: nominal - compensation - robust, each of shape (n,) [N·m].

    Attributes
    ----------
    nominal : ndarray
        What the model and the feedback ask for.
    compensation : ndarray
        C v of the paper's laws.
    robust : ndarray
        What acts against the perturbation: chattering, integral, estimate.
    clipping_error : ndarray
        What ±Ka has taken from the chattering term.

    """

    nominal: Array
    compensation: Array
    robust: Array
    clipping_error: Array


@record
class Applied(NamedTuple):
    """
    A torque when it is applied, and what is remembered of it, each of shape (n,) [N·m].

    Attributes
    ----------
    tau, saturation_error : ndarray
        Within the limits, and what these have taken from it.
    excess : ndarray
        Torque of the law alone less ``tau``, which the filter does not see; to `advanced` 0 for
        no anti-windup.
    clipping_error : ndarray
        As in `Terms`.

    """

    tau: Array
    saturation_error: Array
    excess: Array
    clipping_error: Array


#: More periods without a state are no gap of states: the law goes on as if there were none.
MOST_MISSED = 50


@record
class Memories(NamedTuple):
    """What is remembered: by the control step, by the law, and of the last sample."""

    control: ControlMemory
    law: Any
    last: LastSample


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
def at_sample(points: Array, after: float, delay: float, room: Array) -> Array:
    """Return the 1 + d points of a reference `after` [s] their instants."""
    if after == 0.0:
        return points
    for i in range(0, 3 + 3 * int(delay), 3):
        room[i] = points[i] + after * (points[i + 1] + 0.5 * after * points[i + 2])
        room[i + 1] = points[i + 1] + after * points[i + 2]
        room[i + 2] = 1.0 * points[i + 2]
    return room


@function
def step(context: Context, law: Any, law_memory: Any, last: LastSample, arrival: Arrival,
         q: Array, dq: Array) -> tuple[State, Terms, Applied, Memories]:
    """
    Return the sample as the law takes it, its torque, and what is remembered a period later.

    The torque is returned as the law has it, and as it will be applied.

    Parameters
    ----------
    context : Context
        Of the sample, with what the step remembers. The torque in transit that is applied now
        gives way to that of this sample.
    law, law_memory
        The law in force, and what it remembers after the last sample.
    last : LastSample
        That sample.
    arrival : Arrival
        Of the state. One that was not measured at the sample, or has not come, is replaced by
        (LS1).
    q, dq : array, shape (n,)
        Measured position [rad] and velocity [rad/s].

    """
    settings, memory, offset = context.settings, context.memory, arrival.offset
    if offset != 0.0 or arrival.measured == 0.0:
        next_q, next_dq = law.predicted_state(law_memory, last, context)
        a = (next_dq - last.dq) / settings.period
        if arrival.measured == 0.0:
            q, dq = next_q, next_dq
        else:
            q, dq = q - offset * (next_dq + 0.5 * offset * a), dq - offset * a
    law_memory, q, dq = law.corrected(law_memory, q, dq, memory.held)
    now = evaluated(settings, context.models.now, q, dq, context.points, 0, memory.xi)
    law_memory = law.updated(law_memory, now)
    terms, law_memory = law.answer(law_memory, now, context)
    own = terms.nominal - terms.compensation - terms.robust
    tau, sent = own, Applied(own, settings.zero, settings.zero, terms.clipping_error)
    fading, difference, turn = memory.fading, memory.difference, memory.turn
    lossy = losing(settings, memory)
    if lossy:
        wanted = own
        if fading > 0.0:
            if fading == settings.fading:
                difference = memory.held - own
            wanted = own + fading / settings.fading * difference
        fading = max(fading - 1.0, -settings.delay)
        tau = settings.limit(wanted, memory.held)
        sent = Applied(tau, wanted - tau, own - tau, terms.clipping_error)
    if arrival.kept != 0.0:
        tau = memory.held
        sent = Applied(tau, settings.zero, settings.zero, settings.zero)
    applied = sent
    if settings.delay > 0.0:
        applied = exchanged(context.transit, context.row(0), sent)
        turn = (turn + 1.0) % settings.delay
    xi, excess = settings.filter.next_state(memory.xi, now.de, now.u), settings.zero
    if lossy:
        excess = settings.anti_windup * applied.excess
        xi = xi + settings.filter.correction(now.M, excess)
    law_memory = law.advanced(law_memory, now, applied._replace(excess=excess))
    return now, terms, sent, Memories(
        ControlMemory(xi, tau, difference, fading, turn), law_memory,
        LastSample(now.q, now.dq, applied.tau))


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


def taken_over(settings: ControlSettings, before: tuple[Any, Any], law: Any, memories: Memories,
               model: Model, rows: Array) -> Memories:
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
        After the last sample; that of the law is the new one's, at the start.
    model : Model
        M, C and G.
    rows : array, shape (5, n)
        Measured q, dq and desired q, dq, ddq of the sample to come.

    """
    (old, known), control, of_law = before, memories.control, memories.law
    if law.acts_on_v and not old.acts_on_v:
        control = control._replace(xi=settings.filter.b * (rows[3] - rows[1]))
    now = evaluated(settings, model, rows[0], rows[1], rows[2:], 0, control.xi)
    if not (old.of_the_paper and law.of_the_paper):
        control = control._replace(fading=settings.fading)
    if old.estimates:
        of_law = law.initialized(now, old.estimate(known, now))
    return Memories(control, of_law, memories.last)


class PlainStep:
    """
    The control step of a controller between two changes of its settings, in plain Python.

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
        self._room = np.zeros((3 + 3 * int(settings.delay), len(settings.zero)))

    @property
    def law_memory(self) -> Any:
        """Return what the law remembers."""
        return self.memories.law

    def step(self, rows: Array, arrival: Arrival) -> list[list[float]]:
        """
        Go on by a sample, and return the rows of `Sample`, shape (8, n).

        Parameters
        ----------
        rows : array, shape (5 + 3 d, n)
            Measured q and dq, and the points of the reference.
        arrival : Arrival
            Of the state.

        """
        control, of_law, last = self.memories
        points = at_sample(
            rows[2:], arrival.after_points, self._fixed[0].delay, self._room)
        now, terms, sent, self.memories = step(
            Context(*self._fixed, control, points), self._law, of_law, last, arrival, rows[0],
            rows[1])
        return [x.tolist() for x in (sent.tau, now.e, now.de, now.v, terms.nominal,
                                     terms.compensation, terms.robust, sent.saturation_error)]


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
    arm : CompiledArm
        Of the model.
    records : ControlRecords
        What it computes with.

    """

    def __init__(self, settings: ControlSettings, law: Any, memories: Memories, transit: Array,
                 arm: Arm) -> None:
        n = len(settings.zero)
        self.measured, self.made = np.zeros((2, n)), np.zeros((8, n))
        self.points = np.zeros((3 + 3 * int(settings.delay), n))
        self.arrival, self._arrival = packed(REGULAR), REGULAR
        self.arm = CompiledArm(arm, n)
        self.records = ControlRecords(
            packed(settings), packed(law), packed(memories), self.arrival, *self.arm.model,
            *(self.arm.add_terms() for _ in range(3)),  # type: ignore[call-arg]
            transit, np.zeros_like(self.points), self.measured, self.made)
        super().__init__(self.arm.codes, stepped, (self.records, self.points),
                         f'control-{type(law).__name__}-{n}'.lower())

    @property
    def memories(self) -> Memories:
        """Return what is remembered; it may be set."""
        memories: Memories = load(self.records.memories)
        return memories

    @memories.setter
    def memories(self, memories: Memories) -> None:
        store(self.records.memories, memories)

    @property
    def law_memory(self) -> Any:
        """Return what the law remembers."""
        return load(self.records.memories['law'])

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
    settings, arrival, measured = load(p.settings), load(p.arrival), rows(p.measured, like)
    model = CompiledModel(p.call, p.body)
    models = Models(EvaluatedModel(model, p.now), EvaluatedModel(model, p.arriving),
                    EvaluatedModel(model, p.after))
    reference = at_sample(
        rows(points, like), arrival.after_points, settings.delay, rows(p.reference, like))
    context = Context(settings, models, rows(p.transit, like), memories.control, reference)
    now, terms, sent, after = step(context, load(p.law), memories.law, memories.last, arrival,
                                   measured[0], measured[1])
    store(p.memories, after)
    made = rows(p.made, like)
    made[TAU], made[E], made[DE], made[V] = sent.tau, now.e, now.de, now.v
    made[NOMINAL], made[COMPENSATION] = terms.nominal, terms.compensation
    made[ROBUST], made[SATURATION_ERROR] = terms.robust, sent.saturation_error
    return 0


@function
def regained(p: ControlRecords, ka: Array) -> int:
    """
    Have law and memory follow other gains, as `Controller.configure` does with the same law.

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
