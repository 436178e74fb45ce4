"""Whether commands keep up with the samples of a plant in real time, by times from outside."""

from __future__ import annotations

from ctc_chattering.core.grid import seconds
from ctc_chattering.core.rates import Rates
from ctc_chattering.core.state_health import BUSY

#: Part of the samples without a new command that is a warning, and an error.
WARNING, ERROR = 0.2, 0.5


class CommandWatchdog:
    """
    Finds outages of the commands, and counts the samples that had no new one.

    Parameters
    ----------
    period : int
        Control period [ns].

    Attributes
    ----------
    timeout : int
        Silence that is an outage [ns].
    timeouts, stale : int
        Outages so far, and samples over which an old torque was held.
    longest : int
        Longest silence since the last report [ns].

    """

    def __init__(self, period: int) -> None:
        self._period = period
        self.timeout = 0
        self.timeouts = self.stale = self.longest = 0
        self._heard = 0
        self._fresh = self._out = False
        self._rates = Rates()

    def command(self, now: int) -> int:
        """Take note of a command at `now`, and return the silence before it [ns]."""
        silence = now - self._heard
        self._heard, self._fresh, self._out = now, True, False
        return silence

    def silence(self, now: int) -> int:
        """Return the time without a command [ns]; one above `timeout` counts as an outage."""
        silence = now - self._heard
        self.longest = max(self.longest, silence)
        if silence > self.timeout and not self._out:
            self._out = True
            self.timeouts += 1
        return silence

    def sample(self) -> None:
        """Count a sample that goes on with the torque at hand."""
        self.stale += not self._fresh
        self._fresh = False

    def rotate(self, now: int, samples: int) -> None:
        """Begin a new report at `now` [ns], with the number of samples so far."""
        self._rates.note(now, {
            'samples': samples, 'stale': self.stale, 'timeouts': self.timeouts})

    @property
    def timeouts_per_second(self) -> float:
        """Outages per second over the last reports [1/s]."""
        return self._rates.per_second('timeouts')

    @property
    def fraction(self) -> float:
        """Part of the samples without a new command over the last reports, 0 to 1."""
        return self._rates.fraction('stale', 'samples')

    @property
    def poor(self) -> bool:
        """Whether commands keep up so badly that it is worth a warning."""
        return self.timeouts_per_second > 0.0 or self.fraction > WARNING

    @property
    def bad(self) -> bool:
        """Whether they keep up so badly that the robot cannot be controlled."""
        return self.timeouts_per_second >= 1.0 or self.fraction > ERROR

    def __str__(self) -> str:
        """Say what is found, and the likely cause."""
        return (f'{100.0 * self.fraction:.0f} % of the samples have no new command, the longest '
                f'time without one was {seconds(self.longest):.3f} s, the brakes came on '
                f'{self.timeouts_per_second:.2g} times a second: {BUSY}; control_period is '
                f'{1e3 * seconds(self._period):g} ms')
