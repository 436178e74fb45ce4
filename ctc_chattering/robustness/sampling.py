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

"""Draws of what is uncertain: the same at every point of a map and for every law."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, log2

from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.robustness.quantity import Uncertain
from ctc_chattering.robustness.spec import Repeats
import numpy as np

#: Distance from 0 and 1 that a draw keeps: there a normal distribution is infinite.
_OPEN = 2.0 ** -53


def draws(uncertain: Sequence[Uncertain], repeats: Repeats) -> Array:
    """
    Return the drawn numbers, shape (repeats, m).

    Parameters
    ----------
    uncertain : sequence of Uncertain
        m quantities.
    repeats : Repeats
        How many, how, and the seed. With `sobol` and `random` a larger number of repeats begins
        with the draws of a smaller one.

    """
    u = unit_draws(repeats.sampling, repeats.repeats, len(uncertain), repeats.seed)
    for column, x in zip(u.T, uncertain):
        column[:] = quantile(x, column)
    return u


def unit_draws(method: str, n: int, m: int, seed: int) -> Array:
    """Return draws from the unit cube of m dimensions, shape (n, m)."""
    rng = np.random.default_rng(seed)
    if method == 'random' or m == 0:
        return rng.random((n, m))
    if method == 'saltelli':
        return _saltelli(unit_draws('sobol', n // (m + 2), 2 * m, seed))
    # Here, for the workers, which need no draws, to start twice as fast.
    from scipy.stats import qmc  # type: ignore[import-untyped]
    if method == 'latin_hypercube':
        return np.asarray(qmc.LatinHypercube(m, rng=rng).random(n))
    # A Sobol sequence has its balance at powers of two.
    return np.asarray(qmc.Sobol(m, rng=rng).random_base2(ceil(log2(n))))[:n]


def _saltelli(pairs: Array) -> Array:
    """Return draws A, B, and A with each column of B in turn, shape ((m + 2) n, m)."""
    A, B = np.hsplit(pairs, 2)
    one = np.eye(len(A.T), dtype=bool)
    return np.vstack([A, B, *(np.where(mine, B, A) for mine in one)])


def quantile(x: Uncertain, u: Array) -> Array:
    """Return the quantiles of `x` at probabilities `u`, shape (n,)."""
    values = np.array(x.numbers)
    if x.distribution == 'uniform':
        return np.asarray(values[0] + (values[1] - values[0]) * u)
    if x.distribution == 'log_uniform':
        return np.asarray(values[0] * (values[1] / values[0]) ** u)
    if x.distribution == 'normal':
        from scipy.stats import norm
        return np.asarray(norm.ppf(np.clip(u, _OPEN, 1.0 - _OPEN), *values))
    return np.asarray(values[(u * len(values)).astype(int)])
