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

from ctc_chattering.controller.health import (
    ControllerHealth,
    FaultCount,
    FaultKind,
    FaultRates,
    WINDOW,
)
from hypothesis import given
from hypothesis import strategies as st
import pytest

SECOND, MS = 10 ** 9, 10 ** 6
SLOW = 'half of the steps take more than 2 ms at a period of 1 ms, which is too slow'
BUSY = 'the computer is too busy, or processes are stopped'


def report(taken: int, skipped: int, cause: str = '', simulated: bool = False,
           period: int = MS, **rejected: int) -> Sequence[tuple[int, str]]:
    """Return the last report of four seconds with so many states a second."""
    health = ControllerHealth(('joint1',), MS)
    found: Sequence[tuple[int, str]] = []
    for k in range(1, 5):
        health.taken += taken
        found = health.report(k * SECOND, k * (taken + skipped) * period, {
            kind: k * n for kind, n in rejected.items()}, k * skipped, simulated, cause)
    return found


@pytest.mark.parametrize(('skipped', 'level'), [(0, 0), (200, 0), (300, 1), (1100, 2)])
def test_skipped_states_are_reported_with_their_cause(skipped: int, level: int) -> None:
    """They count for the rate of the stamps, which is right."""
    assert report(1000, skipped, SLOW, simulated=True) == []
    found = report(1000, skipped, SLOW)
    assert [x for x, _ in found] == [level] * bool(level)
    if found:
        share = 100 * skipped / (1000 + skipped)
        assert found[0][1] == f'{share:.0f} % of the states were skipped for newer ones: {SLOW}'
        assert report(1000, skipped)[0][1].endswith(BUSY)


def test_refused_states_are_reported() -> None:
    assert report(1000, 0, stale=50, backward=50) == [
        (1, f'9 % of the states were refused: {BUSY}')]
    assert report(1000, 0, stale=100, backward=50)[0][0] == 2
    assert report(1000, 0, stale=10, second_publisher=900) == []


@pytest.mark.parametrize('skipped', [0, 100])
def test_a_wrong_rate_is_reported(skipped: int) -> None:
    assert report(500, skipped, period=2 * MS) == [
        (1, 'states come every 2 ms, but control_period is 1 ms; set it to the period of the '
            'robot')]


def rates(*totals: tuple[int, int]) -> list[Sequence[tuple[int, str]]]:
    """Return the reports of faults and of their part of the samples, once a second."""
    judged = FaultRates(
        FaultKind('{:.2g} faults per second', 0.0, 1.0), FaultKind('{1:.0f} % refused', 0.01, 0.1))
    return [judged.report('', FaultCount(events, float(k)), FaultCount(part, 1000 * k))
            for k, (events, part) in enumerate(totals)]


@pytest.mark.parametrize(('events', 'part', 'level'), [
    (0, 0, 0), (0, 10, 0), (0, 11, 1), (0, 99, 1), (0, 101, 2), (1, 0, 2)])
def test_the_level_is_that_of_the_last_reports(events: int, part: int, level: int) -> None:
    """Let so many of 1000 a second be faults, for four seconds, and none after them."""
    first, *found = rates(*((min(k, 4) * events, min(k, 4) * part) for k in range(8)))
    assert first == found[-1] == []
    text = f'{events} faults per second' if events else f'{part / 10:.0f} % refused'
    assert found[:4] == [[(level, f'{text}: {BUSY}')] if level else []] * 4


@given(st.lists(st.integers(0, 1000), min_size=2, max_size=20))
def test_a_rate_is_that_of_the_last_reports(steps: list[int]) -> None:
    """Check against sums over the last steps, one second each."""
    totals = [sum(steps[:k]) for k in range(len(steps) + 1)]
    last = steps[-WINDOW:]
    found = [text for _, text in rates(*((x, 0) for x in totals))[-1]]
    assert found == [f'{sum(last) / len(last):.2g} faults per second: {BUSY}'] * any(last)


def windows(health: ControllerHealth, t: int, steps: Sequence[int], count: int = 1) -> bool:
    """Take states in these steps from `t` on between two reports; return if the last is one."""
    found = False
    for k in range(count):
        health.taken += len(steps)
        found = bool(health.report(0, t + (k + 1) * sum(steps), {}, 0, True))
    return found


@pytest.mark.parametrize(('step', 'found'), [
    (5 * MS, True), (2 * MS, True), (1_190_000, False), (1_210_000, True), (MS, False),
    (810_000, False), (790_000, True), (MS // 2, True)])
def test_a_fifth_is_too_much_after_three_reports(step: int, found: bool) -> None:
    health = ControllerHealth(('joint1',), MS)
    assert not windows(health, 0, [step] * 100, 3)
    assert windows(health, 300 * step, [step] * 100) == found
    assert not windows(health, 400 * step, [MS] * 100)


def test_silence_and_a_restart_are_no_period() -> None:
    """Nothing is reported of the rate after either, until three periods are known again."""
    health = ControllerHealth(('joint1',), MS)
    assert windows(health, 0, [3 * MS] * 10, 4)
    assert not windows(health, 120 * MS, [])
    for k in range(1, 6):
        health.restarts += 1
        assert not windows(health, k * SECOND, [MS] * 10, 2)
