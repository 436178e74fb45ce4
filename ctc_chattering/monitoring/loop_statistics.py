"""How regularly a loop runs and how long its samples take, by times given from outside."""

from __future__ import annotations

from ctc_chattering.monitoring.durations import Durations

_NANO = 1e-9
_SHARES = {'p50': 0.5, 'p99': 0.99, 'p99.9': 0.999}


class LoopStatistics:
    """
    Counts samples, their periods, their computing times and the times until they are answered.

    Attributes
    ----------
    periods, computing, answers : Durations
        Over the last windows.
    samples, misses : int
        Samples since the start, and those that came or took too long.

    """

    def __init__(self) -> None:
        self.periods, self.computing, self.answers = Durations(), Durations(), Durations()
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

    def answer(self, asked: int, now: int) -> None:
        """Count an answer that came at `now` to what was sent at `asked` [ns]."""
        self.answers.add(_NANO * (now - asked))

    def pause(self) -> None:
        """Do not count the time to the next sample as a period."""
        self._last = None

    def rotate(self, now: int) -> None:
        """Begin a new window at `now` [ns]."""
        samples, before = self._seen
        if before and now > before:
            self.rate = (self.samples - samples) / (_NANO * (now - before))
        self._seen = self.samples, now
        for durations in (self.periods, self.computing, self.answers):
            durations.rotate()

    def values(self) -> dict[str, float | str]:
        """Return what there is to say, by name with unit."""
        result: dict[str, float | str] = {'samples': self.samples, 'rate [Hz]': self.rate}
        for name, durations in (('period', self.periods), ('computing time', self.computing),
                                ('answer time', self.answers)):
            if not durations.count:
                continue
            result[f'{name}, mean [ms]'] = 1e3 * durations.mean()
            for share, value in zip(_SHARES, durations.quantiles(*_SHARES.values())):
                result[f'{name}, {share} [ms]'] = 1e3 * value
            result[f'{name}, max [ms]'] = 1e3 * durations.largest()
            result[f'{name}, histogram [ms]'] = ', '.join(
                f'<{1e3 * end:.2g}: {count}' for end, count in durations.histogram().items())
        result['deadline misses'] = self.misses
        return result
