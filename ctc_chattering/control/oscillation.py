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
Reduce the bandwidth of a loop whose feedback torque oscillates.

At every sample the law `observer_feedback` passes its feedback torque f to the guard. It then
multiplies its bandwidths by the guard's fraction s. Drives that are slower than their model (rate
limit, lag, delay) make a fast loop oscillate. The law takes the torque that they fail to deliver
for a perturbation, and asks for more. The same loop is stable with a fraction of its bandwidth.
Drives with a lower rate than configured make f exceed Ka plus the amplitude that they follow,
although the law assumes that they deliver it. Drives that are late keep f oscillating. After a
load step, a reversal of friction or a motion that is too hard, each half-wave is smaller than the
one before::

    r = max(|f_b - f_s| / (Ka + B + |f_s|),  min(|f|, f₁, f₂) / min(Ka, B)),    B = R / √Kp
    d(ln s)/dt = -w max(r - 1/2, 0) - ln(s) / t                                            (OG1)

with w = 80 rad/s, t = 2 seconds, 0.1 <= s <= 1. B is the largest amplitude that drives with the
rate limit R follow at the frequency √Kp. Without a rate limit it is left out. f_b has the sign of
f and the size ``max(|f| - |missing|, 0)``, where the law knows that the drives do not deliver
`missing`. f_s is the slow part of f_b, below 30 s rad/s. It is no oscillation, but a smooth motion
or a Ka that is too small. f₁ and f₂ are the sizes of the last half-wave and the one before, which
fade with 10 rad/s. The largest ratio of all joints counts. s is one number, since joints are
coupled. A loop is strained while f exceeds 3 Ka with s < 0.2: less bandwidth does not help. A
start 1 rad off the reference strains the paper's arm for 0.09 seconds, less than the trip's 0.2.

Elastic joints, or an inertia that is far from the model's, keep the loop oscillating at any s: f
stays within 3 Ka, and s low. L is the time for which such a limit cycle has lasted::

    dL/dt = 1 where s < 0.7 and m has exceeded 1/4 within 0.2 s, else 0 where s < 0.3, else -1
    m = min(|f|, f₁, f₂) / min(Ka, B), the largest of all joints                           (OG2)

