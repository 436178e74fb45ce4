"""
The random numbers of the reference, for the same seed.

A `numpy.random.Generator` on the state of a `random.Random` draws the same numbers in [0, 1).
"""

from __future__ import annotations

from math import cos, log, pi, sin, sqrt
from random import Random

from ctc_chattering.batch.compiler import inlined
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


def generator(seed: int | str) -> np.random.Generator:
    """Return a source of the numbers of ``Random(seed).random()``."""
    *key, position = Random(seed).getstate()[1]
    bits = np.random.MT19937()
    bits.state = {'bit_generator': 'MT19937',
                  'state': {'key': np.array(key, np.uint32), 'pos': position}}
    return np.random.Generator(bits)


@inlined
def gauss(source: np.random.Generator, kept: Array) -> float:
    """
    Return a number of the standard normal distribution, as `Random.gauss` makes it.

    Parameters
    ----------
    source : Generator
        As `generator` returns it.
    kept : array, shape (2,)
        Whether there is a second number of the last pair (Box & Muller), and that number.

    """
    if kept[0]:
        kept[0] = 0.0
        return float(kept[1])
    angle = 2.0 * pi * source.random()
    radius = sqrt(-2.0 * log(1.0 - source.random()))
    kept[0], kept[1] = 1.0, sin(angle) * radius
    return cos(angle) * radius
