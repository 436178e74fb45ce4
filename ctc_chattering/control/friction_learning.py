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
Learning of the level of Coulomb's friction, from an observer's estimate.

The law `observer_feedback` updates the level K̂ at every sample, from the observed velocity dq̂
and the estimate P̂. Where K̂ is too low by ΔK, P̂ jumps by 2 ΔK when the velocity changes its
sign, delayed by the observer. K̂ follows the correlation of P̂ with the sign of the velocity,
delayed alike: three lags of the observer's bandwidth ω. Both are taken above the frequency w₀::

    dK̂/dt = γ y φ,     y = HP(P̂),     φ = HP(LP³(sgn dq̂)),     0 <= K̂ <= Ka             (FL1)

with w₀ = 60 rad/s. The high-pass keeps slow errors of the model out, and friction that grows with
the velocity. A joint at rest, or one that does not turn back, teaches nothing.
"""

from __future__ import annotations

from math import exp
from typing import NamedTuple

from ctc_chattering.compiled.compilable import record
from ctc_chattering.numerics.box_qp import clip
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class LearnedFriction(NamedTuple):
    """
    Friction of every joint as learned so far.

    Attributes
    ----------
    level : ndarray
        K̂ [N·m].
    lag1, lag2, lag3 : ndarray
        Sign of the velocity behind one, two and three lags.
    slow_sign : ndarray
        Slow part of `lag3`.
    slow_estimate : ndarray
        Slow part of P̂ [N·m].

    """

    level: Array
    lag1: Array
    lag2: Array
    lag3: Array
    slow_sign: Array
    slow_estimate: Array


@record
class FrictionLearner(NamedTuple):
    """
    Learns the level of friction of every joint.

    Attributes
    ----------
    gain : float
        γ h.
    lag_gain, slow_gain : float
        1 - exp(-ω h) and 1 - exp(-w₀ h).
    bound : ndarray, shape (n,)
        Ka [N·m].

    """

    gain: float
    lag_gain: float
    slow_gain: float
    bound: Array

    def slow_down(self, factor: float) -> FrictionLearner:
        """Return a copy with a factor on ω."""
        return self._replace(lag_gain=factor * self.lag_gain)

    def learn(self, last: LearnedFriction, dq: Array, perturbation: Array) -> LearnedFriction:
        """
        Return the friction level updated with one sample.

        It takes dq̂ [rad/s] and P̂ [N·m].
        """
        if self.gain == 0.0:
            return last
        sign = np.where(np.abs(dq) > 2e-3, np.sign(dq), 0.0)  # Slower, the sign may be noise.
        lag1 = last.lag1 + self.lag_gain * (sign - last.lag1)
        lag2 = last.lag2 + self.lag_gain * (lag1 - last.lag2)
        lag3 = last.lag3 + self.lag_gain * (lag2 - last.lag3)
        slow_sign = last.slow_sign + self.slow_gain * (lag3 - last.slow_sign)
        slow_estimate = last.slow_estimate + self.slow_gain * (perturbation - last.slow_estimate)
        phi = lag3 - slow_sign
        level = last.level + self.gain * phi * (perturbation - slow_estimate)
        level = clip(level, 0.0, self.bound)
        return LearnedFriction(level, lag1, lag2, lag3, slow_sign, slow_estimate)


def design_learner(gain: float, bandwidth: float, period: float, bound: Array) -> FrictionLearner:
    """
    Return the learner for its gains.

    They are γ [1/s], ω [rad/s], h [s] and Ka, shape (n,) [N·m].
    """
    return FrictionLearner(
        gain=gain * period,
        lag_gain=1.0 - exp(-bandwidth * period),
        slow_gain=1.0 - exp(-60.0 * period),
        bound=bound)
