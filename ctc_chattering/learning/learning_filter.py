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
Filter from the errors of a pass to the next correction.

`Learner` applies it at the end of a pass, and `design.py` computes it from the loop. With the
error e of pass j, and the Fourier transforms over the pass::

    r_j+1 = Q (r_j + L e_j)                                                               (RL1)

Both filters are functions of the frequency, so that neither delays: Q is the square of a
Butterworth low-pass of fourth order, Q(f) = 1 / (1 + (f / f_c)⁸).
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses

from ctc_chattering.numerics.linear_algebra import Array, ComplexArray
import numpy as np

#: Ratio of a frequency to f_c, above which Q = 1.5e-4 or less is taken as 0.
_MAX_FREQUENCY_RATIO = 3.0


def low_pass(frequency: Array, cutoff: float) -> Array:
    """Return Q at frequencies [Hz]."""
    passed: Array = 1.0 / (1.0 + (frequency / cutoff) ** 8)
    return passed


@dataclasses.dataclass(frozen=True)
class LearningFilter:
    """
    Filters Q and L of (RL1).

    Attributes
    ----------
    frequencies : array, shape (K,)
        Rising frequencies at which `gain` is known [Hz].
    gain : array, shape (K, n, n)
        L, from errors to changes of the correction.
    cutoff : float
        f_c [Hz].
    contraction : float
        Bound of |Q (I - L T)|₂, below 1. A pass leaves at most this share of the distance of the
        correction from its limit.

    """

    frequencies: Array
    gain: ComplexArray
    cutoff: float
    contraction: float

    def update(self, correction: Array, e: Array, period: float, lead_out: float = 0.0) -> Array:
        """
        Return the next correction, shape (N, n) [rad].

        Parameters
        ----------
        correction, e : array, shape (N, n)
            Correction and error during the pass, at equal intervals [rad].
        period : float
            Interval [s].
        lead_out : float
            Time in which the end passes into the beginning, for a motion that is not periodic [s].

        """
        count = len(e)
        added_count = round(lead_out / period)
        angle = np.linspace(0.0, np.pi, added_count)[:, np.newaxis]
        share = 0.5 + 0.5 * np.cos(angle)
        r, e = (np.vstack([x, share * x[-1] + (1.0 - share) * x[0]]) for x in (correction, e))
        frequency = np.fft.rfftfreq(len(e), period).astype(float)
        passed = frequency < _MAX_FREQUENCY_RATIO * self.cutoff
        frequency = frequency[passed]
        spectrum = np.zeros((len(passed), e.shape[1]), complex)
        e_spectrum, r_spectrum = (np.fft.rfft(x, axis=0)[passed] for x in (e, r))
        change = (self._gain_at(frequency) @ e_spectrum[:, :, np.newaxis])[:, :, 0]
        spectrum[passed] = low_pass(frequency, self.cutoff)[:, np.newaxis] * (r_spectrum + change)
        updated: Array = np.fft.irfft(spectrum, len(e), axis=0)[:count]
        return updated

    def reordered(self, order: Sequence[int]) -> LearningFilter:
        """Return the filter for joints in another order."""
        gain = self.gain[:, order][:, :, order]
        return dataclasses.replace(self, gain=gain)

    def _gain_at(self, frequency: Array) -> ComplexArray:
        """Return L at frequencies [Hz], shape (len(frequency), n, n)."""
        last = len(self.frequencies) - 1
        index = np.interp(frequency, self.frequencies, np.arange(last + 1))
        k = np.minimum(index.astype(int), last - 1)
        share = (index - k)[:, np.newaxis, np.newaxis]
        gain: ComplexArray = (1.0 - share) * self.gain[k] + share * self.gain[k + 1]
        return gain
