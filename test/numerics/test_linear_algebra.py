"""Products and solutions with sequences of floats, against numpy."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
from oracles import random_spd
import pytest

from ctc_chattering.numerics.linear_algebra import dot, solve, times


@given(st.integers(1, 6), st.integers(0, 2 ** 32 - 1), st.floats(0.0, 6.0))
def test_solve_is_a_solution(n: int, seed: int, decades: float) -> None:
    """Check random positive definite systems, well and badly conditioned, against numpy."""
    rng = np.random.default_rng(seed)
    a, b = random_spd(rng, n, decades), rng.normal(size=n)
    x = np.array(solve(a.tolist(), b.tolist()))
    residual = np.abs(a @ x - b).max()
    assert residual <= 1e-13 * (1.0 + np.abs(a).max() * np.abs(x).max())
    np.testing.assert_allclose(x, np.linalg.solve(a, b), rtol=1e-7, atol=1e-10)


def test_solve_leaves_its_arguments_alone() -> None:
    """Check that nothing is done in place."""
    a, b = [[4.0, 1.0], [1.0, 3.0]], [1.0, 2.0]
    assert solve(a, b) == pytest.approx([1 / 11, 7 / 11])
    assert (a, b) == ([[4.0, 1.0], [1.0, 3.0]], [1.0, 2.0])
    assert solve([], []) == []


def test_products_against_numpy() -> None:
    """Check dot and a matrix that is not square."""
    rng = np.random.default_rng(0)
    a, x = rng.normal(size=(3, 5)), rng.normal(size=5)
    assert times(a.tolist(), x.tolist()) == pytest.approx((a @ x).tolist())
    assert dot(x.tolist(), a[0].tolist()) == pytest.approx(float(a[0] @ x))
