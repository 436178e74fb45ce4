"""The box-constrained problem against enumeration, scipy, and its optimality conditions."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from oracles import Array, box_by_enumeration, inclusion_by_enumeration, random_spd
import pytest
from scipy.optimize import lsq_linear  # type: ignore[import-untyped]

from ctc_chattering.core.box import nearest, solve_box


def _solve(a: Array, b: Array, bound: Array) -> Array:
    return np.array(solve_box(a.tolist(), b.tolist(), bound.tolist()))


def _check_conditions(a: Array, b: Array, bound: Array, z: Array) -> None:
    """Assert the module's conditions, with w relative to the sum of its terms."""
    w, size = a @ z + b, np.abs(a) @ np.abs(z) + np.abs(b) + np.abs(a) @ bound
    tolerance = 1e-11 * size + 1e-300
    assert (np.abs(z) <= bound).all()
    inner = np.abs(z) < bound
    assert (np.abs(w[inner]) <= tolerance[inner] * np.linalg.cond(a)).all()
    assert (w[(z >= bound) & (bound > 0)] <= tolerance[(z >= bound) & (bound > 0)]).all()
    assert (w[(z <= -bound) & (bound > 0)] >= -tolerance[(z <= -bound) & (bound > 0)]).all()


@pytest.mark.parametrize('n', [1, 2, 3, 4])
@pytest.mark.parametrize('decades', [0.5, 3.0])
def test_against_enumeration(n: int, decades: float) -> None:
    """Check random problems against all 3^n sets of active bounds, and that all kinds occur."""
    rng = np.random.default_rng(10 * n)
    inner = active = 0
    for _ in range(60):
        a, b = random_spd(rng, n, decades), rng.normal(size=n) * 3.0
        bound = rng.uniform(0.0, 2.0, n) * rng.integers(0, 4, n).clip(0, 1)
        z = _solve(a, b, bound)
        np.testing.assert_allclose(z, box_by_enumeration(a, b, bound), rtol=1e-9, atol=1e-11)
        inner += int((np.abs(z) < bound).sum())
        active += int(((np.abs(z) == bound) & (bound > 0)).sum())
    assert inner > 5
    assert active > 5


