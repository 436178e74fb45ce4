"""The random numbers of compiled code are those of `random.Random`."""

from random import Random

from ctc_chattering.batch.random_numbers import gauss, generator
import numpy as np
import pytest


@pytest.mark.parametrize('seed', [0, 7, 2 ** 61, '3 loss'])
def test_the_same_numbers_as_python(seed: int | str) -> None:
    made, right = generator(seed), Random(seed)
    assert [made.random() for _ in range(700)] == [right.random() for _ in range(700)]


def test_the_same_normal_numbers_as_python() -> None:
    made, right, kept = generator(3), Random(3), np.zeros(2)
    found = [gauss(made, kept) for _ in range(1001)]
    np.testing.assert_allclose(found, [right.gauss(0.0, 1.0) for _ in range(1001)], rtol=1e-14)
