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
Classification of joint states by their stamps, before anything is computed from them.

A stamp that repeats, goes back or jumps is refused. Where the next one goes on from there, time
itself has changed (a simulation was reset, a clock was set) and a new run begins. In real time
the time of arrival shows a state that was delayed for too long, and a gap as long as the silence
before it. The clocks need not agree: delays are compared with the shortest one measured.
"""

from __future__ import annotations

from ctc_chattering.monitoring.controller_health import BUSY
from ctc_chattering.numerics.time_grid import seconds

#: Verdicts on stamps that are taken: the next one, one after an outage, one of a new run.
NEXT, GAP, RESTART = 'next', 'gap', 'restart'
#: Verdicts on stamps that are refused.
REPEATED, BACKWARD, JUMP, STALE = 'repeated', 'backward', 'jump', 'stale'
TAKEN = frozenset({NEXT, GAP, RESTART})
_REASONS = {REPEATED: 'the stamp repeats', BACKWARD: 'the stamp goes back',
            JUMP: 'the stamp jumps'}

#: The shortest delay seen grows by a thousandth of time, more than clocks drift apart.
_LEAK = 1000
#: After so many limits of nothing but stale states the delay is believed to have changed.
_BELIEF = 50


class Stamps:
    """
    Classifies one source's stamps.

    Parameters
    ----------
    limit : int
        Longest step that is no outage, and longest additional delay [ns].

    Attributes
    ----------
    lateness : int
        How much longer the state classified last was delayed than the quickest one [ns]; only in
        real time.

    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.lateness = 0
        self._last: int | None = None
        self._candidate: int | None = None
        self._arrived = 0
        self._least: int | None = None
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
        last = self._last
        if last is None:
            return self._take(t, now, RESTART)
        step = t - last
        if step > 0 and not simulated and self._is_stale(t, now):
            return STALE
        if 0 < step <= self.limit:
            return self._take(t, now, NEXT)
        silence = now - self._arrived
        if step > 0 and not simulated and step <= silence + silence // _LEAK + self.limit:
            return self._take(t, now, GAP)
        if step == 0:
            return REPEATED
        candidate, self._candidate = self._candidate, t
        if candidate is not None and (0 if simulated else 1) <= t - candidate <= self.limit:
            self._least = None
            return self._take(t, now, RESTART if step < 0 else GAP)
        return BACKWARD if step < 0 else JUMP

    def arrival(self, t: int) -> int:
        """Return when a state of stamp `t` [ns] comes that is as quick as any, as of `now`."""
        return t + (self._least or 0)

    def reason(self, verdict: str, t: int) -> str:
        """Return why the state of stamp `t` [ns] was refused just now."""
        if verdict == STALE:
            return (f'it comes {1e3 * seconds(self.lateness):.1f} ms later than the quickest one, '
                    f'more than {1e3 * seconds(self.limit):g} ms (state_timeout): {BUSY}')
        return f'{_REASONS[verdict]}: {seconds(t):.9f} s'

    def _take(self, t: int, now: int, verdict: str) -> str:
        delay = now - t
        if self._least is None:
            self._least = delay
        else:
            self._least = min(self._least + (now - self._arrived) // _LEAK, delay)
        self._last, self._arrived, self._candidate, self._stale_since = t, now, None, None
        return verdict

    def _is_stale(self, t: int, now: int) -> bool:
        """Return whether a state comes later after its stamp than it should."""
        if self._least is None:
            return False
        self.lateness = now - t - self._least
        if self.lateness <= self.limit + (now - self._arrived) // _LEAK:
            return False
        if self._stale_since is None:
            self._stale_since = now
        if now - self._stale_since > _BELIEF * self.limit:
            self._least = now - t
            return False
        return True
