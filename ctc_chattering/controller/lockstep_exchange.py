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
States and torques in lockstep, as the plant sees them.

Simulated time waits for the torque that answers a state. A state without an answer is sent again,
and may then be answered twice: `LockstepExchange` recognises the surplus answers.
"""

from __future__ import annotations

from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS

#: Time after which a state without an answer is sent again [ns].
_REPEAT_PERIOD_NS = NANOSECONDS // 5


class LockstepExchange:
    """
    Recognises surplus answers to the state before.

    Parameters
    ----------
    now : int
        Time [ns].

    Attributes
    ----------
    sent_at : int
        Time of the present state's first message [ns].

    """

    def __init__(self, now: int) -> None:
        self.sent_at = self._repeated = now
        self._latest: Vector | None = None
        #: Repetitions of the present state, and surplus answers that the one before may still get.
        self._repeats = self._surplus = 0

    def repeat_due(self, now: int) -> bool:
        """Return whether to send the state again at `now` [ns]."""
        if now - max(self.sent_at, self._repeated) <= _REPEAT_PERIOD_NS:
            return False
        self._repeated = now
        self._repeats += 1
        return True

    def accept(self, tau: Vector) -> bool:
        """Return whether a torque [N·m] answers the present state."""
        if self._surplus and tau == self._latest:
            self._surplus -= 1
            return False
        self._latest, self._surplus, self._repeats = tau, self._repeats, 0
        return True
