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
A rehearsal of the loop, for this computer's rate.

In real time, before the first torque, the law computes torques for the states of about a second,
and none is sent. `ControlLoop.rehearse` runs it, and the first torque waits for its end.

No time is read here: all are given.
"""

from __future__ import annotations

from ctc_chattering.control.controller import Controller
from ctc_chattering.controller.answers import Answered, REMEDY
from ctc_chattering.controller.positions import JointSample
from ctc_chattering.controller.watchdog import Logger
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds

#: Longest time of a rehearsal, where states come slowly [ns].
_MAX_DURATION_NS = 2 * NANOSECONDS
#: Share of the configured rate below which a computer does not keep it.
_MIN_RATE_SHARE = 0.9
#: Cure for a robot that sends fewer states.
_FEWER_STATES = 'states come less often; set control_period to the period of the robot'


class Rehearsal:
    """
    The law on states before the first torque.

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
        self._begin: int | None = None
        #: Stamps of the first state and of the last one [ns].
        self._first_stamp: int | None = None
        self._last_stamp: int | None = None
        self._answers = self._outages = 0
        self.total = Answered(0, 0)

    def is_over(self, now: int, complete: bool) -> bool:
        """
        Return whether states or time were enough at `now` [ns].

        The time begins with the first call.
        """
        if self._begin is None:
            self._begin = now
        return complete or now - self._begin >= _MAX_DURATION_NS

    def step(self, state: JointSample) -> bool:
        """Compute a state's torque, and return whether it is new."""
        if state.t == self._last_stamp:
            return False
        if self._first_stamp is None or self._last_stamp is None:
            self._first_stamp = state.t
        else:
            self._outages += state.t - self._last_stamp > self._timeout
        self._last_stamp = state.t
        law = self._law
        at_rest = [0.0] * len(state.q)
        point = state.q, at_rest, at_rest
        ahead = [point] * law.config.input_delay
        law.try_step(state.q, state.dq, *point, ahead, state.t, law.instant(state.t), 0)
        return True

    def miss(self, states: int) -> None:
        """Count states that were missed, each of them."""
        total, in_time = self.total
        self.total = Answered(total + states, in_time)

    def answer(self, in_time: bool) -> None:
        """Count a state that was answered."""
        self._answers += 1
        self.miss(1)
        if in_time:
            self.total = self.total._replace(in_time=self.total.in_time + 1)

    def report(self, logger: Logger) -> None:
        """Log the rate, or warn of it."""
        if self._first_stamp is None or self._last_stamp is None or self._answers < 2:
            return
        states, in_time = self.total
        span = seconds(self._last_stamp - self._first_stamp)
        period = seconds(self._period)
        configured_rate = 1.0 / period
        rate = (self._answers - 1) / span
        text = (f'before the first torque {states} states came in {span:.2f} s; '
                f'{in_time} were answered within {1e3 * period:g} ms, with '
                f'{self._outages} outages; this loop reaches {rate:.0f} Hz')
        if min(rate, in_time / span) >= _MIN_RATE_SHARE * configured_rate:
            logger.info(text)
            return
        fewer_states = in_time >= _MIN_RATE_SHARE * states and not self._outages
        cure = _FEWER_STATES if fewer_states else REMEDY
        logger.warning(f'{text} of the {configured_rate:g} Hz of control_period; {cure}')
