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
The right to command a topic, of one publisher.

Each subscription of `ros/subscription.py` has one `TopicOwnership`, and tells it how many
publishers the middleware has matched. No clock is read here.
"""

from __future__ import annotations

from ctc_chattering.numerics.time_grid import NANOSECONDS

#: A message may wait so long in the queue of a process that stands still [ns].
_LONGEST_QUEUE_NS = NANOSECONDS


class TopicOwnership:
    """
    Decides which messages of a topic are obeyed.

    They are obeyed while one publisher is matched. While there are several, all are ignored, since
    rclpy of Jazzy does not tell who sent a message.

    Attributes
    ----------
    publishers : int
        Number of publishers matched.

    """

    def __init__(self) -> None:
        self.publishers = 0
        self._contested_until = -1

    @property
    def contested(self) -> bool:
        """Return whether there are several publishers."""
        return self.publishers > 1

    def update(self, publishers: int, now: int) -> None:
        """Take the publishers' number at `now` [ns]."""
        if self.contested:
            self._contested_until = now
        self.publishers = publishers

    def admits(self, received: int) -> bool:
        """
        Return whether a message is obeyed.

        A message received before the contention ended may be of a publisher that has left.

        Parameters
        ----------
        received : int
            When it was received, by the system's clock [ns], or 0 if that is unknown.

        """
        return self.publishers <= 1 and not (
            0 <= self._contested_until - received < _LONGEST_QUEUE_NS)
