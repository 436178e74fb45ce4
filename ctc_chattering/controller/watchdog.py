# Copyright 2026 The ctc_chattering maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Whether messages come in real time as they should, by times that are given from outside."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds

#: Time between two lines on short outages [ns].
_BETWEEN = NANOSECONDS


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

    def feed(self, now: int, begun: bool = True) -> None:
        """Note a message at `now` [ns]; a short outage that it ends is reported once `begun`."""
        silence, self._last, self._fresh = now - self._last, now, True
        if not self.out:
            return
        self.out = False
        if self._reported:
            self._reported = False
            self._log.info(
                f'{self._name}: {self._kind}s again, after {seconds(silence):.1f} s')
        elif begun and now - self._logged > _BETWEEN:
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
