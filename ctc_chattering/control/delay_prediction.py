"""
A known input delay: the law is evaluated at the state predicted for when its torque is applied.

The prediction runs model, reference and filter ahead under the torques in transit. Filter and
observer themselves advance with what is measured and applied.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from ctc_chattering.control.control_step import ControlStep
from ctc_chattering.control.feasible_reference import Desired
from ctc_chattering.control.laws.base import State, Terms, Torque
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.trajectory.buffer import Point
import numpy as np


class DelayPrediction:
    """
    Takes the steps of a controller whose torques are applied `delay` samples after they are sent.

    Parameters
    ----------
    control : ControlStep
        Whose torques they are.
    delay : int
        Samples; 0 for none.
    n : int
        Number of joints.

    """

    def __init__(self, control: ControlStep, delay: int, n: int) -> None:
        self._control = control
        zero = np.zeros(n)
        self._idle = [Torque(zero, Terms(zero, zero, zero), None, None)] * delay
        self.reset()

    def reset(self) -> None:
        """Forget the torques in transit."""
        self._in_transit = deque(self._idle)

    def step(self, q: Array, dq: Array, q_d: Array, dq_d: Array, ddq_d: Array,
             ahead: Sequence[Point]) -> tuple[State, Torque]:
        """Return this state, and the torque for the one in which it is applied."""
        control, law = self._control, self._control.law
        q, dq = law.observe(q, dq, control.limiter.held)
        now = control.evaluate(q, dq, q_d, dq_d, ddq_d, control.filter.state)
        now = control.update(now)
        if law.foresees:
            points = [Desired(q_d, dq_d, ddq_d), *(Desired(*map(np.array, p)) for p in ahead)]
            law.foresee(now, [torque.tau for torque in self._in_transit], points, control.model)
            sent = control.torque(now)
        else:
            sent = control.torque(self._predict(now, ahead))
        self._in_transit.append(sent)
        control.advance(now, self._in_transit.popleft())
        return now, sent

    def _predict(self, now: State, ahead: Sequence[Point]) -> State:
        """Return the state in which the torque of this step is applied; `now` without a delay."""
        control, at, xi = self._control, now, self._control.filter.state
        law = control.law
        estimate = law.estimate(now) if self._in_transit and law.predicts else None
        for torque, (q_d, dq_d, ddq_d) in zip(self._in_transit, ahead):
            xi = control.filter.next_state(
                xi, at.de, at.u, control.limiter.correction(at.M, torque.excess))
            tau = torque.tau if estimate is None else torque.tau - estimate
            q, dq = predict(control.model, at.q, at.dq, tau, control.period)
            at = control.evaluate(q, dq, np.array(q_d), np.array(dq_d), np.array(ddq_d), xi)
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
