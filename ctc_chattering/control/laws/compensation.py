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
Law `compensation`, equation (2) of the paper.

It has computed torque and compensation.

Its state is that of `control/sample.py`, with v of the filter (3)::

    τ = M (ddq_d + Kv de + Kp e) + C dq + G - C v                                             (2)

With M̂ = c M instead of M, the sampled linear part is stable if c h Kv < 2 and h Kp < 2 Kv.
Friction is not cancelled: v settles where λ M v balances it.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import dot
from ctc_chattering.control.laws.base import law, Nothing
from ctc_chattering.control.recommended_gains import PoleRule
from ctc_chattering.control.sample import State, Terms


@law(of_the_paper=True, acts_on_v=True, parameters=('lambda', 'b', 'anti_windup'),
     gain_rule=PoleRule(0.5))
class Compensation(NamedTuple):
    """Law (2)."""

    #: Its gains are in the state. A record needs a field.
    nothing: float = 0.0

    def terms(self, memory: Nothing, state: State) -> tuple[Terms, Nothing]:
        """Return the terms of (2)."""
        return Terms(state.N, dot(state.C, state.v), state.zero, state.zero), memory
