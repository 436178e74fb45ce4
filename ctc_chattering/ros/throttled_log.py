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

"""A log that does not repeat itself: on a machine that is too slow, one event follows another."""

from __future__ import annotations

from collections.abc import Callable
import time

from ctc_chattering.controller.timing import Logger
from ctc_chattering.numerics.time_grid import NANOSECONDS


class ThrottledLog:
    """
    Hands a text on to `logger`, unless it has done so within the last second.

    Parameters
    ----------
    logger : Logger
        Of a node.
    clock : callable
        Returns the time, which only goes forward [ns].

    """

    def __init__(self, logger: Logger, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._log, self._clock = logger, clock
        self._until: dict[str, int] = {}

    def info(self, message: str, /) -> None:
        """Log what is in order."""
        if self._due(message):
            self._log.info(message)

    def warning(self, message: str, /) -> None:
        """Log what may be wrong."""
        if self._due(message):
            self._log.warning(message)

    def error(self, message: str, /) -> None:
        """Log what is wrong."""
        if self._due(message):
            self._log.error(message)

    def _due(self, message: str) -> bool:
        now = self._clock()
        self._until = {text: end for text, end in self._until.items() if end > now}
        due = message not in self._until
        if due:
            self._until[message] = now + NANOSECONDS
        return due
