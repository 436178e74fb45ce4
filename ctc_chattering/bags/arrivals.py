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
What a recorder knows of the messages that arrive: their log time, and how many were lost before.

Several publishers of one topic number their messages each for itself, and do not say who they are.
What each of them would send next is remembered, also of those that have gone.
"""

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


#: Publishers that are remembered.
_MANY = 16


class SequenceTracker:
    """Follows the numbers of one topic's messages."""

    def __init__(self) -> None:
        self._next: dict[int, None] = {}

    def follows(self, number: int) -> bool:
        """Return whether a message is one that was expected; if not, ask `lost`."""
        if number not in self._next:
            return False
        del self._next[number]
        self._next[number + 1] = None
        return True

    def lost(self, number: int, publishers: int) -> int:
        """
        Return how many messages are missing before one that was not expected.

        Parameters
        ----------
        number : int
            The publisher's number of the message.
        publishers : int
            How many there are now. With several, it is not known whose message is missing, and a
            number never seen may be a new publisher's; then it is 0.

        """
        before = None
        if publishers == 1:
            before = max((x for x in self._next if x < number), default=None)
        if before is not None:
            del self._next[before]
        self._next[number + 1] = None
        if len(self._next) > _MANY:
            del self._next[next(iter(self._next))]
        return 0 if before is None else number - before
