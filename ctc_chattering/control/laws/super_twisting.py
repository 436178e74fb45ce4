# Copyright 2026 The ctc_chattering maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Law `super_twisting`: the super-twisting algorithm on v, discretised implicitly.

Levant 1993; the backward-Euler discretisation is that of Brogliato, Polyakov & Efimov, *The
implicit discretization of the supertwisting sliding-mode control algorithm*, IEEE TAC 65, 2020.
Joint by joint, with τ = N - M a and N = M (ddq_d + Kv de + Kp e) + C dq + G::

    a = k1 √|v| sgn(v) + w,     dw/dt = k2 sgn(v)                                            (ST1)

v then obeys dv/dt = -λ v - b (a + M⁻¹ P); sampled, v[k+1] = y - b h a - b h M⁻¹ P with y as in
docs/theory.md. All of (ST1) is taken at v⁺, the next v without a perturbation::

    v⁺ + b h k1 √|v⁺| sgn(v⁺) + b h² k2 ξ = r,     r = y - b h w[k],     ξ ∈ Sgn(v⁺)         (ST2)
    w[k+1] = w[k] + h k2 ξ,     a = k1 √|v⁺| sgn(v⁺) + w[k+1]                                (ST3)

(ST2) has one solution: v⁺ = 0 and ξ = r / (b h² k2) if that is within ±1; otherwise ξ = sgn(r) and
√|v⁺| is the positive root of s² + b h k1 s + b h² k2 - |r| = 0. While v⁺ = 0, v is -b h M⁻¹ P.

With |d(M⁻¹ P)/dt| ≤ L on every joint, v stays there if k2 > L; k1 > √(k2 + L) brings it there
(Seeber & Horn 2017). With M̂ = c M the sampled v is multiplied by 1 - c at each sample: c < 2.
Under an input delay -M w is no part of the prediction: w follows v within a sample, and both would
correct the same error.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import dot, record, solve
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.filter import design_filter, ErrorFilter
from ctc_chattering.control.laws.base import law
from ctc_chattering.control.sample import Applied, State, Terms
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class Twisted(NamedTuple):
    """The memory of the law; arrays of shape (n,)."""

    #: w, and w of the next sample [rad/s²].
    w: Array
    coming: Array


@law(symbol='M (k₁ √|v⁺| sgn(v⁺) + w)', acts_on_v=True)
class SuperTwisting(NamedTuple):
    """Super-twisting with the integrator w."""

    filter: ErrorFilter  # noqa: A003
    #: k1 and h k2, shape (n,).
    k1: Array
    jump: Array

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> SuperTwisting:
        """Return the law of a configuration."""
        return cls(design_filter(config.lambda_, config.b, period),
                   np.array(config.super_twisting_k1), period * np.array(config.super_twisting_k2))

    def initial(self) -> Twisted:
        """Return w = 0."""
        return Twisted(0.0 * self.k1, 0.0 * self.k1)

    def initialized(self, now: State, estimate: Array) -> Twisted:
        """Set w so that it cancels the estimated perturbation."""
        w = -solve(now.M, estimate)
        return Twisted(w, w)

    def terms(self, memory: Twisted, at: State) -> tuple[Terms, Twisted]:
        """Return the terms of N - M a, and remember w of the next sample."""
        scale = self.filter.scale
        r = self.filter.nominal_response(at.v, at.u) - scale * memory.w
        linear, bound = scale * self.k1, scale * self.jump
        rest = np.maximum(np.abs(r) - bound, 0.0)
        root = 2.0 * rest / (linear + np.sqrt(linear * linear + 4.0 * rest))    # √|v⁺|
        xi = np.minimum(np.maximum(r / bound, -1.0), 1.0)
        coming = memory.w + self.jump * xi                                      # (ST3)
        a = self.k1 * root * np.sign(r) + coming
        return Terms(at.N, at.zero, dot(at.M, a), at.zero), Twisted(memory.w, coming)

    def advanced(self, memory: Twisted, now: State, applied: Applied) -> Twisted:
        """Advance w."""
        return Twisted(memory.coming, memory.coming)

    def estimate(self, memory: Twisted, now: State) -> Array:
        """Return -M w, which is P while v⁺ = 0."""
        return -dot(now.M, memory.w)

    def acting(self, memory: Twisted, now: State) -> Array:
        """Return 0; see the module."""
        return now.zero
