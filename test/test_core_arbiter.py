"""Who has control of a topic."""

from __future__ import annotations

from ctc_chattering.core.arbiter import Arbiter

MS = 1_000_000


def several() -> bool:
    return False


def test_one_that_has_gone_costs_the_owner_nothing() -> None:
    """The owner's numbers meet those that another one would have sent next, long ago."""
    arbiter = Arbiter(500 * MS, trusting=False)
    now = 0
    for k in range(1, 3):
        assert arbiter.admits(k, now, several)
    for k in range(40, 50):
        assert not arbiter.admits(k, now, several)
    for k in range(3, 100):
        now += 20 * MS
        assert arbiter.admits(k, now, several)


def test_one_that_is_there_is_told_from_the_owner_by_its_number() -> None:
    arbiter = Arbiter(500 * MS, trusting=False)
    assert arbiter.admits(1, 0, several)
    for k in range(40, 50):
        assert not arbiter.admits(k, k * MS, several)
    for k in range(2, 50):
        assert arbiter.admits(k, 50 * MS, several)
    assert not arbiter.admits(50, 51 * MS, several), 'it may be either of them'
