"""
The control laws over one sample, as the modules of `control/laws` have them, equation by equation.

Each has up to four parts: `update` improves an estimate by the measured state, `terms` answers the
state in which the torque arrives, `advance` goes on by a period, `estimate` is what the law knows
of the perturbation.
"""

from __future__ import annotations

from math import sqrt, tanh

from ctc_chattering.batch import switching
from ctc_chattering.batch.compiler import inlined
from ctc_chattering.batch.control_state import (
    ControlScratch,
    ControlSettings,
    ControlState,
    Evaluated,
)
from ctc_chattering.batch.error_filter import nominal_response
from ctc_chattering.batch.linear_algebra import invert, product, solve
from ctc_chattering.control.controller import LAWS
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

(COMPENSATION, CHATTERING, INTEGRAL, MOMENTUM_OBSERVER, SUPER_TWISTING, SLOTINE_LI,
 FRICTION_FEEDFORWARD, PD_GRAVITY) = map(LAWS.index, (
     'compensation', 'chattering', 'integral', 'momentum_observer', 'super_twisting',
     'slotine_li', 'friction_feedforward', 'pd_gravity'))


@inlined
def update(c: ControlSettings, s: ControlState, now: Evaluated, w: ControlScratch) -> None:
    """Improve the estimate by the measured state."""
    n = len(now.q)
    if c.law == CHATTERING and c.switching == switching.IMPLICIT_OBSERVER:
        switching.observe(c, s, now.v, w)
    elif c.law == MOMENTUM_OBSERVER:
        product(now.M, now.dq, w.x)
        _momentum_rate(now, w.y)
        for i in range(n):
            if s.observed:                                            # (2), (3)
                P = (s.third[i] + 0.5 * (s.residual[i] + w.y[i])
                     - (w.x[i] - s.nominal[i]) / c.period)
                s.estimate[i] += c.momentum * (P - s.estimate[i])
            s.nominal[i], s.residual[i] = w.x[i], w.y[i]


@inlined
def terms(c: ControlSettings, s: ControlState, at: Evaluated, w: ControlScratch) -> None:
    """Set nominal, compensation, robust and clipped in the scratch, each of shape (n,) [N·m]."""
    n = len(at.q)
    for i in range(n):
        w.nominal[i] = at.N[i]
        w.compensation[i] = w.robust[i] = w.clipped[i] = 0.0
    if c.law in (COMPENSATION, CHATTERING):
        product(at.C, at.v, w.compensation)
        if c.law == CHATTERING:
            switching.term(c, s, at, w)
    elif c.law == INTEGRAL:
        product(at.M, s.integral, w.x)
        for i in range(n):
            w.robust[i] = -w.x[i]
    elif c.law == MOMENTUM_OBSERVER:
        for i in range(n):
            w.robust[i] = -s.estimate[i]
    elif c.law == SUPER_TWISTING:
        _super_twisting(c, s, at, w)
    elif c.law == SLOTINE_LI:
        _slotine_li(c, s, at, w)
    elif c.law == FRICTION_FEEDFORWARD:
        for i in range(n):
            w.robust[i] = -c.level[i] * tanh(at.dq_d[i] / c.friction_velocity)
    elif c.law == PD_GRAVITY:
        invert(at.M, n, w.lower, w.inverse)
        for i in range(n):
            w.nominal[i] = at.u[i] / w.inverse[i, i] + at.G[i]


