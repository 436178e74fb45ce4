"""
Law `momentum_observer`: computed torque with a disturbance observer on the momentum.

De Luca & Mattone, *Actuator failure detection and isolation using generalized momenta*, ICRA 2003.
The momentum p = M dq of the plant M ddq + C dq + G + P = τ obeys, since dM/dt = C + Cᵀ::

    dp/dt = τ + β - P,     β = Cᵀ dq - G                                                      (1)

Their residual r = -P̂ follows -P with the gain K. Sampled, with τ held, β by the trapezoidal rule
and the filter exact for its pole::

    P[k-1] = τ[k-1] + ½ (β[k-1] + β[k]) - (p[k] - p[k-1]) / h                                 (2)
    P̂[k]   = P̂[k-1] + (1 - exp(-K h)) (P[k-1] - P̂[k-1])                                      (3)
    τ[k]   = M (ddq_d + Kv de + Kp e) + C dq + G + P̂[k]                                       (4)

τ in (2) is the torque that was applied, so the limits do not wind it up. With M̂ = c M, (2)
to (4) give P̂[k] = (1 - c (1 - exp(-K h))) P̂[k-1] + ..., which is stable if::

    c (1 - exp(-K h)) < 2                                                                     (5)
"""

from __future__ import annotations

from math import exp

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.laws.base import Law, State, Terms, Torque
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class MomentumObserver(Law):
    """Computed torque plus the estimate P̂ [N·m]."""

    symbol = '-P̂'

    def __init__(self, filter_: ErrorFilter) -> None:
        super().__init__(filter_)
        self.reset()

    def configure(self, config: ControllerConfig, period: float) -> None:
        """Use another gain; P̂ is preserved."""
        self._gain, self._period = 1.0 - exp(-config.momentum_gain * period), period

    def reset(self) -> None:
        """Set P̂ = 0."""
        self._estimate = self.zero
        self._before: tuple[Array, Array, Array] | None = None

    def initialize(self, now: State, estimate: Array | None) -> None:
        """Go on from the estimate of the other law."""
        self.reset()
        if estimate is not None:
            self._estimate = np.array(estimate)

    def update(self, now: State) -> None:
        """Improve P̂ by (2) and (3)."""
        if self._before is not None:
            p, beta, tau = self._before
            P = tau + 0.5 * (beta + _beta(now)) - (now.M.dot(now.dq) - p) / self._period
            self._estimate = self._estimate + self._gain * (P - self._estimate)

    def terms(self, at: State) -> Terms:
        """Return the terms of (4)."""
        return Terms(at.N, self.zero, -self._estimate)

    def advance(self, now: State, applied: Torque, correction: Array | None) -> None:
        """Remember momentum, β and torque for the next sample."""
        self._before = now.M.dot(now.dq), _beta(now), applied.tau

    def estimate(self, now: State) -> Array:
        """Return P̂."""
        del now
        return self._estimate


def _beta(at: State) -> Array:
    """Return Cᵀ dq - G, shape (n,) [N·m]."""
    beta: Array = at.dq.dot(at.C) - at.G
    return beta


#: What the name of this module stands for.
LAW = MomentumObserver
