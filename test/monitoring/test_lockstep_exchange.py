"""Answers in lockstep, against a controller that answers every state it gets, late or not."""

from __future__ import annotations

from ctc_chattering.monitoring.lockstep import LockstepExchange
from hypothesis import given
from hypothesis import strategies as st

MS = 1_000_000


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
