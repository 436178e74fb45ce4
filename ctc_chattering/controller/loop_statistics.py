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

"""How regularly a loop runs and how long its samples take, by times given from outside."""

from __future__ import annotations

from array import array
from collections import deque
from math import sqrt

import numpy as np

_NANO = 1e-9
_SHARES = {'p50': 0.5, 'p99': 0.99, 'p99.9': 0.999}
#: Part of the period that leaves too little for the middleware.
_TOO_MUCH = 0.5
#: Shorter durations are in the octave of this one [ms].
_SHORTEST = 1e-3


class Durations:
    """
    Durations in windows, of which the last few count.

    Parameters
    ----------
    windows : int
        How many windows are looked back on.

    """

    def __init__(self, windows: int = 10) -> None:
        self._windows: deque[array[float]] = deque(maxlen=windows)
        self.rotate()

    def add(self, duration: float) -> None:
        """Note a duration [s]."""
        self._windows[-1].append(duration)

    def rotate(self) -> None:
        """Begin a new window, and forget the oldest."""
        self._windows.append(array('d'))

    def summary(self) -> dict[str, float | str]:
        """Return mean, quantiles, maximum and histogram by name; nothing without durations."""
        ms = 1e3 * np.concatenate(tuple(self._windows))
        if not ms.size:
            return {}
        quantiles = np.quantile(ms, list(_SHARES.values()), method='inverted_cdf').tolist()
        # The octaves end at √2 ms times powers of two: a period of 1 ms and its jitter are in one.
        octaves = np.frexp(np.maximum(ms, _SHORTEST) / sqrt(2.0))[1]
        first = int(octaves.min())
        return {'mean [ms]': float(ms.mean()),
                **{f'{share} [ms]': value for share, value in zip(_SHARES, quantiles)},
                'max [ms]': float(ms.max()),
                'histogram [ms]': ', '.join(
                    f'<{sqrt(2.0) * 2.0 ** (first + k):.2g}: {count}'
                    for k, count in enumerate(np.bincount(octaves - first).tolist()) if count)}


class LoopStatistics:
    """
    Counts samples, their periods, the time they take, and the times until they are answered.

    Attributes
    ----------
    samples, misses : int
        Samples since the start, and those that came or took too long.
    rate : float
        Samples per second in the last window.

    """

    def __init__(self) -> None:
        self._durations = {name: Durations() for name in (
            'period', 'computing time', 'processor time', 'answer time')}
        self._periods, self._computing, self._processor, self._answers = self._durations.values()
        self.samples = self.misses = 0
        self.rate = 0.0
        self._last: int | None = None
        self._seen = (0, 0)

    def sample(self, begin: int, end: int, processor: int | None = None) -> None:
        """Count a sample computed from `begin` to `end`, of it on a `processor` [ns]."""
        self.samples += 1
        last, self._last = self._last, begin
        if last is not None:
            self._periods.add(_NANO * (begin - last))
        self._computing.add(_NANO * (end - begin))
        if processor is not None:
            self._processor.add(_NANO * processor)

    def answer(self, asked: int, now: int) -> None:
        """Count an answer that came at `now` to what was sent at `asked` [ns]."""
        self._answers.add(_NANO * (now - asked))

    def pause(self) -> None:
        """Do not count the time to the next sample as a period."""
        self._last = None

    def rotate(self, now: int) -> None:
        """Begin a new window at `now` [ns]."""
        samples, before = self._seen
        if before and now > before:
            self.rate = (self.samples - samples) / (_NANO * (now - before))
        self._seen = self.samples, now
        for durations in self._durations.values():
            durations.rotate()

    def too_slow(self, period: int) -> str:
        """
        Return a line if samples take too much of the period [ns] on a processor, '' if not.

        Processor time leaves out what other processes took: it is our own. Half of the samples
        must take more than `_TOO_MUCH` of the period; a few slow ones make no loop late.
        """
        p50 = float(self._processor.summary().get('p50 [ms]', 0.0))
        if 1e6 * p50 <= _TOO_MUCH * period:
            return ''
        return (f'the step takes {p50:.2g} ms (p50) at a period of {1e-6 * period:g} ms: too slow '
                'for the sample rate')

    def values(self) -> dict[str, float | str]:
        """Return what there is to say, by name with unit."""
        result: dict[str, float | str] = {'samples': self.samples, 'rate [Hz]': self.rate}
        for name, durations in self._durations.items():
            result |= {f'{name}, {key}': value for key, value in durations.summary().items()}
        return {**result, 'deadline misses': self.misses}
