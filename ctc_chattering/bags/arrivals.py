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
Log times and losses of arriving messages.

`nodes/recorder.py` calls this for each message that it takes.
"""

from __future__ import annotations

from collections.abc import Callable

from ctc_chattering.numerics.time_grid import NANOSECONDS

#: Topics' stamps that differ by more than this show a jump of time [ns].
_MAX_SKEW = NANOSECONDS


class LogTime:
    """
    Log time that follows the stamps of several topics.

    It does not go back because one of them is ahead. A bag is read in the order of its log times,
    so they must not decrease if the order of arrival is to be preserved. A jump of time is
    accepted when the next message of that topic follows it. A jump back, as when a simulation
    restarts, is one only if the topic itself had come farther: its messages may be late by any
    time, and single ones may have other stamps.

    Attributes
    ----------
    now : int
        The time [ns].

    """

    def __init__(self) -> None:
        self.now = 0
        self._last: dict[str, int] = {}
        #: How far each topic has come, without stray stamps, since it was last as far as `now`.
        self._latest: dict[str, int] = {}

    def note(self, topic: str, stamp: int) -> None:
        """Take the stamp of a message of `topic` [ns]."""
        last = self._last.get(topic)
        latest = self._latest.setdefault(topic, stamp)
        is_far = abs(stamp - self.now) > _MAX_SKEW
        follows = last is not None and 0 <= stamp - last <= _MAX_SKEW
        is_jump = stamp > self.now or stamp < latest - _MAX_SKEW
        if not self._last or (is_far and follows and is_jump):
            self.now = stamp
        elif not is_far:
            self.now = max(self.now, stamp)
        if follows:
            is_late = self.now - stamp > _MAX_SKEW
            self._latest[topic] = max(latest, stamp) if is_late else stamp
        self._last[topic] = stamp


class SequenceTracker:
    """
    Sequence numbers of one topic's messages.

    Several publishers of a topic number their messages each for itself, and a message does not say
    whose it is. The number that each would send next is remembered, also of those that have gone.
    """

    def __init__(self) -> None:
        self._next: set[int] = set()

    def lost(self, number: int, publishers: Callable[[], int]) -> int:
        """
        Return how many messages are missing before one.

        Parameters
        ----------
        number : int
            The publisher's number of the message.
        publishers : callable
            Returns how many there are now. With several, it is not known whose message is
            missing, and a number never seen may be a new publisher's. Then 0 is returned.

        """
        expected = number
        if number not in self._next and publishers() == 1:
            earlier = (x for x in self._next if x < number)
            expected = max(earlier, default=number)
        self._next.discard(expected)
        self._next.add(number + 1)
        return number - expected
