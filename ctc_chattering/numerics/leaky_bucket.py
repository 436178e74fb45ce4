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
Limit of a rate that allows bursts.

The parameter services limit the time that requests take, `ctc live` the messages of a page. What
is limited fills a bucket that leaks at the allowed rate; what is beyond the capacity is too much.
"""

from __future__ import annotations


class LeakyBucket:
    """
    A level that rises by amounts and leaks steadily.

    Parameters
    ----------
    rate : float
        Amount per second that is allowed in the long run.
    capacity : float
        Amount that is allowed at once.

    """

    def __init__(self, rate: float, capacity: float) -> None:
        self._rate = rate
        self._capacity = capacity
        self._level = 0.0
        self._time = 0.0

    def fill(self, amount: float, now: float) -> float:
        """
        Add an amount at `now` [s].

        Return the excess over the capacity.
        """
        leaked = self._rate * (now - self._time)
        remaining = max(self._level - leaked, 0.0)
        self._level = remaining + amount
        self._time = now
        return max(self._level - self._capacity, 0.0)
