"""Outages and rates of faults, against time lines of which the truth is known."""

from __future__ import annotations

from ctc_chattering.monitoring.watchdog import HealthMonitor, Watchdog, WINDOW
from hypothesis import given
from hypothesis import strategies as st
import pytest

SECOND, MS = 10 ** 9, 10 ** 6


class Log:
    """Keeps what is logged."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str]] = []

    def info(self, message: str) -> None:
        self.lines.append(('info', message))

    def warning(self, message: str) -> None:
        self.lines.append(('warning', message))

    def error(self, message: str) -> None:
        self.lines.append(('error', message))


def watched(out: range, publishers: int = 1) -> tuple[Watchdog, Log, list[int]]:
    """Let a message come every millisecond of 5 s but `out`; return also when outages began."""
    log = Log()
    begins: list[int] = []
    watchdog = Watchdog('topic', 'command', 'brakes on', SECOND // 2, log)
    watchdog.timeout = 20 * MS
    watchdog.feed(0)
    for k in range(1, 5000):
        if k not in out:
            watchdog.feed(k * MS)
        if watchdog.check(k * MS, lambda: publishers):
            begins.append(k)
        assert watchdog.out == (k in out and k - out.start >= 20)
        watchdog.sample()
    return watchdog, log, begins


@pytest.mark.parametrize(('lasts', 'outages', 'lines'), [
    (20, 0, []),
    (50, 1, [('warning', 'topic: no command for 0.051 s; brakes on after 0.02 s')]),
    (2000, 1, [('error', 'topic: no command for 0.5 s; brakes on'),
               ('info', 'topic: commands again, after 2.0 s')])])
def test_an_outage_is_found_once_and_reported(
        lasts: int, outages: int, lines: list[tuple[str, str]]) -> None:
    watchdog, log, begins = watched(range(2000, 2000 + lasts))
    assert begins == [2020] * outages
    assert watchdog.outages == outages
    assert watchdog.stale == lasts
    assert watchdog.longest == lasts * MS
    assert log.lines == lines


def test_without_a_publisher_an_outage_is_no_error() -> None:
    _, log, _ = watched(range(2000, 6000), publishers=0)
    assert log.lines == [('info', 'topic: its publisher has left; brakes on')]


def test_short_outages_are_reported_once_a_second() -> None:
    log = Log()
    watchdog = Watchdog('topic', 'command', 'brakes on', SECOND, log)
    watchdog.timeout = 20 * MS
    for k in range(100):
        watchdog.check(50 * k * MS, lambda: 1)
        watchdog.feed(50 * k * MS)
    assert watchdog.outages == 99
    assert 4 <= len(log.lines) <= 5


@pytest.mark.parametrize(('events', 'part', 'level'), [
    (0, 0, 0), (0, 10, 0), (0, 11, 1), (0, 100, 1), (0, 101, 2), (1, 0, 2)])
def test_the_level_is_that_of_the_last_reports(events: int, part: int, level: int) -> None:
    """Let so many of 1000 a second be faults, for four seconds, and none after them."""
    health = HealthMonitor('restarts', 'of the states refused', 0.01, 0.1, MS)
    for k in range(5):
        health.note(k * SECOND, k * events, k * part, k * 1000, 'stale')
        assert health.level == (level if k else 0)
    assert health.events_per_second == events
    assert health.fraction == pytest.approx(part / 1000)
    assert str(health).startswith(
        f'{events} restarts per second, {part / 10:.0f} % of the states refused (stale): this')
    assert str(health).endswith('control_period is 1 ms')
    for k in range(5, 8):
        health.note(k * SECOND, 4 * events, 4 * part, k * 1000, '')
    assert health.level == 0
    assert '(' not in str(health)


@given(st.lists(st.tuples(st.integers(0, 1000), st.integers(0, 1000)), min_size=2, max_size=20))
def test_a_rate_is_that_of_the_last_reports(steps: list[tuple[int, int]]) -> None:
    """Check rates and fractions against sums over the last steps, two seconds each."""
    health = HealthMonitor('restarts', 'refused', 0.01, 0.1, MS)
    assert (health.level, health.events_per_second, health.fraction) == (0, 0.0, 0.0)
    events = part = 0
    for i, (one, other) in enumerate(steps):
        events, part = events + one, part + other
        health.note(2 * i * SECOND, events, part, 5 * part, '')
        assert i or (health.level, health.events_per_second, health.fraction) == (0, 0.0, 0.0)
    last = steps[1:][-WINDOW:]
    assert health.events_per_second == pytest.approx(sum(x for x, _ in last) / (2 * len(last)))
    assert health.fraction == pytest.approx(0.2 if sum(x for _, x in last) else 0.0)


def test_one_event_in_three_seconds_is_a_warning() -> None:
    health = HealthMonitor('restarts', 'of the states refused', 0.01, 0.1, MS)
    for k, events in enumerate((0, 1, 1, 1, 1)):
        health.note(k * SECOND, events, 0, k * 1000, '')
        assert health.level == (0, 2, 1, 1, 0)[k]


def test_a_cause_that_is_known_replaces_the_likely_one() -> None:
    health = HealthMonitor('', 'of the states skipped', 0.2, 0.5, MS)
    for k in range(2):
        health.note(k * SECOND, 0, 300 * k, 1000 * k, '')
    assert health.level == 1
    assert str(health) == ('30 % of the states skipped: this computer is too busy, or processes '
                           'are stopped; control_period is 1 ms')
    health.cause = 'the step takes 2 ms'
    assert str(health) == '30 % of the states skipped: the step takes 2 ms'
