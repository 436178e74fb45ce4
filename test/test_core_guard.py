"""Whether torques may be sent, against numpy's comparison."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from ctc_chattering.core.guard import Guard

ERROR = st.floats(-10.0, 10.0)
PAIRS = st.lists(st.tuples(ERROR, st.floats(1e-3, 10.0)), min_size=1, max_size=7)


@given(PAIRS)
def test_trips_where_an_error_is_beyond_its_limit(pairs: list[tuple[float, float]]) -> None:
    """Check the verdict and the first joint at fault, each against its own limit."""
    e, limit = (list(row) for row in zip(*pairs))
    guard = Guard(enabled=True)
    beyond = np.flatnonzero(np.abs(e) > limit)
    assert guard.check(e, limit) == (beyond.size == 0) == guard.allows
    assert guard.tripped == (beyond[0] if beyond.size else None)


@pytest.mark.parametrize('limit', [0.1, 3.0])
def test_the_bound_itself_is_allowed(limit: float) -> None:
    """Check ±limit on both sides of it, to the last bit; .inf never trips."""
    for sign in (1.0, -1.0):
        guard = Guard(enabled=True)
        assert guard.check([0.0, sign * limit], [limit, limit])
        assert guard.check([0.0, sign * 1e300], [limit, math.inf])
        assert not guard.check([0.0, sign * math.nextafter(limit, 9.0)], [limit, limit])
        assert guard.tripped == 1


@pytest.mark.parametrize('limit', [1.0, math.inf])
def test_no_number_trips(limit: float) -> None:
    """Check NaN against any limit: it is within none."""
    guard = Guard(enabled=True)
    assert not guard.check([math.nan], [limit])
    assert guard.tripped == 0
    assert not guard.allows


def test_tripped_until_reset() -> None:
    """Check that an error that is small again does not end it, and a reset does."""
    guard = Guard(enabled=True)
    guard.check([2.0], [1.0])
    assert guard.check([0.0], [1.0])
    assert not guard.allows
    guard.reset()
    assert guard.allows
    assert guard.tripped is None
    guard.check([2.0], [1.0])
    assert not guard.allows


def test_enabled_and_tripped_are_two_things() -> None:
    """Check all four combinations: torques need both."""
    guard = Guard(enabled=False)
    assert not guard.allows
    assert guard.check([0.0], [1.0])
    assert not guard.allows
    guard.check([2.0], [1.0])
    guard.enabled = True
    assert not guard.allows
    guard.enabled = False
    guard.reset()
    assert not guard.allows
    guard.enabled = True
    assert guard.allows
