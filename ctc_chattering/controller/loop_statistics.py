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
Rates and durations of a loop, for `/diagnostics`.

Controller and plant note their samples and answers in a `LoopStatistics`, and report it once a
second. No time is read here.
"""

from __future__ import annotations

from array import array

from ctc_chattering.numerics.time_grid import seconds
import numpy as np

#: Quantiles of the durations in the report.
_QUANTILES = {'p50': 0.5, 'p99': 0.99, 'p99.9': 0.999, 'max': 1.0}
#: Number of the last durations in the report: 10 s at 1 kHz.
_DURATIONS = 10_000
#: Computing time as a share of the period, above which too little is left for the middleware.
_MAX_COMPUTING_SHARE = 0.5


class LoopStatistics:
    """
    Counts samples, their durations and their answers.

    Attributes
    ----------
    samples, misses : int
        Samples since the start, and those that came or took too long.
    rate : float
        Samples per second in the last window.

    """

    def __init__(self) -> None:
        #: In the order of the report [ns].
        self._durations = {name: array('q') for name in (
            'period', 'computing time', 'answer time')}
        self._periods, self._computing, self._answers = self._durations.values()
        self.samples = self.misses = 0
        self.rate = 0.0
        self._last: int | None = None
        self._seen = 0, 0

    def sample(self, begin: int, end: int) -> None:
        """Count a sample computed from `begin` to `end` [ns]."""
        self.samples += 1
        if self._last is not None:
            self._periods.append(begin - self._last)
        self._last = begin
        self._computing.append(end - begin)

    def answer(self, sent: int, now: int) -> None:
        """Count an answer at `now` to a message `sent` [ns]."""
        self._answers.append(now - sent)

    def pause(self) -> None:
        """Leave out the period to the next sample."""
        self._last = None

    def rotate(self, now: int) -> None:
        """Begin a new window of the rate at `now` [ns]."""
        samples, begin = self._seen
        self._seen = self.samples, now
        if now > begin > 0:
            self.rate = (self.samples - samples) / seconds(now - begin)
        for durations in self._durations.values():
            del durations[:-_DURATIONS]

    def too_slow(self, period: int) -> str:
        """
        Return a line if samples take too long.

        They do if half of them take more than `_MAX_COMPUTING_SHARE` of the period [ns]. A few
        slow ones make no loop late.
        """
        p50 = np.median(self._computing) if self._computing else 0.0
        return '' if p50 <= _MAX_COMPUTING_SHARE * period else (
            f'half of the steps take more than {1e-6 * p50:.2g} ms at a period of '
            f'{1e-6 * period:g} ms, which is too slow for the sample rate')

    def values(self) -> dict[str, float]:
        """Return the values of the report, by name with unit."""
        result = {
            'samples': self.samples,
            'rate [Hz]': self.rate,
            'deadline misses': self.misses}
        levels = list(_QUANTILES.values())
        for name, durations in self._durations.items():
            if durations:
                ms = np.quantile(durations, levels, method='inverted_cdf') / 1e6
                for key, value in zip(_QUANTILES, ms.tolist()):
                    result[f'{name}, {key} [ms]'] = value
        return result