with L >= 0. 1/4 is half of the ratio at which (OG1) reduces s. An oscillation that comes back as
soon as s recovers counts as the same one. Drives that are slower or later than configured
oscillate for half a second, until s is low enough. The joint with the largest m and the frequency
of its f say what oscillates.
"""

from __future__ import annotations

from math import exp, log
from typing import NamedTuple

from ctc_chattering.compiled.compilable import function, record
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: w of (OG1) [rad/s].
RETREAT_RATE_RAD_S = 80.0
#: Least ln s.
_LN_LEAST = log(0.1)
#: ln s below which a feedback beyond 3 Ka strains the loop.
_LN_STRAINED = log(0.2)
#: ln s below which a pause does not end a limit cycle.
_LN_INTERMITTENT = log(0.3)
#: ln s below which an oscillation that lasts is a limit cycle.
_LN_CYCLING = log(0.7)


@record
class Oscillation(NamedTuple):
    """
    Oscillation of the feedback f, up to a sample.

    Attributes
    ----------
    slow : ndarray, shape (n,)
        f_s [N·m].
    extreme : ndarray, shape (n,)
        Extreme of the present half-wave of f, with its sign; it fades like f₁ [N·m].
    wave_1, wave_2 : ndarray, shape (n,)
        f₁ and f₂ [N·m].
    retreat : float
        ln s.
    strained : float
        Time for which f has exceeded 3 Ka with s < 0.2 [s].
    frequency : ndarray, shape (n,)
        Frequency of f [Hz].
    calm : float
        Time since m of (OG2) last exceeded 1/4 [s].
    cycling : float
        L of (OG2) [s].

    """

    slow: Array
    extreme: Array
    wave_1: Array
    wave_2: Array
    retreat: float
    strained: float
    frequency: Array
    calm: float
    cycling: float


@record
class OscillationGuard(NamedTuple):
    """
    Guard that computes s, the usable fraction of the bandwidth.

    Attributes
    ----------
    bound : ndarray, shape (n,)
        Ka [N·m].
    feedback_limit : ndarray, shape (n,)
        Ka + B [N·m].
    wave_limit : ndarray, shape (n,)
        The lesser of Ka and B [N·m].
    slow_gain : float
        1 - exp(-30 h), the gain of f_s for s = 1.
    wave_decay, retreat_decay, frequency_decay : float
        Factors of a sample: exp(-10 h), exp(-h / 2) and exp(-h / 0.25), with h in seconds.
    period : float
        h [s].

    """

    bound: Array
    feedback_limit: Array
    wave_limit: Array
    slow_gain: float
    wave_decay: float
    retreat_decay: float
    frequency_decay: float
    period: float

    def update_oscillation(self, state: Oscillation, feedback: Array, missing: Array
                           ) -> Oscillation:
        """
        Return the oscillation after a sample, by (OG1) and (OG2).

        Parameters
        ----------
        state : Oscillation
            Oscillation after the sample before.
        feedback, missing : array, shape (n,)
            f, and the torque that the law knows the drives not to deliver [N·m].

        """
        h = self.period
        decay = self.wave_decay
        size = np.abs(feedback)
        sign = np.sign(feedback)
        peak = decay * np.abs(state.extreme)
        crossed = sign * state.extreme < 0.0  # A change of sign ends the half-wave.
        extreme = np.where(crossed | (size > peak), feedback, decay * state.extreme)
        f1 = np.where(crossed, peak, decay * state.wave_1)
        f2 = decay * np.where(crossed, state.wave_1, state.wave_2)

        delivered = sign * np.maximum(size - np.abs(missing), 0.0)
        slow = state.slow + exp(state.retreat) * self.slow_gain * (delivered - state.slow)
        waves = np.minimum(size, np.minimum(f1, f2)) / self.wave_limit
        fast = np.abs(delivered - slow) / (self.feedback_limit + np.abs(slow))
        r = np.maximum(fast, waves).max()
        excess = max(r - 0.5, 0.0)
        retreat = self.retreat_decay * state.retreat - RETREAT_RATE_RAD_S * h * excess

        strained = state.strained + h
        if (size / self.bound).max() < 3.0 or retreat > _LN_STRAINED:
            strained = 0.0

        calm = 0.0 if waves.max() > 0.25 else state.calm + h
        cycling_rate = 0.0 if retreat < _LN_INTERMITTENT else -1.0
        if retreat < _LN_CYCLING and calm < 0.2:
            cycling_rate = 1.0
        cycling = max(state.cycling + cycling_rate * h, 0.0)
        crossings = np.where(crossed, 0.5 / h, 0.0)  # A wave crosses zero twice.
        frequency = crossings + self.frequency_decay * (state.frequency - crossings)
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
        """Return the joint with the largest half-waves over min(Ka, B)."""
        waves = np.minimum(oscillation.wave_1, oscillation.wave_2)
        return int(np.argmax(waves / self.wave_limit))


@function
def design_guard(bound: Array, rate: Array, pole: Array, period: float) -> OscillationGuard:
    """
    Return the guard of a law and its drives.

    The arguments are Ka [N·m], R [N·m/s], √Kp_ii [rad/s] and h [s], in this order.
    """
    bound = np.maximum(bound, 1e-9)  # Ka is a divisor.
    followed = rate / pole
    return OscillationGuard(
        bound=bound,
        feedback_limit=bound + np.where(followed < np.inf, followed, 0.0),
        wave_limit=np.minimum(bound, followed),
        slow_gain=1.0 - exp(-30.0 * period),
        wave_decay=exp(-10.0 * period),
        retreat_decay=exp(-period / 2.0),
        frequency_decay=exp(-period / 0.25),
        period=period)
