"""The limits of the torque, against numpy's clip, and the anti-windup correction."""

from ctc_chattering.control.limiter import Limiter
import numpy as np
from oracles import random_spd
import pytest

UNLIMITED = np.full(3, np.inf)


def _limiter(effort: list[float], change: list[float], anti_windup: float = 0.0) -> Limiter:
    made = Limiter(3)
    made.configure(np.array(effort), np.array(change), anti_windup)
    return made


@pytest.mark.parametrize('effort', [[5.0, 9.0, np.inf], [np.inf] * 3])
@pytest.mark.parametrize('change', [[1.0, np.inf, 3.0], [np.inf] * 3])
def test_first_the_change_then_the_size(effort: list[float], change: list[float]) -> None:
    """Check a random walk: each torque near the one before, within the limits, and the rest."""
    rng, made, before = np.random.default_rng(1), _limiter(effort, change), np.zeros(3)
    saturated = 0
    for _ in range(200):
        wanted = before + 4.0 * rng.normal(size=3)
        tau, error = made.limit(wanted)
        size = np.minimum(effort, 1e300)
        near = np.clip(wanted, before - change, before + change)
        np.testing.assert_array_equal(tau, np.clip(near, -size, size))
        if error is None:
            assert (tau == wanted).all()
        else:
            saturated += 1
            np.testing.assert_array_equal(error, wanted - tau)
            assert error.any()
        before = tau
    assert (saturated > 20) == bool(np.isfinite([*effort, *change]).any())


def test_reset_and_new_limits() -> None:
    """Check that the torque sent last survives new limits, and that reset replaces it."""
    made = _limiter([np.inf] * 3, [np.inf] * 3)
    made.limit(np.array([7.0, -7.0, 0.0]))
    made.configure(UNLIMITED, np.ones(3), 0.0)
    assert made.limit(np.zeros(3))[0].tolist() == [6.0, -6.0, 0.0]
    made.reset(np.array([2.0, 0.0, -3.0]))
    assert made.limit(np.zeros(3))[0].tolist() == [1.0, 0.0, -2.0]


def test_correction_is_what_the_saturation_error_does_to_v() -> None:
    """Check b h M⁻¹ times the error, and that there is none without it or without anti-windup."""
    rng = np.random.default_rng(2)
    mass, error = random_spd(rng, 3), rng.normal(size=3)
    made = _limiter([1.0] * 3, [np.inf] * 3, 1.3e-3)
    assert made.correction(mass, None) is None
    correction = made.correction(mass, error)
    assert correction is not None
    np.testing.assert_allclose(mass @ correction, 1.3e-3 * error, rtol=1e-9)
    assert _limiter([1.0] * 3, [np.inf] * 3).correction(mass, error) is None
