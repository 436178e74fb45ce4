"""Whether messages come in real time as they should, by times that are given from outside."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Protocol

from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds

#: Likely cause of messages that come too late.
BUSY = 'this computer is too busy, or processes are stopped'
#: Time between two lines on short outages [ns].
_BETWEEN = NANOSECONDS
#: Reports that rates are the mean over: a total says nothing about the present.
WINDOW = 3


class Logger(Protocol):
    """What a watchdog needs of the logger of a node."""

    def info(self, message: str, /) -> object:
        """Log what is in order."""

    def warning(self, message: str, /) -> object:
        """Log what may be wrong."""

    def error(self, message: str, /) -> object:
        """Log what is wrong."""


class Watchdog:
    """
    Finds and reports outages of a topic: silence that is longer than `timeout`.

    Parameters
    ----------
    topic, kind : str
        Name of the topic, and one word for its messages.
    consequence : str
        What an outage leads to.
    patience : int
        An outage that lasts longer is reported at once, a shorter one at its end [ns].
    logger : Logger
        Where outages are reported.

    Attributes
    ----------
    timeout : int
        Silence that is an outage [ns].
    out : bool
        Whether there is an outage.
    outages, stale : int
        Outages so far, and samples without a new message.
    longest : int
        Longest silence [ns]; may be reset.

    """

    def __init__(self, topic: str, kind: str, consequence: str, patience: int, logger: Logger
                 ) -> None:
        self._name, self._kind, self._consequence = topic, kind, consequence
        self._patience, self._log = patience, logger
        self.timeout = self.outages = self.stale = self.longest = 0
        self.out = False
        self._last = self._logged = 0
        self._fresh = self._reported = False

    def feed(self, now: int) -> None:
        """Note a message at `now` [ns], which ends an outage."""
        silence, self._last, self._fresh = now - self._last, now, True
        if not self.out:
            return
        self.out = False
        if self._reported:
            self._reported = False
            self._log.info(
                f'{self._name}: {self._kind}s again, after {seconds(silence):.1f} s')
        elif now - self._logged > _BETWEEN:
            self._logged = now
            self._log.warning(
                f'{self._name}: no {self._kind} for {seconds(silence):.3f} s; '
                f'{self._consequence} after {seconds(self.timeout):g} s')

    def silence(self, now: int) -> int:
        """Return the time without a message at `now` [ns]."""
        return now - self._last

    def check(self, now: int, publishers: Callable[[], int]) -> bool:
        """
        Return whether an outage begins at `now` [ns]; report one that lasts.

        Parameters
        ----------
        now : int
            On the clock of `feed` [ns].
        publishers : callable
            Returns how many there are; without any an outage is no error.

        """
        silence = self.silence(now)
        self.longest = max(self.longest, silence)
        begins = silence > self.timeout and not self.out
        if begins:
            self.out = True
            self.outages += 1
        if silence > max(self.timeout, self._patience) and not self._reported:
            self._reported = True
            if publishers():
                self._log.error(f'{self._name}: no {self._kind} for {seconds(silence):.1f} s; '
                                f'{self._consequence}')
            else:
                self._log.info(f'{self._name}: its publisher has left; {self._consequence}')
        return begins

    def sample(self) -> None:
        """Count a sample that goes on with the last message, however old."""
        self.stale += not self._fresh
        self._fresh = False


class HealthMonitor:
    """
    Judges two kinds of faults by their rates over the last reports.

    Parameters
    ----------
    events, part : str
        What the faults are: such that disturb each time, none if '', and such of which a part is
        normal.
    warning, error : float
        Fraction of `part` that is a warning, and an error, 0 to 1. Of the events any is a
        warning, and one per second an error.
    period : int
        Control period, for the text [ns].

    Attributes
    ----------
    cause : str
        What is known to be the cause; '' where nothing is.

    """

    def __init__(self, events: str, part: str, warning: float, error: float, period: int) -> None:
        self._events, self._part = events, part
        self._warning, self._error = warning, error
        self._period = period
        self.cause = ''
        #: Time [ns], events, faults of the other kind, and what those are a part of.
        self._reports: deque[tuple[int, int, int, int]] = deque(maxlen=WINDOW + 1)
        self._detail = ''

    def note(self, now: int, events: int, part: int, whole: int, detail: str) -> None:
        """
        Take the totals at a report.

        Parameters
        ----------
        now : int
            Time of the report [ns].
        events : int
            Number of events so far.
        part, whole : int
            Number of faults of the other kind so far, and what the fraction is of.
        detail : str
            What else is known of the latter.

        """
        self._detail = detail
        self._reports.append((now, events, part, whole))

    def _increase(self, column: int) -> int:
        """Return by how much a number has grown over the reports kept."""
        return self._reports[-1][column] - self._reports[0][column] if self._reports else 0

    @property
    def events_per_second(self) -> float:
        """Events per second over the last reports [1/s]."""
        return self._increase(1) / max(seconds(self._increase(0)), 1e-9)

    @property
    def fraction(self) -> float:
        """Fraction of the other faults over the last reports, 0 to 1."""
        return self._increase(2) / max(self._increase(3), 1)

    @property
    def level(self) -> int:
        """0 if all is well, 1 if a warning is due, 2 if an error is."""
        if self.events_per_second >= 1.0 or self.fraction > self._error:
            return 2
        return int(self.events_per_second > 0.0 or self.fraction > self._warning)

    def __str__(self) -> str:
        """Return the rates and the likely cause on one line."""
        detail = f' ({self._detail})' if self._detail else ''
        events = f'{self.events_per_second:.2g} {self._events} per second, '
        cause = self.cause or f'{BUSY}; control_period is {1e3 * seconds(self._period):g} ms'
        return (f'{events if self._events else ""}{100.0 * self.fraction:.0f} % '
                f'{self._part}{detail}: {cause}')
