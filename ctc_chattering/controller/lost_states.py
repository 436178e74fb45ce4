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
The times of torques for states that do not come.

`ControlLoop.due` and `ControlLoop.predict` use it in real time. The law itself predicts the state.
"""

from __future__ import annotations


class LostStates:
    """
    Times of the torques for predicted states.

    Parameters
    ----------
    period : int
        Control period [ns].

    Attributes
    ----------
    predicted_periods : int
        As the parameter of this name.
    may_follow : bool
        Whether the law has answered the last state, and all that were predicted after it.

    """

    def __init__(self, period: int) -> None:
        self._period = period
        self.predicted_periods = 0
        self.may_follow = False

    def due(self, arrival: int, predicted: int, timeout: int) -> int | None:
        """
        Return the time of the next torque [ns], if any.

        That is a quarter of a period after the next state should have come.

        Parameters
        ----------
        arrival, timeout : int
            Arrival of the last state, and `state_timeout` [ns].
        predicted : int
            Periods after it that have been answered.

        """
        periods = predicted + 1
        silence = periods * self._period + self._period // 4
        if periods > self.predicted_periods or silence >= timeout:
            return None
        return arrival + silence

    def periods_since(self, arrival: int, now: int) -> int:
        """
        Return the periods passed since the arrival of a state.

        No more than are made good. Times are in ns.

        A torque sent within half a period after the state should have come is in force from its
        sample on.
        """
        passed = (now - arrival + self._period // 2) // self._period
        return min(max(passed, 0), self.predicted_periods)
