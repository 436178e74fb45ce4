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
The level of Coulomb's friction, learned from what an observer still has to add.

Where the level K̂ is too low by ΔK, the estimate P̂ jumps by 2 ΔK, delayed by the observer, when
the velocity changes its sign. K̂ follows the correlation of P̂ with the sign of the velocity,
delayed alike (three lags of the observer's bandwidth ω), both above the frequency w₀::

    dK̂/dt = γ y φ,     y = HP(P̂),     φ = HP(LP³(sgn dq̂)),     0 <= K̂ <= Ka             (FL1)

The high-pass keeps slow errors of the model out, and a friction that grows with the velocity. A
joint at rest, or one that does not turn back, teaches nothing.
"""

from __future__ import annotations

from math import exp
from typing import NamedTuple

from ctc_chattering.numerics.compilable import record, some
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: w₀ [rad/s].
_SLOW = 60.0
#: Velocity that counts as motion [rad/s].
_MOVING = 2e-3


@record
class Learned(NamedTuple):
    """What has been learned of the friction of every joint; arrays of shape (n,)."""

    #: K̂ [N·m].
    level: Array
    #: Of the sign of the velocity: outputs of the three lags, and the slow part of the last.
    lag1: Array
    lag2: Array
    lag3: Array
    slow_sign: Array
    #: Slow part of the estimate [N·m].
    slow_estimate: Array


@record
class FrictionLevel(NamedTuple):
    """Learns the level of friction of every joint; made by `friction_level`."""

    #: γ h, 1 - exp(-ω h) and 1 - exp(-w₀ h).
    gain: Array
    follow: Array
    forget: Array
    #: Ka [N·m]; all of shape (n,).
    bound: Array

    def slowed(self, part: float) -> FrictionLevel:
        """Return what learns from an estimate that follows with a part of ω."""
        return FrictionLevel(self.gain, part * self.follow, self.forget, self.bound)

    def learn(self, last: Learned, dq: Array, perturbation: Array) -> Learned:
        """Return K̂ improved by dq̂ [rad/s] and P̂ [N·m], shape (n,), of one sample."""
        if not some(self.gain):
            return last
        sign = np.where(np.abs(dq) > _MOVING, np.sign(dq), 0.0)
        lag1 = last.lag1 + self.follow * (sign - last.lag1)
        lag2 = last.lag2 + self.follow * (lag1 - last.lag2)
        lag3 = last.lag3 + self.follow * (lag2 - last.lag3)
        slow_sign = last.slow_sign + self.forget * (lag3 - last.slow_sign)
        slow = last.slow_estimate + self.forget * (perturbation - last.slow_estimate)
        level = last.level + self.gain * (lag3 - slow_sign) * (perturbation - slow)
        return Learned(np.minimum(np.maximum(level, 0.0), self.bound), lag1, lag2, lag3,
                       slow_sign, slow)


def friction_level(gain: float, bandwidth: float, period: float, bound: Array) -> FrictionLevel:
    """Return what learns with γ [1/s], ω [rad/s], h [s] and Ka, shape (n,) [N·m]."""
    one = np.ones_like(bound)
    return FrictionLevel(gain * period * one, (1.0 - exp(-bandwidth * period)) * one,
                         (1.0 - exp(-_SLOW * period)) * one, bound)


def untaught(level: Array) -> Learned:
    """Return the start at the level K̂, shape (n,) [N·m]."""
    zero = np.zeros_like(level)
    return Learned(level, zero, zero, zero, zero, zero)
