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
Law `friction_feedforward`: computed torque plus friction.

The friction is that of the desired velocity.

Armstrong-Hélouvry, Dupont & Canudas de Wit, *A survey of models, analysis tools and compensation
methods for the control of machines with friction*, Automatica 30(7), 1994. Coulomb's friction has
the configured level f and is smoothed::

    τ = M (ddq_d + Kv de + Kp e) + C dq + G + f tanh(dq_d / ε)                               (FF1)

The added term depends on the reference only, so no f makes the loop unstable. With M̂ = c M, the
sampled linear part is stable if::

    c h Kv < 2     and     h Kp < 2 Kv                                                       (FF2)
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import record
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.base import law, Nothing
from ctc_chattering.control.recommended_gains import PoleRule
from ctc_chattering.control.sample import State, Terms
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class FrictionAhead(NamedTuple):
    """
    Friction that is fed forward with a lead t.

    It is f tanh((dq_d + t ddq_d) / ε).
    """

    #: f [N·m], shape (n,).
    level: Array
    #: ε [rad/s].
    width: float
    #: t [s].
    lead: float

    def friction_torque(self, dq_d: Array, ddq_d: Array) -> Array:
        """Return the friction, shape (n,) [N·m]."""
        return self.level * np.tanh((dq_d + self.lead * ddq_d) / self.width)


def friction_ahead(config: ControllerConfig) -> FrictionAhead:
    """Return the friction of a configuration."""
    return FrictionAhead(
        np.array(config.friction_level), config.friction_velocity, config.friction_lead)


@law(symbol='-f tanh(dq_d / ε)', parameters=('friction_level', 'friction_velocity'),
     gain_rule=PoleRule(0.5, knows_friction=True))
class FrictionFeedforward(NamedTuple):
    """Computed torque with the feedforward (FF1)."""

    #: f [N·m], shape (n,).
    friction: Array
    #: ε [rad/s].
    width: float

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> FrictionFeedforward:
        """Return the law of a configuration."""
        return cls(np.array(config.friction_level), config.friction_velocity)

    def terms(self, memory: Nothing, state: State) -> tuple[Terms, Nothing]:
        """Return the terms of (FF1)."""
        robust = -self.estimate(memory, state)
        return Terms(state.N, state.zero, robust, state.zero), memory

    def estimate(self, memory: Nothing, now: State) -> Array:
        """Return f tanh(dq_d / ε)."""
        return self.friction * np.tanh(now.dq_d / self.width)
