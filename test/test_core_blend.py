"""The smooth start."""

from __future__ import annotations

from collections.abc import Callable

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.interpolate import BPoly  # type: ignore[import-untyped]

from ctc_chattering.core.blend import Blend
from ctc_chattering.core.trajectory import Point
from ctc_chattering.errors import ParameterError

S = 1_000_000_000
values = st.floats(-5.0, 5.0)
pairs = st.tuples(values, values)


class Wave:
    """A motion of two joints that never rests."""

    def at(self, t: int) -> Point:
        x = t / S
        return ((np.sin(3 * x), x ** 2), (3 * np.cos(3 * x), 2 * x), (-9 * np.sin(3 * x), 2.0))


def _apart(a: Point, b: Point) -> float:
    return float(np.abs(np.array(a) - np.array(b)).max())


@settings(max_examples=60)
@given(pairs, pairs, pairs, st.floats(0.05, 20.0), st.integers(-10 * S, 10 * S))
def test_both_ends(q0: tuple[float, float], dq0: tuple[float, float], ddq0: tuple[float, float],
                   duration: float, t0: int) -> None:
    """Check state and acceleration at both ends, to 1e-9, and the motion itself from then on."""
    motion = Wave()
    blend = Blend(motion, t0, q0, dq0, duration, ddq0)
    assert blend.at(t0) == (q0, dq0, ddq0)
    assert blend.end == t0 + round(duration * S)
    for t in (blend.end, blend.end + 1, blend.end + 7 * S):
        assert blend.at(t) == motion.at(t)
    jerk = 2000.0 * (1.0 + 1.0 / duration ** 3) * 1e-9 * (1.0 + np.abs(motion.at(t0)).max())
    assert _apart(blend.at(t0 + 1), (q0, dq0, ddq0)) < jerk
    assert _apart(blend.at(blend.end - 1), motion.at(blend.end)) < jerk


def _limit(path: Callable[[int], Point], t: int, side: int) -> Point:
    """Return the limit of `path` at `t` from one side, by extrapolation."""
    near = [np.array(path(t + side * k * S // 10_000)) for k in range(1, 6)]
    return tuple(
        5 * near[0] - 10 * near[1] + 10 * near[2] - 5 * near[3] + near[4])


def test_continuity_to_1e_9() -> None:
    """Check the limits at both seams against what is there."""
    blend = Blend(Wave(), S, (2.0, -1.0), (0.5, 0.0), 2.0)
    assert _apart(_limit(blend.at, S, 1), ((2.0, -1.0), (0.5, 0.0), (0.0, 0.0))) < 1e-9
    assert _apart(_limit(blend.at, 3 * S, -1), Wave().at(3 * S)) < 1e-9


@settings(max_examples=40)
@given(pairs, pairs, st.floats(0.1, 10.0), st.floats(0.0, 1.0))
def test_the_correction_is_the_quintic(q0: tuple[float, float], dq0: tuple[float, float],
                                       duration: float, share: float) -> None:
    """Check the difference to the motion against scipy's polynomial of the same ends."""
    motion, t0 = Wave(), 2 * S
    blend = Blend(motion, t0, q0, dq0, duration)
    t = t0 + round(share * duration * S)
    steps = np.array([q0, dq0, (0.0, 0.0)]) - np.array(motion.at(t0))
    exact = BPoly.from_derivatives([0.0, duration], np.stack([steps, np.zeros((3, 2))]))
    for order in range(3):
        found = np.array(blend.at(t)[order]) - np.array(motion.at(t)[order])
        np.testing.assert_allclose(
            found, exact((t - t0) / S, nu=order), atol=1e-7 * (1.0 + duration ** -2), rtol=1e-7)


def test_derivatives_are_finite_differences() -> None:
    blend, step = Blend(Wave(), 0, (1.0, 2.0), (-1.0, 0.0), 1.5), 100_000
    for t in range(step, 2 * S, S // 17):
        before, now, after = (np.array(blend.at(t + d)) for d in (-step, 0, step))
        np.testing.assert_allclose(now[1:], (after - before)[:2] / (2 * step / S), atol=1e-4)


def test_it_rests_before_and_starts_without_acceleration() -> None:
    """Check the instants before the start, and the default acceleration there."""
    blend = Blend(Wave(), S, [1.0, 2.0], [3.0, 4.0], 1.0)
    assert blend.at(S) == ((1.0, 2.0), (3.0, 4.0), (0.0, 0.0))
    assert blend.at(S - 1) == blend.at(-S) == ((1.0, 2.0), (0.0, 0.0), (0.0, 0.0))


def test_a_start_on_the_motion_changes_nothing() -> None:
    """Check that nothing is added where nothing is to be corrected."""
    motion = Wave()
    q, dq, ddq = motion.at(S)
    blend = Blend(motion, S, q, dq, 3.0, ddq)
    for t in range(S, 5 * S, S // 7):
        assert blend.at(t) == motion.at(t)


@pytest.mark.parametrize(('q0', 'dq0', 'duration', 'ddq0', 'name'), [
    ((0.0, 0.0), (0.0, 0.0), 0.0, (), 'duration'), ((0.0, 0.0), (0.0, 0.0), -1.0, (), 'duration'),
    ((0.0, 0.0), (0.0, 0.0), 1e-10, (), 'duration'),
    ((0.0, 0.0), (0.0, 0.0), float('nan'), (), 'duration'),
    ((0.0, 0.0), (0.0, 0.0), float('inf'), (), 'duration'),
    ((0.0,), (0.0, 0.0), 1.0, (), 'q0'), ((0.0, float('nan')), (0.0, 0.0), 1.0, (), 'q0'),
    ((0.0, 0.0), (), 1.0, (), 'dq0'), ((0.0, 0.0), (0.0, float('inf')), 1.0, (), 'dq0'),
    ((0.0, 0.0), (0.0, 0.0), 1.0, (0.0,), 'ddq0')])
def test_refusals(q0: tuple[float, ...], dq0: tuple[float, ...], duration: float,
                  ddq0: tuple[float, ...], name: str) -> None:
    """Check that the error names what is wrong."""
    with pytest.raises(ParameterError) as error:
        Blend(Wave(), 0, q0, dq0, duration, ddq0)
    assert error.value.name == name
