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

"""Rates of faults and of samples, on time lines of which the truth is known, and the report."""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.controller.health import ControllerHealth, HealthMonitor, WINDOW
from hypothesis import given
from hypothesis import strategies as st
import pytest

SECOND, MS = 10 ** 9, 10 ** 6
SLOW = 'the step takes 2 ms (p50) at a period of 1 ms: too slow for the sample rate'


def report(taken: int, skipped: int, cause: str = '', simulated: bool = False,
           period: int = MS) -> list[tuple[int, str]]:
    """Return the last report of four seconds with so many states a second."""
    health = ControllerHealth(('joint1',), MS)
    found: list[tuple[int, str]] = []
    for k in range(4 * taken):
        before = k * skipped // taken
        health.take((k + before) * period, before)
        if (k + 1) % taken == 0:
            found = health.report(k // taken * SECOND, {}, simulated, cause)
    return found


@pytest.mark.parametrize(('skipped', 'level'), [(0, 0), (200, 0), (300, 1), (1100, 2)])
def test_skipped_states_are_reported_with_their_cause(skipped: int, level: int) -> None:
    """They count for the rate of the stamps, which is right."""
    assert report(1000, skipped, SLOW, simulated=True) == []
    found = report(1000, skipped, SLOW)
    assert [x for x, _ in found] == [level] * bool(level)
    if found:
        share = 100 * skipped / (1000 + skipped)
        assert found[0][1] == f'{share:.0f} % of the states skipped for newer ones: {SLOW}'
        assert 'this computer is too busy' in report(1000, skipped)[0][1]


@pytest.mark.parametrize('skipped', [0, 100])
def test_a_wrong_rate_is_reported(skipped: int) -> None:
    assert report(500, skipped, period=2 * MS) == [
        (1, 'states come every 2 ms; control_period is 1 ms')]


def test_states_before_a_restart_are_no_part_of_the_rate() -> None:
    health = ControllerHealth(('joint1',), MS)
    for k in range(10):
        health.take(k * MS)
    health.restart()
    health.take(1000 * MS, 900)
    health.take(1002 * MS, 901)
    health.report(0, {}, False)
    assert health.periods == [MS]


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
    rate, refused = f'{events} restarts per second', f'{part / 10:.0f} % of the states refused'
    assert str(health).startswith(f'{rate}: this' if events else f'{refused} (stale): this')
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


def windows(health: ControllerHealth, t: int, steps: Sequence[int], count: int = 1) -> int:
    """Take states in these steps, once between two reports; return the last stamp."""
    for _ in range(count):
        for step in steps:
            t += step
            health.take(t)
        health.report(t, {}, True)
    return t


def wrong(health: ControllerHealth) -> bool:
    return bool(health.report(0, {}, True))


@given(st.lists(st.integers(1, 20 * MS), min_size=1, max_size=50), st.integers(0, 2 ** 61),
       st.integers(1, 20 * MS))
def test_the_mean_is_that_of_the_steps_between_reports(
        steps: list[int], start: int, period: int) -> None:
    health = ControllerHealth(('joint1',), period)
    health.take(start)
    for k in range(4):
        start = windows(health, start, steps)
        mean = sum(steps) / len(steps)
        assert health.periods == [round(mean)] * min(k + 1, 3)
        if abs(abs(mean / period - 1.0) - 0.2) > 1.0 / period:
            assert wrong(health) == (k >= 2 and abs(mean / period - 1.0) > 0.2)


@pytest.mark.parametrize(('step', 'found'), [
    (5 * MS, True), (2 * MS, True), (1_190_000, False), (1_210_000, True), (MS, False),
    (810_000, False), (790_000, True), (MS // 2, True)])
def test_a_fifth_is_too_much_after_three_reports(step: int, found: bool) -> None:
    health = ControllerHealth(('joint1',), MS)
    assert not wrong(health)
    t = windows(health, 0, [step] * 100, 2)
    assert not wrong(health)
    t = windows(health, t, [step] * 100)
    assert wrong(health) == found
    windows(health, t, [MS] * 100)
    assert not wrong(health)


def test_jitter_and_a_burst_are_none_of_its_business() -> None:
    """Only the mean counts, and a single time between two reports does not."""
    health = ControllerHealth(('joint1',), MS)
    t = windows(health, 0, [MS // 10, 19 * MS // 10] * 50, 5)
    assert not wrong(health)
    for _ in range(5):
        t = windows(health, t, [5 * MS] * 100, 2)
        t = windows(health, t, [MS] * 100)
        assert not wrong(health)


def test_silence_and_a_restart_are_no_period() -> None:
    """Silence does not say that all is well, either."""
    health = ControllerHealth(('joint1',), MS)
    assert health.periods == [] and not wrong(health)
    t = windows(health, 0, [3 * MS] * 10, 4)
    for _ in range(3):
        assert wrong(health)
    for _ in range(5):
        t += 1000 * MS
        health.restart()
        t = windows(health, t, [MS] * 10)
        assert health.periods == [MS]
        assert not wrong(health)
