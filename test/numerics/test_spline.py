"""A spline in pieces is the spline through all."""

from ctc_chattering.numerics.spline import interpolated
import numpy as np
import pytest
from scipy.interpolate import CubicSpline


@pytest.mark.parametrize('count', [4, 100, 30_000])
def test_pieces_are_the_whole(count: int) -> None:
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.5, 1.5, count))
    x = rng.normal(size=(count, 2))
    at = np.sort(rng.uniform(t[0], t[-1], count))
    assert interpolated(t, x, at) == pytest.approx(CubicSpline(t, x)(at), abs=1e-12)
