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
    ControlSettings,
    evaluated,
    Models,
    State,
)
from ctc_chattering.control.laws.base import Applied, Terms
from ctc_chattering.numerics.compilable import function, record
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class ControlMemory(NamedTuple):
    """What the control step remembers, besides the memory of the law and torques in transit."""

    #: ξ of the filter [rad/s], shape (n,).
    xi: Array
    #: Torque sent last, shape (n,) [N·m].
    held: Array
    #: Of a law that took over (`handover`): what its torque differed from the last one sent,
    #: shape (n,) [N·m]; for how many samples it is still added; 1.0 before the first of them.
    difference: Array
    fading: float
    fresh: float
    #: Which of the torques in transit is applied next.
    turn: float


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


def control_memory(held: Array) -> ControlMemory:
    """Return the memory at the start, with the torque that is still held, shape (n,) [N·m]."""
    zero = np.zeros_like(held)
    return ControlMemory(zero, held, zero, 0.0, 0.0, 0.0)


def in_transit(n: int, delay: int) -> Array:
    """Return no torques in transit, shape (4 delay, n)."""
    return np.zeros((ROWS * delay, n))


@function
def step(settings: ControlSettings, law: Any, memory: ControlMemory, law_memory: Any,
         models: Models, q: Array, dq: Array, points: Array, transit: Array) -> Step:
    """
    Return the torque of a sample, and what is remembered a period later.

    Parameters
    ----------
    settings, law
        What is common to all laws, and the law in force.
    memory, law_memory
        After the last sample.
    models : Models
        M, C and G.
    q, dq : array, shape (n,)
        Measured position [rad] and velocity [rad/s].
    points : array, shape (3 (1 + d), n)
        q_d [rad], dq_d [rad/s] and ddq_d [rad/s²] of this sample and of those of the delay.
    transit : array, shape (4 d, n)
        Torques in transit; the one that is applied now gives way to that of this sample.

    """
    law_memory, q, dq = law.corrected(law_memory, q, dq, memory.held)
    now = evaluated(settings, models.now, q, dq, points, 0, memory.xi)
    law_memory = law.updated(law_memory, now)
    turn = int(memory.turn)
    terms, law_memory = law.answer(
        law_memory, now, Context(settings, models, memory.xi, points, transit, turn))
    own, fading, difference = (terms.nominal - terms.compensation - terms.robust, memory.fading,
                               memory.difference)
    wanted = own
    if fading > 0.0:
        if memory.fresh != 0.0:
            difference = memory.held - own
        wanted, fading = own + fading / settings.fading * difference, fading - 1.0
    tau = settings.limiter.limit(wanted, memory.held)
    sent = applied = Applied(tau, wanted - tau, own - tau, terms.clipping_error)
    if settings.delay > 0.0:
        applied = exchanged(transit, ROWS * turn, sent)
        turn = (turn + 1) % int(settings.delay)
    correction = settings.limiter.correction(now.M, applied.excess)
    xi = settings.filter.next_state(memory.xi, now.de, now.u) + correction
    law_memory = law.advanced(law_memory, now, applied, correction)
    return Step(now, terms, sent, ControlMemory(xi, tau, difference, fading, 0.0, float(turn)),
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
