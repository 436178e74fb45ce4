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

"""When a plant goes on: in lockstep with the answer, in real time on the grid of a timer."""

from __future__ import annotations

from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS

#: Time after which a state without an answer is sent again, and after which is said what is
#: waited for [ns].
_REPEAT, _REPORT = NANOSECONDS // 5, 3 * NANOSECONDS


class LockstepExchange:
    """
    Tells the answer to a state from further answers to the state before, which was repeated.

    Parameters
    ----------
    now : int
        Time [ns].

    Attributes
    ----------
    asked : int
        When the present state was sent first [ns].

    """

    def __init__(self, now: int) -> None:
        self.asked = self._repeated = self._reported = now
        self._latest: Vector | None = None
        #: Times that the present state was repeated, and further answers that the one before may
        #: still get.
        self._repeats = self._surplus = 0

    def repeat_due(self, now: int) -> bool:
        """Return whether the state is to be sent again at `now` [ns]."""
        due = now - max(self.asked, self._repeated) > _REPEAT
        if due:
            self._repeated = now
            self._repeats += 1
        return due

    def report_due(self, now: int) -> bool:
        """Return whether to say at `now` [ns] what is waited for."""
        due = now - max(self.asked, self._reported) > _REPORT
        if due:
            self._reported = now
        return due

    def accept(self, tau: Vector) -> bool:
        """Return whether a torque, shape (n,) [N·m], answers the present state."""
        if self._surplus and tau == self._latest:
            self._surplus -= 1
            return False
        self._latest, self._surplus, self._repeats = tau, self._repeats, 0
        return True


class TimerGrid:
    """
    A grid of samples on a timer's own grid.

    A tick comes when it is due or a little later, never earlier. On a grid of any other phase some
    ticks would come before their period and the next ones would have two to make good.

    Parameters
    ----------
    period : int
        Of the timer and of the samples [ns].

    Attributes
    ----------
    start : int or None
        Time of sample 0 [ns]; None before the first tick.

    """

    def __init__(self, period: int) -> None:
        self._period = period
        self.start: int | None = None

    def anchor(self, now: int, left: int, k: int) -> int:
        """
        Put sample `k` to the tick that was due last, and return `start`.

        Parameters
        ----------
        now : int
            Time [ns].
        left : int
            From then to the next tick that is due [ns]; less than 0 if that is late.
        k : int
            Number of the sample.

        """
        self.start = now - (self._period - left) % self._period - k * self._period
        return self.start

    def due(self, now: int, k: int) -> int:
        """Return how many samples after `k` are due at `now` [ns]."""
        assert self.start is not None
        return (now - self.start) // self._period - k
