"""The compiled nearest point of a box, against enumeration and against the reference."""

import numpy as np
from oracles import Array, inclusion_by_enumeration, random_spd
import pytest

from ctc_chattering.batch.box_qp import box_scratch, nearest
from ctc_chattering.batch.records import record
from ctc_chattering.numerics.box_qp import nearest as reference

#: Compiled for three rows, that takes long; `test_as_plain_python.py` runs them not compiled.
pytestmark = pytest.mark.slow


def solved(mass: Array, point: Array, bound: Array) -> Array:
    out = np.zeros(len(point))
    moved = nearest(mass, point, bound, len(point), record(box_scratch(len(point))), out)
    assert moved == (out != point).any()
    return out


def test_against_enumeration_and_the_reference() -> None:
    rng = np.random.default_rng(8)
    inner = 0
    for _ in range(200):
        mass, point = random_spd(rng, 3, 3.0), 3.0 * rng.normal(size=3)
        bound = rng.uniform(0.0, 3.0, 3) * (rng.random(3) < 0.8)
        z = solved(mass, point, bound)
        inner += bool((np.abs(z) < bound).any())
        np.testing.assert_allclose(
            z, inclusion_by_enumeration(mass, point, bound), rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(z, reference(mass, point, bound), rtol=1e-9, atol=1e-11)
    assert 20 < inner < 200


def test_some_of_the_rows() -> None:
    """The first rows of larger arrays are a problem of their own."""
    rng = np.random.default_rng(9)
    mass, point, bound = random_spd(rng, 3), 5.0 * rng.normal(size=3), np.ones(3)
    out = np.full(3, 7.0)
    nearest(mass, point, bound, 2, record(box_scratch(3)), out)
    np.testing.assert_allclose(
        out[:2], reference(mass[:2, :2].copy(), point[:2], bound[:2]), rtol=1e-10)
    assert out[2] == 7.0


def test_a_point_too_large_to_compute_with() -> None:
    np.testing.assert_array_equal(
        solved(np.eye(3), np.array([1e290, -1e300, 0.5]), np.ones(3)), [1.0, -1.0, 1.0])
