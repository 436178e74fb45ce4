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
Law `chattering`, equation (6) of the paper.

It has computed torque, compensation and chattering.

Its state is that of `control/sample.py`, with v of the filter (3)::

    τ = M (ddq_d + Kv de + Kp e) + C dq + G - C v - z                                         (6)

A switching (`control/switching.py`) evaluates z, which is Ka sgn(v) in the paper. v reaches 0 and
stays there if Ka exceeds the perturbation on every joint. docs/theory.md derives the sampled loop
and its tolerances.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import dot
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.base import law
from ctc_chattering.control.laws.registry import switching_class
from ctc_chattering.control.recommended_gains import SwitchingRule
from ctc_chattering.control.sample import Applied, State, Terms
from ctc_chattering.control.switching import Perturbation, Switching
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@law(symbol='chattering term z', of_the_paper=True, acts_on_v=True, gain_rule=SwitchingRule(),
     parameters=('ka', 'lambda', 'b', 'switching', 'boundary_layer', 'observer_bandwidth',
                 'anti_windup'))
class Chattering(NamedTuple):
    """Law (6)."""

    #: Ka [N·m], shape (n,).
    ka: Array
    switching: Switching

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> Chattering:
        """Return the law of a configuration."""
        switching = switching_class(config.switching).from_config(config, period)
        return cls(np.array(config.ka), switching)

    def with_gains(self, kp: Array, kv: Array, ka: Array) -> Chattering:
        """Return the law with another Ka."""
        return self._replace(ka=ka, switching=self.switching.with_gains(kp, kv, ka))

    @property
    def estimates(self) -> bool:
        """Return whether the switching has an estimate."""
        return self.switching.estimates

    def initial(self) -> Perturbation:
        """Return P̂ = 0."""
        zero = 0.0 * self.ka
        return Perturbation(zero, np.diag(zero), zero, zero, 0.0)

    def reconfigured(self, memory: Perturbation) -> Perturbation:
        """Keep P̂; forget the last sample."""
        return memory._replace(known=0.0)

    def initialized(self, now: State, estimate: Array) -> Perturbation:
        """Continue from the estimate of the other law, within ±Ka."""
        perturbation = nearest(now.M, estimate, self.ka)
        return self.initial()._replace(perturbation=perturbation)

    def updated(self, memory: Perturbation, now: State) -> Perturbation:
        """Correct the estimate, if the switching has one."""
        return self.switching.updated(memory, now)

    def terms(self, memory: Perturbation, state: State) -> tuple[Terms, Perturbation]:
        """Return the terms of (6)."""
        compensation = dot(state.C, state.v)
        z, clipping_error = self.switching.term(memory, state, compensation)
        return Terms(state.N, compensation, z, clipping_error), memory

    def advanced(self, memory: Perturbation, now: State, applied: Applied) -> Perturbation:
        """Predict the next sample, if the switching has an estimate."""
        return self.switching.advanced(memory, now, applied)

    def estimate(self, memory: Perturbation, now: State) -> Array:
        """Return P̂ of the switching."""
        return self.switching.estimate(memory, now)
