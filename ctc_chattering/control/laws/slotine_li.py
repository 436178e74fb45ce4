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
Law `slotine_li`: passivity-based, with adapted friction.

Slotine & Li, *On the adaptive control of robot manipulators*, IJRR 6(3), 1987, with Coulomb's
friction f as the one unknown parameter of each joint::

    dq_r = dq_d + Λ e,     ddq_r = ddq_d + Λ de,     s = dq_r - dq = de + Λ e                (SL1)
    τ[k] = M ddq_r + C dq_r + G + K s + f̂[k] tanh(dq_r / ε)                                  (SL2)
    f̂[k+1] = max(0, f̂[k] + h Γ tanh(dq_r / ε) s[k])                                         (SL3)

Λ = Kv⁻¹ Kp and K = diag(D) Kv, so that K s = diag(D) (Kv de + Kp e). D_i = 1 / (M⁻¹)_ii is the
inertia that a joint has while the others are free, so the same gains suit every robot. A joint
whose torque is at its limit does not adapt. The regressor has the velocity dq_r, since the sign of
the measured one rattles near rest. V = ½ sᵀ M s + ½ Σ (f - f̂)² / Γ falls for ε → 0::

    dV/dt = -sᵀ K s + Σ f_i (sgn dq_i - sgn dq_r,i) (dq_r,i - dq_i)  ≤  -sᵀ K s              (SL4)

since sgn is monotone. With ε > 0 at most 0.28 f ε per joint remains. The eigenvalues of
M⁻¹ diag(D) are n or less. So s and f̂, sampled and with diagonal gains, are stable if::

    h Γ < K_ii     and     h Kv < 2 / n                                                      (SL5)
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import dot, inverse_diagonal, record
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.base import law
from ctc_chattering.control.recommended_gains import PoleRule
from ctc_chattering.control.sample import Applied, State, Terms
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import matrix
import numpy as np


@record
class Adapted(NamedTuple):
    """Memory of the law."""

    #: f̂ [N·m], shape (n,).
    level: Array


@law(symbol='-f̂ tanh(dq_r / ε)', gain_rule=PoleRule(0.5, knows_friction=True),
     parameters=('adaptation_gain', 'friction_level', 'friction_velocity', 'anti_windup'))
class SlotineLi(NamedTuple):
    """Adaptive law."""

    #: Λ [1/s], shape (n, n).
    ratio: Array
    #: ε [rad/s].
    width: float
    #: h Γ [N·m·s/rad], shape (n,).
    gain: Array
    #: f̂ at the start [N·m], shape (n,).
    initial_level: Array
    #: 1.0 if a joint at its limit does not adapt, else 0.0.
    anti_windup: float

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> SlotineLi:
        """Return the law of a configuration."""
        n = len(config.joint_names)
        inverse = np.linalg.pinv(matrix(config.kv, n))
        return cls(
            ratio=inverse.dot(matrix(config.kp, n)),
            width=config.friction_velocity,
            gain=period * np.array(config.adaptation_gain),
            initial_level=np.array(config.friction_level),
            anti_windup=float(config.anti_windup))

    def initial(self) -> Adapted:
        """Return the configured level."""
        return Adapted(self.initial_level)

    def initialized(self, now: State, estimate: Array) -> Adapted:
        """
        Take f̂ of moving joints from the estimate.

        Joints at rest have the configured level.
        """
        y = self.regressor(now)
        is_moving = np.abs(y) > 0.5
        level = np.maximum(estimate / np.where(is_moving, y, 1.0), 0.0)
        return Adapted(np.where(is_moving, level, self.initial_level))

    def regressor(self, state: State) -> Array:
        """Return tanh(dq_r / ε), shape (n,)."""
        return np.tanh((state.dq_d + dot(self.ratio, state.e)) / self.width)

    def terms(self, memory: Adapted, state: State) -> tuple[Terms, Adapted]:
        """Return the terms of (SL2)."""
        M = state.M
        dq_r = state.dq_d + dot(self.ratio, state.e)
        ddq_r = state.ddq_d + dot(self.ratio, state.de)
        feedback = state.u / inverse_diagonal(M)
        nominal = dot(M, ddq_r) + dot(state.C, dq_r) + state.G + feedback
        robust = -memory.level * self.regressor(state)
        return Terms(nominal, state.zero, robust, state.zero), memory

    def advanced(self, memory: Adapted, now: State, applied: Applied) -> Adapted:
        """Adapt f̂ by (SL3)."""
        s = now.de + dot(self.ratio, now.e)
        change = self.gain * self.regressor(now) * s
        if self.anti_windup != 0.0:
            change = np.where(applied.saturation_error == 0.0, change, 0.0)
        return Adapted(np.maximum(memory.level + change, 0.0))

    def estimate(self, memory: Adapted, now: State) -> Array:
        """Return f̂ tanh(dq_r / ε)."""
        return memory.level * self.regressor(now)
