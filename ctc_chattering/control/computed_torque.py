"""
The control step: laws (2) and (6) at one sample, for any model.

Vectors are arrays of shape (n,), matrices of shape (n, n). A product by `dot` takes half the time
of one by `@` where there are so few numbers.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.limiter import Limiter
from ctc_chattering.control.switching.base import Switching
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Array


class State(NamedTuple):
    """A state with all that the law needs to know of it."""

    #: Position [rad] and velocity [rad/s].
    q: Array
    dq: Array
    #: Errors [rad, rad/s].
    e: Array
    de: Array
    #: Kv de + Kp e [rad/s²].
    feedback_acceleration: Array
    #: Filtered error [rad/s].
    v: Array
    #: M [kg·m²].
    mass: Array
    #: N = M (ddq_d + Kv de + Kp e) + C dq + G [N·m].
    inverse_dynamics: Array
    #: C v [N·m].
    compensation: Array


class Torque(NamedTuple):
    """A torque, and what is to be remembered of it until it is applied [N·m]."""

    #: Within the limits.
    tau: Array
    #: Ka sgn(v), however switched.
    chattering: Array
    #: What ±Ka has taken from the chattering term, for the observer; None for nothing.
    clipping_error: Array | None
    #: What the limits have taken from the torque; None for nothing.
    saturation_error: Array | None


class ComputedTorque:
    """
    Computed torque plus compensation plus chattering.

    A step is `evaluate`, then `torque`, then `advance`; `DelayPrediction` takes it.

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
    switching : Switching
        How the chattering term is evaluated.

    """

    kp: Array
    kv: Array
    switching: Switching

    def __init__(self, model: Model, filter_: ErrorFilter, limiter: Limiter) -> None:
        self.model, self.filter, self.limiter = model, filter_, limiter

    def evaluate(self, q: Array, dq: Array, q_d: Array, dq_d: Array, ddq_d: Array, xi: Array
                 ) -> State:
        """Return what the law needs of a state, a reference and a state ξ of the filter."""
        e, de = q_d - q, dq_d - dq
        u = self.kv.dot(de) + self.kp.dot(e)
        v = self.filter.output(de, xi)                                   # (3)
        M, C, G = self.model.evaluate(q, dq)
        N = M.dot(ddq_d + u) + C.dot(dq) + G                             # inverse dynamics
        return State(q, dq, e, de, u, v, M, N, C.dot(v))

    def torque(self, at: State) -> Torque:
        """Return the torque of law (2) or (6)."""
        z, clipping = self.switching.term(                               # Ka sgn(v)
            at.v, at.feedback_acceleration, at.mass, at.compensation)
        tau, saturation = self.limiter.limit(at.inverse_dynamics - at.compensation - z)
        return Torque(tau, z, clipping, saturation)

    def advance(self, at: State, applied: Torque) -> None:
        """Advance filter and observer over the period for which `applied` is held."""
        u, observer = at.feedback_acceleration, self.switching.observer
        correction = self.limiter.correction(at.mass, applied.saturation_error)
        self.filter.state = self.filter.next_state(self.filter.state, at.de, u, correction)
        if observer is not None:
            observer.predict(
                at.mass, self.filter.nominal_response(at.v, u, correction),
                at.inverse_dynamics - applied.tau, applied.clipping_error)
