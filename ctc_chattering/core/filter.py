"""
The filter (3), with b > 0, λ > 0 and a state ξ that needs no acceleration.

In continuous time ``v = -b de + ξ`` with ``dξ/dt = -λ ξ + b [(λ I - Kv) de - Kp e]``, ξ(0) = 0.
Sampled, with the bracket held over each period h, this has the exact solution::

    ξ[k+1] = exp(-λ h) ξ[k] + (1 - exp(-λ h)) / λ · b [λ de - (Kv de + Kp e)]
"""

from __future__ import annotations

from math import exp, expm1

from ctc_chattering.core.model import Vector


class ErrorFilter:
    """
    State and coefficients of the filter (3).

    Parameters
    ----------
    n : int
        Number of joints.

    """

    def __init__(self, n: int) -> None:
        self.state: Vector = (0.0,) * n
        self.configure(10.0, 1.0, 1e-3)

    def configure(self, lambda_: float, b: float, period: float) -> None:
        """Set λ [1/s], b and the sample period [s]; the state ξ lives on."""
        self._lambda = lambda_
        self._b = b
        self.scale = b * period
        self._decay = exp(-lambda_ * period)
        self._gain = -b * expm1(-lambda_ * period) / lambda_

    def output(self, de: Vector, state: Vector | None = None) -> Vector:
        """Return v, shape (n,) [rad/s], at the present sample, or of another state ξ."""
        b = self._b
        return [x - b * d for x, d in zip(self.state if state is None else state, de)]

    def drift(self, v: Vector, feedback: Vector) -> Vector:
        """
        Return what v would be a period later if dde + Kv de + Kp e were 0, shape (n,) [rad/s].

        It is exp(-λ h) v + (b h - c) (Kv de + Kp e), with c the gain of the filter's input; the
        second part is of the order of h².
        """
        decay, rest = self._decay, self.scale - self._gain
        return [decay * x + rest * f for x, f in zip(v, feedback)]

    def update(self, de: Vector, feedback: Vector) -> None:
        """Advance ξ by one period; arguments as `advance` has them."""
        self.state = self.advance(self.state, de, feedback)

    def advance(self, state: Vector, de: Vector, feedback: Vector) -> Vector:
        """
        Return ξ, shape (n,), one period after `state`.

        Parameters
        ----------
        state : sequence of float, shape (n,)
            ξ [rad/s].
        de : sequence of float, shape (n,)
            Velocity error [rad/s].
        feedback : sequence of float, shape (n,)
            Kv de + Kp e [rad/s²].

        """
        decay, gain, lambda_ = self._decay, self._gain, self._lambda
        return [decay * x + gain * (lambda_ * d - f)
                for x, d, f in zip(state, de, feedback)]

    def shift(self, acceleration: Vector) -> Vector:
        """Return what `acceleration`, shape (n,) [rad/s²], adds to -v over a period [rad/s]."""
        return [self.scale * a for a in acceleration]

    def reset(self) -> None:
        """Set ξ = 0."""
        self.state = (0.0,) * len(self.state)

    def settle(self, de: Vector) -> None:
        """Set ξ so that v = 0 at the velocity error `de`, shape (n,) [rad/s]."""
        self.state = [self._b * d for d in de]
