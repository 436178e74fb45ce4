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
Time along a motion, whose speed is scaled while it runs, down to a stop.

`MotionSchedule` publishes a `ScaledMotion`, and passes into another speed by `PathClock.slew`. A
`Stop` is one whose speed falls to 0.
With the path time s and the motion p, the reference at instant t is

    q_d = p(s),    dq_d = ṡ p'(s),    ddq_d = ṡ² p''(s) + s̈ p'(s)    (PC1)
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.transitions import TimedMotion


class PathTime(NamedTuple):
    """Path time at an instant, and its derivatives."""

    #: s [ns].
    instant: int
    #: ṡ, 1 at full speed.
    rate: float
    #: s̈ [1/s].
    rate_change: float


@dataclasses.dataclass(frozen=True)
class PathClock:
    """
    Path time as a function of time, with one change of its rate.

    From `t0` on the rate passes from r0 to r1 within a duration T, with τ = (t - t0) / T. Before
    and after that it is constant.

        ṡ = r0 + (r1 - r0) (3 τ² - 2 τ³)    (PC2)

    At full speed path time is time, to the nanosecond.

    Attributes
    ----------
    rate : float
        Rate after the change, from 0 to 1.
    previous_rate : float
        Rate before it.
    t0, s0 : int
        Instant at which the rate begins to change, and the path time there [ns].
    span : int
        Time that the change takes [ns].

    """

    rate: float = 1.0
    previous_rate: float = 1.0
    t0: int = 0
    s0: int = 0
    span: int = 0

    @classmethod
    def steady(cls, rate: float) -> PathClock:
        """Return a clock of one rate."""
        return cls(rate, rate)

    @property
    def end(self) -> int:
        """Instant from which on the rate is constant [ns]."""
        return self.t0 + self.span

    def slew(self, t0: int, rate: float, duration: float) -> PathClock:
        """
        Return a clock that passes to another rate from `t0` [ns] on.

        Parameters
        ----------
        t0 : int
            Instant at which this clock's own change is complete, or later [ns].
        rate : float
            Rate after the change.
        duration : float
            Time that the change takes [s].

        """
        s0 = self.at(t0).instant
        return PathClock(rate, self.rate, t0, s0, round(duration * NANOSECONDS))

    def at(self, t: int) -> PathTime:
        """Return the path time at `t` [ns], by (PC2)."""
        elapsed = t - self.t0
        after = max(elapsed - self.span, 0)
        change = self.rate - self.previous_rate
        slewed = min(max(elapsed, 0), self.span)
        tau = slewed / self.span if self.span else float(elapsed >= 0)
        gained = round(change * slewed * tau * tau * (1.0 - 0.5 * tau))
        rate_change = 0.0
        if 0.0 < tau < 1.0:
            rate_change = change * 6.0 * tau * (1.0 - tau) / seconds(self.span)
        return PathTime(
            self.s0 + _scale(elapsed - after, self.previous_rate) + gained
            + _scale(after, self.rate),
            self.previous_rate + change * tau * tau * (3.0 - 2.0 * tau),
            rate_change)

    def instant_of(self, s: int) -> int | None:
        """Return when path time `s` is reached [ns], at `end` or later, None for never."""
        missing = max(s - self.at(self.end).instant, 0)
        if missing and not self.rate:
            return None
        return self.end + (round(missing / self.rate) if missing else 0)


def _scale(elapsed: int, rate: float) -> int:
    """Return a time [ns] at a rate, exact at full speed."""
    return elapsed if rate == 1.0 else round(elapsed * rate)


class ScaledMotion:
    """
    A motion at the speed of a clock, by (PC1).

    Parameters
    ----------
    motion : TimedMotion
    clock : PathClock

    """

    def __init__(self, motion: TimedMotion, clock: PathClock) -> None:
        self._motion = motion
        self._clock = clock
        self.t0 = clock.t0
        self.end = clock.end

    def at(self, t: int) -> Point:
        """Return the point at `t` [ns]."""
        s, rate, rate_change = self._clock.at(t)
        point = self._motion.at(s)
        if rate == 1.0 and not rate_change:
            return point
        q, dq, ddq = point
        return (
            tuple(q),
            tuple(rate * v for v in dq),
            tuple(rate * rate * a + rate_change * v for v, a in zip(dq, ddq)))


class Stop(ScaledMotion):
    """
    A motion that comes to rest on its own path, by a rate that falls from 1 to 0.

    No velocity exceeds that of the path, and |ddq| is at most that of the path plus 1.5 |dq| / T.

    Parameters
    ----------
    path : TimedMotion
        The motion to stop.
    t0 : int
        Instant until which it follows the path in time [ns].
    duration : float
        T, until it rests [s].

    Attributes
    ----------
    end : int
        Instant from which on it rests [ns].

    """

    def __init__(self, path: TimedMotion, t0: int, duration: float) -> None:
        super().__init__(path, PathClock().slew(t0, 0.0, duration))
