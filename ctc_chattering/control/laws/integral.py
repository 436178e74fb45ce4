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
Law `integral`: computed torque with integral action.

Siciliano, Sciavicco, Villani & Oriolo, *Robotics: Modelling, Planning and Control*, 2009, sec.
8.5, with an integral in the feedback; back-calculation as in Åström & Hägglund, *PID Controllers*,
1995, sec. 3.5. Sampled, with x the integral::

    τ[k]   = M (ddq_d + Kv de + Kp e + x[k]) + C dq + G                                      (I1)
    x[k+1] = x[k] + h Ki e[k] - (1 - exp(-h / T)) M⁻¹ s[k],      T_i = Kp_ii / Ki_i          (I2)

s is the saturation error, what the limits took from the torque: x tracks what they allow within
the integral time T. Without saturation and friction, e obeys ddde + Kv dde + Kp de + Ki e = 0,
which is stable if and only if, on every joint (Hurwitz)::

    Ki < Kv Kp                                                                               (I3)

A triple pole at -p has Kv = 3 p, Kp = 3 p², Ki = p³. In a sampled loop (I1) with M̂ = c M needs
c h Kv < 2 as well.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import dot, record, solve, some
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.base import law
from ctc_chattering.control.sample import Applied, State, Terms
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import matrix
import numpy as np


@record
class Integrated(NamedTuple):
    """The memory of the law."""

    #: x [rad/s²], shape (n,).
    x: Array


@law(symbol='-M ∫ Ki e dt')
class Integral(NamedTuple):
    """Computed torque with an integral."""

    #: h Ki [1/s²], and 1 - exp(-h / T), 0 for no anti-windup, shape (n,).
    gain: Array
    tracking: Array

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> Integral:
        """Return the law of a configuration."""
        ki, kp = np.array(config.ki), matrix(config.kp, len(config.joint_names))
        tracking = -np.expm1(-period * ki / np.diag(kp))
        return cls(period * ki, tracking if config.anti_windup else 0.0 * tracking)

    def initial(self) -> Integrated:
        """Return x = 0."""
        return Integrated(0.0 * self.gain)

    def initialized(self, now: State, estimate: Array) -> Integrated:
        """Set x so that it cancels the estimated perturbation."""
        return Integrated(solve(now.M, estimate))

    def terms(self, memory: Integrated, at: State) -> tuple[Terms, Integrated]:
        """Return the terms of (I1)."""
        return Terms(at.N, at.zero, -dot(at.M, memory.x), at.zero), memory

    def advanced(self, memory: Integrated, now: State, applied: Applied) -> Integrated:
        """Advance x by (I2)."""
        x = memory.x + self.gain * now.e
        if some(applied.saturation_error):
            x = x - self.tracking * solve(now.M, applied.saturation_error)
        return Integrated(x)

    def estimate(self, memory: Integrated, now: State) -> Array:
        """Return M x, which is P where e is at rest."""
        return dot(now.M, memory.x)
