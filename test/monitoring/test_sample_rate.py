"""Whether samples come as often as they should, on stamps of known periods."""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.monitoring.sample_rate import SampleRate
from hypothesis import given
from hypothesis import strategies as st
import pytest

MS = 1_000_000


def windows(cadence: SampleRate, t: int, steps: Sequence[int], count: int = 1) -> int:
    """Note stamps in these steps, once for every window; return the last one."""
    for _ in range(count):
        for step in steps:
            t += step
            cadence.note(t)
        cadence.rotate()
    return t


@given(st.lists(st.integers(1, 20 * MS), min_size=1, max_size=50), st.integers(0, 2 ** 61),
       st.integers(1, 20 * MS))
def test_the_mean_is_that_of_the_steps_across_windows(
        steps: list[int], start: int, period: int) -> None:
    cadence = SampleRate(period)
    cadence.note(start)
    for k in range(4):
        start = windows(cadence, start, steps)
        mean = sum(steps) / len(steps)
        assert cadence.mean == pytest.approx(1e-9 * mean, abs=1e-9)
        if abs(abs(mean / period - 1.0) - 0.2) > 1e-9:
            assert cadence.wrong == (k >= 2 and abs(mean / period - 1.0) > 0.2)


@pytest.mark.parametrize(('step', 'wrong'), [
    (5 * MS, True), (2 * MS, True), (1_190_000, False), (1_210_000, True), (MS, False),
    (810_000, False), (790_000, True), (MS // 2, True)])
def test_a_fifth_is_too_much_after_three_windows(step: int, wrong: bool) -> None:
    cadence = SampleRate(MS)
    assert not cadence.wrong
    t = windows(cadence, 0, [step] * 100, 2)
    assert not cadence.wrong
    t = windows(cadence, t, [step] * 100)
    assert cadence.wrong == wrong
    windows(cadence, t, [MS] * 100)
    assert not cadence.wrong


def test_jitter_and_a_burst_are_none_of_its_business() -> None:
    """Only the mean counts, and a single window does not."""
    cadence = SampleRate(MS)
    t = windows(cadence, 0, [MS // 10, 19 * MS // 10] * 50, 5)
    assert not cadence.wrong
    for _ in range(5):
        t = windows(cadence, t, [5 * MS] * 100, 2)
        t = windows(cadence, t, [MS] * 100)
        assert not cadence.wrong


def test_a_pause_and_silence_are_no_period() -> None:
    """Neither says that all is well, either."""
    cadence = SampleRate(MS)
    cadence.rotate()
    cadence.note(0)
    cadence.rotate()
    assert (cadence.mean, cadence.wrong) == (0.0, False)
    t = windows(cadence, 0, [MS] * 10, 3)
    for _ in range(5):
        t += 1000 * MS
        cadence.pause()
        t = windows(cadence, t, [MS] * 10)
        assert cadence.mean == 1e-3
        assert not cadence.wrong
    t = windows(cadence, t, [3 * MS] * 10, 3)
    cadence.pause()
    cadence.rotate()
    cadence.rotate()
    assert cadence.wrong
    cadence.note(10 ** 15)
    windows(cadence, 10 ** 15, [MS])
    assert not cadence.wrong
