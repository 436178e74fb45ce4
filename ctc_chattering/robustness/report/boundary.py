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

"""Failure probability: its interval, for runs that share draws too, and where a law passes."""

from __future__ import annotations

from itertools import groupby
from typing import Any

from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt
from scipy.special import ndtri, stdtrit  # type: ignore[import-untyped]

#: Failure probability of the boundary.
LEVEL = 0.5
#: Of all intervals.
CONFIDENCE = 0.95


def wilson(failures: npt.ArrayLike, runs: npt.ArrayLike, confidence: float = CONFIDENCE
           ) -> tuple[Array, Array]:
    """
    Return Wilson's interval of a probability, without correction for continuity.

    Parameters
    ----------
    failures, runs : array_like of int
        Failures among independent runs; arrays that broadcast. Without a run: 0 and 1.
    confidence : float
        Probability that the interval contains the true one.

    Returns
    -------
    (ndarray, ndarray)
        Lower and upper ends.

    """
    k, n = np.broadcast_arrays(np.asarray(failures, float), np.asarray(runs, float))
    return _score_interval(k / np.maximum(n, 1.0), n, float(ndtri(0.5 + 0.5 * confidence)))


def _score_interval(p: Array, n: Array, z: float) -> tuple[Array, Array]:
    """Return the ends where a share `p` of `n` runs is `z` standard deviations off."""
    middle, half = n * p + 0.5 * z * z, z * np.sqrt(n * p * (1.0 - p) + 0.25 * z * z)
    return (np.where(n * p > 0.0, (middle - half) / (n + z * z), 0.0),
            np.where(n * p < n, (middle + half) / (n + z * z), 1.0))


def pooled(failures: npt.ArrayLike, runs: npt.ArrayLike, confidence: float = CONFIDENCE
           ) -> tuple[float, float]:
    """
    Return the interval of a probability from runs at several points that share their draws.

    It is Wilson's for as many independent runs as would vary as much as the draws do, with
    Student's quantile in place of the normal one. Where no run fails, or every one, there are
    as many as draws. A bootstrap over draws has no width there, and covers too little where
    failures are rare.

    Parameters
    ----------
    failures, runs : array_like of int, shape (m,)
        Of each draw, over all points.
    confidence : float
        Probability that the interval contains the true one.

    Returns
    -------
    (float, float)
        Lower and upper end; nan for a single draw, which does not show what others do.

    """
    n = np.asarray(runs, float)
    k, n = np.asarray(failures, float)[n > 0.0], n[n > 0.0]
    m, total = len(n), float(n.sum())
    if total == m:
        low, high = wilson(k.sum(), total, confidence)
        return float(low), float(high)
    if m < 2:
        return np.nan, np.nan
    p = k.sum() / total
    variance = m / (m - 1.0) * np.square(k - p * n).sum() / total ** 2
    likely = p * (1.0 - p)
    independent = m if likely == 0.0 else min(total, likely / variance) if variance else total
    low, high = _score_interval(np.asarray(p), np.asarray(float(independent)),
                                float(stdtrit(m - 1, 0.5 + 0.5 * confidence)))
    return float(low), float(high)


def share(failures: npt.ArrayLike, runs: npt.ArrayLike) -> Array:
    """Return failures / runs; nan without a run."""
    k, n = np.broadcast_arrays(np.asarray(failures, float), np.asarray(runs, float))
    found: Array = np.divide(k, n, out=np.full(k.shape, np.nan), where=n > 0.0)
    return found


def side(failures: npt.ArrayLike, runs: npt.ArrayLike, level: float = LEVEL
         ) -> npt.NDArray[np.int_]:
    """Return -1 where the interval is below `level`, 1 where it is above, 0 where it has both."""
    low, high = wilson(failures, runs)
    return (low > level).astype(int) - (high < level)


def passing_ranges(values: npt.ArrayLike, probability: npt.ArrayLike, level: float = LEVEL
                   ) -> list[tuple[float, float]]:
    """
    Return first and last value of each stretch of `values` where the law passes.

    Parameters
    ----------
    values : array_like, shape (n,)
        Grid of one axis.
    probability : array_like, shape (n,)
        Failure probability there; nan where nothing is known.
    level : float
        A law passes where the probability is less.

    """
    pairs: Any = zip(np.asarray(values).tolist(), np.asarray(probability).tolist())
    found = []
    for passes, stretch in groupby(pairs, key=lambda pair: pair[1] < level):
        if passes:
            mine = [value for value, _ in stretch]
            found.append((mine[0], mine[-1]))
    return found
