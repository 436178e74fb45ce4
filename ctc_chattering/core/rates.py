"""How often something happens per second, over the last few reports."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from ctc_chattering.core.grid import seconds

#: Reports that a rate is the mean over.
WINDOW = 3


class Rates:
    """
    Mean rates of counters over the last `WINDOW` intervals between two reports.

    A total says nothing about the present: a node that has run for a day has a large one, and a
    node that fails now has a small one.
    """

    def __init__(self) -> None:
        self._kept: deque[tuple[int, dict[str, int]]] = deque(maxlen=WINDOW + 1)

    def note(self, now: int, counts: Mapping[str, int]) -> None:
        """
        Take the counters as they are at a report.

        Parameters
        ----------
        now : int
            Time of the report, on a clock that only goes forward [ns].
        counts : mapping
            Totals by name; a name that was not there before counts from 0.

        """
        self._kept.append((now, dict(counts)))

    def count(self, name: str) -> int:
        """Return how often it happened within the window."""
        if not self._kept:
            return 0
        return self._kept[-1][1].get(name, 0) - self._kept[0][1].get(name, 0)

    def per_second(self, name: str) -> float:
        """Return how often it happened per second [1/s]; 0 before the second report."""
        span = self._kept[-1][0] - self._kept[0][0] if self._kept else 0
        return self.count(name) / seconds(span) if span > 0 else 0.0

    def fraction(self, part: str, whole: str) -> float:
        """Return which part of `whole` was `part`, 0 to 1."""
        return self.count(part) / max(self.count(whole), 1)
