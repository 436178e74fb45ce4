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
How much of its bandwidth a loop may use: less while its feedback oscillates.

Drives that are slower than their model (rate limit, lag, delay) make a fast loop oscillate: what
the drives lack goes into the estimate, which asks for more. The same loop with a part of its
bandwidth is stable. The torque f of the feedback shows it. A load, a reversal of friction or a
motion that is too hard for the drives makes f large, too, even beyond Ka, but each of its
half-waves is smaller than the one before. So with the sizes f₁ and f₂ of the last half-wave and
the one before, which fade with 10 rad/s, so that a slow motion is no oscillation::

    r = max(min(|f|, f₁, f₂) / min(Ka, R / √Kp),  f₁ / Ka where |f| >= f₁)
    d(ln s)/dt = -w max(r - 1/2, 0) - ln(s) / t                                            (OG1)

with w = 80 rad/s, t = 2 seconds, 0.1 <= s <= 1. The first part is an oscillation that goes on:
drives with the rate limit R follow none beyond R / √Kp at the pole of the feedback. The second is
one that grows. The largest ratio of all joints counts, and s is one number, since joints are
coupled. Where less bandwidth does not help, f exceeds 3 Ka with s < 0.2; a start far from the
reference does so, too, and has 2 seconds.
"""

from __future__ import annotations

from math import exp, log
from typing import NamedTuple

from ctc_chattering.numerics.compilable import record
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Least s.
LEAST = 0.1
#: How fast a half-wave fades [rad/s]; the ratio r that is normal; w [rad/s]; t [s].
_FADING, _NORMAL, _RETREAT, _RETURN = 10.0, 0.5, 80.0, 2.0
#: Feedback in Ka, and s, beyond and below which the loop may be out of control.
_STRONG, _LOW = 3.0, 0.2
#: How much later that counts after a start that is strong from the first sample on [s].
GRACE = 2.0
#: In the place of a bound of 0 [N·m].
_TINY = 1e-9


@record
class Oscillation(NamedTuple):
    """What is remembered of the feedback."""

    #: Extreme of this half-wave of f, with its sign; f₁ and f₂; shape (n,) [N·m].
    extreme: Array
    last: Array
    second_last: Array
    #: ln s.
    retreat: float
    #: How long f has exceeded 3 Ka with s < 0.2, from -2 at the start on [s].
    strained: float


@record
class OscillationGuard(NamedTuple):
    """Says how much bandwidth a loop may use; made by `oscillation_guard`."""

    #: Ka and the lesser of Ka and R / √Kp_ii [N·m], shape (n,).
    bound: Array
    tolerated: Array
    #: exp(-10 h).
    fading: float
    #: 80 h, exp(-h / 2 s), and the least ln s.
    retreating: float
    kept: float
    farthest: float
    #: ln 0.2, and h [s].
    low: float
    period: float

    def noticed(self, last: Oscillation, feedback: Array) -> Oscillation:
        """Return what follows a sample with the feedback f, shape (n,) [N·m], by (OG1)."""
        size, largest = np.abs(feedback), self.fading * np.abs(last.extreme)
        turned = np.sign(feedback) * last.extreme < 0.0
        extreme = np.where(turned | (size > largest), feedback, self.fading * last.extreme)
        f1 = np.where(turned, largest, self.fading * last.last)
        f2 = self.fading * np.where(turned, last.last, last.second_last)
        sustained = np.minimum(size, np.minimum(f1, f2)) / self.tolerated
        growing = np.where(size >= f1, f1, 0.0) / self.bound
        ratio = np.maximum(sustained, growing).max()
        retreat = self.kept * last.retreat - self.retreating * max(ratio - _NORMAL, 0.0)
        strained = last.strained + self.period
        if (size / self.bound).max() < _STRONG or retreat > self.low:
            strained = 0.0
        return Oscillation(extreme, f1, f2, max(retreat, self.farthest), strained)


def oscillation_guard(bound: Array, rate: Array, pole: Array, period: float) -> OscillationGuard:
    """Return a guard for Ka [N·m], R [N·m/s] and √Kp_ii [rad/s], shape (n,), and h [s]."""
    bound = np.maximum(bound, _TINY)
    return OscillationGuard(
        bound, np.minimum(bound, rate / pole), exp(-_FADING * period), _RETREAT * period,
        exp(-period / _RETURN), log(LEAST), log(_LOW), period)
