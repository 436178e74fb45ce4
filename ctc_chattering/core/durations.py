"""Mean and quantiles of durations over the last seconds, at a constant price a sample."""

from __future__ import annotations

from collections import deque
from math import ceil, exp, log

#: Bins a factor of e: each is 2 % wide.
_BINS = 50.0
#: Shorter durations count as this one [s].
_SHORTEST = 1e-9


class Durations:
    """
    Counts durations in logarithmic bins, in windows of which the last few are kept.

    Parameters
    ----------
    windows : int
        How many windows are looked back on.

    """

    def __init__(self, windows: int = 10) -> None:
        self._windows: deque[tuple[dict[int, int], list[float]]] = deque(maxlen=windows)
        self.rotate()

    def add(self, duration: float) -> None:
        """Count a duration [s]."""
        key = int(log(duration if duration > _SHORTEST else _SHORTEST) * _BINS)
        counts = self._counts
        counts[key] = counts.get(key, 0) + 1
        self._total[0] += duration

    def rotate(self) -> None:
        """Begin a new window, and forget the oldest."""
        self._counts: dict[int, int] = {}
        self._total = [0.0]
        self._windows.append((self._counts, self._total))

    @property
    def count(self) -> int:
        """Durations in all windows."""
        return sum(sum(counts.values()) for counts, _ in self._windows)

    def mean(self) -> float:
        """Return the mean [s]; 0 without any."""
        return sum(total[0] for _, total in self._windows) / max(1, self.count)

    def quantile(self, share: float) -> float:
        """Return what `share` of the durations do not exceed [s], to 2 %; 0 without any."""
        together: dict[int, int] = {}
        for counts, _ in self._windows:
            for key, count in counts.items():
                together[key] = together.get(key, 0) + count
        left = ceil(share * sum(together.values()))
        for key in sorted(together):
            left -= together[key]
            if left <= 0:
                return exp((key + (1 if key >= 0 else 0)) / _BINS)
        return 0.0