@inlined
def advance(c: ControlSettings, s: ControlState, now: Evaluated, tau: Array, lost: Array,
            clipped: Array, correction: Array, w: ControlScratch) -> None:
    """
    Advance integrators and observers by a period.

    Parameters
    ----------
    c, s, now
        Parameters, memory, measured state.
    tau, lost, clipped : array, shape (n,)
        Torque applied, what the limits took from it, and what ±Ka took from its term [N·m].
    correction : array, shape (n,)
        What anti-windup adds to v [rad/s].
    w : ControlScratch
        Scratch.

    """
    n = len(tau)
    if c.law == CHATTERING and c.switching == switching.IMPLICIT_OBSERVER:
        switching.predict(c, s, now, tau, clipped, correction)
    elif c.law == INTEGRAL:
        for i in range(n):
            w.x[i] = lost[i] if c.anti_windup else 0.0
        solve(now.M, w.x, w.lower)
        for i in range(n):
            s.integral[i] += c.ki[i] * now.e[i] - c.tracking[i] * w.x[i]
    elif c.law == MOMENTUM_OBSERVER:
        s.observed = 1
        for i in range(n):
            s.third[i] = tau[i]
    elif c.law == SUPER_TWISTING:
        for i in range(n):
            s.integral[i] = s.next[i]
    elif c.law == SLOTINE_LI:
        product(c.slope, now.e, w.x)
        for i in range(n):
            if lost[i] == 0.0 or not c.anti_windup:
                y = tanh((now.dq_d[i] + w.x[i]) / c.friction_velocity)
                s.level[i] = max(s.level[i] + c.adaptation[i] * y * (now.de[i] + w.x[i]), 0.0)


@inlined
def estimate(c: ControlSettings, s: ControlState, now: Evaluated, w: ControlScratch) -> None:
    """Set in `w.x` what the law takes for the perturbation while torques are in transit [N·m]."""
    n = len(now.q)
    for i in range(n):
        w.x[i] = 0.0
    if c.law == MOMENTUM_OBSERVER or (
            c.law == CHATTERING and c.switching == switching.IMPLICIT_OBSERVER):
        for i in range(n):
            w.x[i] = s.estimate[i]
    elif c.law == INTEGRAL:
        product(now.M, s.integral, w.x)
    elif c.law == SLOTINE_LI:
        product(c.slope, now.e, w.y)
        for i in range(n):
            w.x[i] = s.level[i] * tanh((now.dq_d[i] + w.y[i]) / c.friction_velocity)
    elif c.law == FRICTION_FEEDFORWARD:
        for i in range(n):
            w.x[i] = c.level[i] * tanh(now.dq_d[i] / c.friction_velocity)


@inlined
def _momentum_rate(at: Evaluated, out: Array) -> None:
    """Set β = Cᵀ dq - G of `momentum_observer`, shape (n,) [N·m]."""
    n = len(out)
    for i in range(n):
        out[i] = -at.G[i]
        for j in range(n):
            out[i] += at.C[j, i] * at.dq[j]


@inlined
def _super_twisting(c: ControlSettings, s: ControlState, at: Evaluated, w: ControlScratch) -> None:
    """Set M a of `super_twisting` by (2) and (3), and w of the next sample."""
    n = len(at.q)
    for i in range(n):
        w.z[i] = 0.0
    nominal_response(c, at.v, at.u, w.z, w.x)
    for i in range(n):
        r = w.x[i] - c.scale * s.integral[i]
        linear, bound = c.scale * c.k1[i], c.scale * c.k2[i]
        rest = max(abs(r) - bound, 0.0)
        root = 2.0 * rest / (linear + sqrt(linear * linear + 4.0 * rest))
        s.next[i] = s.integral[i] + c.k2[i] * min(max(r / bound, -1.0), 1.0)
        w.y[i] = c.k1[i] * root * np.sign(r) + s.next[i]
    product(at.M, w.y, w.robust)


@inlined
def _slotine_li(c: ControlSettings, s: ControlState, at: Evaluated, w: ControlScratch) -> None:
    """Set the terms (2) of `slotine_li`."""
    n = len(at.q)
    product(c.slope, at.e, w.x)
    product(c.slope, at.de, w.y)
    invert(at.M, n, w.lower, w.inverse)
    for i in range(n):
        w.x[i] += at.dq_d[i]                                          # dq_r
        w.y[i] += at.ddq_d[i]                                         # ddq_r
        w.robust[i] = -s.level[i] * tanh(w.x[i] / c.friction_velocity)
    for i in range(n):
        total = at.G[i] + at.u[i] / w.inverse[i, i]
        for j in range(n):
            total += at.M[i, j] * w.y[j] + at.C[i, j] * w.x[j]
        w.nominal[i] = total
