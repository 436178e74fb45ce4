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
The share of states that are answered in time.

The control loop counts each state here, and ends the torques where the share is too small. A state
is answered in time if its torque is sent within a control period after a state that is as quick as
any would have come. Those that were skipped for newer ones or refused as stale, because this
process stood still, are not. One stall counts as 0.1 s at most: it ends the torques by
`state_timeout` already, and says little about the next second.

No time is read here: all are given.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from ctc_chattering.numerics.time_grid import NANOSECONDS

#: Smallest number of states to judge by.
MIN_STATES = 20
#: Largest share of a second's states that one stall counts.
_MAX_STALL_SHARE = 0.1
#: Cure for a computer that is too slow.
REMEDY = 'give the controller a real-time priority or raise control_period (docs/real_time.md)'


class Answered(NamedTuple):
    """
    A number of states.

    Attributes
    ----------
    states, in_time : int
        All, and those answered in time.

    """

    states: int
    in_time: int


def shortfall(answered: Answered, least_share: float, min_states: int) -> str:
    """Return a reason if too few were in time, or ''."""
    states, in_time = answered
    if states < min_states or in_time >= least_share * states:
        return ''
    return (f'the computer is too slow: only {in_time} of the last {states} states were answered '
            f'in time, and least_answered requires {100.0 * least_share:g} %; {REMEDY}')


class AnsweredStates:
    """
    Counts the states of the last second, by answer.

    Parameters
    ----------
    period : int
        Control period [ns].

    Attributes
    ----------
    window : int
        Number of states that are counted.
    total : Answered
        Those states.

    """

    def __init__(self, period: int) -> None:
        self.window = max(NANOSECONDS // period, MIN_STATES)
        self._stall = max(round(_MAX_STALL_SHARE * self.window), 1)
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
        """Return whether there are enough states to judge."""
        return self.total.states >= self.window
