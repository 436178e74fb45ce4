# Copyright 2026 The ctc_chattering maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Many random numbers at once, those of `random.Random`."""

from __future__ import annotations

from math import cos, log, sin
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
    # Box and Muller, with functions of `math`: those of NumPy differ in the last bit.
    angle, rest = (2.0 * np.pi * x[:, 0]).tolist(), (1.0 - x[:, 1]).tolist()
    cosine, sine, logarithm = (np.fromiter(map(function, values), float) for function, values in (
        (cos, angle), (sin, angle), (log, rest)))
    radius = np.sqrt(-2.0 * logarithm)
    made = np.stack((cosine * radius, sine * radius), 1).ravel()
    return made[:count] if kept is None else np.concatenate(([kept], made))[:count]
