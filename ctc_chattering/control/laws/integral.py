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

s is the saturation error, by which the limits changed the torque. Within the integral time T, x
tracks a torque that they allow. Without saturation and friction, e obeys
ddde + Kv dde + Kp de + Ki e = 0. This is stable if and only if, on every joint (Hurwitz)::

    Ki < Kv Kp,     behind drives with the lag L:  Ki < Kp (Kv - L Kp)                       (I3)

A triple pole at -p has Kv = 3 p, Kp = 3 p², Ki = p³. A sampled loop with M̂ = c M also needs
c h Kv < 2.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import dot, record, solve, some
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.base import law
from ctc_chattering.control.recommended_gains import PoleRule
from ctc_chattering.control.sample import Applied, State, Terms
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import matrix
import numpy as np


@record
class Integrated(NamedTuple):
    """Memory of the law."""

    #: x [rad/s²], shape (n,).
    x: Array


@record
class IntegralAction(NamedTuple):
    """The integral of e with back-calculation, (I2)."""

    #: h Ki [1/s²], shape (n,).
    gain: Array
    #: 1 - exp(-h / T), shape (n,); 0 for no anti-windup.
    tracking: Array

    def relieved(self, x: Array, M: Array, lost: Array) -> Array:
        """
        Return x less what is `lost` at limits.

        It tracks the torque that they allow, shape (n,) [N·m].
        """
        return x - self.tracking * solve(M, lost) if some(lost) else x

    def integrated(self, x: Array, now: State, lost: Array) -> Array:
        """Return x a period later by (I2)."""
        return self.relieved(x + self.gain * now.e, now.M, lost)


def integral_action(config: ControllerConfig, period: float) -> IntegralAction:
    """Return the integral of a configuration and period [s]."""
    ki = np.array(config.ki)
    kp = np.diag(matrix(config.kp, len(ki)))
    tracking = -np.expm1(-period * ki / kp)
    if not config.anti_windup:
        tracking = 0.0 * tracking
    return IntegralAction(period * ki, tracking)


@law(symbol='-M ∫ Ki e dt', parameters=('ki', 'anti_windup'), is_bounded=False,
     gain_rule=PoleRule(0.24, kp=3.0, kv=3.0, ki=1.0, reversal=1.0, start_duration=2.0))
class Integral(NamedTuple):
    """Computed torque with an integral."""

    action: IntegralAction

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> Integral:
        """Return the law of a configuration."""
        return cls(integral_action(config, period))

    @classmethod
    def largest_ki(cls, config: ControllerConfig) -> Array:
        """Return the bound of (I3), shape (n,) [1/s³]."""
        n = len(config.joint_names)
        lag = np.array(config.known_lag)
        kp = np.diag(matrix(config.kp, n))
        kv = np.diag(matrix(config.kv, n))
        bound: Array = kp * (kv - lag * kp)
        return bound

    def initial(self) -> Integrated:
        """Return x = 0."""
        return Integrated(0.0 * self.action.gain)

    def initialized(self, now: State, estimate: Array) -> Integrated:
        """Set x so that it cancels the estimated perturbation."""
        return Integrated(solve(now.M, estimate))

    def terms(self, memory: Integrated, state: State) -> tuple[Terms, Integrated]:
        """Return the terms of (I1)."""
        robust = -dot(state.M, memory.x)
        return Terms(state.N, state.zero, robust, state.zero), memory

    def advanced(self, memory: Integrated, now: State, applied: Applied) -> Integrated:
        """Advance x by (I2)."""
        return Integrated(self.action.integrated(memory.x, now, applied.saturation_error))

    def estimate(self, memory: Integrated, now: State) -> Array:
        """Return M x, which is P while e is constant."""
        return dot(now.M, memory.x)
