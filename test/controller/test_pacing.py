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

"""When a plant goes on: answers in lockstep that may be late, and samples on a timer's grid."""

from __future__ import annotations

from ctc_chattering.controller.timing import LockstepExchange, TimerGrid
from hypothesis import given
from hypothesis import strategies as st

MS = P = 1_000_000


@given(st.lists(st.tuples(st.integers(0, 1), st.integers(0, 3)), min_size=1, max_size=30))
def test_every_state_is_answered_once(states: list[tuple[int, int]]) -> None:
    """
    Repeat states, each of which gets an answer that comes late.

    The torque is 0 or 1, so that many answers in a row are equal; further answers to a state come
    after the first and before that to the next one.
    """
    exchange, now, late, last = LockstepExchange(0), 0, 0, 0
    for tau, repeats in states:
        exchange.asked = now
        for _ in range(repeats):
            now += 201 * MS
            assert exchange.repeat_due(now)
            assert not exchange.repeat_due(now + 199 * MS)
        assert not any(exchange.accept((float(last),)) for _ in range(late))
        assert exchange.accept((float(tau),))
        last, late = tau, repeats
        now += MS


def test_a_report_is_due_every_three_seconds_of_waiting() -> None:
    exchange = LockstepExchange(0)
    due = [t for t in range(0, 10_000, 10) if exchange.report_due(t * MS)]
    assert due == [3010, 6020, 9030]
    exchange.asked = 9_500 * MS
    assert not exchange.report_due(12_400 * MS)
    assert exchange.report_due(12_600 * MS)


def counts(ticks: TimerGrid, phase: int, late: list[int]) -> list[int]:
    """Return how many samples are due at ticks that come so late [ns]."""
    k, result = 0, []
    for i, lateness in enumerate(late):
        found = ticks.due(phase + (i + 1) * P + lateness, k)
        result.append(found)
        k += max(0, found)
    return result


@given(st.integers(0, 10 ** 18), st.integers(0, P - 1),
       st.lists(st.integers(0, P - 1), min_size=1, max_size=50))
def test_each_tick_is_one_sample(phase: int, first: int, late: list[int]) -> None:
    ticks = TimerGrid(P)
    assert ticks.start is None
    assert ticks.anchor(phase + first, P - first, 0) == phase == ticks.start
    assert counts(ticks, phase, late) == [1] * len(late)


def test_what_is_due_after_a_pause_and_where_the_grid_goes_on() -> None:
    """A next tick that is late itself is on the same grid."""
    ticks, now = TimerGrid(P), 7 + 40 * P + 5
    ticks.anchor(7, P, 0)
    assert ticks.due(now, 3) == 37
    for left in (P - 5, -5, -3 * P - 5):
        assert ticks.anchor(now, left, 12) == 7 + 28 * P
        assert ticks.due(now, 12) == 0
