"""Many random numbers at once, those of `random.Random`."""

from __future__ import annotations

from math import cos, log, pi, sin, sqrt
from random import Random

from ctc_chattering.batch.compiler import compiled
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


def normal_numbers(random: Random, count: int) -> Array:
    """Return the next `count` numbers of ``random.gauss(0.0, 1.0)``; `random` stays as it is."""
    if not count:
        return np.zeros(0)
    _, (*key, position), kept = random.getstate()
    bits = np.random.MT19937()
    bits.state = {'bit_generator': 'MT19937',
                  'state': {'key': np.array(key, np.uint32), 'pos': position}}
    made = np.random.Generator(bits).random(count + 1)
    box_muller(made)
    return made[:count] if kept is None else np.concatenate(([kept], made))[:count]


@compiled
def box_muller(x: Array) -> None:
    """Replace pairs of numbers in [0, 1) by pairs of the standard normal distribution."""
    for i in range(0, len(x) - 1, 2):
        angle, radius = 2.0 * pi * x[i], sqrt(-2.0 * log(1.0 - x[i + 1]))
        x[i], x[i + 1] = cos(angle) * radius, sin(angle) * radius
