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

"""The log time of messages in simulated time, from the stamps of several topics."""

from __future__ import annotations

from ctc_chattering.numerics.time_grid import NANOSECONDS

#: Largest difference between the stamps of two topics that is no jump of time [ns].
_SKEW = NANOSECONDS


class LogTime:
    """
    Follows the stamps of several topics, and does not go back because one of them is ahead.

    A bag is read in the order of its log times, so they must not decrease if the order of arrival
    is to be preserved. A jump of time, as when a simulation restarts, is accepted when the next
    message of that topic follows it.

    Attributes
    ----------
    now : int
        The time [ns].

    """

    def __init__(self) -> None:
        self.now = 0
        self._begun = False
        self._jumps: dict[str, int] = {}

    def note(self, topic: str, stamp: int) -> None:
        """Take the stamp of a message of `topic` [ns]."""
        jump = self._jumps.pop(topic, None)
        if not self._begun:
            self._begun = True
            self.now = stamp
        elif abs(stamp - self.now) <= _SKEW:
            self.now = max(self.now, stamp)
        elif jump is not None and 0 <= stamp - jump <= _SKEW:
            self.now = stamp
        else:
            self._jumps[topic] = stamp
