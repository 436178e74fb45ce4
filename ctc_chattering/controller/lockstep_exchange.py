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
Match torques to states in lockstep, for the plant node.

Simulated time waits for the torque that answers a state. An unanswered state is sent again, and
may then get two answers. Torques have no stamp, so `LockstepExchange` takes one that equals the
last for the second answer. A genuine answer may be refused, as that of a robot at rest. Then the
state is sent once more.
"""

from __future__ import annotations

from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS

#: Real time after which an unanswered state is sent again [ns].
_REPEAT_PERIOD_NS = NANOSECONDS // 5


class LockstepExchange:
    """
    Detection of second answers to the state before.

    Parameters
    ----------
    now : int
        Monotonic time [ns].

    Attributes
    ----------
    sent_at : int
        Time of the present state's first message [ns]. The caller sets it.

    """

    def __init__(self, now: int) -> None:
        self.sent_at = now
        self._last_repeat_at = now
        self._last_accepted: Vector | None = None
        #: Repetitions of the present state.
        self._repeats = 0
        #: Second answers that the state before may still get.
        self._surplus = 0

    def repeat_due(self, now: int) -> bool:
        """Return whether to send the state again at `now` [ns], and count that."""
        if now - max(self.sent_at, self._last_repeat_at) <= _REPEAT_PERIOD_NS:
            return False
        self._last_repeat_at = now
        self._repeats += 1
        return True

    def accept(self, tau: Vector) -> bool:
        """Take a torque [N·m], and return whether it answers the present state."""
        if self._surplus and tau == self._last_accepted:
            self._surplus -= 1
            return False
        self._last_accepted = tau
        self._surplus = self._repeats
        self._repeats = 0
        return True
