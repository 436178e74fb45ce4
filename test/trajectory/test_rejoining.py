"""Back to the reference after a pause."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
import pytest

from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.reference import ReferenceConfig, Sinusoid
from ctc_chattering.trajectory.rejoining import PAUSE, Rejoining

S = 1_000_000_000
MS = S // 1000


class Reference:
    """The paper's motion."""

    def at(self, t: int) -> Point:
        return Sinusoid(ReferenceConfig()).at(t / S)


@given(st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)), st.integers(PAUSE + 1, 100 * S),
       st.floats(0.2, 5.0))
def test_after_a_pause_the_error_begins_at_zero_and_the_way_is_within_the_hull(
        q: tuple[float, float], pause: int, duration: float) -> None:
    """Whatever the reference has done meanwhile; at the end it is the reference itself."""
    reference = Reference()
    motion = Rejoining(reference)
    for t in (0, MS, 2 * MS):
        assert not motion.begin(t, q, (0.0, 0.0), duration)
        assert motion.at(t, reference.at(t)) == reference.at(t)
    t0 = 2 * MS + pause
    assert motion.begin(t0, q, (0.0, 0.0), duration)
    assert motion.at(t0, reference.at(t0)) == (q, (0.0, 0.0), (0.0, 0.0))
    for k in range(1, 60):
        t = t0 + k * PAUSE
        assert not motion.begin(t, (9.0, 9.0), (0.0, 0.0), duration)
        found = motion.at(t, reference.at(t))
        for x, start, center in zip(found[0], q, ReferenceConfig().center):
            assert min(start, center - 0.5) - 1e-9 <= x <= max(start, center + 0.5) + 1e-9
        if t >= t0 + round(duration * S):
            assert found == reference.at(t)


@pytest.mark.parametrize(('gap', 'duration'), [(PAUSE, 1.0), (5 * S, 0.0), (-5 * S, 1.0)])
def test_without_a_pause_or_a_duration_nothing_is_replaced(gap: int, duration: float) -> None:
    reference = Reference()
    motion = Rejoining(reference)
    motion.begin(0, (9.0, 9.0), (0.0, 0.0), duration)
    assert not motion.begin(gap, (9.0, 9.0), (0.0, 0.0), duration)
    assert motion.at(gap, reference.at(gap)) == reference.at(gap)


def test_a_controller_that_is_disabled_at_first_joins_a_reference_that_runs() -> None:
    reference = Reference()
    motion = Rejoining(reference)
    for t in (0, S, 2 * S):
        motion.pause(t)
    assert motion.begin(2 * S + MS, (0.3, 0.4), (0.0, 0.0), 1.0)
    assert motion.at(2 * S + MS, reference.at(2 * S + MS))[0] == (0.3, 0.4)
