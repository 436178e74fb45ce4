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
Oscillation guard, which takes bandwidth from a loop that oscillates.

The law `observer_feedback` calls it at every sample with its feedback torque f, and multiplies its
bandwidths by the fraction s. Drives that are slower than their model (rate limit, lag, delay) make
a fast loop oscillate: the torque that the drives lack goes into the estimate, which asks for more.
The same loop with a fraction of its bandwidth is stable. f shows it in two ways. Drives of a lower
rate than the law believes make f large, beyond Ka and what the drives follow, while the law
believes that they give it. Drives that are late make f oscillate on. Under a load, a reversal of
friction or a motion that is too hard, each half-wave is smaller than the one before::

    r = max(|f_b - f_s| / (Ka + B + |f_s|),  min(|f|, f₁, f₂) / min(Ka, B)),    B = R / √Kp
    d(ln s)/dt = -w max(r - 1/2, 0) - ln(s) / t                                            (OG1)

with w = 80 rad/s, t = 2 seconds, 0.1 <= s <= 1. Drives with the rate limit R follow B at the pole
of the feedback. Where R is not known, B counts for nothing. f_b is f less the torque that the law
knows the drives not to give. f_s is its slow part, below 30 s rad/s, which is there where Ka is
too small or the motion smooth. f₁ and f₂ are the sizes of the last half-wave and the one before,
which fade with 10 rad/s. The largest ratio of all joints counts, and s is one number, since joints
are coupled. Where less bandwidth does not help, f exceeds 3 Ka with s < 0.2. A start far from the
reference does so as well, and has 2 seconds.

Elastic joints, or an inertia that is far from the model's, keep the loop oscillating at any s: f
stays within 3 Ka, and s low. L is how long such a limit cycle lasts::

    dL/dt = 1 where s < 0.7 and m has exceeded 1/4 within 0.2 s, else 0 where s < 0.3, else -1
    m = min(|f|, f₁, f₂) / min(Ka, B), the largest of all joints                           (OG2)

with L >= 0. m counts from half of the ratio at which the bandwidth retreats. An oscillation that
comes back as soon as s recovers counts as one. Drives that are slower or later than configured
oscillate for half a second, until s is low enough. The joint of the largest half-waves and the
frequency of its f say what oscillates.
"""

from __future__ import annotations

from math import exp, log
from typing import NamedTuple

from ctc_chattering.compiled.compilable import function, record
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Time in which a start may be strained without consequence [s].
START_GRACE_S = 2.0
#: w of (OG1) [rad/s].
RETREAT_RATE_RAD_S = 80.0
#: ln s at the least s.
_LN_LEAST = log(0.1)
#: ln s below which a strong feedback means a loop out of control.
_LN_STRAINED = log(0.2)
#: ln s below which a calm may be that between two oscillations.
_LN_INTERMITTENT = log(0.3)
#: ln s below which a loop that goes on oscillating has a limit cycle.
_LN_CYCLING = log(0.7)


@record
class Oscillation(NamedTuple):
    """
    Oscillation of the feedback f so far.

    Attributes
    ----------
    slow : ndarray, shape (n,)
        f_s [N·m].
    extreme, last, second_last : ndarray, shape (n,)
        Extreme of this half-wave of f, with its sign, f₁ and f₂ [N·m].
    retreat : float
        ln s.
    strained : float
        Time for which f has exceeded 3 Ka with s < 0.2, from -2 at the start on [s].
    frequency : ndarray, shape (n,)
        Waves of f a second [Hz].
    calm, cycling : float
        Time since a half-wave of a limit cycle, and L of (OG2) [s].

    """

    slow: Array
    extreme: Array
    last: Array
    second_last: Array
    retreat: float
    strained: float
    frequency: Array
    calm: float
    cycling: float


@record
class OscillationGuard(NamedTuple):
    """
    Guard that computes s, the bandwidth's usable fraction.

    Attributes
    ----------
    bound, believed, sustained : ndarray, shape (n,)
        Ka, Ka + B, and the lesser of Ka and B [N·m].
    slow_gain : float
        1 - exp(-30 h).
    wave_decay, retreat_decay, frequency_decay : float
        exp(-10 h), exp(-h / 2 s) and exp(-h / 0.25 s).
    period : float
        h [s].

    """

    bound: Array
    believed: Array
    sustained: Array
    slow_gain: float
    wave_decay: float
    retreat_decay: float
    frequency_decay: float
    period: float

    def update_oscillation(self, last: Oscillation, feedback: Array, missing: Array
                           ) -> Oscillation:
        """
        Return the oscillation after a sample.

        Equations (OG1) and (OG2) describe it.

        Parameters
        ----------
        last : Oscillation
            After the sample before.
        feedback, missing : array, shape (n,)
            f, and the torque that the law knows the drives not to give [N·m].

        """
        h = self.period
        decay = self.wave_decay
        size = np.abs(feedback)
        sign = np.sign(feedback)
        peak = decay * np.abs(last.extreme)
        turned = sign * last.extreme < 0.0
        extreme = np.where(turned | (size > peak), feedback, decay * last.extreme)
        f1 = np.where(turned, peak, decay * last.last)
        f2 = decay * np.where(turned, last.last, last.second_last)

        believed = sign * np.maximum(size - np.abs(missing), 0.0)
        slow = last.slow + exp(last.retreat) * self.slow_gain * (believed - last.slow)
        waves = np.minimum(size, np.minimum(f1, f2)) / self.sustained
        fast = np.abs(believed - slow) / (self.believed + np.abs(slow))
        r = np.maximum(fast, waves).max()
        excess = max(r - 0.5, 0.0)
        retreat = self.retreat_decay * last.retreat - RETREAT_RATE_RAD_S * h * excess

        strained = last.strained + h
        if (size / self.bound).max() < 3.0 or retreat > _LN_STRAINED:
            strained = 0.0

        calm = 0.0 if waves.max() > 0.25 else last.calm + h
        rate = 0.0 if retreat < _LN_INTERMITTENT else -1.0
        if retreat < _LN_CYCLING and calm < 0.2:
            rate = 1.0
        cycling = max(last.cycling + rate * h, 0.0)
        turns = np.where(turned, 0.5 / h, 0.0)
        frequency = turns + self.frequency_decay * (last.frequency - turns)
        return Oscillation(
            slow,
            extreme,
            f1,
            f2,
            max(retreat, _LN_LEAST),
            strained,
            frequency,
            calm,
            cycling)

    def find_cycling_joint(self, oscillation: Oscillation) -> int:
        """Return the joint with the largest half-waves."""
        waves = np.minimum(oscillation.last, oscillation.second_last)
        return int(np.argmax(waves / self.sustained))


@function
def design_guard(bound: Array, rate: Array, pole: Array, period: float) -> OscillationGuard:
    """
    Return a guard for a law and drives.

    They are Ka [N·m], R [N·m/s], √Kp_ii [rad/s] and h [s].
    """
    bound = np.maximum(bound, 1e-9)  # A bound of 0 is no divisor.
    followed = rate / pole
    return OscillationGuard(
        bound=bound,
        believed=bound + np.where(followed < np.inf, followed, 0.0),
        sustained=np.minimum(bound, followed),
        slow_gain=1.0 - exp(-30.0 * period),
        wave_decay=exp(-10.0 * period),
        retreat_decay=exp(-period / 2.0),
        frequency_decay=exp(-period / 0.25),
        period=period)
