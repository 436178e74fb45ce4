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
When states and torques are in time: stamps, outages, and the pace of a plant in lockstep.

A stamp that repeats, goes back or jumps is refused. Where the next one goes on from there, time
itself has changed (a simulation was reset, a clock was set) and a new run begins. In real time
the time of arrival shows a state that was delayed for too long, and a gap as long as the silence
before it. The clocks need not agree: delays are compared with the shortest one measured.

No time is read here: all are given.
"""

from __future__ import annotations

from typing import Protocol

from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds

#: Verdicts on stamps that are taken: the next one, one after an outage, one of a new run.
NEXT, GAP, RESTART = 'next', 'gap', 'restart'
#: Verdicts on stamps that are refused.
REPEATED, BACKWARD, JUMP, STALE = 'repeated', 'backward', 'jump', 'stale'
TAKEN = frozenset({NEXT, GAP, RESTART})

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
        How much longer the state classified last was delayed than the quickest one [ns]; 0 in
        simulated time.

    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.lateness = 0
        self._last: int | None = None
        self._candidate: int | None = None
        #: When the last state came that was taken, and the shortest delay [ns].
        self._arrived = self._least = 0
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
        step, silence = t - self._last, now - self._arrived
        least = min(self._least + silence // _LEAK, now - t)
        self.lateness = 0 if simulated else now - t - self._least
        if step > 0 and self.lateness > self.limit + silence // _LEAK:
            self._stale_since = now if self._stale_since is None else self._stale_since
            if now - self._stale_since <= _BELIEF * self.limit:
                return STALE
            least = now - t
        if 0 < step <= self.limit:
            return self._take(t, now, least, NEXT)
        if step > 0 and not simulated and step <= silence + silence // _LEAK + self.limit:
            return self._take(t, now, least, GAP)
        if step == 0:
            return REPEATED
        candidate, self._candidate = self._candidate, t
        if candidate is not None and (0 if simulated else 1) <= t - candidate <= self.limit:
            return self._take(t, now, now - t, RESTART if step < 0 else GAP)
        return BACKWARD if step < 0 else JUMP

    def arrival(self, t: int) -> int:
        """Return when a state of stamp `t` [ns] comes that is as quick as any, as of `now`."""
        return t + self._least

    def _take(self, t: int, now: int, least: int, verdict: str) -> str:
        """Take a state; `least` is the shortest delay from now on [ns]."""
        self._last, self._arrived, self._least = t, now, least
        self._candidate = self._stale_since = None
        return verdict


class Logger(Protocol):
    """What is needed of the logger of a node; `filters` are those of rclpy's."""

    def info(self, message: str, /, **filters: float) -> object:
        """Log what is in order."""

    def warning(self, message: str, /, **filters: float) -> object:
        """Log what may be wrong."""

    def error(self, message: str, /, **filters: float) -> object:
        """Log what is wrong."""


#: An outage that lasts longer is reported while it lasts [ns]; a plant may take so long to shut
#: down. And how often [s].
_PATIENCE, _AGAIN = 2 * NANOSECONDS, 60.0


class Watchdog:
    """
    Finds and reports outages of a topic: silence that is longer than `timeout`.

    Parameters
    ----------
    topic, kind : str
        Name of the topic, and one word for its messages.
    consequence : str
        What an outage leads to.
    logger : Logger
        Where outages are reported.

    Attributes
    ----------
    timeout : int
        Silence that is an outage [ns].
    out : bool
        Whether there is an outage.
    outages : int
        Outages so far.

    """

    def __init__(self, topic: str, kind: str, consequence: str, logger: Logger) -> None:
        self._name, self._kind, self._consequence = topic, kind, consequence
        self._log = logger
        self.timeout = self.outages = self._last = 0
        self.out = False

    def feed(self, now: int, begun: bool = True) -> None:
        """Note a message at `now` [ns]; an outage that it ends is reported once `begun`."""
        silence, self._last = now - self._last, now
        if self.out and begun:
            self._log.warning(f'{self._name}: {self._kind}s again, after {seconds(silence):.3f} s;'
                              f' meanwhile {self._consequence}', throttle_duration_sec=1.0)
        self.out = False

    def silence(self, now: int) -> int:
        """Return the time without a message at `now` [ns]."""
        return now - self._last

    def check(self, now: int) -> bool:
        """Return whether an outage begins at `now` [ns], as `feed`; report one that lasts."""
        silence = self.silence(now)
        begins = silence > self.timeout and not self.out
        self.out |= begins
        self.outages += begins
        if silence > max(self.timeout, _PATIENCE):
            self._log.error(f'{self._name}: no {self._kind} for {seconds(silence):.1f} s; '
                            f'{self._consequence}', throttle_duration_sec=_AGAIN)
        return begins


#: Time after which a state without an answer is sent again [ns].
_REPEAT = NANOSECONDS // 5


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
        self.asked = self._repeated = now
        self._latest: Vector | None = None
        #: Times that the present state was repeated, and further answers that the one before may
        #: still get.
        self._repeats = self._surplus = 0

    def repeat_due(self, now: int) -> bool:
        """Return whether the state is to be sent again at `now` [ns]."""
        if now - max(self.asked, self._repeated) <= _REPEAT:
            return False
        self._repeated = now
        self._repeats += 1
        return True

    def accept(self, tau: Vector) -> bool:
        """Return whether a torque, shape (n,) [N·m], answers the present state."""
        if self._surplus and tau == self._latest:
            self._surplus -= 1
            return False
        self._latest, self._surplus, self._repeats = tau, self._repeats, 0
        return True
