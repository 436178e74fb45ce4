"""Rates of counters, against the counts of a loop that is written out."""

from hypothesis import given
from hypothesis import strategies as st
import pytest

from ctc_chattering.core.rates import Rates, WINDOW

SECOND = 10 ** 9


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
