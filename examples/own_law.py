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
A law of your own: computed torque with an estimate that leaks.

::

    τ = M (ddq_d + Kv de + Kp e) + C dq + G + P̂,     P̂[k+1] = (1 - h / T) P̂[k] + h Γ M s,
    s = de + e / T

Put the module where Python finds it, and name the class: ``law: own_law:LeakyIntegral``. What a
law has is in `ctc_chattering/control/laws/base.py`, what its methods may use in
`ctc_chattering/numerics/compilable.py`. It then runs in nodes and in `ctc simulate`, and compiled
in maps, all from this text.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.evaluation import State
from ctc_chattering.control.laws.base import Applied, law, Terms
from ctc_chattering.numerics.compilable import dot, record
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: T [s].
_TIME = 0.5


@record
class Leaky(NamedTuple):
    """The memory."""

    #: P̂ [N·m], shape (n,).
    perturbation: Array


@law(symbol='-P̂')
class LeakyIntegral(NamedTuple):
    """The law with its gains."""

    #: h [s], and h Γ [1/s], shape (n,); here Γ is the parameter ki.
    period: float
    gain: Array

    @classmethod
    def made(cls, config: ControllerConfig, period: float) -> LeakyIntegral:
        """Return the law of a configuration."""
        return cls(period, period * np.array(config.ki))

    def initial(self) -> Leaky:
        """Return P̂ = 0."""
        return Leaky(0.0 * self.gain)

    def terms(self, memory: Leaky, at: State) -> tuple[Terms, Leaky]:
        """Return nominal, compensation, robust term and what was clipped off it."""
        return Terms(at.N, at.zero, -memory.perturbation, at.zero), memory

    def advanced(self, memory: Leaky, now: State, applied: Applied, correction: Array) -> Leaky:
        """Return the memory a period later."""
        s = now.de + now.e / _TIME
        kept = (1.0 - self.period / _TIME) * memory.perturbation
        return Leaky(kept + self.gain * dot(now.M, s))

    def estimate(self, memory: Leaky, now: State) -> Array:
        """Return P̂, from which a law that follows begins."""
        return memory.perturbation
