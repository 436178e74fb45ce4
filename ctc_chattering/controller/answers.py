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
The share of the robot's states that are answered in time, before and after the first torque.

A state is answered in time if its torque is sent within a control period after a state that is as
quick as any would have come. Not in time are those that were skipped for newer ones or refused as
stale, because this process stood still. One stall counts as 0.1 s at most: it ends the torques by
`state_timeout` already, and says little about the next second.

No time is read here: all are given.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from ctc_chattering.control.controller import Controller
from ctc_chattering.controller.positions import JointSample
from ctc_chattering.controller.timing import Logger
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds

#: Least number of states to judge by.
LEAST_STATES = 20
#: Part of a second's states that one stall counts at most.
LARGEST_STALL = 0.1
#: Longest time for which the loop is measured, where states come slowly [ns].
LONGEST_REHEARSAL = 2 * NANOSECONDS
#: Share of the configured rate below which a computer does not keep it.
KEPT = 0.9
#: What to do about a computer that is too slow.
_REMEDY = 'give the controller a priority, or raise control_period: see docs/real_time.md'
#: What to do where the robot sends fewer states.
_FEWER_STATES = 'states come less often: set control_period to that of the robot'


class Answered(NamedTuple):
    """
    A number of states.

    Attributes
    ----------
    states, in_time : int
        States, and those of them that were answered in time.

    """

    states: int
    in_time: int


def shortfall(answered: Answered, least: float, enough: int) -> str:
    """Return why a share in time is below the least one, of `enough` states; '' if it is not."""
    states, in_time = answered
    if states < enough or in_time >= least * states:
        return ''
    return (f'the computer is too slow: {in_time} of the last {states} states were answered in '
            f'time; least_answered is {least:g}; {_REMEDY}')


class AnsweredStates:
    """
    Counts the last states, of about a second, and those that were answered in time.

    Parameters
    ----------
    period : int
        Control period [ns].

    Attributes
    ----------
    window : int
        Number of states that are looked at.

    """

    def __init__(self, period: int) -> None:
        self.window = max(NANOSECONDS // period, LEAST_STATES)
        self._stall = max(round(LARGEST_STALL * self.window), 1)
        self.clear()

    def clear(self) -> None:
        """Forget all states."""
        self._last: deque[Answered] = deque()
        self.total = Answered(0, 0)

    def miss(self, states: int) -> None:
        """Count states that were missed at once."""
        self._add(Answered(min(states, self._stall), 0))

    def answer(self, in_time: bool) -> None:
        """Count a state that was answered."""
        self._add(Answered(1, int(in_time)))

    def _add(self, latest: Answered) -> None:
        self._last.append(latest)
        states = self.total.states + latest.states
        answered = self.total.in_time + latest.in_time
        while states - self._last[0].states >= self.window:
            oldest = self._last.popleft()
            states -= oldest.states
            answered -= oldest.in_time
        self.total = Answered(states, answered)

    @property
    def complete(self) -> bool:
        """Whether there are enough states to judge."""
        return self.total.states >= self.window


class Rehearsal:
    """
    The law on states before the first torque: it shows the rate that this computer keeps.

    Parameters
    ----------
    law : Controller
        One that drives nothing.
    period, timeout : int
        Control period, and gap of the stamps that is an outage [ns].

    Attributes
    ----------
    total : Answered
        All states so far.

    """

    def __init__(self, law: Controller, period: int, timeout: int) -> None:
        self._law, self._period, self._timeout = law, period, timeout
        self._began: int | None = None
        #: Stamps of the first state and of the last one [ns].
        self._first: int | None = None
        self._t: int | None = None
        self._answers = self._outages = 0
        self.total = Answered(0, 0)

    def begin(self, now: int) -> None:
        """Begin with the first state, at `now` [ns] on the clock of `over`."""
        self._began = now if self._began is None else self._began

    def over(self, now: int, complete: bool) -> bool:
        """Return whether there were states enough, or time enough at `now` [ns]."""
        return self._began is not None and (
            complete or now - self._began >= LONGEST_REHEARSAL)

    def step(self, state: JointSample) -> bool:
        """Compute the torque of a state that is new, at rest there; return whether it is new."""
        if state.t == self._t:
            return False
        if self._t is not None:
            self._outages += state.t - self._t > self._timeout
        self._first = state.t if self._first is None else self._first
        self._t = state.t
        law, still = self._law, [0.0] * len(state.q)
        point = state.q, still, still
        law.try_step(state.q, state.dq, *point, [point] * law.config.input_delay,
                     state.t, law.instant(state.t), 0)
        return True

    def miss(self, states: int) -> None:
        """Count states that were missed, each of them."""
        self.total = Answered(self.total.states + states, self.total.in_time)

    def answer(self, in_time: bool) -> None:
        """Count a state that was answered."""
        self._answers += 1
        self.total = Answered(self.total.states + 1, self.total.in_time + in_time)

    def report(self, logger: Logger) -> None:
        """Log the rate that is kept, as a warning if it is below the configured one."""
        if self._first is None or self._t is None or self._answers < 2:
            return
        span, wanted = seconds(self._t - self._first), 1.0 / seconds(self._period)
        kept, (states, in_time) = (self._answers - 1) / span, self.total
        text = (f'before the first torque {states} states came in {span:.2f} s; '
                f'{in_time} were answered within {1e3 * seconds(self._period):g} ms, with '
                f'{self._outages} outages: this loop keeps {kept:.0f} Hz')
        if min(kept, in_time / span) >= KEPT * wanted:
            logger.info(text)
        else:
            cure = _FEWER_STATES if in_time >= KEPT * states and not self._outages else _REMEDY
            logger.warning(f'{text} of the {wanted:g} Hz of control_period; {cure}')
