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
        #: Stamps of the window [ns].
        self._stamps: list[int] = []
        self._skipped = self._strange = 0
        self.mean = 0.0

    def note(self, t: int, skipped: int = 0) -> None:
        """Count a sample of stamp `t` [ns], and those `skipped` between the last one and it."""
        self._skipped += skipped if self._stamps else 0
        self._stamps.append(t)

    def pause(self) -> None:
        """Do not count the time to the next sample; start the window again."""
        self._stamps.clear()
        self._skipped = 0

    def rotate(self) -> None:
        """Evaluate the window and start the next one; without a period it says nothing."""
        if len(self._stamps) < 2:
            return
        mean = (self._stamps[-1] - self._stamps[0]) / (
            len(self._stamps) - 1 + self._skipped)
        del self._stamps[:-1]
        self._skipped = 0
        self.mean = seconds(round(mean))
        wrong = abs(mean - self._period) > TOLERANCE * self._period
        self._strange = self._strange + 1 if wrong else 0

    @property
    def wrong(self) -> bool:
        """Whether the period has been wrong for a while."""
        return self._strange >= PATIENCE
