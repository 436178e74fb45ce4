"""
The control step: evaluate, update, predict over the input delay, torque, advance.

As `control/control_step.py`, `control/delay_prediction.py` and `control/limiter.py` have it, for
one law from start to end.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.batch import error_filter, laws, observer_feedback
from ctc_chattering.batch.compiler import compiled, inlined
from ctc_chattering.batch.control_state import (
    ControlScratch,
    ControlSettings,
    ControlState,
    Evaluated,
)
from ctc_chattering.batch.dynamics import evaluate as evaluate_model
from ctc_chattering.batch.dynamics import forward_dynamics
from ctc_chattering.batch.linear_algebra import solve
from ctc_chattering.batch.observer_feedback import ObserverFeedback
from ctc_chattering.control.controller import LAWS
from ctc_chattering.dynamics.arm import Arm, BodyScratch
from ctc_chattering.numerics.linear_algebra import Array

OBSERVER_FEEDBACK = LAWS.index('observer_feedback')


class Controller(NamedTuple):
    """A controller with its scratch, each a record."""

    arm: Arm
    c: ControlSettings
    s: ControlState
    now: Evaluated
    at: Evaluated
    w: ControlScratch
    body: BodyScratch
    law: ObserverFeedback


@compiled
def evaluate(p: Controller, at: Evaluated, point: Array) -> None:
    """
    Set what the law needs of the state in `at` and a point of the reference.

    Parameters
    ----------
    p : Controller
        Whose gains and model.
    at : Evaluated
        With q, dq and ξ.
    point : array, shape (3, n)
        q_d [rad], dq_d [rad/s] and ddq_d [rad/s²].

    """
    c, n = p.c, len(at.q)
    for i in range(n):
        at.q_d[i], at.dq_d[i], at.ddq_d[i] = point[0, i], point[1, i], point[2, i]
        at.e[i], at.de[i] = at.q_d[i] - at.q[i], at.dq_d[i] - at.dq[i]
        at.v[i] = at.xi[i] - c.b * at.de[i]                           # (3)
    evaluate_model(p.arm, at.q, at.dq, p.body, at.M, at.C, at.G)
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += c.kv[i, j] * at.de[j] + c.kp[i, j] * at.e[j]
        at.u[i] = total
        p.w.x[i] = at.ddq_d[i] + total
    for i in range(n):
        total = at.G[i]
        for j in range(n):
            total += at.M[i, j] * p.w.x[j] + at.C[i, j] * at.dq[j]
        at.N[i] = total                                               # inverse dynamics


@inlined
def correction(c: ControlSettings, M: Array, lost: Array, lower: Array, out: Array) -> None:
    """Set b h M⁻¹ times what the limits took from a torque, shape (n,) [rad/s]."""
    n, any_lost = len(lost), False
    for i in range(n):
        out[i] = c.scale * lost[i] if c.anti_windup else 0.0
        any_lost |= out[i] != 0.0
    if any_lost:
        solve(M, out, lower)


@inlined
def limit(c: ControlSettings, held: Array, tau: Array, lost: Array) -> None:
    """Replace `tau` by a torque within the limits, and set what they took from it, (n,) [N·m]."""
    for i in range(len(tau)):
        wanted = tau[i]
        if c.limited:
            tau[i] = min(max(tau[i], held[i] - c.change[i]), held[i] + c.change[i])
            tau[i] = min(max(tau[i], -c.effort[i]), c.effort[i])
        lost[i] = wanted - tau[i] if tau[i] != wanted else 0.0
        held[i] = tau[i]


@compiled
def predict(p: Controller, k: int, table: Array) -> None:
    """Set in `p.at` the state in which the torque of sample `k` is applied; see the reference."""
    c, s, at, before, w = p.c, p.s, p.at, p.now, p.w
    n, h = len(at.q), c.period
    laws.estimate(c, s, before, w)
    for i in range(n):
        at.xi[i], w.z[i] = s.xi[i], w.x[i]
    for j in range(c.delay):
        place = (s.steps + j) % c.delay
        correction(c, before.M, s.excess[place], w.lower, w.y)
        error_filter.advance(c, at.xi, before.de, before.u, w.y)
        for i in range(n):
            w.robust[i] = s.sent[place, i] - w.z[i]
        forward_dynamics(p.arm, before.q, before.dq, w.robust, p.body, w.x)
        for i in range(n):
            w.nominal[i] = before.dq[i] + 0.5 * h * w.x[i]
            w.compensation[i] = before.q[i] + 0.5 * h * before.dq[i]
        forward_dynamics(p.arm, w.compensation, w.nominal, w.robust, p.body, w.x)
        for i in range(n):
            at.q[i] = before.q[i] + h * w.nominal[i]
            at.dq[i] = before.dq[i] + h * w.x[i]
        evaluate(p, at, table[k + j + 1])
        before = at


@inlined
def exchange(p: Controller, tau: Array) -> None:
    """Put the torque of this sample in transit; set in the scratch the one that arrives now."""
    c, s, w = p.c, p.s, p.w
    place = s.steps % c.delay if c.delay else 0
    for i in range(len(tau)):
        sent, lost, clipped = tau[i], w.nominal[i], w.clipped[i]
        if c.delay:
            sent, s.sent[place, i] = s.sent[place, i], sent
            lost, s.excess[place, i] = s.excess[place, i], lost
            clipped, s.clipped[place, i] = s.clipped[place, i], clipped
        w.robust[i], w.nominal[i], w.clipped[i] = sent, lost, clipped
    s.steps += 1


@compiled
def step(p: Controller, k: int, q: Array, dq: Array, table: Array, tau: Array) -> None:
    """
    Set the torque of a sample, and go on by a period.

    Parameters
    ----------
    p : Controller
        After the last sample.
    k : int
        Index of the point of the reference at this sample.
    q, dq : array, shape (n,)
        Measured position [rad] and velocity [rad/s].
    table : array, shape (N, 3, n)
        The reference, sample by sample.
    tau : array, shape (n,)
        To be set [N·m].

    """
    c, s, now, w = p.c, p.s, p.now, p.w
    n = len(q)
    for i in range(n):
        now.q[i], now.dq[i], now.xi[i] = q[i], dq[i], s.xi[i]
    if c.law == OBSERVER_FEEDBACK:
        observer_feedback.observe(p.law, now, s.held)
    evaluate(p, now, table[k])
    if c.law == OBSERVER_FEEDBACK:
        observer_feedback.foresee(p.law, p.arm, p.body, now, s.sent, s.steps, c.delay)
        observer_feedback.terms(p.law, p.arm, p.body, table[k + c.delay], w.nominal, w.robust)
        for i in range(n):
            w.compensation[i] = w.clipped[i] = 0.0
    else:
        laws.update(c, s, now, w)
        if c.delay:
            predict(p, k, table)
        laws.terms(c, s, p.at if c.delay else now, w)
    for i in range(n):
        tau[i] = w.nominal[i] - w.compensation[i] - w.robust[i]
    limit(c, s.held, tau, w.nominal)
    exchange(p, tau)
    correction(c, now.M, w.nominal, w.lower, w.compensation)
    error_filter.advance(c, s.xi, now.de, now.u, w.compensation)
    if c.law == OBSERVER_FEEDBACK:
        observer_feedback.advance(p.law, w.robust, w.nominal)
    else:
        laws.advance(c, s, now, w.robust, w.nominal, w.clipped, w.compensation, w)
