"""
An estimate of the matched perturbation P = F(dq) - d(t), model error included.

Over one period with the torque τ held, the filter (3) gives, exactly for its pole::

    v[k+1] = y[k] - b h M⁻¹ (N[k] - τ[k] + P[k]),     y[k] = a v[k] + (b h - c) u[k]

with u = Kv de + Kp e, N = M (ddq_d + u) + C dq + G, a = exp(-λ h), c = b (1 - a) / λ. What the
last sample's v says of P is the residual of the closed loop (8), and the estimate follows it with
a bandwidth ω::

    r = M (y[k] - v[k+1]) / (b h) - (N[k] - τ[k]) - P̂ - ½ clipping,    P̂ += (1 - exp(-ω h)) r

With ω → ∞ the last residual is believed at once. P̂ is bounded by Ka, in the metric of M⁻¹: where
one joint's estimate meets its bound, the others' make up for it as far as the acceleration is
concerned. `clipping` is the clipping error, what the bound ±Ka has taken from the chattering term,
where that was less than Ka: noise around a perturbation close to Ka is clipped on one side only,
and the mean of what is lost must be made good, or v rests beside 0. A larger clipping error means
that v is still far from 0, and is left out.
"""

from __future__ import annotations

from math import exp
from typing import NamedTuple

from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class _Prediction(NamedTuple):
    """The next sample without a perturbation; see `PerturbationObserver.predict`."""

    mass: Array
    nominal: Array
    torque_residual: Array


class PerturbationObserver:
    """
    Estimates the perturbation, sample by sample.

    Parameters
    ----------
    n : int
        Number of joints.

    Attributes
    ----------
    estimate : array, shape (n,)
        P̂ [N·m].

    """

    def __init__(self, n: int) -> None:
        self.estimate: Array = np.zeros(n)
        self._predicted: _Prediction | None = None

    def configure(self, bandwidth: float, period: float, b: float, bound: Array) -> None:
        """
        Set what the estimate is made with; P̂ is preserved, the last sample is forgotten.

        Parameters
        ----------
        bandwidth : float
            ω [rad/s].
        period : float
            h [s].
        b : float
            Gain of the filter (3).
        bound : array, shape (n,)
            Ka [N·m].

        """
        self._gain = 1.0 - exp(-bandwidth * period)
        self._scale = b * period
        self._bound = bound
        self._predicted = None

    def reset(self) -> None:
        """Set P̂ = 0."""
        self.estimate = np.zeros_like(self.estimate)
        self._predicted = None

    def predict(self, mass: Array, nominal: Array, torque_residual: Array,
                clipping_error: Array | None) -> None:
        """
        Predict the next sample's v without a perturbation.

        Parameters
        ----------
        mass : array, shape (n, n)
            M [kg·m²].
        nominal : array, shape (n,)
            y [rad/s].
        torque_residual : array, shape (n,)
            N - τ, with the torque τ that is held from now on [N·m].
        clipping_error : array, shape (n,), or None
            What the bound has taken from the chattering term [N·m]; None for nothing.

        """
        if clipping_error is not None:
            shallow = np.abs(clipping_error) < self._bound
            torque_residual = torque_residual + np.where(shallow, 0.5 * clipping_error, 0.0)
        self._predicted = _Prediction(mass, nominal, torque_residual)

    def update(self, v: Array) -> None:
        """Improve the estimate by what v, shape (n,) [rad/s], has become."""
        if self._predicted is None:
            return
        mass, nominal, torque_residual = self._predicted
        residual = mass.dot((nominal - v) / self._scale) - torque_residual - self.estimate
        self.estimate = nearest(mass, self.estimate + self._gain * residual, self._bound)
