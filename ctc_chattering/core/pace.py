"""How regularly a loop runs and how long its samples take, by times given from outside."""

from __future__ import annotations

from ctc_chattering.core.durations import Durations

_NANO = 1e-9


class Pace:
    """
    Counts samples, their periods and their computing times.

    Attributes
    ----------
    periods, computing : Durations
        Over the last windows.
    samples, misses : int
        Samples since the start, and those that came or took too long.

    """

    def __init__(self) -> None:
        self.periods, self.computing = Durations(), Durations()
        self.samples = self.misses = 0
        self._last: int | None = None
        self._seen = (0, 0)
        #: Samples per second in the last window.
        self.rate = 0.0

    def sample(self, begin: int, end: int) -> None:
        """Count a sample computed from `begin` to `end` [ns]."""
        self.samples += 1
        last, self._last = self._last, begin
        if last is not None:
            self.periods.add(_NANO * (begin - last))
        self.computing.add(_NANO * (end - begin))

    def pause(self) -> None:
        """Do not count the time to the next sample as a period."""
        self._last = None

    def rotate(self, now: int) -> None:
        """Begin a new window at `now` [ns]."""
        samples, before = self._seen
        if before and now > before:
            self.rate = (self.samples - samples) / (_NANO * (now - before))
        self._seen = self.samples, now
        self.periods.rotate()
        self.computing.rotate()

    def values(self) -> dict[str, float]:
        """Return what there is to say, by name with unit."""
        result: dict[str, float] = {'samples': self.samples, 'rate [Hz]': self.rate}
        for name, durations in (('period', self.periods), ('computing time', self.computing)):
            result[f'{name}, mean [ms]'] = 1e3 * durations.mean()
            result[f'{name}, 99.9 % [ms]'] = 1e3 * durations.quantile(0.999)
        result['deadline misses'] = self.misses
        return result
