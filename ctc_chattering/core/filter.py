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
        self._decay = exp(-lambda_ * period)
        self._gain = -b * expm1(-lambda_ * period) / lambda_

    def output(self, de: Vector) -> Vector:
        """Return v, shape (n,) [rad/s], at the present sample."""
        b = self._b
        return [x - b * d for x, d in zip(self.state, de)]

    def update(self, de: Vector, feedback: Vector) -> None:
        """
        Advance ξ by one period.

        Parameters
        ----------
        de : sequence of float, shape (n,)
            Velocity error [rad/s].
        feedback : sequence of float, shape (n,)
            Kv de + Kp e [rad/s²].

        """
        decay, gain, lambda_ = self._decay, self._gain, self._lambda
        self.state = [decay * x + gain * (lambda_ * d - f)
                      for x, d, f in zip(self.state, de, feedback)]

    def reset(self) -> None:
        """Set ξ = 0."""
        self.state = (0.0,) * len(self.state)
