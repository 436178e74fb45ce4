"""The random numbers of compiled runs are those of `random.Random`."""

from random import Random

from ctc_chattering.simulation.random_numbers import normal_numbers
import numpy as np
import pytest


@pytest.mark.parametrize('drawn', [0, 1, 2, 701])
def test_the_same_normal_numbers_as_python(drawn: int) -> None:
    """From any state on, and of an odd count, the last of which is the first of a pair."""
    random = Random(3)
    for _ in range(drawn):
        random.gauss(0.0, 1.0)
    found = normal_numbers(random, 1001)
    np.testing.assert_allclose(
        found, [random.gauss(0.0, 1.0) for _ in range(1001)], rtol=1e-14)
