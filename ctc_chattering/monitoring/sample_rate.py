"""Whether samples come at the configured rate, by their stamps, one window at a time."""

from __future__ import annotations

from ctc_chattering.numerics.time_grid import seconds

#: Share by which the mean period may differ from what it should be.
TOLERANCE = 0.2
#: Windows in a row that must differ by more.
PATIENCE = 3


class SampleRate:
    """
    Compares the mean period of stamps with what it should be.

    Parameters
    ----------
    period : int
        What it should be [ns].

    Attributes
    ----------
    mean : float
        Mean period over the last window that had one [s]; 0 before.

    """

    def __init__(self, period: int) -> None:
        self._period = period
        self._first: int | None = None
        self._last = self._count = self._strange = 0
        self.mean = 0.0

    def note(self, t: int) -> None:
        """Count a sample of stamp `t` [ns]."""
        if self._first is None:
            self._first = t
        else:
            self._count += 1
        self._last = t

    def pause(self) -> None:
        """Do not count the time to the next sample; start the window again."""
        self._first = None
        self._count = 0

    def rotate(self) -> None:
        """Evaluate the window and start the next one; without a period it says nothing."""
        if self._first is None or not self._count:
            return
        mean = (self._last - self._first) / self._count
        self._first, self._count = self._last, 0
        self.mean = seconds(round(mean))
        wrong = abs(mean - self._period) > TOLERANCE * self._period
        self._strange = self._strange + 1 if wrong else 0

    @property
    def wrong(self) -> bool:
        """Whether the period has been wrong for a while."""
        return self._strange >= PATIENCE
