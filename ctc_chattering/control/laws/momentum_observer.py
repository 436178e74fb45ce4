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
Law `momentum_observer`: computed torque with a momentum observer.

De Luca & Mattone, *Actuator failure detection and isolation using generalized momenta*, ICRA 2003.
The momentum p = M dq of the plant M ddq + C dq + G + P = τ obeys, since dM/dt = C + Cᵀ::

    dp/dt = τ + β - P,     β = Cᵀ dq - G                                                     (MO1)

P is the perturbation, and C the matrix of Christoffel symbols. Their residual r = -P̂ tracks -P
with the bandwidth K [rad/s] (`momentum_gain`). In discrete time τ is constant over a period, β is
integrated by the trapezoidal rule, and the first-order filter is exact::

    P[k-1] = τ[k-1] + ½ (β[k-1] + β[k]) - (p[k] - p[k-1]) / h                                (MO2)
    P̂[k]   = P̂[k-1] + (1 - exp(-K h)) (P[k-1] - P̂[k-1])                                    (MO3)
    τ[k]   = M (ddq_d + Kv de + Kp e) + C dq + G + P̂[k]                                      (MO4)

τ in (MO2) is the torque that was applied, so saturation does not wind P̂ up. With a model's
inertia of a M, (MO2) to (MO4) give P̂[k] = (1 - a (1 - exp(-K h))) P̂[k-1] + ..., which is stable
if::

    a (1 - exp(-K h)) < 2                                                                    (MO5)
"""

from __future__ import annotations

from math import exp
from typing import NamedTuple

from ctc_chattering.compiled.compilable import dot, record, transposed_dot
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.base import law
from ctc_chattering.control.recommended_gains import PoleRule
from ctc_chattering.control.sample import Applied, State, Terms
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class Momentum(NamedTuple):
    """Memory of the law, in arrays of shape (n,)."""

    #: P̂ [N·m].
    perturbation: Array
    #: M dq of the last sample [N·m·s].
    p: Array
    #: β of the last sample [N·m].
    beta: Array
    #: Torque applied after the last sample [N·m].
    tau: Array
    #: 1.0 after the first sample, else 0.0.
    has_sample: float


@law(symbol='-P̂', parameters=('momentum_gain',), is_bounded=False,
     gain_rule=PoleRule(0.3, times_p={'momentum_gain': 1.0}))
class MomentumObserver(NamedTuple):
    """Computed torque plus the estimate P̂."""

    #: 1 - exp(-K h).
    gain: float
    #: h [s].
    period: float
    #: Zeros, shape (n,).
    zero: Array

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> MomentumObserver:
        """Return the law of a configuration."""
        gain = 1.0 - exp(-config.momentum_gain * period)
        return cls(gain, period, np.zeros(len(config.joint_names)))

    def initial(self) -> Momentum:
        """Return the memory at the start, with P̂ = 0."""
        return Momentum(self.zero, self.zero, self.zero, self.zero, 0.0)

    def initialized(self, now: State, estimate: Array) -> Momentum:
        """Return the memory that continues from another law's estimate."""
        return self.initial()._replace(perturbation=estimate)

    def updated(self, memory: Momentum, now: State) -> Momentum:
        """Correct P̂ by (MO2) and (MO3)."""
        p = dot(now.M, now.dq)
        beta = transposed_dot(now.C, now.dq) - now.G
        P = memory.perturbation
        if memory.has_sample != 0.0:
            dp = (p - memory.p) / self.period
            measured_P = memory.tau + 0.5 * (memory.beta + beta) - dp
            P = P + self.gain * (measured_P - P)
        return memory._replace(perturbation=P, p=p, beta=beta)

    def terms(self, memory: Momentum, state: State) -> tuple[Terms, Momentum]:
        """Return the terms of (MO4) at `state`, predicted for when the torque acts."""
        return Terms(state.N, state.zero, -memory.perturbation, state.zero), memory

    def advanced(self, memory: Momentum, now: State, applied: Applied) -> Momentum:
        """Remember the torque for the next sample."""
        return memory._replace(tau=applied.tau, has_sample=1.0)

    def estimate(self, memory: Momentum, now: State) -> Array:
        """Return P̂."""
        return memory.perturbation
