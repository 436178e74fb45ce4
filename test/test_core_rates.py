"""Rates of counters, against the counts of a loop that is written out."""

from hypothesis import given
from hypothesis import strategies as st
import pytest

from ctc_chattering.core.command_watchdog import CommandWatchdog
from ctc_chattering.core.rates import Rates, WINDOW
from ctc_chattering.core.state_health import StateHealth

SECOND, MS = 10 ** 9, 10 ** 6


@given(st.lists(st.integers(0, 1000), min_size=2, max_size=20))
def test_a_rate_is_that_of_the_last_reports(steps: list[int]) -> None:
    """Check rates and fractions against sums over the last steps, two seconds each."""
    rates, total = Rates(), 0
    for i, step in enumerate(steps):
        total += step
        rates.note(2 * i * SECOND, {'x': total, 'all': 5 * total})
    last = steps[1:][-WINDOW:]
    assert rates.count('x') == sum(last)
    assert rates.per_second('x') == pytest.approx(sum(last) / (2 * len(last)))
    assert rates.fraction('x', 'all') == pytest.approx(0.2 if sum(last) else 0.0)


def test_without_reports_there_is_no_rate() -> None:
    rates = Rates()
    assert rates.per_second('x') == rates.fraction('x', 'y') == rates.count('x') == 0
    rates.note(SECOND, {'x': 7})
    assert rates.per_second('x') == 0.0
    rates.note(2 * SECOND, {'x': 7, 'new': 3})
    assert (rates.per_second('x'), rates.per_second('new')) == (0.0, 3.0)


def test_outages_of_commands_are_counted_once_each() -> None:
    """Let commands come every millisecond, but for two outages of 50 ms in ten seconds."""
    watchdog = CommandWatchdog(MS)
    watchdog.timeout = 20 * MS
    watchdog.command(0)
    watchdog.rotate(0, 0)
    outages = 0
    for k in range(1, 10_001):
        now = k * MS
        out = 2000 <= k < 2050 or 2100 <= k < 2150
        if not out:
            silence = watchdog.command(now)
            assert silence == (51 * MS if k in (2050, 2150) else MS)
        outages += watchdog.silence(now) > watchdog.timeout and k in (2020, 2120)
        watchdog.sample()
        if k % 1000 == 0:
            watchdog.rotate(now, k)
            assert watchdog.poor == (k in (3000, 4000, 5000))
            assert not watchdog.bad
    assert outages == watchdog.timeouts == 2
    assert watchdog.stale == 100
    assert watchdog.longest == 50 * MS


@pytest.mark.parametrize(('every', 'poor', 'bad'), [
    (1, False, False), (2, True, False), (3, True, True)])
def test_samples_without_a_new_command(every: int, poor: bool, bad: bool) -> None:
    watchdog = CommandWatchdog(MS)
    watchdog.timeout = 20 * MS
    for k in range(3001):
        if k % every == 0:
            watchdog.command(k * MS)
        watchdog.silence(k * MS)
        if k % 1000 == 0:
            watchdog.rotate(k * MS, k)
        watchdog.sample()
    assert (watchdog.timeouts, watchdog.poor, watchdog.bad) == (0, poor, bad)
    assert watchdog.fraction == pytest.approx(1.0 - 1.0 / every, abs=2e-3)


@pytest.mark.parametrize(('restarts', 'stale', 'poor', 'bad'), [
    (0, 0, False, False), (0, 5, False, False), (0, 50, True, False), (0, 300, True, True),
    (1, 0, True, True)])
def test_states_that_are_refused(restarts: int, stale: int, poor: bool, bad: bool) -> None:
    """Check the present, beside a second publisher that does not count, over four seconds."""
    health = StateHealth(MS)
    for k in range(5):
        health.rotate(k * SECOND, k * (1000 - stale), k * restarts,
                      {'stale': k * stale, 'second_publisher': k * 1000})
    assert (health.poor, health.bad) == (poor, bad)
    assert ('stale' in str(health)) == (stale > 0)
    assert 'second_publisher' not in str(health)
    for k in range(5, 9):
        health.rotate(k * SECOND, k * 1000, 4 * restarts, {'stale': 4 * stale})
    assert not health.poor
