"""Histogram of durations over the last seconds: mean, quantiles and largest one."""

from __future__ import annotations

from array import array
from collections import deque
from math import ceil

import numpy as np
import numpy.typing as npt

#: Bins of one octave; a quantile is exact to half a bin, 1.1 %.
BINS_PER_OCTAVE = 32
#: Octaves below and above the one of 1 ms: from 1 us to a quarter of an hour.
_OCTAVES_BELOW, _OCTAVES_ABOVE = 10, 20
#: Number of the bin with 1 ms at its centre, about the middle of its octave: a period of 1 ms and
#: its jitter are in one octave.
_UNIT, _CENTRE = 1e-3, _OCTAVES_BELOW * BINS_PER_OCTAVE + BINS_PER_OCTAVE // 2
_BINS = (_OCTAVES_BELOW + 1 + _OCTAVES_ABOVE) * BINS_PER_OCTAVE


class _Window:
    """What is kept of one window: number in each bin, sum and largest one [s]."""

    def __init__(self) -> None:
        self.counts = np.zeros(_BINS, dtype=np.int64)
        self.sum = self.largest = 0.0


class Durations:
    """
    Counts durations in bins of equal ratio, in windows of which the last few count.

    A duration is only noted when it is added, and put into its bin together with the others of its
    window, so that the loop that is measured pays next to nothing. Memory: 8 kB a window, and the
    durations of the present one.

    Parameters
    ----------
    windows : int
        How many windows are looked back on.

    Attributes
    ----------
    add : callable
        Notes a duration [s].

    """

    def __init__(self, windows: int = 10) -> None:
        self._windows = deque([_Window()])
        self._size = windows
        self._total = np.zeros(_BINS, dtype=np.int64)
        self._renew()

    def _renew(self) -> None:
        self._noted = array('d')
        self.add = self._noted.append

    def rotate(self) -> None:
        """Begin a new window, and forget the oldest."""
        self._put()
        self._windows.append(_Window())
        if len(self._windows) > self._size:
            self._total -= self._windows.popleft().counts

    def _put(self) -> None:
        """Put what has been noted into its bins."""
        if not self._noted:
            return
        durations, window = np.frombuffer(self._noted), self._windows[-1]
        with np.errstate(divide='ignore'):  # The logarithm of 0 is in the first bin.
            bins = np.rint(np.log2(durations / _UNIT) * BINS_PER_OCTAVE + _CENTRE)
        counts = np.bincount(bins.clip(0, _BINS - 1).astype(np.int64), minlength=_BINS)
        window.counts += counts
        self._total += counts
        window.sum += float(durations.sum())
        window.largest = max(window.largest, float(durations.max()))
        self._renew()

    @property
    def counts(self) -> npt.NDArray[np.int64]:
        """Number of durations in each bin, over all windows."""
        self._put()
        return self._total

    @property
    def count(self) -> int:
        """Durations in all windows."""
        return int(self.counts.sum())

    def mean(self) -> float:
        """Return the mean [s]; 0 without any."""
        return sum(window.sum for window in self._windows) / (self.count or 1)

    def largest(self) -> float:
        """Return the longest duration [s]; 0 without any."""
        self._put()
        return max(window.largest for window in self._windows)

    def quantiles(self, *shares: float) -> list[float]:
        """Return for each share a duration that as many do not exceed [s]; 0 without any."""
        below = np.cumsum(self.counts)
        ranks = [max(1, ceil(share * int(below[-1]))) for share in shares]
        longest = self.largest()
        return [min(longest, _UNIT * 2.0 ** ((number - _CENTRE) / BINS_PER_OCTAVE))
                for number in below.searchsorted(ranks).tolist()]

    def histogram(self) -> dict[float, int]:
        """Return how many durations there are in each octave that has any, by its end [s]."""
        octaves = self.counts.reshape(-1, BINS_PER_OCTAVE).sum(axis=1).tolist()
        return {_UNIT * 2.0 ** (k + 0.5 - _OCTAVES_BELOW): count
                for k, count in enumerate(octaves) if count}
