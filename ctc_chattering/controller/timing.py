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
When states and torques are in time: stamps, outages, and the pace of a plant.

A stamp that repeats, goes back or jumps is refused. Where the next one goes on from there, time
itself has changed (a simulation was reset, a clock was set) and a new run begins. In real time
the time of arrival shows a state that was delayed for too long, and a gap as long as the silence
before it. The clocks need not agree: delays are compared with the shortest one measured.

A plant goes on in lockstep with the answer, or in real time on the grid of a timer. No time is
read here: all are given.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from ctc_chattering.controller.health import BUSY
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds

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


class Logger(Protocol):
    """What is needed of the logger of a node; `filters` are those of rclpy's."""

    def info(self, message: str, /, **filters: float) -> object:
        """Log what is in order."""

    def warning(self, message: str, /, **filters: float) -> object:
        """Log what may be wrong."""

    def error(self, message: str, /, **filters: float) -> object:
        """Log what is wrong."""


class Watchdog:
    """
    Finds and reports outages of a topic: silence that is longer than `timeout`.

    Parameters
    ----------
    topic, kind : str
        Name of the topic, and one word for its messages.
    consequence : str
        What an outage leads to.
    patience : int
        An outage that lasts longer is reported at once, a shorter one at its end [ns].
    logger : Logger
        Where outages are reported.

    Attributes
    ----------
    timeout : int
        Silence that is an outage [ns].
    out : bool
        Whether there is an outage.
    outages, stale : int
        Outages so far, and samples without a new message.
    longest : int
        Longest silence [ns]; may be reset.

    """

    def __init__(self, topic: str, kind: str, consequence: str, patience: int, logger: Logger
                 ) -> None:
        self._name, self._kind, self._consequence = topic, kind, consequence
        self._patience, self._log = patience, logger
        self.timeout = self.outages = self.stale = self.longest = 0
        self.out = False
        self._last = 0
        self._fresh = self._reported = False

    def feed(self, now: int, begun: bool = True) -> None:
        """Note a message at `now` [ns]; a short outage that it ends is reported once `begun`."""
        silence, self._last, self._fresh = now - self._last, now, True
        if not self.out:
            return
        self.out = False
        if self._reported:
            self._reported = False
            self._log.info(
                f'{self._name}: {self._kind}s again, after {seconds(silence):.1f} s')
        elif begun:
            self._log.warning(
                f'{self._name}: no {self._kind} for {seconds(silence):.3f} s; '
                f'{self._consequence} after {seconds(self.timeout):g} s',
                throttle_duration_sec=1.0)

    def silence(self, now: int) -> int:
        """Return the time without a message at `now` [ns]."""
        return now - self._last

    def check(self, now: int, publishers: Callable[[], int]) -> bool:
        """
        Return whether an outage begins at `now` [ns]; report one that lasts.

        Parameters
        ----------
        now : int
            On the clock of `feed` [ns].
        publishers : callable
            Returns how many there are; without any an outage is no error.

        """
        silence = self.silence(now)
        self.longest = max(self.longest, silence)
        begins = silence > self.timeout and not self.out
        if begins:
            self.out = True
            self.outages += 1
        if silence > max(self.timeout, self._patience) and not self._reported:
            self._reported = True
            if publishers():
                self._log.error(f'{self._name}: no {self._kind} for {seconds(silence):.1f} s; '
                                f'{self._consequence}')
            else:
                self._log.info(f'{self._name}: its publisher has left; {self._consequence}')
        return begins

    def sample(self) -> None:
        """Count a sample that goes on with the last message, however old."""
        self.stale += not self._fresh
        self._fresh = False


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
