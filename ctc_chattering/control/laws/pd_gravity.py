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
Law `pd_gravity`: joint PD with gravity compensated.

Takegaki & Arimoto, *A new feedback method for dynamic control of manipulators*, ASME J. Dynamic
Systems, Measurement and Control 103, 1981. Kp and Kv are multiplied by the inertia
D_i = 1 / (M⁻¹)_ii that a joint has while the others are free. So the same gains suit every robot::

    τ = diag(D) (Kp e + Kv de) + G                                                           (PG1)

At a constant q_d all positive definite Kp, Kv make e = 0 asymptotically stable: locally, and
globally where D is constant. In motion e is not 0, since M ddq_d + C dq is left out. The
eigenvalues of M⁻¹ diag(D) are n or less. So the sampled loop with diagonal gains is stable if::

    h Kv < 2 / n     and     h Kp < 2 Kv                                                     (PG2)
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import inverse_diagonal
from ctc_chattering.control.laws.base import law, Nothing
from ctc_chattering.control.recommended_gains import PoleRule
from ctc_chattering.control.sample import State, Terms


@law(parameters=(), gain_rule=PoleRule(0.5))
class PdGravity(NamedTuple):
    """PD with gravity."""

    #: Its gains are in the state. A record needs a field.
    nothing: float = 0.0

    def terms(self, memory: Nothing, state: State) -> tuple[Terms, Nothing]:
        """Return the terms of (PG1)."""
        nominal = state.u / inverse_diagonal(state.M) + state.G
        return Terms(nominal, state.zero, state.zero, state.zero), memory
