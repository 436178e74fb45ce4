"""
The control step: a law at one sample, for any model.

Vectors are arrays of shape (n,), matrices of shape (n, n). A product by `dot` takes half the time
of one by `@` where there are so few numbers.
"""

from __future__ import annotations

from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.handover import Handover
from ctc_chattering.control.laws.base import Law, State, Torque
from ctc_chattering.control.limiter import Limiter
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class ControlStep:
    """
    Evaluates a state, has the law answer it, limits the torque, and advances the filter.

    A step is `evaluate`, `update`, `torque`, `advance`; `DelayPrediction` takes it.

    Parameters
    ----------
    model : Model
        M, C and G.
    filter_ : ErrorFilter
        The filter (3).
    limiter : Limiter
        Limits of the torque.

    Attributes
    ----------
    kp, kv : array, shape (n, n)
        Kp [1/s²] and Kv [1/s].
    period : float
        h [s].
    law : Law
        In force from the next step on.
    handover : Handover
        From one law to the next.

    """

    kp: Array
    kv: Array
    period: float
    law: Law

    def __init__(self, model: Model, filter_: ErrorFilter, limiter: Limiter) -> None:
        self.model, self.filter, self.limiter = model, filter_, limiter
        self.handover = Handover()
        self._before: Law | None = None

    def reset(self) -> None:
        """Start again, with nothing to take over."""
        self.handover.reset()
        self._before = None

    def evaluate(self, q: Array, dq: Array, q_d: Array, dq_d: Array, ddq_d: Array, xi: Array
                 ) -> State:
        """Return what the law needs of a state, a reference and a state ξ of the filter."""
        e, de = q_d - q, dq_d - dq
        u = self.kv.dot(de) + self.kp.dot(e)
        v = self.filter.output(de, xi)                                   # (3)
        M, C, G = self.model.evaluate(q, dq)
        N = M.dot(ddq_d + u) + C.dot(dq) + G                             # inverse dynamics
        return State(q, dq, dq_d, ddq_d, e, de, u, v, M, C, G, N)

    def update(self, now: State) -> State:
        """Have the law take the measured state; return it, with v as the law has it."""
        law, before = self.law, self._before
        if before is not law and before is not None:
            if law.acts_on_v and not before.acts_on_v:
                self.filter.initialize_bumpless(now.de)
                now = now._replace(v=np.zeros_like(now.v))
            self.handover.initialize(before, law, now, self.period)
        self._before = law
        law.update(now)
        return now

    def torque(self, at: State) -> Torque:
        """Return the torque of the law."""
        terms = self.law.terms(at)
        own = terms.nominal - terms.compensation - terms.robust
        added = self.handover.added(own)
        tau, saturation_error = self.limiter.limit(own if added is None else own + added)
        self.handover.sent = tau
        return Torque(tau, terms, saturation_error,
                      saturation_error if added is None else own - tau)

    def advance(self, now: State, applied: Torque) -> None:
        """Advance filter and law over the period for which `applied` is held."""
        correction = self.limiter.correction(now.M, applied.excess)
        self.filter.state = self.filter.next_state(self.filter.state, now.de, now.u, correction)
        self.law.advance(now, applied, correction)
