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

v then obeys dv/dt = -λ v - b (a + M⁻¹ P). Sampled, v[k+1] = y - b h a - b h M⁻¹ P with y of
docs/theory.md. All of (ST1) is evaluated at v⁺, the next v without a perturbation::

    v⁺ + b h k1 √|v⁺| sgn(v⁺) + b h² k2 ξ = r,     r = y - b h w[k],     ξ ∈ Sgn(v⁺)         (ST2)
    w[k+1] = w[k] + h k2 ξ,     a = k1 √|v⁺| sgn(v⁺) + w[k+1]                                (ST3)

(ST2) has one solution: v⁺ = 0 and ξ = r / (b h² k2) if that is within ±1. Otherwise ξ = sgn(r),
and √|v⁺| is the positive root of s² + b h k1 s + b h² k2 - |r| = 0. While v⁺ = 0, v is -b h M⁻¹ P.

With |d(M⁻¹ P)/dt| ≤ L on every joint, k1 > √(k2 + L) brings v there, and k2 > L keeps it there
(Seeber & Horn 2017). With M̂ = c M each sample multiplies v by 1 - c, so c < 2. The prediction of
an input delay leaves -M w out: w follows v within a sample, and both would correct the same error.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import dot, record, solve
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.filter import design_filter, ErrorFilter
from ctc_chattering.control.laws.base import law
from ctc_chattering.control.recommended_gains import PoleRule
from ctc_chattering.control.sample import Applied, State, Terms
from ctc_chattering.numerics.box_qp import clip
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class Twisted(NamedTuple):
    """Memory of the law, in arrays of shape (n,)."""

    #: w [rad/s²].
    w: Array
    #: w of the next sample [rad/s²].
    next_w: Array


@law(symbol='M (k₁ √|v⁺| sgn(v⁺) + w)', acts_on_v=True, is_bounded=False,
     parameters=('lambda', 'b', 'super_twisting_k1', 'super_twisting_k2', 'anti_windup'),
     gain_rule=PoleRule(0.3, fixed={'super_twisting_k1': 3.0, 'super_twisting_k2': 10.0}))
class SuperTwisting(NamedTuple):
    """Super-twisting with the integrator w."""

    filter: ErrorFilter  # noqa: A003
    #: k1 [√(rad/s³)], shape (n,).
    k1: Array
    #: Largest change of w in a sample, h k2 [rad/s²], shape (n,).
    jump: Array

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> SuperTwisting:
        """Return the law of a configuration."""
        return cls(
            design_filter(config.lambda_, config.b, period),
            k1=np.array(config.super_twisting_k1),
            jump=period * np.array(config.super_twisting_k2))

    def initial(self) -> Twisted:
        """Return w = 0."""
        return Twisted(0.0 * self.k1, 0.0 * self.k1)

    def initialized(self, now: State, estimate: Array) -> Twisted:
        """Set w so that it cancels the estimated perturbation."""
        w = -solve(now.M, estimate)
        return Twisted(w, w)

    def terms(self, memory: Twisted, state: State) -> tuple[Terms, Twisted]:
        """
        Return the terms of N - M a.

        The memory has w of the next sample.
        """
        bh = self.filter.scale
        r = self.filter.nominal_response(state.v, state.u) - bh * memory.w
        linear = bh * self.k1
        bound = bh * self.jump
        excess = np.maximum(np.abs(r) - bound, 0.0)
        discriminant = linear * linear + 4.0 * excess
        root = 2.0 * excess / (linear + np.sqrt(discriminant))                      # √|v⁺|
        xi = clip(r / bound, -1.0, 1.0)
        w = memory.w + self.jump * xi                                               # (ST3)
        a = self.k1 * root * np.sign(r) + w
        terms = Terms(state.N, state.zero, dot(state.M, a), state.zero)
        return terms, Twisted(memory.w, w)

    def advanced(self, memory: Twisted, now: State, applied: Applied) -> Twisted:
        """Advance w."""
        return Twisted(memory.next_w, memory.next_w)

    def estimate(self, memory: Twisted, now: State) -> Array:
        """Return -M w, which is P while v⁺ = 0."""
        return -dot(now.M, memory.w)

    def acting(self, memory: Twisted, now: State) -> Array:
        """Return 0, since w is no part of the delay prediction."""
        return now.zero
