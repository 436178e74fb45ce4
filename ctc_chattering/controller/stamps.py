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
Stamps of the states: order, gaps and lateness.

The control loop asks `Stamps` for a verdict on each state. A stamp that repeats, goes back or
jumps is refused. Where the next one goes on from there, time itself has changed (a simulation was
reset, a clock was set) and a new run begins. In real time the time of arrival shows a state that
was delayed for too long, and a gap as long as the silence before it. The clocks need not agree:
delays are compared with the shortest one measured.

No time is read here: all are given.
"""

from __future__ import annotations

#: Verdicts on stamps that are taken: the next one, one after an outage, one of a new run.
NEXT = 'next'
GAP = 'gap'
RESTART = 'restart'
#: Verdicts on stamps that are refused.
REPEATED = 'repeated'
BACKWARD = 'backward'
JUMP = 'jump'
STALE = 'stale'
TAKEN = frozenset({NEXT, GAP, RESTART})

#: Time in which the shortest delay seen grows by one unit: more than clocks drift apart.
_LEAK = 1000
#: Number of limits with only stale states after which the delay is taken to have changed.
_MAX_STALE_LIMITS = 50


class Stamps:
    """
    Classifies the stamps of one source.

    Parameters
    ----------
    limit : int
        Longest step that is no outage, and longest additional delay [ns].

    Attributes
    ----------
    lateness : int
        Delay of the state classified last, beyond the shortest one [ns]. It is 0 in simulated
        time.

    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.lateness = 0
        self._last: int | None = None
        self._candidate: int | None = None
        #: When the last state came that was taken, and the shortest delay [ns].
        self._arrived = self._shortest_delay = 0
        self._stale_since: int | None = None

    def classify(self, t: int, now: int, simulated: bool) -> str:
        """
        Return the verdict on a state.

        Parameters
        ----------
        t : int
            Its stamp [ns].
        now : int
            When it came, on a clock that only goes forward [ns].
        simulated : bool
            Whether time is simulated, so that arrival says nothing.

        """
        if self._last is None:
            return self._take(t, now, now - t, RESTART)
        step = t - self._last
        silence = now - self._arrived
        leak = silence // _LEAK
        delay = now - t
        shortest_delay = min(self._shortest_delay + leak, delay)
        self.lateness = 0 if simulated else delay - self._shortest_delay
        if step > 0 and self.lateness > self.limit + leak:
            if self._stale_since is None:
                self._stale_since = now
            if now - self._stale_since <= _MAX_STALE_LIMITS * self.limit:
                return STALE
            shortest_delay = delay
        if 0 < step <= self.limit:
            return self._take(t, now, shortest_delay, NEXT)
        if not simulated and 0 < step <= silence + leak + self.limit:
            return self._take(t, now, shortest_delay, GAP)
        if step == 0:
            return REPEATED
        candidate, self._candidate = self._candidate, t
        least_step = 0 if simulated else 1
        if candidate is not None and least_step <= t - candidate <= self.limit:
            return self._take(t, now, delay, RESTART if step < 0 else GAP)
        return BACKWARD if step < 0 else JUMP

    def arrival(self, t: int) -> int:
        """Return the earliest arrival of a state `t` [ns]."""
        return t + self._shortest_delay

    def _take(self, t: int, now: int, shortest_delay: int, verdict: str) -> str:
        """Take a state, and the shortest delay from now on [ns]."""
        self._last = t
        self._arrived = now
        self._shortest_delay = shortest_delay
        self._candidate = self._stale_since = None
        return verdict
