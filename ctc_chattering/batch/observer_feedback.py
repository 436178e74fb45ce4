"""Law `observer_feedback` in the compiled loop: the steps of `control/laws/observer_feedback`."""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.batch.compiler import compiled
from ctc_chattering.batch.control_state import Evaluated
from ctc_chattering.batch.dynamics import evaluate
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.feasible_reference import Desired
from ctc_chattering.control.laws.observer_feedback import (
    Feedback,
    feedback,
    Memory,
    unobserved,
)
from ctc_chattering.control.state_observer import Observed
from ctc_chattering.dynamics.arm import Arm, BodyScratch
from ctc_chattering.numerics.compilable import dot, record
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.simd.records import load, packed, store, value, write
from ctc_chattering.numerics.time_grid import period_ns, seconds
import numpy as np


@record
class Place(NamedTuple):
    """A state of robot and drives with the terms of (1) there; arrays (n,) and (n, n)."""

    at: Observed
    M: Array
    C: Array
    G: Array
    bias: Array


class ObserverFeedback(NamedTuple):
    """The law with its memory, each a record of the fields of what it is named after."""

    law: Any
    memory: Any
    #: The state of the sample, where its torque arrives, and a period later.
    now: Any
    arriving: Any
    after: Any
    #: The point of the reference at arrival, and the torque sent last.
    point: Any
    sent: Any


@record
class _Sent(NamedTuple):
    tau: Array


def observer_feedback(config: ControllerConfig) -> ObserverFeedback:
    """Return the law of a configuration at its start."""
    zero = np.zeros(len(config.joint_names))
    square, state = np.zeros((len(zero), len(zero))), Observed(zero, zero, zero, zero, zero)
    place = Place(state, square, square, zero, zero)
    return ObserverFeedback(*map(packed, (
        feedback(config, seconds(period_ns(config.control_period))),
        unobserved(np.array(config.friction_level)), place, place, place,
        Desired(zero, zero, zero), _Sent(zero))))


@compiled
def observe(p: ObserverFeedback, now: Evaluated, held: Array) -> None:
    """Replace the measured position and velocity in `now` by the observed ones."""
    state = load(Feedback, p.law).observe(
        load(Memory, p.memory), value(now.q), value(now.dq), value(held))
    here = load(Place, p.now)
    store(p.now, Place(state, here.M, here.C, here.G, here.bias))
    write(now.q, state.q)
    write(now.dq, state.dq)


@compiled
def move(place: Any, arm: Arm, body: BodyScratch, at: Observed) -> None:
    """Set a place: the state and its terms."""
    here = load(Place, place)
    store(place, Place(at, here.M, here.C, here.G, here.bias))
    evaluate(arm, place.at__q, place.at__dq, body, place.M, place.C, place.G)
    write(place.bias, dot(here.C, at.dq) + value(place.G))


@compiled
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
    law, level = load(Feedback, p.law), load(Memory, p.memory).learned.level
    here = load(Place, p.now)
    bias = dot(value(now.C), value(now.dq)) + value(now.G)
    store(p.now, Place(here.at, value(now.M), value(now.C), value(now.G), bias))
    store(p.arriving, load(Place, p.now))
    for j in range(delay):
        p.sent.tau[:] = sent[(steps + j) % delay]
        place = load(Place, p.arriving)
        move(p.arriving, arm, body, law.observer.predict(
            place.at, place.M, place.bias, level, value(p.sent.tau)))


@compiled
def terms(p: ObserverFeedback, arm: Arm, body: BodyScratch, point: Array, nominal: Array,
          robust: Array) -> None:
    """Set the terms of (4), shape (n,) [N·m], for the state in which the torque arrives."""
    p.point.q[:], p.point.dq[:], p.point.ddq[:] = point[0], point[1], point[2]
    law, memory = load(Feedback, p.law), load(Memory, p.memory)
    at, to = load(Place, p.arriving), load(Desired, p.point)
    answer = law.answer(memory, at.at, at.M, at.bias, to)
    if law.lagging != 0.0:
        move(p.after, arm, body, law.next_state(memory, answer, at.at, at.M, at.bias))
        after = load(Place, p.after)
        answer = law.led(memory, answer, after.at, after.M, after.bias, law.next_point(memory, to))
    sent = law.within_reach(answer, at.at, at.M)
    store(p.memory, law.answered(memory, answer, sent, at.M, to))
    write(nominal, sent + answer.z)
    write(robust, answer.z)


@compiled
def advance(p: ObserverFeedback, tau: Array, lost: Array) -> None:
    """Go on by a period under the torque applied; `lost` as of `laws`."""
    here = load(Place, p.now)
    store(p.memory, load(Feedback, p.law).advanced(
        load(Memory, p.memory), here.at, here.M, here.bias, value(tau), value(lost)))
