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

"""Which publisher is obeyed on a topic that only one may command."""

from __future__ import annotations

from collections.abc import Hashable

from ctc_chattering.numerics.time_grid import NANOSECONDS

#: How long a message may be queued here at the most [ns]; a larger difference comes from a system
#: clock that was set.
_QUEUED = NANOSECONDS


class TopicOwnership:
    """
    Decides which messages of a topic are obeyed.

    They are obeyed while one publisher is matched; while there are several, none is obeyed. Who
    sent a message is not known: rclpy of Jazzy does not tell.

    A shared topic, such as joint_states, may have a publisher for each part of a robot. It is
    obeyed while as many different parts have been received as publishers are matched, never were
    more, and just one of them is ours. After a publisher has left, that begins again.

    Attributes
    ----------
    publishers : int
        Number of publishers matched.
    contested : bool
        Whether more than one publisher may speak of our part.

    """

    def __init__(self) -> None:
        self.publishers = 0
        self.contested = False
        #: Parts received since a publisher left last; the value is whether it is ours.
        self._parts: dict[Hashable, bool] = {}
        #: Whether one publisher must have spoken of several parts.
        self._mixed = False
        self._contested_until = -1

    def update(self, publishers: int, now: int) -> None:
        """Take the number of publishers matched at `now`, of the system's clock [ns]."""
        if publishers < self.publishers:
            self._parts.clear()
            self._mixed = False
        self.publishers = publishers
        self._decide(now)

    def note_part(self, part: Hashable, ours: bool, now: int) -> None:
        """
        Note what a message on a shared topic speaks of.

        Parameters
        ----------
        part : hashable
            Such as a list of joints.
        ours : bool
            Whether it concerns us.
        now : int
            Of the system's clock [ns].

        """
        if part not in self._parts and not self._mixed:
            self._parts[part] = ours
            self._mixed = len(self._parts) > self.publishers
            self._decide(now)

    def _decide(self, now: int) -> None:
        if self.contested:
            self._contested_until = now
        told_apart = (not self._mixed and len(self._parts) == self.publishers
                      and sum(self._parts.values()) == 1)
        self.contested = self.publishers > 1 and not told_apart

    def admits(self, received: int) -> bool:
        """
        Return whether a message is obeyed.

        Parameters
        ----------
        received : int
            When it was received, by the system's clock [ns]; 0 if that is unknown. A message that
            was received before the contention ended, and is taken afterwards, may be of a
            publisher that has left.

        """
        return not (self.contested or 0 <= self._contested_until - received < _QUEUED)