@pytest.mark.parametrize('n', [2, 3, 4])
def test_badly_scaled(n: int) -> None:
    """Check joints whose inertias differ by 12 orders of magnitude."""
    rng = np.random.default_rng(n)
    for _ in range(60):
        scale = 10.0 ** rng.uniform(-6.0, 6.0, n)
        a = random_spd(rng, n) * np.outer(scale, scale)
        b, bound = rng.normal(size=n) * scale, rng.uniform(0.0, 2.0, n) / scale
        z = _solve(a, b, bound)
        np.testing.assert_allclose(
            z * scale, box_by_enumeration(a, b, bound) * scale, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize('n', [5, 7])
def test_larger_against_scipy(n: int) -> None:
    """Check against scipy's bounded least squares, of which this is the normal form."""
    rng = np.random.default_rng(n)
    for _ in range(10):
        a, b = random_spd(rng, n), rng.normal(size=n) * 2.0
        bound = rng.uniform(0.1, 1.5, n)
        root = np.linalg.cholesky(a).T
        fit = lsq_linear(root, -np.linalg.solve(root.T, b), (-bound, bound), tol=1e-14,
                         method='bvls')
        np.testing.assert_allclose(_solve(a, b, bound), fit.x, atol=1e-7)


@settings(max_examples=300)
@given(st.integers(1, 6), st.integers(0, 2 ** 32 - 1), st.floats(0.0, 8.0),
       st.floats(-6.0, 6.0))
def test_optimality_conditions(n: int, seed: int, decades: float, size: float) -> None:
    """Check the conditions, which have one solution, for problems of every scale."""
    rng = np.random.default_rng(seed)
    a = random_spd(rng, n, decades) * 10.0 ** size
    b = rng.normal(size=n) * 10.0 ** rng.uniform(-3.0, 3.0, n)
    bound = 10.0 ** rng.uniform(-3.0, 3.0, n) * rng.integers(0, 3, n).clip(0, 1)
    _check_conditions(a, b, bound, _solve(a, b, bound))


@settings(max_examples=200)
@given(st.lists(st.sampled_from([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0]), min_size=3, max_size=3),
       st.lists(st.sampled_from([0.0, 0.5, 1.0, 2.0]), min_size=3, max_size=3),
       st.sampled_from([-0.5, 0.0, 0.5, 0.9]))
def test_degenerate_problems(b: list[float], bound: list[float], c: float) -> None:
    """Check ties: w = 0 on a bound, bounds of 0, loads of exactly the bound."""
    a = np.array([[2.0, c, 0.0], [c, 2.0, c], [0.0, c, 2.0]])
    z = _solve(a, np.array(b), np.array(bound))
    _check_conditions(a, np.array(b), np.array(bound), z)
    np.testing.assert_allclose(
        z, box_by_enumeration(a, np.array(b), np.array(bound)), atol=1e-12)


def test_closed_forms() -> None:
    """Check one joint in its three cases, a box of points, and a box without effect."""
    for b, z in ((-1.0, 0.5), (8.0, -2.0), (-8.0, 2.0), (4.0, -2.0), (0.0, 0.0)):
        assert solve_box([[2.0]], [b], [2.0]) == [z]
    a = np.array([[3.0, 1.0], [1.0, 2.0]])
    assert solve_box(a.tolist(), [5.0, -7.0], [0.0, 0.0]) == [0.0, 0.0]
    np.testing.assert_allclose(solve_box(a.tolist(), [5.0, -7.0], [1e9, 1e9]),
                               np.linalg.solve(a, [-5.0, 7.0]))


def test_reaching_one_bound_moves_the_other_joint() -> None:
    """Check that the answer is not the clipped free solution: the joints are coupled."""
    a, b, bound = np.array([[2.0, 1.9], [1.9, 2.0]]), np.array([-4.0, 0.0]), np.array([1.0, 50.0])
    clipped = np.clip(np.linalg.solve(a, -b), -bound, bound)
    z = _solve(a, b, bound)
    assert z == pytest.approx([1.0, -0.95])
    assert np.abs(z - clipped).max() > 1.0


@pytest.mark.parametrize('n', [1, 2, 3, 4])
@pytest.mark.parametrize('decades', [0.5, 4.0])
def test_nearest_against_enumeration(n: int, decades: float) -> None:
    """Check against the inclusion M x = wanted - z, z ∈ bound Sgn(x), and `solve_box`."""
    rng = np.random.default_rng(20 * n)
    for _ in range(80):
        mass, wanted = random_spd(rng, n, decades), rng.normal(size=n) * 3.0
        bound = rng.uniform(0.0, 3.0, n) * rng.integers(0, 4, n).clip(0, 1)
        z = nearest(mass, wanted, bound)
        np.testing.assert_allclose(
            z, inclusion_by_enumeration(mass, wanted, bound), rtol=1e-8, atol=1e-9)
        inverse: Array = np.linalg.inv(mass).astype(np.float64)
        np.testing.assert_allclose(
            z, _solve(inverse, -inverse @ wanted, bound), rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize('spread', [0.0, 6.0])
def test_nearest_of_seven(spread: float) -> None:
    """Check the conditions with seven joints, alike and of very different inertia."""
    rng = np.random.default_rng(3)
    for _ in range(60):
        scale = 10.0 ** rng.uniform(-spread / 2, spread / 2, 7)
        mass = random_spd(rng, 7, 3.0) * np.outer(scale, scale)
        bound = rng.uniform(0.1, 3.0, 7) * scale
        wanted = rng.normal(size=7) * 3.0 * scale
        z = nearest(mass, wanted, bound)
        x = np.linalg.solve(mass / np.outer(scale, scale), (wanted - z) / scale)
        assert (np.abs(z) <= bound).all()
        inner = np.abs(z) < bound * (1 - 1e-12)
        assert (np.abs(x[inner]) <= 1e-9).all()
        assert (x * z >= -1e-9 * np.abs(z)).all()


def test_nearest_on_the_edge() -> None:
    """Check wanted values at the bound, bounds of 0, and none that is exceeded."""
    rng = np.random.default_rng(4)
    mass, bound = random_spd(rng, 5), np.array([1.0, 2.0, 0.0, 4.0, 0.0])
    edge = np.array([1.0, -2.0, 0.0, 3.0, 0.0])
    assert nearest(mass, edge, bound) is edge
    assert nearest(mass, np.full(5, 5.0), np.zeros(5)).tolist() == [0.0] * 5
    held = mass @ [0.0, 0.0, 1.0, 0.0, 0.0] + [1.0, 2.0, 0.0, 1.0, 0.0]
    np.testing.assert_allclose(nearest(mass, held, bound), [1.0, 2.0, 0.0, 1.0, 0.0], atol=1e-12)
