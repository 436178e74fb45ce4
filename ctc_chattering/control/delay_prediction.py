"""
A known input delay: the law is evaluated at the state predicted for when its torque is applied.

The prediction runs model, reference and filter ahead under the torques in transit. Filter and
observer themselves advance with what is measured and applied.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from ctc_chattering.control.computed_torque import ComputedTorque, State, Torque
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.trajectory.buffer import Point


class DelayPrediction:
    """
    Takes the steps of a law whose torques are applied `delay` samples after they are sent.

    Parameters
    ----------
    law : ComputedTorque
        What computes the torque.
    delay : int
        Samples; 0 for none.
    n : int
        Number of joints.

    Attributes
    ----------
    period : float
        h [s].

    """

    period: float

    def __init__(self, law: ComputedTorque, delay: int, n: int) -> None:
        self._law = law
        self._idle = [Torque(np.zeros(n), np.zeros(n), None, None)] * delay
        self.reset()

    def reset(self) -> None:
        """Forget the torques in transit."""
        self._in_transit = deque(self._idle)

    def step(self, q: Array, dq: Array, q_d: Array, dq_d: Array, ddq_d: Array,
             ahead: Sequence[Point]) -> tuple[State, State, Torque]:
        """Return this state, the one in which the torque sent now is applied, and the torque."""
        law, observer = self._law, self._law.switching.observer
        now = law.evaluate(q, dq, q_d, dq_d, ddq_d, law.filter.state)
        if observer is not None:
            observer.update(now.v)
        arrival = self._predict(now, ahead)
        sent = law.torque(arrival)
        self._in_transit.append(sent)
        law.advance(now, self._in_transit.popleft())
        return now, arrival, sent

    def _predict(self, now: State, ahead: Sequence[Point]) -> State:
        """Return the state in which the torque of this step is applied; `now` without a delay."""
        law, observer = self._law, self._law.switching.observer
        at, xi = now, law.filter.state
        for torque, (q_d, dq_d, ddq_d) in zip(self._in_transit, ahead):
            xi = law.filter.next_state(
                xi, at.de, at.feedback_acceleration,
                law.limiter.correction(at.mass, torque.saturation_error))
            tau = torque.tau if observer is None else torque.tau - observer.estimate
            q, dq = predict(law.model, at.q, at.dq, tau, self.period)
            at = law.evaluate(q, dq, np.array(q_d), np.array(dq_d), np.array(ddq_d), xi)
        return at


def predict(model: Model, q: Array, dq: Array, u: Array, h: float) -> tuple[Array, Array]:
    """
    Return q and dq after one period under a held torque, by the midpoint rule.

    Parameters
    ----------
    model : Model
        As the controller knows it.
    q, dq : array, shape (n,)
        Position [rad] and velocity [rad/s].
    u : array, shape (n,)
        Torque less the perturbation [N·m].
    h : float
        Period [s].

    """
    def acceleration(q: Array, dq: Array) -> Array:
        return np.array(model.forward_dynamics(q.tolist(), dq.tolist(), u.tolist()))

    middle = dq + 0.5 * h * acceleration(q, dq)
    return q + h * middle, dq + h * acceleration(q + 0.5 * h * dq, middle)
