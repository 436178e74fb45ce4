"""The chattering term."""

import numpy as np
import pytest

from ctc_chattering.core.switching import sign, SWITCHINGS


@pytest.mark.parametrize(('v', 'expected'), [
    (2.0, 7.0), (1e-300, 7.0), (5e-324, 7.0), (0.0, 0.0), (-0.0, 0.0), (-5e-324, -7.0),
    (-3.0, -7.0), (float('inf'), 7.0), (-float('inf'), -7.0)])
def test_every_case_of_one_joint(v: float, expected: float) -> None:
    """Check sgn with sgn(0) = 0: no dead band, no smoothing."""
    assert sign([v], [7.0]) == [expected]


def test_joints_have_their_own_gain_and_sign() -> None:
    """Check against numpy's sign for random vectors of four joints."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        v = rng.normal(size=4) * rng.integers(0, 2, 4)
        ka = rng.uniform(0.0, 20.0, 4)
        assert sign(v.tolist(), ka.tolist()) == (ka * np.sign(v)).tolist()


def test_power_is_the_one_norm() -> None:
    """Check vᵀ Ka sgn(v) = ka ‖v‖₁, the term that makes V of equation (9) fall."""
    v = [0.3, -2.0, 0.0]
    assert np.dot(v, sign(v, [10.0] * 3)) == pytest.approx(10.0 * np.abs(v).sum())


def test_zero_gain_is_no_chattering() -> None:
    """Check that ka = 0 makes law (6) law (2)."""
    assert sign([1.0, -1.0], [0.0, 0.0]) == [0.0, 0.0]
    assert SWITCHINGS == ('sign',)
