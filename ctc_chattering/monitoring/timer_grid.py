"""Which sample periods the ticks of a timer stand for."""

from __future__ import annotations


class TimerGrid:
    """
    A grid of samples on a timer's own grid.

    A tick comes when it is due or a little later, never earlier. On a grid of any other phase some
    ticks would come before their period and the next ones would have two to make good.

    Parameters
    ----------
    period : int
        Of the timer and of the samples [ns].

    Attributes
    ----------
    start : int or None
        Time of sample 0 [ns]; None before the first tick.

    """

    def __init__(self, period: int) -> None:
        self._period = period
        self.start: int | None = None

    def anchor(self, now: int, left: int, k: int) -> int:
        """
        Put sample `k` to the tick that was due last, and return `start`.

        Parameters
        ----------
        now : int
            Time [ns].
        left : int
            From then to the next tick that is due [ns]; less than 0 if that is late.
        k : int
            Number of the sample.

        """
        self.start = now - (self._period - left) % self._period - k * self._period
        return self.start

    def due(self, now: int, k: int) -> int:
        """Return how many samples after `k` are due at `now` [ns]."""
        assert self.start is not None
        return (now - self.start) // self._period - k
