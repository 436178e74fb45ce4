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
bandwidth is stable. The torque f of the feedback shows it in two ways. Drives of a lower rate
than the law believes make f large, beyond Ka and what the drives follow, while the law believes
that they give it. Drives that are late make f oscillate on, while of a load, a reversal of
friction or a motion that is too hard each half-wave is smaller than the one before::

    r = max(|f_b - f_s| / (Ka + B + |f_s|),  min(|f|, f₁, f₂) / min(Ka, B)),    B = R / √Kp
    d(ln s)/dt = -w max(r - 1/2, 0) - ln(s) / t                                            (OG1)

with w = 80 rad/s, t = 2 seconds, 0.1 <= s <= 1. Drives with the rate limit R follow B at the pole
of the feedback; where R is not known, B counts for nothing. f_b is f less what the law knows that
the drives do not give; f_s is its slow part, below 30 s rad/s, which is there where Ka is too
small or the motion smooth; f₁ and f₂ are the sizes of the last half-wave and the one before, which
fade with 10 rad/s. The largest ratio of all joints counts, and s is one number, since joints are
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
#: Below which the feedback is slow, at s = 1, and how fast a half-wave fades [rad/s].
_SLOW, _FADING = 30.0, 10.0
#: The ratio r that is normal; w [rad/s]; t [s].
_NORMAL, _RETREAT, _RETURN = 0.5, 80.0, 2.0
#: Feedback in Ka, and s, beyond and below which the loop may be out of control.
_STRONG, _LOW = 3.0, 0.2
#: How much later that counts after a start that is strong from the first sample on [s].
GRACE = 2.0
#: In the place of a bound of 0 [N·m].
_TINY = 1e-9


@record
class Oscillation(NamedTuple):
    """What is remembered of the feedback."""

    #: f_s [N·m], shape (n,).
    slow: Array
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

    #: Ka, Ka + B and the lesser of Ka and B [N·m], shape (n,).
    bound: Array
    believed: Array
    sustained: Array
    #: 1 - exp(-30 h) and exp(-10 h).
    renewed: float
    fading: float
    #: 80 h, exp(-h / 2 s), and the least ln s.
    retreating: float
    kept: float
    farthest: float
    #: ln 0.2, and h [s].
    low: float
    period: float

    def noticed(self, last: Oscillation, feedback: Array, missing: Array) -> Oscillation:
        """
        Return what follows a sample, by (OG1); arrays of shape (n,) [N·m].

        Parameters
        ----------
        last : Oscillation
            After the sample before.
        feedback, missing : array, shape (n,)
            f, and what the law knows that the drives do not give.

        """
        size, largest = np.abs(feedback), self.fading * np.abs(last.extreme)
        turned = np.sign(feedback) * last.extreme < 0.0
        extreme = np.where(turned | (size > largest), feedback, self.fading * last.extreme)
        f1 = np.where(turned, largest, self.fading * last.last)
        f2 = self.fading * np.where(turned, last.last, last.second_last)
        believed = np.sign(feedback) * np.maximum(size - np.abs(missing), 0.0)
        slow = last.slow + exp(last.retreat) * self.renewed * (believed - last.slow)
        ratio = np.maximum(np.abs(believed - slow) / (self.believed + np.abs(slow)),
                           np.minimum(size, np.minimum(f1, f2)) / self.sustained).max()
        retreat = self.kept * last.retreat - self.retreating * max(ratio - _NORMAL, 0.0)
        strained = last.strained + self.period
        if (size / self.bound).max() < _STRONG or retreat > self.low:
            strained = 0.0
        return Oscillation(slow, extreme, f1, f2, max(retreat, self.farthest), strained)


def oscillation_guard(bound: Array, rate: Array, pole: Array, period: float) -> OscillationGuard:
    """Return a guard for Ka [N·m], R [N·m/s] and √Kp_ii [rad/s], shape (n,), and h [s]."""
    bound, followed = np.maximum(bound, _TINY), rate / pole
    return OscillationGuard(
        bound, bound + np.where(followed < np.inf, followed, 0.0), np.minimum(bound, followed),
        1.0 - exp(-_SLOW * period), exp(-_FADING * period), _RETREAT * period,
        exp(-period / _RETURN), log(LEAST), log(_LOW), period)
