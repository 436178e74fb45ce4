"""
The filter (3), with b > 0, λ > 0 and a state ξ that needs no acceleration.

In continuous time ``v = -b de + ξ`` with ``dξ/dt = -λ ξ + b [(λ I - Kv) de - Kp e]``, ξ(0) = 0.
Sampled, with the bracket held over each period h, this has the exact solution::

    ξ[k+1] = exp(-λ h) ξ[k] + (1 - exp(-λ h)) / λ · b [λ de - u],     u = Kv de + Kp e
"""

from __future__ import annotations

from math import exp, expm1

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class ErrorFilter:
    """
    State and coefficients of the filter (3).

    Parameters
    ----------
    n : int
        Number of joints.

    Attributes
    ----------
    state : array, shape (n,)
        ξ [rad/s].
    scale : float
        b h [s].

    """

    def __init__(self, n: int) -> None:
        self.state: Array = np.zeros(n)
        self.configure(10.0, 1.0, 1e-3)

    def configure(self, lambda_: float, b: float, period: float) -> None:
        """Set λ [1/s], b and the sample period [s]; the state ξ is preserved."""
        self.scale = b * period
        decay, gain = exp(-lambda_ * period), -b * expm1(-lambda_ * period) / lambda_
        # Arrays, because a product with a float takes twice as long.
        self._lambda, self._b, self._decay, self._gain, self._rest = (
            np.full(len(self.state), x) for x in (lambda_, b, decay, gain, self.scale - gain))

    def reset(self) -> None:
        """Set ξ = 0."""
        self.state = np.zeros_like(self.state)

    def initialize_bumpless(self, de: Array) -> None:
        """Set ξ so that v = 0 at the velocity error `de`, shape (n,) [rad/s]."""
        self.state = self._b * de

    def output(self, de: Array, state: Array) -> Array:
        """Return v, shape (n,) [rad/s], at the velocity error `de` and the state ξ."""
        return state - self._b * de

    def next_state(self, state: Array, de: Array, u: Array, correction: Array | None = None
                   ) -> Array:
        """
        Return ξ, shape (n,), one period after `state`.

        Parameters
        ----------
        state : array, shape (n,)
            ξ [rad/s].
        de : array, shape (n,)
            Velocity error [rad/s].
        u : array, shape (n,)
            Kv de + Kp e [rad/s²].
        correction : array, shape (n,), optional
            Anti-windup correction [rad/s].

        """
        ahead = self._decay * state + self._gain * (self._lambda * de - u)
        return ahead if correction is None else ahead + correction

    def nominal_response(self, v: Array, u: Array, correction: Array | None = None) -> Array:
        """
        Return y: what v would be a period later if dde + Kv de + Kp e were 0, shape (n,) [rad/s].

        It is exp(-λ h) v + (b h - c) u, with c the gain of the filter's input; the second part is
        of the order of h². Arguments as `next_state` has them.
        """
        ahead = self._decay * v + self._rest * u
        return ahead if correction is None else ahead + correction
