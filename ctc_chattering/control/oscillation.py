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

Drives that are slower than their model (rate limit, lag) make a fast loop oscillate with growing
amplitude: what the drives lack goes into the estimate, which asks for more. The same loop with a
part of its bandwidth is stable. The torque f of the feedback shows it: where the model of the
drives is right, f is far below Ka but for some 10 ms at a reversal of friction. With its slow
part f_s, below 30 s rad/s, which is there where Ka is too small or the motion smooth::

    r = max |f - f_s| / (Ka + |f_s|),     d(ln s)/dt = -w max(r - 1/2, 0) - ln(s) / t    (OG1)

with w = 80 rad/s, t = 2 seconds, 0.1 <= s <= 1. The largest ratio of all joints counts, and s is
one number, since joints are coupled. A slow loop oscillates slowly, hence 30 s. Where less
bandwidth does not help, f exceeds 3 Ka with s < 0.2; a start far from the reference does so, too,
and has 2 seconds.
"""

from __future__ import annotations

from math import exp, log
from typing import NamedTuple

from ctc_chattering.numerics.compilable import record
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Least s.
LEAST = 0.1
#: Below which the feedback is slow, at s = 1 [rad/s]; part of Ka that is normal; w [rad/s]; t [s].
_SLOW, _NORMAL, _RETREAT, _RETURN = 30.0, 0.5, 80.0, 2.0
#: Feedback in Ka, and s, beyond and below which the loop may be out of control.
_STRONG, _LOW = 3.0, 0.2
#: How much later that counts after a start that is strong from the first sample on [s].
GRACE = 2.0
#: In the place of a bound of 0 [N·m].
_TINY = 1e-9


@record
class Oscillation(NamedTuple):
    """What is remembered of the feedback."""

    #: f_s, shape (n,) [N·m].
    slow_feedback: Array
    #: ln s.
    retreat: float
    #: How long f has exceeded 3 Ka with s < 0.2, from -2 at the start on [s].
    strained: float


@record
class OscillationGuard(NamedTuple):
    """Says how much bandwidth a loop may use; made by `oscillation_guard`."""

    #: Ka [N·m] and 1 - exp(-30 h), shape (n,).
    tolerated: Array
    renewed: Array
    #: 80 h, exp(-h / 2 s), and the least ln s.
    retreating: float
    kept: float
    farthest: float
    #: ln 0.2, and h [s].
    low: float
    period: float

    def noticed(self, last: Oscillation, feedback: Array) -> Oscillation:
        """Return what follows a sample with the feedback f, shape (n,) [N·m], by (OG1)."""
        renewed = exp(last.retreat) * self.renewed
        slow = last.slow_feedback + renewed * (feedback - last.slow_feedback)
        ratio = (np.abs(feedback - slow) / (self.tolerated + np.abs(slow))).max()
        retreat = self.kept * last.retreat - self.retreating * max(ratio - _NORMAL, 0.0)
        strain = (np.abs(feedback) / self.tolerated).max()
        strained = last.strained + self.period
        if strain < _STRONG or retreat > self.low:
            strained = 0.0
        return Oscillation(slow, max(retreat, self.farthest), strained)


def oscillation_guard(bound: Array, period: float) -> OscillationGuard:
    """Return a guard for Ka, shape (n,) [N·m], and h [s]."""
    return OscillationGuard(
        np.maximum(bound, _TINY), np.full(len(bound), 1.0 - exp(-_SLOW * period)),
        _RETREAT * period, exp(-period / _RETURN), log(LEAST), log(_LOW), period)
