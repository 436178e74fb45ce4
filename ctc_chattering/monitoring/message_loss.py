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
Messages lost on the way, from the numbers that publishers give them.

Several publishers of one topic number their messages each for itself, and do not say who they are.
What each of them would send next is remembered, also of those that have gone.
"""

from __future__ import annotations

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
