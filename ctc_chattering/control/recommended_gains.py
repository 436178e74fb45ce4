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

"""Gains of `observer_feedback` that drives, delay and encoders allow; see docs/theory.md."""

from __future__ import annotations

#: Double pole of the error, unless drives or delay are slower [rad/s].
POLE = 100.0
#: Most that the pole times lag and delay may be.
SLOWNESS = 0.4
#: ω over the pole, for positions of at most this resolution [rad], and for coarser ones.
_FINE, _FAST, _SLOW = 2e-5, 2.0, 1.0


def lateness(lag: float, period: float, delay: int) -> float:
    """Return T + h (1 + d) [s]: after which time a torque acts, with the sample it waits for."""
    return lag + period * (1 + delay)


def largest_pole(late: float) -> float:
    """Return p [rad/s] of kp = p², kv = 2 p, where torques act after `late` [s]."""
    return min(POLE, SLOWNESS / late)


def estimator_bandwidth(pole: float, resolution: float) -> float:
    """
    Return ω of the observer [rad/s].

    Parameters
    ----------
    pole : float
        p [rad/s].
    resolution : float
        Step of the encoders, or noise of the positions, if that is more [rad].

    """
    return (_FAST if resolution <= _FINE else _SLOW) * pole
