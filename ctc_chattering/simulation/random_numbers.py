"""Many random numbers at once, those of `random.Random`."""

from __future__ import annotations

from random import Random

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
    x = np.random.Generator(bits).random((count + 1) // 2 * 2).reshape(-1, 2)
    angle, radius = 2.0 * np.pi * x[:, 0], np.sqrt(-2.0 * np.log1p(-x[:, 1]))  # Box and Muller
    made = np.stack((np.cos(angle) * radius, np.sin(angle) * radius), 1).ravel()
    return made[:count] if kept is None else np.concatenate(([kept], made))[:count]
