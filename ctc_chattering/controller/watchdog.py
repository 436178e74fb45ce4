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

"""
Outages of a topic, from the times of arrival.

Controller and plant each have one, for states and for commands. No time is read here.
"""

from __future__ import annotations

from typing import Protocol

from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds


class Logger(Protocol):
    """Logger of a node, with the filters of rclpy."""

    def info(self, message: str, /, **filters: float) -> object:
        """Log a change that is in order."""

    def warning(self, message: str, /, **filters: float) -> object:
        """Log a possible fault."""

    def error(self, message: str, /, **filters: float) -> object:
        """Log a fault."""


#: Outage from which on it is reported while it lasts [ns]: a plant may take less to shut down.
_LONG_OUTAGE_NS = 2 * NANOSECONDS
#: Time between two such reports [s].
_REPORT_PERIOD_S = 60.0


class Watchdog:
    """
    Detects and reports silence that is longer than `timeout`.

    Parameters
    ----------
    topic, noun : str
        Name of the topic, and one word for its messages.
    consequence : str
        Consequence of an outage, for the report.
    logger : Logger
        Logger of the reports.

    Attributes
    ----------
    timeout : int
        Silence that is an outage [ns].
    out : bool
        Whether there is an outage.
    outages : int
        Outages so far.

    """

    def __init__(self, topic: str, noun: str, consequence: str, logger: Logger) -> None:
        self._name, self._noun, self._consequence = topic, noun, consequence
        self._log = logger
        self.timeout = self.outages = self._last = 0
        self.out = False

    def feed(self, now: int, begun: bool = True) -> None:
        """Note a message at `now` [ns], and report an outage's end once `begun`."""
        silence = self.silence(now)
        self._last = now
        if self.out and begun:
            self._log.warning(
                f'{self._name}: {self._noun}s again, after {seconds(silence):.3f} s; meanwhile '
                f'{self._consequence}',
                throttle_duration_sec=1.0)
        self.out = False

    def silence(self, now: int) -> int:
        """Return the time without a message at `now` [ns]."""
        return now - self._last

    def check(self, now: int) -> bool:
        """Return whether an outage begins at `now`, or report one."""
        silence = self.silence(now)
        begins = silence > self.timeout and not self.out
        self.out |= begins
        self.outages += begins
        if silence > max(self.timeout, _LONG_OUTAGE_NS):
            self._log.error(
                f'{self._name}: no {self._noun} for {seconds(silence):.1f} s; '
                f'{self._consequence}',
                throttle_duration_sec=_REPORT_PERIOD_S)
        return begins
