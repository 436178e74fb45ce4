"""Law `observer_feedback`, as `control/laws/observer_feedback.py` has it."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from ctc_chattering.batch import observer
from ctc_chattering.batch.arm import Arm, BodyScratch
from ctc_chattering.batch.box_qp import BoxScratch, nearest
from ctc_chattering.batch.compiler import compiled, inlined
from ctc_chattering.batch.control_state import Evaluated
from ctc_chattering.batch.dynamics import evaluate
from ctc_chattering.batch.feasible_reference import back, FeedbackSettings, friction, relieve
from ctc_chattering.batch.linear_algebra import copy
from ctc_chattering.batch.observer import (
    DQ,
    ObserverScratch,
    ObserverSettings,
    P,
    Q,
    TORQUE,
)
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.numerics.linear_algebra import Array


@dataclasses.dataclass
class FeedbackState:
    """What the law remembers, and scratch; arrays of shape (n,) unless they say otherwise."""

    #: Observed state (5, n), M there (n, n), and whether there are any.
    observed: Array
    mass: Array
    begun: int
    #: Deviation x, dx of the reference, and whether there is one.
    x: Array
    dx: Array
    deviating: int
    #: Last desired acceleration, and whether there is one.
    ddq: Array
    followed: int
    #: Level of friction, and its filters (3, n) and (2, n).
    level: Array
    lags: Array
    slow: Array
    #: State in which the torque arrives (5, n), M (n, n), C (n, n), G, C dq + G there.
    arriving: Array
    M: Array
    C: Array
    G: Array
    bias: Array
    #: A period later.
    after: Array
    next_M: Array
    next_bias: Array
    #: Scratch.
    tau: Array
    wanted: Array
    z: Array
    half: Array
    point: Array
    lower: Array


class ObserverFeedback(NamedTuple):
    """The law with its scratch, each a record."""

    c: FeedbackSettings
    o: ObserverSettings
    s: FeedbackState
    w: ObserverScratch
    box: BoxScratch


def feedback_state(config: ControllerConfig) -> FeedbackState:
    """Return the state at the start."""
    n = len(config.joint_names)
    zero, square, state = np.zeros(n), np.zeros((n, n)), np.zeros((5, n))
    return FeedbackState(
        state, square, 0, zero, zero, 0, zero, 0, np.array(config.friction_level),
        np.zeros((3, n)), np.zeros((2, n)), state, square, square, zero, zero, state, square, zero,
        zero, zero, zero, zero, np.zeros((3, n)), square)


@inlined
def observe(p: ObserverFeedback, q: Array, dq: Array, held: Array) -> None:
    """Replace the measured position and velocity, shape (n,), by the observed ones."""
    s = p.s
    if s.begun:
        observer.correct(p.o, p.w, p.box, s.observed, s.mass, q)
    for i in range(len(q)):
        if not s.begun:
            s.observed[Q, i], s.observed[DQ, i], s.observed[TORQUE, i] = q[i], dq[i], held[i]
        q[i], dq[i] = s.observed[Q, i], s.observed[DQ, i]
    s.begun = 1


@inlined
def set_bias(C: Array, dq: Array, G: Array, out: Array) -> None:
    """Set C dq + G, shape (n,)."""
    for i in range(len(out)):
        out[i] = G[i]
        for j in range(len(out)):
            out[i] += C[i, j] * dq[j]


@inlined
def foresee(p: ObserverFeedback, arm: Arm, body: BodyScratch, now: Evaluated, sent: Array,
            steps: int, delay: int) -> None:
    """
    Predict the state in which the torque of this sample arrives.

    Parameters
    ----------
    p, arm, body
        The law, the model and its scratch.
    now : Evaluated
        As observed.
    sent : array, shape (101, n)
        Torques in transit, that of this sample in row ``steps % delay`` [N·m].
    steps, delay : int
        Control steps taken; input delay in samples.

    """
    s = p.s
    copy(s.observed, s.arriving)
    copy(now.M, s.M)
    set_bias(now.C, now.dq, now.G, s.bias)
    for j in range(delay):
        observer.predict(p.o, p.w, p.box, s.arriving, s.M, s.bias, s.level,
                         sent[(steps + j) % delay], s.arriving)
        evaluate(arm, s.arriving[Q], s.arriving[DQ], body, s.M, s.C, s.G)
        set_bias(s.C, s.arriving[DQ], s.G, s.bias)


@compiled
def want(p: ObserverFeedback, at: Array, M: Array, bias: Array, point: Array, tau: Array) -> None:
    """Set τ* of (2), and z of (3) in the state, at the state `at` and a point of the reference."""
    c, s, x = p.c, p.s, p.w.x
    n = len(tau)
    for i in range(n):
        s.z[i] = at[P, i] + friction(c, s.level, point[1, i], point[2, i], 0.0, i)
    nearest(M, s.z, p.o.bound, n, p.box, s.z)
    for i in range(n):
        s.z[i] = -s.z[i]
        x[i] = point[2, i] + back(c, M[i, i], s.level[i], s.x[i], s.dx[i], i)
        for j in range(n):
            x[i] += (c.kv[i, j] * (point[1, j] + s.dx[j] - at[DQ, j])
                     + c.kp[i, j] * (point[0, j] + s.x[j] - at[Q, j]))
    for i in range(n):
        tau[i] = bias[i] - s.z[i]
        for j in range(n):
            tau[i] += M[i, j] * x[j]


@inlined
def follow(p: ObserverFeedback, point: Array) -> None:
    """Set the deviation a period after a point, by (3) of `feasible_reference`."""
    c, s, h = p.c, p.s, p.o.period
    for i in range(len(s.x)):
        inertia, level, dq, ddq = s.M[i, i], s.level[i], point[1, i], point[2, i]
        a = back(c, inertia, level, s.x[i], s.dx[i], i)
        F = friction(c, s.level, dq, ddq, 0.5 * h, i)
        f = min(max(inertia * ((dq + s.dx[i]) / h + ddq + a) + F, -level), level)
        ddx = (F - f) / inertia + a
        s.x[i] += h * s.dx[i] + 0.5 * h * h * ddx
        s.dx[i] += h * ddx


@inlined
def lead(p: ObserverFeedback, arm: Arm, body: BodyScratch, point: Array) -> None:
    """Replace the wanted torque by the command that gives it in spite of the lag, (4)."""
    s, o, h = p.s, p.o, p.o.period
    n = len(s.tau)
    copy(s.arriving, s.after)
    for i in range(n):
        s.half[i] = 0.5 * (s.arriving[TORQUE, i] + s.tau[i])
        s.after[TORQUE, i] = s.half[i]
        step = point[2, i] - s.ddq[i] if s.followed else 0.0
        s.point[0, i] = point[0, i] + h * (point[1, i] + h * (0.5 * point[2, i] + step / 6.0))
        s.point[1, i] = point[1, i] + h * (point[2, i] + 0.5 * step)
        s.point[2, i] = point[2, i] + step
    observer.predict(o, p.w, p.box, s.after, s.M, s.bias, s.level, s.half, s.after)
    evaluate(arm, s.after[Q], s.after[DQ], body, s.next_M, s.C, s.G)
    set_bias(s.C, s.after[DQ], s.G, s.next_bias)
    for i in range(n):
        s.half[i] = s.z[i]
    want(p, s.after, s.next_M, s.next_bias, s.point, s.wanted)
    for i in range(n):
        s.z[i] = s.half[i]
        if o.lagging[i]:
            E = o.decay[i]
            s.tau[i] = (s.wanted[i] - E * s.tau[i]) / (1.0 - E)


@compiled
def terms(p: ObserverFeedback, arm: Arm, body: BodyScratch, point: Array, nominal: Array,
          robust: Array) -> None:
    """Set the terms of (4), shape (n,) [N·m], for the state in which the torque arrives."""
    c, s = p.c, p.s
    n = len(nominal)
    if not s.deviating:
        for i in range(n):
            s.x[i], s.dx[i] = s.arriving[Q, i] - point[0, i], s.arriving[DQ, i] - point[1, i]
        s.deviating = 1
    want(p, s.arriving, s.M, s.bias, point, s.tau)
    follow(p, point)
    if c.any_lag:
        lead(p, arm, body, point)
    for i in range(n):
        s.half[i] = s.tau[i] - s.arriving[TORQUE, i]
    nearest(s.M, s.half, p.o.reach, n, p.box, s.half)
    for i in range(n):
        sent = s.arriving[TORQUE, i] + s.half[i]
        s.wanted[i] = s.tau[i] - sent
        nominal[i], robust[i] = sent + s.z[i], s.z[i]
        s.ddq[i] = point[2, i]
    s.followed = 1
    relieve(c, s.wanted, s.M, s.lower, s.dx)


@compiled
def advance(p: ObserverFeedback, now: Evaluated, tau: Array, lost: Array) -> None:
    """Learn the level of friction, and go on under the torque applied; `lost` as of `laws`."""
    s = p.s
    observer.learn(p.o, s.observed[DQ], s.observed[P], s.lags, s.slow, s.level)
    for i in range(len(tau)):
        s.half[i] = lost[i]
    relieve(p.c, s.half, now.M, s.lower, s.dx)
    set_bias(now.C, now.dq, now.G, s.bias)
    observer.predict(p.o, p.w, p.box, s.observed, now.M, s.bias, s.level, tau, s.observed)
    copy(now.M, s.mass)
