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

"""How much of the time requests for parameters may take."""

from __future__ import annotations

from ctc_chattering.ros.parameters import TimeBudget
import pytest


@pytest.mark.parametrize(('takes', 'period', 'refused'), [
    (6e-3, 1 / 60, 0.0),     # A slider that is moved.
    (10e-3, 20e-3, 0.0),     # Half of the time.
    (12e-3, 20e-3, 0.17),    # A sixth of such requests must be refused.
    (5e-3, 5e-3, 0.5)])      # A flood: half of the time is left.
def test_it_limits_the_share_of_the_time(takes: float, period: float, refused: float) -> None:
    budget, end, count = TimeBudget(0.5, 1.0), 0.0, 20_000
    refusals = 0
    for k in range(count):
        begin = max(k * period, end)
        if budget.exhausted(begin):
            refusals += 1
            end = begin
        else:
            end = begin + takes
            budget.spend(end)
    assert refusals / count == pytest.approx(refused, abs=0.02)


def test_a_burst_is_taken_at_once_and_again_after_a_pause() -> None:
    budget, now = TimeBudget(0.5, 1.0), 100.0
    for _ in range(2):
        count = 0
        while not budget.exhausted(now):
            now += 0.01
            budget.spend(now)
            count += 1
        assert count == pytest.approx(200, abs=2)
        now += 10.0
