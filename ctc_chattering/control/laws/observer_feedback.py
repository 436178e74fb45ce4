"""
Law `observer_feedback`: computed torque on an observed state, for drives and encoders as they are.

An observer that has the perturbation as a state (Han, *From PID to active disturbance rejection
control*, IEEE TIE 56, 2009), with the bound Ka of the paper's law (6). At every sample, with what
`state_observer`, `feasible_reference`, `friction_level` and `drive_model` define::

    q̂, dq̂, P̂, Ṗ̂:  corrected by the measured q, then predicted until the torque arrives     (1)
    τ* = M (ddq_r + Kv (dq_r - dq̂) + Kp (q_r - q̂)) + C dq̂ + G - z                         (2)
    z  = -(P̂ + F), the nearest within ±Ka in the metric of M⁻¹                             (3)
    τ  = the command by which the drives give τ* at arrival and a period later             (4)

q_r is the reference with the deviation that the drives need, F the friction it makes. τ is within
R (T + h) of the torque of the drives, in the metric of M⁻¹: beyond it they are no faster. The
measured velocity is not used after the first sample.

With M̂ = c M, drives without lag and limits, and no friction, (1) to (3) are linear. Their poles
are within the unit circle, for Kp = p², Kv = 2 p, p = 100 rad/s, ω = 100 rad/s, h = 1 ms, if::

    0.47 < c < 3.1                                                                         (5)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.drive_model import drive_model
from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.feasible_reference import (
    Desired,
    Deviation,
    feasible_reference,
    FeasibleReference,
)
from ctc_chattering.control.friction_level import (
    friction_level,
    FrictionLevel,
    Learned,
    untaught,
)
from ctc_chattering.control.laws.base import Law, State, Terms, Torque
from ctc_chattering.control.state_observer import Observed, state_observer, StateObserver
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.compilable import diagonal, dot, record
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import matrix
import numpy as np


@record
class Memory(NamedTuple):
    """What the law remembers from sample to sample; truth values are 1.0 and 0.0."""

    #: The state, predicted from the last sample with M there, (n, n), and whether there is one.
    observed: Observed
    mass: Array
    known: float
    #: K̂ as learned so far.
    learned: Learned
    #: x and dx of the reference, and whether they have begun.
    deviation: Deviation
    deviating: float
    #: The last ddq_d [rad/s²], shape (n,), and whether there is one.
    ddq: Array
    followed: float


@record
class Answer(NamedTuple):
    """A torque that is wanted at arrival, and what goes with it; arrays of shape (n,)."""

    #: τ* and z of (2) and (3) [N·m].
    tau: Array
    z: Array
    #: The deviation a period later.
    by: Deviation


@record
class Feedback(NamedTuple):
    """Equations (1) to (4) with their gains; made by `feedback`."""

    #: Kp [1/s²] and Kv [1/s], shape (n, n), and Ka [N·m], shape (n,).
    kp: Array
    kv: Array
    ka: Array
    #: Whether a drive has a lag, 1.0 or 0.0.
    lagging: float
    observer: StateObserver
    reference: FeasibleReference
    learning: FrictionLevel

    def observe(self, memory: Memory, q: Array, dq: Array, held: Array) -> Observed:
        """Return the state by (1), of the measured one and the torque that was sent last."""
        if memory.known != 0.0:
            return self.observer.correct(memory.observed, memory.mass, q)
        return Observed(q, dq, held, 0.0 * q, 0.0 * q)

    def wanted(self, at: Observed, M: Array, bias: Array, point: Desired, by: Deviation,
               level: Array) -> tuple[Array, Array]:
        """Return τ* of (2) and z of (3), with the bias C dq + G."""
        r = self.reference.shifted(point, by, diagonal(M), level)
        z = -nearest(M, at.perturbation + self.reference.feedforward(point, level, 0.0), self.ka)
        u = dot(self.kv, r.dq - at.dq) + dot(self.kp, r.q - at.q)
        return dot(M, r.ddq + u) + bias - z, z

    def answer(self, memory: Memory, at: Observed, M: Array, bias: Array, point: Desired
               ) -> Answer:
        """Return what is wanted of drives without a lag, in the state in which it arrives."""
        level, by = memory.learned.level, memory.deviation
        if memory.deviating == 0.0:
            by = Deviation(at.q - point.q, at.dq - point.dq)
        tau, z = self.wanted(at, M, bias, point, by, level)
        return Answer(tau, z, self.reference.following(point, by, diagonal(M), level))

    def next_state(self, memory: Memory, answer: Answer, at: Observed, M: Array, bias: Array
                   ) -> Observed:
        """Return the state a period after the arrival, with the drives half way to τ*."""
        half = 0.5 * (at.torque + answer.tau)
        return self.observer.predict(Observed(at.q, at.dq, half, at.perturbation, at.slope), M,
                                     bias, memory.learned.level, half)

    def next_point(self, memory: Memory, point: Desired) -> Desired:
        """Return the point of the reference a period after `point`, with the last jerk."""
        h, step = self.reference.period, memory.followed * (point.ddq - memory.ddq)
        return Desired(point.q + h * (point.dq + h * (0.5 * point.ddq + step / 6.0)),
                       point.dq + h * (point.ddq + 0.5 * step), point.ddq + step)

    def led(self, memory: Memory, answer: Answer, after: Observed, M: Array, bias: Array,
            point: Desired) -> Answer:
        """Return the command of (4) in the place of τ*; M, bias and point of a period later."""
        wanted, _ = self.wanted(after, M, bias, point, answer.by, memory.learned.level)
        return Answer(self.observer.drives.command(answer.tau, wanted), answer.z, answer.by)

    def within_reach(self, answer: Answer, at: Observed, M: Array) -> Array:
        """Return the torque within the reach of the drives, shape (n,) [N·m]."""
        return at.torque + nearest(M, answer.tau - at.torque, self.observer.drives.reach)

    def answered(self, memory: Memory, answer: Answer, sent: Array, M: Array, point: Desired
                 ) -> Memory:
        """Return the memory after a torque was sent."""
        by = self.reference.relieved(answer.by, answer.tau - sent, M)
        return Memory(memory.observed, memory.mass, memory.known, memory.learned, by, 1.0,
                      point.ddq, 1.0)

    def advanced(self, memory: Memory, observed: Observed, M: Array, bias: Array, applied: Array,
                 saturation_error: Array) -> Memory:
        """
        Return the memory a period later.

        Parameters
        ----------
        memory, observed : Memory, Observed
            After the torque of this sample was sent; the state of this sample.
        M, bias : array, shape (n, n) and (n,)
            M and C dq + G there.
        applied, saturation_error : array, shape (n,)
            Torque held over the period, and what the limits took from it [N·m].

        """
        friction = self.learning.learn(memory.learned, observed.dq, observed.perturbation)
        by = self.reference.relieved(memory.deviation, saturation_error, M)
        after = self.observer.predict(observed, M, bias, friction.level, applied)
        return Memory(after, M, 1.0, friction, by, memory.deviating, memory.ddq, memory.followed)


def feedback(config: ControllerConfig, period: float) -> Feedback:
    """Return the law of a configuration, with the sample period [s]."""
    n, bandwidth, ka = len(config.joint_names), config.estimator_bandwidth, np.array(config.ka)
    kp, kv = np.array(matrix(config.kp, n)), np.array(matrix(config.kv, n))
    lag, rate = np.array(config.actuator_lag), np.array(config.torque_rate_limit)
    return Feedback(
        kp, kv, ka, float(any(config.actuator_lag)),
        state_observer(drive_model(lag, rate, period), bandwidth, ka),
        feasible_reference(kp.diagonal(), kv.diagonal(), rate, lag, period),
        friction_level(config.friction_learning, bandwidth, period, ka))


def unobserved(level: Array) -> Memory:
    """Return the memory at the start, with the level K̂ of friction, shape (n,) [N·m]."""
    zero = np.zeros_like(level)
    return Memory(Observed(zero, zero, zero, zero, zero), np.zeros((len(level), len(level))), 0.0,
                  untaught(level), Deviation(zero, zero), 0.0, zero, 0.0)


class ObserverFeedback(Law):
    """Computed torque on an observed state, by `Feedback`."""

    symbol = '-(P̂ + F)'
    foresees = True
    _model: Model
    _observed: Observed

    def __init__(self, filter_: ErrorFilter) -> None:
        super().__init__(filter_)
        self._given = self.zero
        self.reset()

    def configure(self, config: ControllerConfig, period: float) -> None:
        """Use other gains; the observed state, K̂ and the deviation are preserved."""
        self._feedback, self._given = feedback(config, period), np.array(config.friction_level)

    def reset(self) -> None:
        """Forget state, deviation and what was learned."""
        self._memory = unobserved(self._given)

    def initialize(self, now: State, estimate: Array | None) -> None:
        """Begin with the estimate of the other law."""
        if estimate is not None:
            level = self._memory.learned.level
            self._observed = self._observed._replace(perturbation=nearest(
                now.M, estimate - level * np.sign(now.dq), self._feedback.ka))
        self._memory = self._memory._replace(deviating=0.0, followed=0.0)

    def suspend(self) -> None:
        """Have the state observed again from the measured one, once this law comes back."""
        self._memory = self._memory._replace(known=0.0)

    def observe(self, q: Array, dq: Array, held: Array) -> tuple[Array, Array]:
        """Return q̂ and dq̂, corrected by the measured position; see `Law.observe`."""
        self._observed = self._feedback.observe(self._memory, q, dq, held)
        return self._observed.q, self._observed.dq

    def foresee(self, now: State, coming: Sequence[Array], points: Sequence[Desired],
                model: Model) -> None:
        """Predict the state in which the torque arrives; see `Law.foresee`."""
        at, terms = self._observed, (now.M, now.C.dot(now.dq) + now.G)
        for command in coming:
            at = self._feedback.observer.predict(at, *terms, self._memory.learned.level, command)
            terms = _dynamics(model, at)
        self._arriving, self._terms, self._point, self._model = at, terms, points[-1], model

    def terms(self, at: State) -> Terms:
        """Return the terms of (4)."""
        law, memory, arriving, point = (
            self._feedback, self._memory, self._arriving, self._point)
        M, bias = self._terms
        answer = law.answer(memory, arriving, M, bias, point)
        if law.lagging:
            after = law.next_state(memory, answer, arriving, M, bias)
            answer = law.led(memory, answer, after, *_dynamics(self._model, after),
                             law.next_point(memory, point))
        sent = law.within_reach(answer, arriving, M)
        self._memory = law.answered(memory, answer, sent, M, point)
        return Terms(sent + answer.z, self.zero, answer.z)

    def advance(self, now: State, applied: Torque, correction: Array | None) -> None:
        """Learn the level of friction, and go on to the next sample."""
        lost = applied.saturation_error
        self._memory = self._feedback.advanced(
            self._memory, self._observed, now.M, now.C.dot(now.dq) + now.G, applied.tau,
            self.zero if lost is None else lost)

    def estimate(self, now: State) -> Array:
        """Return P̂ with the friction of sliding."""
        friction: Array = self._memory.learned.level * np.sign(now.dq)
        return self._memory.observed.perturbation + friction


def _dynamics(model: Model, at: Observed) -> tuple[Array, Array]:
    """Return M and C dq + G, shapes (n, n) and (n,)."""
    M, C, G = model.evaluate(at.q, at.dq)
    return M, C.dot(at.dq) + G


#: What the name of this module stands for.
LAW = ObserverFeedback
