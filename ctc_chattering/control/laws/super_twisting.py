"""
Law `super_twisting`: the super-twisting algorithm on v, discretised implicitly.

Levant 1993; the backward-Euler discretisation is that of Brogliato, Polyakov & Efimov, *The
implicit discretization of the supertwisting sliding-mode control algorithm*, IEEE TAC 65, 2020.
Joint by joint, with τ = N - M a and N = M (ddq_d + Kv de + Kp e) + C dq + G::

    a = k1 √|v| sgn(v) + w,     dw/dt = k2 sgn(v)                                             (1)

v then obeys dv/dt = -λ v - b (a + M⁻¹ P); sampled, v[k+1] = y - b h a - b h M⁻¹ P with y as in
docs/theory.md. All of (1) is taken at v⁺, the next v without a perturbation::

    v⁺ + b h k1 √|v⁺| sgn(v⁺) + b h² k2 ξ = r,     r = y - b h w[k],     ξ ∈ Sgn(v⁺)          (2)
    w[k+1] = w[k] + h k2 ξ,     a = k1 √|v⁺| sgn(v⁺) + w[k+1]                                 (3)

(2) has one solution: v⁺ = 0 and ξ = r / (b h² k2) if that is within ±1; otherwise ξ = sgn(r) and
√|v⁺| is the positive root of s² + b h k1 s + b h² k2 - |r| = 0. While v⁺ = 0, v is -b h M⁻¹ P.

With |d(M⁻¹ P)/dt| ≤ L on every joint, v stays there if k2 > L; k1 > √(k2 + L) brings it there
(Seeber & Horn 2017). With M̂ = c M the sampled v is multiplied by 1 - c at each sample: c < 2.
Under an input delay -M w is no part of the prediction: w follows v within a sample, and both would
correct the same error.
"""

from __future__ import annotations

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.laws.base import Law, State, Terms, Torque
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class SuperTwisting(Law):
    """Super-twisting with the integrator w [rad/s²]."""

    symbol = 'M (k₁ √|v⁺| sgn(v⁺) + w)'
    acts_on_v = True
    predicts = False

    def __init__(self, filter_: ErrorFilter) -> None:
        super().__init__(filter_)
        self._w = self._next = self.zero

    def configure(self, config: ControllerConfig, period: float) -> None:
        """Use other gains; w is preserved."""
        self._scale = config.b * period
        self._k1 = np.array(config.super_twisting_k1)
        self._step = period * np.array(config.super_twisting_k2)

    def reset(self) -> None:
        """Set w = 0."""
        self._w = self._next = self.zero

    def initialize(self, now: State, estimate: Array | None) -> None:
        """Set w so that it cancels the estimated perturbation."""
        self._w = self.zero
        if estimate is not None:
            self._w = -np.asarray(np.linalg.solve(now.M, estimate), float)

    def terms(self, at: State) -> Terms:
        """Return the terms of N - M a, and remember w of the next sample."""
        r = self.filter.nominal_response(at.v, at.u) - self._scale * self._w
        linear, bound = self._scale * self._k1, self._scale * self._step
        rest = np.maximum(np.abs(r) - bound, 0.0)
        root = 2.0 * rest / (linear + np.sqrt(linear * linear + 4.0 * rest))    # √|v⁺|
        xi = np.minimum(np.maximum(r / bound, -1.0), 1.0)
        self._next = self._w + self._step * xi                                  # (3)
        a = self._k1 * root * np.sign(r) + self._next
        return Terms(at.N, self.zero, at.M.dot(a))

    def advance(self, now: State, applied: Torque, correction: Array | None) -> None:
        """Advance w."""
        self._w = self._next

    def estimate(self, now: State) -> Array:
        """Return -M w, which is P while v⁺ = 0."""
        perturbation: Array = -now.M.dot(self._w)
        return perturbation


#: What the name of this module stands for.
LAW = SuperTwisting
