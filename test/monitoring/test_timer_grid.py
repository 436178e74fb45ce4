"""Samples on a timer's grid: one for each tick, however late it comes."""

from __future__ import annotations

import random

from ctc_chattering.monitoring.timer_grid import TimerGrid
from hypothesis import given
from hypothesis import strategies as st

P = 1_000_000


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


def test_on_another_grid_it_would_not_be() -> None:
    """The same ticks, late by up to a fifth, on a grid that begins with the first of them."""
    rng, ticks = random.Random(1), TimerGrid(P)
    late = [rng.randrange(P // 5) for _ in range(1000)]
    ticks.anchor(late[0], 0, 0)
    found = counts(ticks, 0, late)
    assert found.count(0) > 100 and found.count(2) > 100


def test_what_is_due_after_a_pause_and_where_the_grid_goes_on() -> None:
    """A next tick that is late itself is on the same grid."""
    ticks, now = TimerGrid(P), 7 + 40 * P + 5
    ticks.anchor(7, P, 0)
    assert ticks.due(now, 3) == 37
    for left in (P - 5, -5, -3 * P - 5):
        assert ticks.anchor(now, left, 12) == 7 + 28 * P
        assert ticks.due(now, 12) == 0
