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
Finite Fourier series that begin and end at rest, for motions that excite a robot.

Swevers, Ganseman, Tükel, De Schutter & Van Brussel, "Optimal robot excitation and identification",
IEEE Transactions on Robotics and Automation 13 (1997) 730-740.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.linalg import null_space  # type: ignore[import-untyped]


class FourierSeries(NamedTuple):
    """
    Series: dq(t) = Σ a_k cos(k ω t) + b_k sin(k ω t), with q(0) = 0, k = 1 … K.

    Attributes
    ----------
    cosines, sines : ndarray, shape (m, K)
        a_k and b_k of each series [rad/s].
    period : float
        2π / ω [s].

    """

    cosines: Array
    sines: Array
    period: float

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration, each (N, m), at the times `t`, (N,) [s]."""
        rate = 2.0 * np.pi / self.period * np.arange(1, self.cosines.shape[1] + 1)
        angle = np.outer(t, rate)
        c, s = np.cos(angle), np.sin(angle)
        a, b = self.cosines.T, self.sines.T
        return ((s / rate) @ a + ((1.0 - c) / rate) @ b, c @ a + s @ b,
                (c * rate) @ b - (s * rate) @ a)


def at_rest(harmonics: int, period: float) -> FourierSeries:
    """
    Return 2 K - 3 series of which every one that is at rest at its ends is a combination.

    They have neither velocity nor acceleration at t = 0 and `period`, and their mean is q(0): a_k,
    k b_k and b_k / k each add up to 0.

    Parameters
    ----------
    harmonics : int
        K, at least 3.
    period : float
        Time that the motion takes [s].

    """
    k = np.arange(1.0, harmonics + 1.0)
    # In multiples of √k, in which lower harmonics have more of the motion and all have their part.
    cosines = null_space(np.array([np.sqrt(k)])).T * np.sqrt(k)
    sines = null_space(np.array([np.sqrt(k) / k, np.sqrt(k) * k])).T * np.sqrt(k)
    return FourierSeries(np.vstack((cosines, np.zeros_like(sines))),
                         np.vstack((np.zeros_like(cosines), sines)), period)
